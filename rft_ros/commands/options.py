"""Options that several commands share."""

import argparse
import math

__all__ = ["finite", "integration_option", "mesh_options"]

# as in rft_ros.rft, which would cost the help text a second
_INTEGRATIONS = ("centroid", "refined")


def finite(text: str) -> float:
    """A finite number, as argparse's `type`."""
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a finite number")
    return value


def mesh_options(command: argparse.ArgumentParser) -> None:
    """``--scale`` and ``--origin``: how a mesh file becomes a tool."""
    command.add_argument(
        "--scale", type=finite, default=0.001, metavar="M", help="metres per mesh unit (default 0.001)"
    )
    command.add_argument(
        "--origin",
        type=finite,
        nargs=3,
        default=(0.0, 0.0, 0.0),
        metavar=("X", "Y", "Z"),
        help="where the tool frame's origin lies, in mesh-file coordinates and units (default 0 0 0)",
    )


def integration_option(command: argparse.ArgumentParser) -> None:
    """``--integration``: the rule for plates."""
    command.add_argument(
        "--integration",
        choices=_INTEGRATIONS,
        help="centroid: published rule (default); refined: ours; a reduced tool has its own",
    )
