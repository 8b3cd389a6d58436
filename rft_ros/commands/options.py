"""Options that several commands share, and the objects that they describe."""

import argparse
import math
import sys
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rft_ros.errors import InputError

if TYPE_CHECKING:
    from rft_ros.bags.playback import ReplayOptions
    from rft_ros.parameters import Values
    from rft_ros.rft import Law
    from rft_ros.tool import Tool

MESH = "path, package:// or file:// URI, or name of a shipped mesh (plate, ellipsoid, root_tip, sphere, abb_plate)"
"""Help text for an argument that names a mesh."""

BAG = "rosbag2 folder (MCAP or sqlite3), .mcap or .db3 file, ROS 1 .bag"
"""Help text for an argument that names a recording."""


def finite(text: str) -> float:
    """Parse a finite number, as argparse's `type`."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number") from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a finite number")
    return value


def _option(metavar: str | tuple[str, ...], meaning: str, default: object = None, **further: Any) -> dict[str, Any]:
    return {"metavar": metavar, "help": meaning, "default": default, **further}


_number = partial(_option, type=finite)

# Copies of names in rft_ros.rft: importing that would delay the help text by a second.
_LAWS = ("treers2021", "agarwal2023")
_INTEGRATIONS = ("centroid", "refined")

_ORIGIN = "where the tool frame's origin lies, in mesh-file coordinates and units (default 0 0 0)"
_INTEGRATION = "refined, or centroid: the published rule (default refined; a reduced tool keeps its own)"
_LAW = "treers2021, or agarwal2023, which uses neither --medium nor --alpha-y (default treers2021)"
_ALPHA_Y = "constant, linear or a TABLE.csv of beta [deg], (gamma [deg],) alpha_y [N/cm³] (default constant)"
_REMAP = "topic of the recording, such as ~/pose:=/tool_pose; may be repeated"
_SHARED = {
    "--scale": _number("M", "metres per mesh unit (default 0.001: millimetres)", 0.001),
    "--origin": _number(("X", "Y", "Z"), _ORIGIN, (0.0, 0.0, 0.0), nargs=3),
    "--integration": _option("RULE", _INTEGRATION, choices=_INTEGRATIONS),
    "--surface-height": _number("Z", "world z of the surface [m] (default 0)", 0.0),
    "--law": _option("LAW", _LAW, "treers2021", choices=_LAWS),
    "--medium": _option("NAME", "generic, poppy_seeds_loose or poppy_seeds_close (default generic)", "generic"),
    "--zeta": _number("FACTOR", "the medium's scale factor, no unit (default 1)", 1.0),
    "--alpha-y": _option("MODEL", _ALPHA_Y, "constant"),
    "--density": _number("RHO", "bulk density [kg/m³] for inertia (default 0: none)", 0.0),
    "--inertia": _number("FACTOR", "inertia of an upright plate, no unit (default 1.4)", 1.4),
    "--surface-friction": _number("MU", "of the tool, no unit, for agarwal2023 (default 0.3)", 0.3),
    "--params": _option("FILE.yaml", "the node's own parameter file (default: the node's defaults)", type=Path),
    "--remap": _option("FROM:=TO", _REMAP, [], action="append"),
    "--start": _number("S", "begin S seconds into the recording (default: at its beginning)"),
    "--end": _number("S", "stop S seconds into the recording (default: at its end)"),
}
PLACED = ("--scale", "--origin")
"""How a mesh file becomes a tool."""
OF_LAW = ("--law", "--medium", "--zeta", "--alpha-y", "--density", "--inertia", "--surface-friction")
"""The traction law, for states."""
OF_RECORDING = ("--params", "--remap", "--start", "--end")
"""How a recording is read."""


def add(command: argparse._ActionsContainer, name: str, *meaning: Any, **how: Any) -> None:
    """Add an option. `meaning`: metavar, help, which states unit and default, and the default; `how`: argparse's."""
    command.add_argument(name, **_option(*meaning, **how))


add_number = partial(add, type=finite)
"""As `add`, of a finite number."""


def share(command: argparse._ActionsContainer, *names: str) -> None:
    """Add options that several commands have."""
    for name in names:
        command.add_argument(name, **_SHARED[name])


def output(command: argparse._ActionsContainer, metavar: str, meaning: str, default: Path | None = None) -> None:
    """``-o``, required unless there is a default."""
    how = _option(metavar, meaning, default, type=Path, required=default is None)
    command.add_argument("-o", "--output", **how)


def tool_of(arguments: argparse.Namespace, mesh: str, **further: Any) -> "Tool":
    """The tool of a mesh with `PLACED` and, where the command has it, ``--integration``."""
    from rft_ros.tool import load_tool

    rule = getattr(arguments, "integration", None)
    return load_tool(mesh, scale=arguments.scale, origin=arguments.origin, integration=rule, **further)


def law_of(arguments: argparse.Namespace) -> "Law":
    """The law of `OF_LAW`; InputError names a value that cannot be used."""
    from rft_ros.parameters import read_alpha_y_table
    from rft_ros.rft import ALPHA_Y_MODELS, alpha_y_model, law_named, medium_named

    name, table = arguments.alpha_y, None
    try:
        medium = medium_named(arguments.medium)
        if name not in ALPHA_Y_MODELS or name == "table":
            if not Path(name).suffix:
                names = ", ".join(n for n in ALPHA_Y_MODELS if n != "table")
                raise InputError(f"--alpha-y '{name}' is not {names} or the CSV file of a table")
            name, table = "table", read_alpha_y_table(name)
        numbers = {option: getattr(arguments, option) for option in ("zeta", "surface_friction", "density", "inertia")}
        return law_named(arguments.law, medium, alpha_y_model(name, medium, table), **numbers)
    except ValueError as error:
        raise InputError(str(error)) from None


def refuse_inputs(arguments: argparse.Namespace, *outputs: Path, also: Iterable[Path] = ()) -> None:
    """Raise InputError where an output would overwrite an input: `also`, and each file that another argument names."""
    from rft_ros.files import refuse_overwriting
    from rft_ros.tool import locate_mesh

    given = [value for name, value in vars(arguments).items() if name not in ("command", "output", "figure")]
    words = [word for value in given for word in (value if isinstance(value, list) else [value])]
    files = (Path(str(word).rpartition("=")[2]) for word in words if isinstance(word, str | Path))
    mesh = getattr(arguments, "mesh", None)
    meshes = [locate_mesh(mesh)] if isinstance(mesh, str) else []
    refuse_overwriting(outputs, [*(file for file in files if file.exists()), *meshes, *also])


def warn_of(tool: "Tool") -> None:
    """Print the issues of a tool's mesh on stderr."""
    for issue in tool.issues:
        print(f"warning: {tool.name}: {issue.message}", file=sys.stderr, flush=True)


def recording(arguments: argparse.Namespace) -> "tuple[Values, ReplayOptions]":
    """The node's parameters, and how to read the recording: from the parameter file, overridden by options.

    ``--tare 0`` overrides a `tare` of the file by none.
    """
    from rft_ros.bags.playback import ReplayOptions, read_replay_options
    from rft_ros.parameters import NODE, defaults, read_parameter_file

    file = arguments.params
    values = read_parameter_file(file, getattr(arguments, "node", NODE)) if file else defaults()
    written = read_replay_options(file) if file else ReplayOptions()
    words = {name: getattr(arguments, name, None) for name in ("tare", "start", "end")}
    given = {name: value for name, value in words.items() if value is not None}
    return values, replace(written, remap=(*written.remap, *getattr(arguments, "remap", ())), **given)
