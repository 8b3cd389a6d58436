"""Options shared by several commands, and the objects that they describe."""

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rft_ros.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rft_ros.bags.playback import ReplayOptions
    from rft_ros.parameters import Values
    from rft_ros.rft import Law
    from rft_ros.tool import Tool

# Copies of names in rft_ros.rft and rft_ros.tool: importing those would delay the help text by a second.
_INTEGRATIONS = ("centroid", "refined")
_LAWS = ("treers2021", "agarwal2023")
_MEDIA = "generic, poppy_seeds_loose or poppy_seeds_close"
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


def number_option(
    command: argparse._ActionsContainer, name: str, metavar: str, meaning: str, default: float | None = None
) -> None:
    """Add an option with one finite number; `meaning` states its unit and default."""
    command.add_argument(name, type=finite, default=default, metavar=metavar, help=meaning)


def output_option(command: argparse._ActionsContainer, metavar: str, meaning: str, default: Path | None = None) -> None:
    """``-o``, required unless there is a default."""
    command.add_argument(
        "-o", "--output", type=Path, required=default is None, default=default, metavar=metavar, help=meaning
    )


def mesh_options(command: argparse._ActionsContainer) -> None:
    """``--scale`` and ``--origin``: how a mesh file becomes a tool."""
    number_option(command, "--scale", "M", "metres per mesh unit (default 0.001: millimetres)", 0.001)
    command.add_argument(
        "--origin",
        type=finite,
        nargs=3,
        default=(0.0, 0.0, 0.0),
        metavar=("X", "Y", "Z"),
        help="where the tool frame's origin lies, in mesh-file coordinates and units (default 0 0 0)",
    )


def integration_option(command: argparse._ActionsContainer) -> None:
    """``--integration``: the rule for plates."""
    command.add_argument(
        "--integration",
        choices=_INTEGRATIONS,
        metavar="RULE",
        help="refined, or centroid: the published rule (default refined; a reduced tool keeps its own)",
    )


def surface_option(command: argparse._ActionsContainer) -> None:
    """``--surface-height``, for states."""
    number_option(command, "--surface-height", "Z", "world z of the surface [m] (default 0)", 0.0)


def law_options(command: argparse._ActionsContainer) -> None:
    """``--law``, ``--medium``, ``--zeta``, ``--alpha-y`` and more: the traction law, for states."""
    command.add_argument(
        "--law",
        choices=_LAWS,
        default="treers2021",
        metavar="LAW",
        help="treers2021, or agarwal2023, which uses neither --medium nor --alpha-y (default treers2021)",
    )
    command.add_argument("--medium", default="generic", metavar="NAME", help=f"{_MEDIA} (default generic)")
    number_option(command, "--zeta", "FACTOR", "the medium's scale factor, no unit (default 1)", 1.0)
    command.add_argument(
        "--alpha-y",
        default="constant",
        metavar="MODEL",
        help="constant, linear or a TABLE.csv of beta [deg], (gamma [deg],) alpha_y [N/cm³] (default constant)",
    )
    number_option(command, "--density", "RHO", "bulk density [kg/m³] for inertia (default 0: none)", 0.0)
    number_option(command, "--inertia", "FACTOR", "inertia of an upright plate, no unit (default 1.4)", 1.4)
    number_option(command, "--surface-friction", "MU", "of the tool, no unit, for agarwal2023 (default 0.3)", 0.3)


def law_of(arguments: argparse.Namespace) -> "Law":
    """The law of `law_options`; InputError names a value that cannot be used."""
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


def refuse_inputs(arguments: argparse.Namespace, *outputs: Path, also: "Iterable[Path]" = ()) -> None:
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


def recording_options(command: argparse._ActionsContainer, *, required: bool = False) -> None:
    """``--params``, ``--remap``, ``--start`` and ``--end``: how a recording is read."""
    command.add_argument(
        "--params",
        type=Path,
        required=required,
        metavar="FILE.yaml",
        help="the node's own parameter file" + ("" if required else " (default: the node's defaults)"),
    )
    remap_option(command)
    number_option(command, "--start", "S", "begin S seconds into the recording (default: at its beginning)")
    number_option(command, "--end", "S", "stop S seconds into the recording (default: at its end)")


def remap_option(command: argparse._ActionsContainer) -> None:
    """``--remap``: the topics of the inputs."""
    command.add_argument(
        "--remap",
        action="append",
        default=[],
        metavar="FROM:=TO",
        help="topic of the recording, such as ~/pose:=/tool_pose; may be repeated",
    )


def recording(arguments: argparse.Namespace) -> "tuple[Values, ReplayOptions]":
    """The node's parameters, and how to read the recording: from the parameter file, overridden by options.

    ``--tare 0`` overrides a `tare` of the file by none.
    """
    from rft_ros.bags.playback import ReplayOptions, read_replay_options
    from rft_ros.parameters import NODE, defaults, read_parameter_file

    file = arguments.params
    values = read_parameter_file(file, getattr(arguments, "node", NODE)) if file else defaults()
    written = read_replay_options(file) if file else ReplayOptions()
    given = {name: getattr(arguments, name, None) for name in ("tare", "start", "end")}
    chosen = {name: getattr(written, name) if value is None else value for name, value in given.items()}
    return values, ReplayOptions(remap=(*written.remap, *getattr(arguments, "remap", ())), **chosen)
