"""Run a recorded bag through the estimator."""

import argparse
from pathlib import Path

from rft_ros.commands.options import finite

__all__ = ["add_options", "run"]


def add_options(command: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    command.add_argument(
        "bag", type=Path, metavar="BAG", help="rosbag2 folder (MCAP or sqlite3), .mcap file, ROS 1 .bag"
    )
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder for the results")
    command.add_argument("--params", type=Path, metavar="FILE.yaml", help="the node's own parameter file")
    command.add_argument(
        "--remap", action="append", default=[], metavar="FROM:=TO", help="as ~/pose:=/tool_pose; may be repeated"
    )
    command.add_argument("--tare", type=finite, metavar="S", help="take the load cell's bias from the first S seconds")
    command.add_argument("--start", type=finite, metavar="S", help="begin S seconds into the bag")
    command.add_argument("--end", type=finite, metavar="S", help="stop S seconds into the bag")


def run(arguments: argparse.Namespace) -> int:
    """Replay; exit status."""
    from rft_ros.bags.replay import ReplayOptions, read_replay_options, replay
    from rft_ros.estimator.parameter_file import read_parameter_file
    from rft_ros.estimator.parameters import defaults

    file = arguments.params
    values = read_parameter_file(file) if file else defaults()
    options = read_replay_options(file) if file else ReplayOptions()
    given = {name: getattr(arguments, name) for name in ("tare", "start", "end")}
    summary = replay(
        arguments.bag,
        arguments.output,
        values,
        remap=[*options.remap, *arguments.remap],
        **{name: getattr(options, name) if value is None else value for name, value in given.items()},
    )
    print("\n".join(summary.lines()))
    return 0
