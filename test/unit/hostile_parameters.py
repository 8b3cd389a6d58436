"""Random parameter files: most are what people write, many are what YAML allows and ROS's parser reads otherwise."""

import numpy as np

_PLAIN_SCALARS = """
    1 0 -3 +7 010 08 0x1F 0b11 0o17 1_000 99999999999999999999 -9223372036854775808 1.0 1. .5 1e3 1E-3 1.e+2 -1.5e-2
    1e400 1e-400 5e-324 0e-999 0x1p-3 0x1.8 .inf -.Inf +.INF .nan .NaN nan -nan inf Infinity nan(7) .iNf -.nan -0
    -0.0 off on yes No y N true False TRUE tRue oFF ~ null Null NULL = '' plate 'plate' '1' '010' 12:30
    package://rft_ros/meshes/plate.stl what? 2001-01-01 *a !!str [] {} 0.33 treers2021 linear constant refined apply
    world 0.05 generic
"""
SCALARS = (
    *_PLAIN_SCALARS.split(),
    *(
        '"plate"',
        '"off"',
        '"1.0"',
        '"x\\ty"',
        '"\\u03b1"',
        '"a\\0b"',
        "!!str 5",
        "!!str off",
        "!!float 1",
        "!!int '3'",
    ),
    *(
        "!!bool yes",
        "!own 1.5",
        "! 5",
        "&a 1.0",
        "!!null ''",
        "[1, 2]",
        "[1.0, 2.0]",
        "[0.0, 0.0, 0.0]",
        "[1, 2.0]",
    ),
    *(
        "[true, off]",
        "[a, b]",
        "[[1], [2]]",
        "[1, ~]",
        "[a, '1']",
        "{a: 1}",
        "[{a: 1}]",
        "",
        "|\n      10\n",
    ),
    *("|-\n      10\n", ">-\n      on\n", "|-\n", "# nothing", "a: b", "1.0 # one"),
)
NAMES = (
    *(
        "mesh.file",
        "mesh.scale",
        "mesh.origin",
        "medium.zeta",
        "medium.name",
        "surface_height",
        "learning.mode",
        "law",
    ),
    *("alpha_y.model", "world_frame", "integration", "max_rate", "tolerance", "use_sim_time"),
)
GOOD = {
    "mesh.file": (
        "plate",
        "sphere",
        "tool.stl",
        "'a b.stl'",
        "/x/tool.stl",
        "~/tool.stl",
        "file:///x/y.stl",
    ),
    "mesh.scale": ("1", "0.001", "1e-3"),
    "mesh.origin": ("[0, 0, 1]", "[0.0, 1e-3, 2.]"),
    "medium.zeta": ("0.33", "1", "3e-1"),
    "medium.name": ("generic", "'generic'", "poppy_seeds_loose"),
    "surface_height": ("0", "-0.0", "1E-3"),
    "learning.mode": ("off", "apply", "'off'", "observe"),
    "law": ("treers2021", '"agarwal2023"'),
    "alpha_y.model": ("linear", "constant"),
    "world_frame": ("world", "'on'", "base_link", "'12:30'"),
    "integration": ("refined", "centroid"),
    "max_rate": ("50.0", "1e2"),
    "tolerance": ("0", "0.05", ".5"),
    "use_sim_time": ("true", "off"),
}
"""Values that a parameter takes, by its name."""

ODD_NAMES = (
    *(
        "mesh",
        "medium.zetta",
        "<<",
        "'<<'",
        "a.b.c",
        "1",
        "off",
        "''",
        "mesh..file",
        ".a",
        "a.",
        "? a",
        "!!str x",
    ),
    "&k y",
)
NODES = (
    "/**",
    "rft",
    "/rft",
    "/**/rft",
    "/*",
    "'*'",
    "/*/rft",
    "/cell/rft",
    "cell/rft",
    "arm",
    "rft_replay",
    "/**/*",
)
ODD_NODES = (
    *(
        "/",
        "//rft",
        "rft/",
        "my-node",
        "1st",
        "''",
        "/***",
        "r*",
        "ros__parameters",
        "<<",
        "~",
        "/a//b",
        "/**/**/rft",
    ),
    "a b",
)
ODD_BODIES = (
    "ros__parameters: 3",
    "ros__parameters: {}",
    "ros__parameters:",
    "x: 1",
    "{}",
    "ros__parameters_: {a: 1}",
)


