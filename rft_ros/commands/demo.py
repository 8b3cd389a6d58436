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
    from rft_ros.installation import share_directory
    from rft_ros.node.virtual_arm import LAYER
    from rft_ros.parameters import model_of, read_parameter_file, settings_of
    from rft_ros.report.animation import animate_evenly
    from rft_ros.report.charts import Chart, Line, Panel
    from rft_ros.report.pictures import draw_chart

    values = {**read_parameter_file(share_directory("rft_ros") / "config" / "demo.yaml"), "learning.mode": "off"}
    model = model_of(values)
    estimator, depth, fixed, states = Estimator(settings_of(values), model), {}, [], []
    with Recording(bag, topics_of(values)) as recording:
        for _, answer in play(recording, estimator, bag.name):
            if isinstance(answer, Estimate) and answer.speed > 0.0:
                depth[answer.stamp] = 1e3 * estimator.depth()
                fixed.append((answer.stamp, answer.predicted))
                states.append(estimator.state.copy())
    times = 1e-9 * np.array([*depth])
    title = "Traction and force by the fixed model"
    scene = animate_evenly(title, model.tool, model.law, times - times[0], np.array(states))
    strength = np.linalg.norm(scene.forces, axis=1)
    strength[scene.placed[:, :, 2].max(axis=1) < scene.surface_height + 0.003] = -1.0
    scene = replace(scene, first=int(strength.argmax()))
    moment = 1e3 * (scene.surface_height - scene.placed[scene.first, :, 2].min())

    def panel(axis: str, *lines: Line) -> tuple[Panel]:
        ends = np.array([min(line.y.min() for line in lines), max(line.y.max() for line in lines)])
        layer = Line(label="hard layer begins", colour="z", x=np.full(2, 1e3 * LAYER), y=ends)
        shown = Line(label="the moment on the left", colour="x", x=np.full(2, moment), y=ends)
        return (Panel(x_label="Depth of the tool's lowest point [mm]", y_label=axis, lines=(*lines, layer, shown)),)

    wrenches, sigma = watcher.wrenches, dict(watcher.wrenches["sigma"])
    learned = [(stamp, wrench) for stamp, wrench in wrenches["predicted"] if stamp in sigma]
    forces = []
    for column, axis in ((2, "z (down)"), (0, "x (sideways)")):
        lines = []
        for label, colour, rows in (
            ("virtual load cell, less bias and weight", "measured", wrenches["compensated"]),
            ("predicted by the fixed model", "y", fixed),
            ("predicted by the node, which learns", "predicted", learned),
        ):
            x, y = np.array([(depth[stamp], wrench[column]) for stamp, wrench in rows if stamp in depth]).T
            lines.append(Line(label=label, colour=colour, x=x, y=y))
        deviation = np.array([sigma[stamp][column] for stamp, _ in learned if stamp in depth])
        y = np.stack([y - deviation, y + deviation])
        lines.append(Line(label="± standard deviation", colour="predicted", x=x, y=y, kind="band"))
        forces.append(panel(f"Force along\nsensor {axis} [N]", *lines))
    x, y = np.array([(depth[stamp], score) for stamp, score in watcher.surprise if stamp in depth]).T
    surprise = panel("Surprise\n[std. deviations]", Line(label="surprise", colour="approach", x=x, y=y))
    panels, heights = (*forces, surprise), (1.2, 0.9, 0.7)
    chart = Chart(name="force_over_depth", title="rft demo", panels=panels, height=600, heights=heights)
    title = "an ellipsoid pitches ±9° on its way down at 5 mm/s into grains that the node does not know"
    draw_chart(chart, figure, title=title, scene=scene)
