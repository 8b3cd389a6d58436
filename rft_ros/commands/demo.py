"""Run a virtual arm, a real node and a live table (needs ROS).

rft demo --seconds 20 -o out/demo
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rft_ros.commands.options import finite
from rft_ros.errors import InputError

if TYPE_CHECKING:
    from rft_ros.report.depth_figure import DepthTrace

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
    """Force over depth, beside the tool where the force is greatest while the tool still breaks the surface."""
    import numpy as np

    from rft_ros.bags.playback import ReplayOptions, states_of
    from rft_ros.commands.view import moving_tool
    from rft_ros.estimator.parameters import model_of, read_parameter_file
    from rft_ros.report.depth_figure import draw_force_over_depth
    from rft_ros.tool import share_directory

    values = read_parameter_file(share_directory("rft_ros") / "config" / "demo.yaml")
    if trace.swap is not None:
        values["alpha_y.model"] = "linear"
    model = model_of(values)
    scene = moving_tool(model.tool.name, model.tool, model.law, *states_of(bag, values, model, ReplayOptions()))
    strength = np.linalg.norm(scene.forces, axis=1)
    strength[scene.placed[:, :, 2].max(axis=1) < scene.surface_height + 0.003] = -1.0
    title = "rft demo: an ellipsoid pitches ±9° on its way down at 5 mm/s into virtual grains"
    draw_force_over_depth(trace, figure, title=title, scene=scene.only(int(strength.argmax())))