def hostile_file(random: np.random.Generator, *, strange: float = 1.0) -> str:
    """A random text; `strange`: the share of values that are of any kind, in place of the parameter's own."""
    lines: list[str] = []
    for _ in range(random.choice([1, 1, 2, 2, 3])):
        lines += _section(random, strange)
    text = "\n".join(lines) + "\n"
    if random.random() < 0.03:
        framed = [
            "---\n" + text,
            text + "---\n" + text,
            "\ufeff" + text,
            "%YAML 1.1\n---\n" + text,
            text + "...",
        ]
        text = random.choice([*framed, text.replace("\n", "\r\n")])
    if random.random() < 0.05 and text:
        k = int(random.integers(len(text)))
        text = (
            text[:k]
            + str(random.choice(list("{}[]:,&*!?|>'\"%@`#- \t\n")))
            + text[k + int(random.integers(2)) :]
        )
    return text


def _section(random: np.random.Generator, strange: float) -> list[str]:
    node = str(random.choice(NODES if random.random() < 0.96 else ODD_NODES))
    body = ["ros__parameters:", *(f"  {line}" for line in _parameters(random, strange, depth=0))]
    chance = random.random()
    if chance < 0.02:
        body = [str(random.choice(ODD_BODIES))]
    elif chance < 0.04:
        body += ["other:", "  ros__parameters: {a: 1}"]
    elif chance < 0.06:
        body += body
    if random.random() < 0.05 + 0.1 * strange:  # below a namespace
        inner = str(random.choice(["rft", "cell", "arm", "a/b", "/rft", "*"]))
        body = [f"{inner}:", *(f"  {line}" for line in body)]
        if random.random() < 0.3:
            body += ["second:", "  ros__parameters: {max_rate: 5.0}"]
    if random.random() < 0.05:
        return [
            f"{node}: {{ros__parameters: {{{random.choice(NAMES)}: {random.choice(SCALARS)}}}}}"
        ]
    return [f"{node}:", *(f"  {line}" for line in body)]


def _parameters(random: np.random.Generator, strange: float, *, depth: int) -> list[str]:
    lines: list[str] = []
    for _ in range(random.integers(1, 5)):
        name = str(random.choice(NAMES if random.random() < 1.0 - 0.2 * strange else ODD_NAMES))
        if depth:
            name = name.rpartition(".")[2] if random.random() < 0.7 else name
        if random.random() > strange and random.random() < 0.2 and not depth:
            group = str(random.choice(["mesh", "medium"]))
            inner = [n for n in GOOD if n.startswith(f"{group}.") and random.random() < 0.7] or [
                f"{group}.file"
            ]
            lines += [
                f"{group}:",
                *(
                    f"  {n.partition('.')[2]}: {random.choice(GOOD.get(n, ('x.yaml',)))}"
                    for n in inner
                ),
            ]
        elif random.random() < 0.12 * strange and depth < 3:
            group = str(random.choice(["mesh", "medium", "alpha_y", "a", "a.b", "learning"]))
            lines += [
                f"{group}:",
                *(f"  {line}" for line in _parameters(random, strange, depth=depth + 1)),
            ]
        elif random.random() < 0.05 * strange:
            lines += [f"{name}:", "- 1.0", "- 2.0"]
        else:
            ordinary = name in GOOD and random.random() >= strange
            lines.append(f"{name}: {random.choice(GOOD[name] if ordinary else SCALARS)}")
    return lines
