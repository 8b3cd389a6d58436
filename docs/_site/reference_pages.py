"""``python docs/_site/reference_pages.py``: write the references, the README's table and config/default.yaml."""

import argparse
import math
from collections.abc import Collection
from pathlib import Path

from rft_ros.cli import parser
from rft_ros.commands.options import BAG
from rft_ros.estimator.quality import QualityFlag, Trust, flag_names, sentences, trust
from rft_ros.estimator.samples import Reason
from rft_ros.parameters import PARAMETERS, Parameter, Value

__all__ = ["commands_page", "default_yaml", "main", "node_page", "readme"]

ROOT = Path(__file__).resolve().parents[2]

_REASONS = {
    "the bytes are no message of the topic's type, or the stamp is no time": (Reason.MESSAGE_UNREADABLE,),
    "NaN, infinity or an absurdly large number": (
        Reason.POSE_NOT_FINITE,
        Reason.TWIST_NOT_FINITE,
        Reason.WRENCH_NOT_FINITE,
    ),
    "the quaternion's length differs from 1 by more than 1 %": (Reason.POSE_QUATERNION_NOT_UNIT,),
    "the frame_id is neither the expected one nor fixed to it": (
        Reason.POSE_FRAME_UNKNOWN,
        Reason.TWIST_FRAME_UNKNOWN,
        Reason.WRENCH_FRAME_UNKNOWN,
        Reason.SURFACE_FRAME_UNKNOWN,
    ),
    "the stamp is zero": (
        Reason.POSE_STAMP_ZERO,
        Reason.TWIST_STAMP_ZERO,
        Reason.WRENCH_STAMP_ZERO,
        Reason.SURFACE_STAMP_ZERO,
    ),
    "the stamp is that of the last pose": (Reason.POSE_REPEATED,),
    "not after the last one of the same input; one that is 1 s or more before it begins a new run": (
        Reason.POSE_OUT_OF_ORDER,
        Reason.TWIST_OUT_OF_ORDER,
        Reason.WRENCH_OUT_OF_ORDER,
        Reason.SURFACE_OUT_OF_ORDER,
    ),
    "a pose is 1 s or more before the last one; the estimator starts afresh": (Reason.TIME_JUMP,),
    "sooner after the last answer than `max_rate` allows": (Reason.POSE_RATE_LIMITED,),
    "`twist_source: pose_difference` does not have enough poses yet": (Reason.POSE_HISTORY_SHORT,),
    "none stamped at or before the pose has arrived": (Reason.TWIST_MISSING, Reason.WRENCH_MISSING),
    "the last one is older than the pose by more than `max_input_age`": (Reason.TWIST_STALE, Reason.WRENCH_STALE),
    "in the grains, every point slower than `rest_speed`; not with memory": (Reason.AT_REST,),
    "the computed wrench is NaN or infinite": (Reason.ESTIMATE_NOT_FINITE,),
    "`sensor.frame_source: tf`: no fixed transforms link tool and sensor yet": (Reason.SENSOR_FRAME_UNKNOWN,),
    "a transform has NaN, infinity, a quaternion not of unit length, no name or no stamp": (Reason.TF_INVALID,),
    "a transform's stamp is not after the frame's last one": (Reason.TF_OUT_OF_ORDER,),
    "a frame came with another parent, or fixed where it moved; it is taken, as by tf2": (Reason.TF_TWO_PARENTS,),
    "a transform would make a frame its own ancestor": (Reason.TF_LOOP,),
    "no transforms link `tool_frame` and `world_frame`": (Reason.TF_FRAME_UNKNOWN,),
    "the wanted stamp is before the first transform kept (2 s at 500 Hz)": (Reason.TF_MISSING,),
    "none after the wanted stamp has come within 1 s of the other inputs' stamps": (Reason.TF_STALE,),
    "the transforms around the wanted stamp are over `max_input_age` away": (Reason.TF_GAP,),
    "from Python: a cloud, but `ground.cell` is 0": (Reason.SURFACE_OFF,),
    "a cloud's stamp is 0.5 s or more before the last pose": (Reason.SURFACE_LATE,),
    "a cloud comes less than 0.19 s after the last one": (Reason.SURFACE_RATE_LIMITED,),
}
"""When a sample is not used, by what went wrong."""


def _named(action: argparse.Action) -> str:
    """The argument as a user types it, such as ``--scale M``."""
    metavar = action.metavar if action.metavar is not None else action.dest.upper()
    if action.choices is not None and action.metavar is None:
        metavar = "{" + ",".join(map(str, action.choices)) + "}"
    words = " ".join(metavar) if isinstance(metavar, tuple) else metavar.replace("|", " or ")
    if action.nargs == 0:
        words = ""
    if action.nargs == "+":
        words = f"{words} [{words} ...]"
    return " ".join([*action.option_strings[-1:], words]).strip()


def _arguments(command: argparse.ArgumentParser) -> list[argparse.Action]:
    return [action for action in command._actions if action.dest != "help"]


_AS_PARAMETERS = {
    "--scale": "mesh.scale",
    "--origin": "mesh.origin",
    "--rotate": "mesh.quaternion",
    "--law": "law",
    "--medium": "medium.name",
    "--zeta": "medium.zeta",
    "--density": "medium.density",
    "--inertia": "medium.inertia",
    "--surface-friction": "medium.surface_friction",
    "--mobilization-length": "medium.mobilization_length",
    "--surface-height": "surface_height",
}
"""Options that mean what a parameter of the node means."""


