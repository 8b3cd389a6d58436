"""Options that several commands share, and what they come to."""

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rft_ros.errors import InputError

if TYPE_CHECKING:
    from rft_ros.bags.playback import ReplayOptions
    from rft_ros.estimator.parameters import Values
    from rft_ros.rft import Law
    from rft_ros.tool import Tool

__all__ = [
    "BAG",
    "MESH",
    "finite",
    "integration_option",
    "law_of",
    "law_options",
    "mesh_options",
    "recording",
    "recording_options",
    "surface_option",
    "warn_of",
]

# as in rft_ros.rft and rft_ros.tool, which would cost the help text a second
_INTEGRATIONS = ("centroid", "refined")
_MEDIA = "generic, poppy_seeds_loose or poppy_seeds_close"
MESH = "path, package:// URI or name of a shipped mesh (plate, ellipsoid, root_tip, sphere, abb_plate)"
"""What a mesh is named by."""

BAG = "rosbag2 folder (MCAP or sqlite3), .mcap or .db3 file, ROS 1 .bag"
"""What a recording is named by."""


def finite(text: str) -> float:
    """A finite number, as argparse's `type`."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is not a number") from None
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a finite number")
    return value


def mesh_options(command: argparse._ActionsContainer) -> None:
    """``--scale`` and ``--origin``: how a mesh file becomes a tool."""
    command.add_argument(
        "--scale", type=finite, default=0.001, metavar="M", help="metres per mesh unit (default 0.001: millimetres)"
    )
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
    command.add_argument(
        "--surface-height", type=finite, default=0.0, metavar="Z", help="world z of the surface [m] (default 0)"
    )


def law_options(command: argparse._ActionsContainer) -> None:
    """``--medium``, ``--zeta`` and ``--alpha-y``: the traction law, for states."""
    command.add_argument("--medium", default="generic", metavar="NAME", help=f"{_MEDIA} (default generic)")
    command.add_argument(
        "--zeta", type=finite, default=1.0, metavar="FACTOR", help="the medium's scale factor, no unit (default 1)"
    )
    command.add_argument(
        "--alpha-y",
        default="constant",
        metavar="MODEL",
        help="constant, linear or a TABLE.csv of beta [deg], alpha_y [N/cm³] (default constant)",
    )


def law_of(arguments: argparse.Namespace) -> "Law":
    """The law that `law_options` ask for; InputError names what cannot be used."""
    from rft_ros.estimator.alpha_y_table import read_alpha_y_table
    from rft_ros.rft import ALPHA_Y_MODELS, alpha_y_model, medium_named, treers2021

    name, table = arguments.alpha_y, None
    try:
        medium = medium_named(arguments.medium)
        if name not in ALPHA_Y_MODELS or name == "table":
            if not Path(name).suffix:
                raise InputError(f"--alpha-y '{name}' is neither constant nor linear, nor the CSV file of a table")
            name, table = "table", read_alpha_y_table(name)
        return treers2021(medium, alpha_y_model(name, medium, table), zeta=arguments.zeta)
    except ValueError as error:
        raise InputError(str(error)) from None


def warn_of(tool: "Tool") -> None:
    """Print what looks wrong with a tool's mesh, on stderr."""
    for finding in tool.issues:
        print(f"warning: {tool.name}: {finding.message}", file=sys.stderr, flush=True)


def recording_options(command: argparse._ActionsContainer, *, required: bool = False) -> None:
    """``--params``, ``--remap``, ``--start`` and ``--end``: how a recording is read."""
    command.add_argument(
        "--params",
        type=Path,
        required=required,
        metavar="FILE.yaml",
        help="the node's own parameter file" + ("" if required else " (default: the node's defaults)"),
    )
    command.add_argument(
        "--remap",
        action="append",
        default=[],
        metavar="FROM:=TO",
        help="topic of the recording, such as ~/pose:=/tool_pose; may be repeated",
    )
    command.add_argument(
        "--start", type=finite, metavar="S", help="begin S seconds into the recording (default: at its beginning)"
    )
    command.add_argument(
        "--end", type=finite, metavar="S", help="stop S seconds into the recording (default: at its end)"
    )


def recording(arguments: argparse.Namespace) -> "tuple[Values, ReplayOptions]":
    """The node's parameters, and how to read the recording: from the parameter file, overridden by options.

    ``--tare 0`` overrides a `tare` of the file by none.
    """
    from rft_ros.bags.playback import ReplayOptions, read_replay_options
    from rft_ros.estimator.parameters import defaults, read_parameter_file

    file = arguments.params
    values = read_parameter_file(file) if file else defaults()
    written = read_replay_options(file) if file else ReplayOptions()
    given = {name: getattr(arguments, name, None) for name in ("tare", "start", "end")}
    chosen = {name: getattr(written, name) if value is None else value for name, value in given.items()}
    chosen["tare"] = chosen["tare"] or None
    return values, ReplayOptions(remap=(*written.remap, *getattr(arguments, "remap", ())), **chosen)
