"""Every path that a command or a parameter takes, found in the parser and in `FILES`, and paths that are hostile."""

import argparse
import os
import socket
from collections.abc import Iterator
from pathlib import Path

import trimesh
import yaml
from recordings import moments, write_ros2

from rft_ros.cli import parser
from rft_ros.parameters import FILES, Config
from rft_ros.rft import MEDIA

_WORDS = ("FILE", "TABLE", "MESH", "BAG")
"""Words in the name or the help of an argument whose value is text and may be a path."""

_OF_STATES = {"mesh": "ball.stl", "medium": "medium.yaml", "alpha_y": "table.csv"}
GOOD: dict[str, list[dict[str, str]]] = {
    "predict": [{"states": "states.csv", **_OF_STATES, "output": "out.csv"}],
    "check-mesh": [{"mesh": "ball.stl"}],
    "replay": [{"bag": "bag", "params": "cell.yaml", "check": "limits.yaml", "output": "out"}],
    "calibrate": [
        {"bags": "bag", "params": "cell.yaml", "mesh": "bag=ball.stl", "output": "calibrated.yaml"}
    ],
    "fit-medium": [{"map": "map.csv", "figure": "map.png", "output": "fitted.yaml"}],
    "sweep": [{"study": "study.yaml", "output": "swept"}],
    "view": [
        {"source": "states.csv", **_OF_STATES, "output": "out.html"},
        {"source": "bag", "params": "cell.yaml", "output": "out.html"},
    ],
    "doctor": [{"params": "cell.yaml", "bag": "bag", "output": "mended.yaml"}],
    "demo": [{"output": "out"}],
}
"""Usable values of the path arguments of each command, in sets that go together. `write_good` writes the files."""

STATES = "t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz\n0,0,0,-0.01,0,0,0,1,0.01,0,-0.02,0,0,0\n"
_NEEDED = {"alpha_y.table": {"alpha_y.model": "table"}, "ground.file": {"ground.cell": 0.01}}
"""What else a parameter of `FILES` needs to be read."""


def write_good(folder: Path) -> None:
    """Write the inputs that `GOOD` names."""
    ball = trimesh.creation.icosphere(1, radius=20.0)
    (folder / "ball.stl").write_bytes(bytes(ball.export(file_type="stl")))
    write_ros2(folder / "bag", moments(40))
    contents = {
        "states.csv": STATES,
        "table.csv": "beta,alpha_y\n0,0.1\n90,0.2\n",
        "medium.yaml": yaml.safe_dump(MEDIA["generic"].coefficients),
        "limits.yaml": "estimates: {min: 0}\n",
        "map.csv": "beta_deg,gamma_deg,alpha_x,alpha_z\n0,0,0.1,0.1\n",
        "study.yaml": "{tools: [{mesh: plate}], motions: [{states_file: states.csv}], media: [{zeta: 1.0}]}\n",
        "cell.yaml": parameters_text({}),
    }
    for name, content in contents.items():
        (folder / name).write_text(content)


def parameters_text(values: dict[str, object]) -> str:
    """A parameter file for all nodes, with the full tool `ball.stl`."""
    return yaml.safe_dump(
        {"/**": {"ros__parameters": {"mesh.file": "ball.stl", "tolerance": 0.0} | values}}
    )


def path_arguments() -> Iterator[tuple[str, argparse.Action]]:
    """Each command with each of its arguments that is a path."""
    (commands,) = (a for a in parser()._actions if isinstance(a, argparse._SubParsersAction))
    for name, command in commands.choices.items():
        for action in command._actions:
            words = f"{action.metavar or ''} {action.help or ''}"
            if action.type is Path or (
                action.nargs is None and any(word in words for word in _WORDS)
            ):
                yield name, action


def command_lines(path: str, *, command: str, action: argparse.Action) -> Iterator[list[str]]:
    """Command lines that are good but for the path that they give to an argument."""
    actions = {a.dest: a for name, a in path_arguments() if name == command}
    for good in GOOD[command]:
        if action.dest in good:
            words = [command]
            for dest, value in good.items():
                # of BAG=FILE, which has a path only if it is the one in question
                bag, equals, _ = value.partition("=")
                if dest == action.dest:
                    words += [
                        *actions[dest].option_strings[-1:],
                        f"{bag}={path}" if equals else path,
                    ]
                elif not equals:
                    words += [*actions[dest].option_strings[-1:], value]
            yield words


def parameters_with(path: str) -> Iterator[tuple[str, str]]:
    """Parameter files that are good but for the path that they give to a parameter; each with the parameter's name."""
    assert set(FILES) == {name for name in Config().values if name.endswith((".file", ".table"))}
    for name in FILES:
        yield name, parameters_text({**_NEEDED.get(name, {}), name: path})


def hostile_paths(folder: Path, suffix: str) -> dict[str, Path]:
    """Paths in a new folder that end in `suffix` and are no file of use, by what they are."""
    folder.mkdir()
    names = (
        "loop",
        "pipe",
        "socket",
        "device",
        "system",
        "trace",
        "folder",
        "empty",
        "sparse",
        "zeros",
        "noise",
        "text",
    )
    found = {name: folder / f"{name}{suffix}" for name in names}
    found["loop"].symlink_to(found["loop"].name)
    os.mkfifo(found["pipe"])
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(os.path.relpath(found["socket"]))  # a socket's path has 107 characters at most
    for name, target in (
        ("device", "/dev/zero"),
        ("system", "/proc/kmsg"),
        ("trace", "/proc/self/mem"),
    ):
        found[name].symlink_to(target)
    found["folder"].mkdir()
    found["empty"].touch()
    with found["sparse"].open("wb") as file:
        file.truncate(2**38)
    found["zeros"].write_bytes(bytes(2**16))
    found["noise"].write_bytes(bytes(range(256)) * 64)
    found["text"].write_text("grains, sand & stones\n" * 10)
    found["missing"] = folder / f"missing{suffix}"
    found["in a loop"] = found["loop"] / f"file{suffix}"
    found["in a file"] = found["text"] / f"file{suffix}"
    found["in a pipe"] = found["pipe"] / f"file{suffix}"
    found["long"] = folder / f"{'a' * 300}{suffix}"
    found["deep"] = folder.joinpath(*["a" * 200] * 25, f"file{suffix}")
    found["of another language"] = folder / f"Körner 砂 \u202e{suffix}"
    found["of two lines"] = folder / f"two\nlines{suffix}"
    found["of bytes"] = folder / f"\udcff\udcfe{suffix}"
    return found
