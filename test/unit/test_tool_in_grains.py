"""The animation of a tool in the grains has the force on it, and traction where faces lead."""

import numpy as np
import pytest

from rft_ros.report.animation import animate
from rft_ros.rft import MEDIA, alpha_y_model, treers2021, wrenches
from rft_ros.tool import load_tool

TOOL = load_tool("ellipsoid", scale=0.001)
LAW = treers2021(MEDIA["generic"], alpha_y_model("constant", MEDIA["generic"]))


@pytest.mark.parametrize("height", [-0.03, 0.03])
def test_the_force_is_that_of_the_plates_and_in_the_air_there_is_none(height):
    state = np.array([[0.0, 0.0, height, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -0.01, 0.0, 0.0, 0.0]])
    scene = animate("ellipsoid", TOOL, LAW, state, ["now"], surface_height=0.0)
    np.testing.assert_allclose(scene.forces, wrenches(TOOL.plates, LAW, state)[:, :3], rtol=0.01, atol=0.01)
    low = scene.placed[0][scene.faces].mean(axis=1)[:, 2]
    loaded = scene.traction[0] > 0.0
    assert loaded.any() == (height < 0.0)
    assert not loaded[low > height + 0.002].any()  # the upper half trails
