"""The still picture of a tool in the grains tells the net force, and colours traction alone."""

import re

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from rft_ros.report.animation import animate, draw_moment
from rft_ros.rft import MEDIA, alpha_y_model, treers2021, wrenches
from rft_ros.tool import load_tool

TOOL = load_tool("ellipsoid", scale=0.001)
LAW = treers2021(MEDIA["generic"], alpha_y_model("constant", MEDIA["generic"]))


def drawn(height):
    """Pixels and texts of the ellipsoid at this height, on its way down; and the force on it."""
    state = np.array([[0.0, 0.0, height, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -0.01, 0.0, 0.0, 0.0]])
    figure = Figure(figsize=(6.0, 5.0))
    axes = figure.add_subplot(projection="3d", computed_zorder=False)
    draw_moment(figure, axes, animate("ellipsoid", TOOL, LAW, state, ["now"], surface_height=0.0))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[:, :430, :3].astype(int)  # without the colour bar
    return pixels, [text.get_text() for text in axes.texts], wrenches(TOOL.plates, LAW, state)[0, :3]


def reds(pixels):
    return int(((pixels[..., 0] > 100) & (pixels[..., 1] < 80) & (pixels[..., 2] < 80)).sum())


def test_in_the_grains_the_force_is_written_and_the_loaded_faces_are_red():
    pixels, texts, force = drawn(-0.03)
    told = next(text for text in texts if "net force" in text)
    assert [float(n) for n in re.findall(r"-?\d+\.\d\d", told)] == pytest.approx(force.tolist(), abs=0.01 * force[2])
    assert reds(pixels) > 20


@pytest.mark.parametrize("height", [0.03, 0.1])
def test_in_the_air_there_is_no_force_and_nothing_is_red(height):
    pixels, texts, _ = drawn(height)
    assert any("(0.00, 0.00, 0.00) N" in text for text in texts)
    assert reds(pixels) == 0
