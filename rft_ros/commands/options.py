"""Options that several commands share, and the parameters that they set."""

import argparse
import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from rft_ros.bags.options import ReplayOptions, read_replay_options
from rft_ros.files import refuse_overwriting
from rft_ros.parameters import (
    NODE,
    OPTIONS,
    Config,
    MediumConfig,
    config_of_options,
    read_parameter_file,
)
from rft_ros.parameters.parameter import parameter_fields
from rft_ros.rft import ALPHA_Y_MODELS, MEDIA

BAG = "rosbag2 folder (MCAP or sqlite3), .mcap or .db3 file, also with .zstd, or ROS 1 .bag"
RECORDING = f"{BAG}; or a .csv table with the columns t,px..qw, and if known vx..wz and fx..tz"

MESH_OPTIONS = ("--scale", "--origin", "--rotate", "--hull")
LAW_OPTIONS = tuple(
    f"--{parameter.option.replace('_', '-')}"
    for parameter in parameter_fields(MediumConfig).values()
    if parameter.option and parameter.option != "mobilization_length"
)
"""The options of all numbers of a law but its memory, which only evaluations in time have."""

RECORDING_OPTIONS = ("--params", "--node", "--remap", "--columns", "--start", "--end")

_AXES = ("X", "Y", "Z", "W")


def number(text: str) -> float:
    """Parse a finite number. As argparse's `type`, its name appears in the error for a text that is none."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError
    return value


_MODELS = ", ".join(name for name in ALPHA_Y_MODELS if name != "table")

_SHARED: dict[str, dict[str, Any]] = {
    "--medium": {
        "metavar": "NAME|FILE",
        "help": f"{', '.join(MEDIA)}, or a FILE of your own as for medium.file (default generic)",
    },
    "--alpha-y": {
        "metavar": "MODEL",
        "help": f"{_MODELS} or a TABLE.csv of beta [deg], (gamma [deg],) alpha_y [N/cm³] (default linear)",
    },
    "--tolerance": {
        "type": number,
        "metavar": "SHARE",
        "help": "reduce the tool to the fewest plates whose force and torque deviate by at most this share, such as"
        " 0.01, in 95 of 100 random motions (default 0: full tool)",
    },
    "--params": {
        "type": Path,
        "metavar": "FILE.yaml",
        "help": "the node's own parameter file (default: the node's defaults)",
    },
    "--node": {"metavar": "NAME", "help": f"the node with its namespace (default {NODE})"},
    "--remap": {
        "action": "append",
        "default": [],
        "metavar": "FROM:=TO",
        "help": "topic of the recording, such as ~/pose:=/tool_pose; may be repeated",
    },
    "--columns": {
        "metavar": "NAME=HEADING,...",
        "help": "headings of a .csv table by the names that are read, such as t=timestamp,pose=actual_TCP_pose",
    },
    "--start": {
        "type": number,
        "metavar": "S",
        "help": "begin S seconds into the recording (default: its beginning)",
    },
    "--end": {
        "type": number,
        "metavar": "S",
        "help": "stop S seconds into the recording (default: its end)",
    },
}


def share(command: argparse._ActionsContainer, *names: str) -> None:
    """Add options that several commands have. The value of an option that is not given is None."""
    for name in names:
        command.add_argument(name, **(_SHARED.get(name) or _of_parameter(name)))


def _of_parameter(option: str) -> dict[str, Any]:
    """Arguments of `add_argument` for an option that sets a parameter of the node."""
    parameter = OPTIONS[option.removeprefix("--").replace("-", "_")]
    value = parameter.default
    text = parameter.description.rstrip(".").replace("%", "%%")
    meaning = text[0].lower() + text[1:]
    if parameter.unit:
        meaning += f" [{parameter.unit}]"
    if isinstance(value, bool):
        return {"action": "store_true", "default": None, "help": meaning}
    if isinstance(value, str):
        among = f"{meaning} ({', '.join(parameter.choices)}; default {value})"
        return {"choices": parameter.choices, "metavar": "NAME", "help": among}
    if isinstance(value, float):
        return {"type": number, "metavar": "X", "help": f"{meaning} (default {value:g})"}
    default = " ".join(f"{v:g}" for v in value)
    return {
        "type": number,
        "nargs": len(value),
        "metavar": _AXES[: len(value)],
        "help": f"{meaning} (default {default})",
    }


def config_of(arguments: argparse.Namespace) -> Config:
    """The node's parameters: those that options of `share` set, and the defaults of the others. Raises InputError."""
    given = {
        name: value
        for name, value in vars(arguments).items()
        if name in OPTIONS and value is not None
    }
    table = given.get("alpha_y", "")
    if Path(table).suffix:
        return config_of_options(given | {"alpha_y": "table"}).changed({"alpha_y.table": table})
    return config_of_options(given)


def refuse_inputs(arguments: argparse.Namespace, *outputs: Path, also: Iterable[Path]) -> None:
    """Raise InputError if an output would overwrite an input: a path in another argument, or one of `also`."""
    inputs = [*also]
    for name, value in vars(arguments).items():
        if name != "output":
            words = value if isinstance(value, list) else [value]
            inputs += [word for word in words if isinstance(word, Path)]
    refuse_overwriting(outputs, inputs)


def recording(arguments: argparse.Namespace) -> tuple[Config, ReplayOptions]:
    """The node's parameters and the replay options. Those on the command line override the parameter file."""
    node = "/" + (arguments.node or NODE).strip("/")
    config = Config()
    written = ReplayOptions()
    if arguments.params:
        config = read_parameter_file(arguments.params, node)
        written = read_replay_options(arguments.params)
    given = {
        name: value
        for name, value in vars(arguments).items()
        if name in ("tare", "start", "end", "columns") and value is not None
    }
    return config, replace(written, remap=(*written.remap, *arguments.remap), node=node, **given)
