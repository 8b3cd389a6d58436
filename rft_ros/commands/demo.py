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
    from rft_ros.node.demo import Watcher


def add_options(command: argparse.ArgumentParser) -> None:
    output_option(command, "DIR", "folder for bag and figure (default out/demo)", Path("out/demo"))
    number_option(command, "--seconds", "S", "how long the arm moves [s] (default 12)", 12.0)


def run(arguments: argparse.Namespace) -> int:
    try:
        from rft_ros.node.demo import demo
    except ImportError as error:
        raise InputError(
            f"the demo needs ROS 2 ({error.name} is missing): source a ROS 2 setup file, or run"
            " pip install ros-jazzy-common-interfaces 'ros-rclpy[fastrtps]'"
        ) from None
    watcher = demo(arguments.output, seconds=arguments.seconds)
    if watcher is None:
        return 1
    figure = arguments.output / "force_over_depth.png"
    _draw(watcher, arguments.output / "bag", figure)
    print(f"-> {figure}")
    return 0


def _draw(watcher: "Watcher", bag: Path, figure: Path) -> None:
    """Force over depth, and the tool at the greatest force while part of it is still above the surface."""
    import numpy as np

    from rft_ros.bags.playback import play, topics_of
    from rft_ros.bags.reading import Recording
    from rft_ros.estimator import Estimate, Estimator
    from rft_ros.estimator.parameters import model_of, read_parameter_file, settings_of
    from rft_ros.installation import share_directory
    from rft_ros.node.virtual_arm import LAYER
    from rft_ros.report.animation import animate_evenly
    from rft_ros.report.pictures import draw_force_over_depth

    values = {**read_parameter_file(share_directory("rft_ros") / "config" / "demo.yaml"), "learning.mode": "off"}
    model = model_of(values)
    estimator, depth, fixed, states = Estimator(settings_of(values), model), {}, [], []
    with Recording(bag, topics_of(values)) as recording:
        for _, answer in play(recording, estimator, bag.name):
            if isinstance(answer, Estimate) and answer.speed > 0.0:
                depth[answer.stamp] = estimator.depth()
                fixed.append((depth[answer.stamp], *answer.predicted[:3]))
                states.append(estimator.state.copy())
    times = 1e-9 * np.array([*depth])
    scene = animate_evenly(model.tool.name, model.tool, model.law, times - times[0], np.array(states))
    strength = np.linalg.norm(scene.forces, axis=1)
    strength[scene.placed[:, :, 2].max(axis=1) < scene.surface_height + 0.003] = -1.0
    sigma = dict(watcher.wrenches["sigma"])
    draw_force_over_depth(
        figure,
        title="rft demo: an ellipsoid pitches ±9° on its way down at 5 mm/s into grains that the node does not know",
        scene=replace(scene, first=int(strength.argmax())),
        measured=np.array([(depth[s], *w[:3]) for s, w in watcher.wrenches["compensated"] if s in depth]),
        fixed=np.array(fixed),
        learned=np.array(
            [(depth[s], *w[:3], *sigma[s][:3]) for s, w in watcher.wrenches["predicted"] if s in depth and s in sigma]
        ),
        surprise=np.array([(depth[s], score) for s, score in watcher.surprise if s in depth]),
        layer=LAYER,
    )