def _command(name: str, command: argparse.ArgumentParser, described: dict[str, str]) -> str:
    """The section of a command. What an argument above has described, by its help in `described`, is not repeated."""
    rows, as_above, as_parameters = [], [], []
    for action in _arguments(command):
        typed = f"`{', '.join([*action.option_strings[:-1], _named(action)])}`"
        meaning = (action.help or "").replace(BAG, "recording")
        if any(option in _AS_PARAMETERS for option in action.option_strings):
            as_parameters.append(typed)
        elif meaning not in described:
            described[meaning] = typed
            needed = " (required)" if action.required and action.option_strings else ""
            rows.append(f"- {typed}{needed}: {meaning}")
        elif described[meaning] == typed:
            as_above.append(typed)
        else:
            rows.append(f"- {typed}: as {described[meaning]} above")
    if as_parameters:
        rows.append(f"- {', '.join(as_parameters)}: as the node's [parameters](node.md#parameters)")
    if as_above:
        rows.append(f"- {', '.join(as_above)}: as above")
    return "\n\n".join([f"## rft {name}", command.description or "", "\n".join(rows)]).rstrip() + "\n"


def commands_page() -> str:
    """docs/commands.md: every command with its arguments, defaults and an example."""
    whole = parser()
    (commands,) = (a.choices for a in whole._actions if isinstance(a, argparse._SubParsersAction))
    status = (whole.epilog or "").partition("Exit status: ")[2]
    head = [
        "# Commands\n\n<!-- made by python docs/_site/reference_pages.py from rft_ros/cli.py -->\n",
        "Only `rft demo`, and `rft doctor` without `--bag`, need ROS. After `colcon build`, type `ros2 run rft_ros rft`"
        " instead of `rft`.\n",
        f"Every error is one sentence on stderr. Exit status: {status} A recording is a {BAG}.\n",
    ]
    described: dict[str, str] = {}
    return "\n".join([*head, *(_command(name, command, described) for name, command in commands.items())])


def _table(*rows: str) -> str:
    return "\n".join(rows) + "\n"


def _yaml(value: Value) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_yaml(v) for v in value) + "]"
    return f'"{value}"' if isinstance(value, str) else repr(value)


def _allowed(p: Parameter) -> str:
    return ", ".join(p.choices) or ("" if math.isinf(p.bounds[0]) else "{:g} to {:g}".format(*p.bounds))


def default_yaml() -> str:
    """config/default.yaml: every parameter at its default, with its description."""
    lines = [
        "# Every parameter of rft_node at its default; made by python docs/_site/reference_pages.py",
        "/**:",
        "  ros__parameters:",
    ]
    for p in PARAMETERS:
        unit = f" [{p.unit}]" if p.unit else ""
        allowed = f" Allowed: {_allowed(p)}." if _allowed(p) else ""
        lines += [f"    # {p.description}{unit}{allowed}", f"    {p.name}: {_yaml(p.default)}"]
    return _table(*lines)


_FIRST = (
    "mesh.file",
    "mesh.scale",
    "mesh.origin",
    "mesh.quaternion",
    "medium.zeta",
    "surface_height",
    "world_frame",
    "tool_frame",
    "sensor_frame",
    "sensor.quaternion",
    "sensor.sign",
)
"""What a first cell needs to set."""


def _parameters(names: Collection[str] = ()) -> str:
    """These parameters, or all, each with its default and what else it may be."""
    rows = []
    for p in (p for p in PARAMETERS if p.name in names or not names):
        value = _yaml(p.default).replace('"', "")
        default = f"`{value}` {p.unit}".strip() if value else "none"
        others = ", ".join(f"`{choice}`" for choice in p.choices if choice != value)
        restart = "" if p.applies == "live" else " Needs a restart."
        rows.append(f"- `{p.name}` ({default}{others and f'; or {others}'}): {p.description}{restart}")
    return _table(*rows)


def _with_tables(file: Path, tables: dict[str, str]) -> str:
    """The file's text with each table written between the marks that carry its name."""
    page = file.read_text(encoding="utf-8")
    for name, table in tables.items():
        begin, end = f"<!-- {name}: begin (generated) -->\n", f"<!-- {name}: end -->\n"
        before, _, rest = page.partition(begin)
        page = before + begin + table + end + rest.partition(end)[2]
    return page


def readme() -> str:
    """README.md with its list of the parameters that a first cell needs."""
    return _with_tables(ROOT / "README.md", {"parameters": _parameters(_FIRST)})


_TRUST = {Trust.CAUTION: "", Trust.NO: "; trust NO"}


def node_page() -> str:
    """docs/node.md with its lists of parameters, reasons and quality flags."""
    tables = {
        "parameters": _parameters(),
        "reasons": _table(
            *(f"- {', '.join(f'`{r.value}`' for r in reasons)}: {when}" for when, reasons in _REASONS.items())
        ),
        "quality flags": _table(
            *(f"- `{flag_names(f)[0]}`: {sentences(f)}{_TRUST[trust(f)]}" for f in QualityFlag if f)
        ),
    }
    return _with_tables(ROOT / "docs" / "node.md", tables)


def main() -> None:
    """Rewrite all of them in the checkout."""
    pages = {
        "docs/commands.md": commands_page(),
        "docs/node.md": node_page(),
        "README.md": readme(),
        "config/default.yaml": default_yaml(),
    }
    for name, page in pages.items():
        (ROOT / name).write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
