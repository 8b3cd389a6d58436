"""Run a virtual arm, a real node and a live table (needs ROS).

rft demo --seconds 20 -o out/demo
"""

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from rft_ros.commands.options import number_option, output_option
from rft_ros.errors import InputError

if TYPE_CHECKING:
    from rft_ros.report.pictures import DepthTrace

__all__ = ["add_options", "run"]


def add_options(command: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    output_option(command, "DIR", "folder for bag and figure (default out/demo)", Path("out/demo"))
    number_option(command, "--seconds", "S", "how long the arm moves [s] (default 12)", 12.0)


def run(arguments: argparse.Namespace) -> int:
    """Run the demo; exit status."""
    try:
        from rft_ros.node.demo import demo
    except ImportError as error:
        raise InputError(
            f"the demo needs ROS 2 ({error.name} is missing): source a ROS 2 setup file, or run"
            " pip install ros-jazzy-common-interfaces 'ros-rclpy[fastrtps]'"
        ) from None
    trace = demo(arguments.output, seconds=arguments.seconds)
    if trace is None:
        return 1
    figure = arguments.output / "force_over_depth.png"
    _draw(trace, arguments.output / "bag", figure)
    print(f"-> {figure}")
    return 0


def _draw(trace: "DepthTrace", bag: Path, figure: Path) -> None:
    """Force over depth, and the tool at the greatest force while part of it is still above the surface."""
    import numpy as np

    from rft_ros.bags.playback import ReplayOptions, states_of
    from rft_ros.estimator.parameters import model_of, read_parameter_file
    from rft_ros.report.animation import animate_evenly
    from rft_ros.report.pictures import draw_force_over_depth
    from rft_ros.tool import share_directory

    values = read_parameter_file(share_directory("rft_ros") / "config" / "demo.yaml")
    if trace.swap is not None:
        values["alpha_y.model"] = "linear"
    model = model_of(values)
    scene = animate_evenly(model.tool.name, model.tool, model.law, *states_of(bag, values, model, ReplayOptions())[:2])
    strength = np.linalg.norm(scene.forces, axis=1)
    strength[scene.placed[:, :, 2].max(axis=1) < scene.surface_height + 0.003] = -1.0
    title = "rft demo: an ellipsoid pitches ±9° on its way down at 5 mm/s into virtual grains"
    draw_force_over_depth(trace, figure, title=title, scene=replace(scene, first=int(strength.argmax())))
