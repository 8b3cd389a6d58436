"""`rft demo`: a virtual arm, a real node and a live table; then a replay of the recording."""

import argparse
import shlex
from pathlib import Path

from rft_ros.bags.options import ReplayOptions
from rft_ros.bags.replay import replay
from rft_ros.commands import options
from rft_ros.errors import InputError
from rft_ros.installation import program, share_directory
from rft_ros.parameters import read_parameter_file


def demo_options(command: argparse.ArgumentParser) -> None:
    out, seconds = "folder for bag and report (default out/demo)", "how long the arm moves [s] (default 12)"
    command.add_argument("-o", "--output", type=Path, default=Path("out/demo"), metavar="DIR", help=out)
    command.add_argument("--seconds", type=options.number, default=12.0, metavar="S", help=seconds)


def demo(arguments: argparse.Namespace) -> int:
    """rft demo --seconds 20 -o out/demo"""
    try:
        from rft_ros.demo.run import demo as run
    except ImportError as error:
        raise InputError(
            f"the demo needs ROS 2 ({error.name} is missing): source a ROS 2 setup file, or run"
            " pip install ros-jazzy-common-interfaces 'ros-rclpy[fastrtps]'"
        ) from None

    parameters = share_directory("rft_ros") / "config" / "demo.yaml"
    tare = 2.0  # s at the beginning, in which the arm rests in the air
    bag, out = arguments.output / "bag", arguments.output / "replay"
    run(bag, parameters, seconds=arguments.seconds)
    arguments_of_replay = ["replay", str(bag), "--params", str(parameters), "--tare", f"{tare:g}", "-o", str(out)]
    print(f"the same offline: {program()} {shlex.join(arguments_of_replay)}")
    summary = replay(bag, out, read_parameter_file(parameters), ReplayOptions(tare=tare), report=True)
    print("\n".join([*summary.lines(), f"-> {out / 'report.html'}"]))
    return 0
