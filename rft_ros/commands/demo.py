"""Run a virtual arm, a real node and a live table (needs ROS).

rft demo --seconds 20 -o out/demo
"""

import argparse
from pathlib import Path

from rft_ros.commands.options import finite
from rft_ros.errors import InputError

__all__ = ["add_options", "run"]


def add_options(command: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    command.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("out/demo"),
        metavar="DIR",
        help="for bag and figure (default out/demo)",
    )
    command.add_argument(
        "--seconds", type=finite, default=12.0, metavar="S", help="how long the arm moves [s] (default 12)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the demo; exit status."""
    try:
        from rft_ros.node.demo import demo
    except ImportError as error:
        raise InputError(f"the demo needs ROS 2 ({error.name} is missing): pip install 'rft_ros[ros]'") from None
    return demo(arguments.output, seconds=arguments.seconds)
