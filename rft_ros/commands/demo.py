"""Run a virtual arm, a real node and a live table (needs ROS).

rft demo --seconds 20 -o out/demo
rft demo --mujoco -o out/demo_mujoco
"""

import argparse
from pathlib import Path

from rft_ros.commands.options import number_option, output_option
from rft_ros.errors import InputError


def add_options(command: argparse.ArgumentParser) -> None:
    output_option(command, "DIR", "folder for bag and report (default out/demo)", Path("out/demo"))
    number_option(command, "--seconds", "S", "how long the arm moves [s] (default 12)", 12.0)
    command.add_argument(
        "--mujoco", action="store_true", help="a simulated arm that feels the node's forces (needs mujoco)"
    )


def run(arguments: argparse.Namespace) -> int:
    try:
        from rft_ros.node.demo import demo
    except ImportError as error:
        raise InputError(
            f"the demo needs ROS 2 ({error.name} is missing): source a ROS 2 setup file, or run"
            " pip install ros-jazzy-common-interfaces 'ros-rclpy[fastrtps]'"
        ) from None
    from rft_ros.bags.playback import ReplayOptions
    from rft_ros.bags.replay import replay
    from rft_ros.installation import program, share_directory
    from rft_ros.parameters import read_parameter_file

    parameters = share_directory("rft_ros") / "config" / ("mujoco_arm.yaml" if arguments.mujoco else "demo.yaml")
    tare = 1.5 if arguments.mujoco else 2.0  # s in which the arm rests in the air
    bag, out = arguments.output / "bag", arguments.output / "replay"
    if not demo(bag, parameters, seconds=arguments.seconds, mujoco=arguments.mujoco):
        return 1
    print(f"the same offline: {program('rft')} replay {bag} --params {parameters} --tare {tare:g} -o {out}")
    summary = replay(bag, out, read_parameter_file(parameters), ReplayOptions(tare=tare), report=True)
    print("\n".join([*summary.lines(), f"-> {out / 'report.html'}"]))
    return 0
