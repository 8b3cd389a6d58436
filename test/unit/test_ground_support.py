"""The surface that resists a tool: a plane over the ground ahead of it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from rft_ros.ground import HeightMap, Support
from rft_ros.tool import load_tool

CELL = 0.002
PLATE = load_tool("plate", integration="refined")
SUPPORT = Support(PLATE.corners)


def ground(height, half=0.15):
    axis = CELL * (np.arange(-int(half / CELL), int(half / CELL)) + 0.5)
    x, y = (v.ravel() for v in np.meshgrid(axis, axis, indexing="ij"))
    return HeightMap.unknown(CELL).with_points(x, y, height(x, y))


def state(velocity, z=-0.01, x=0.0):
    return np.array([x, 0.0, z, 0.0, 0.0, 0.0, 1.0, *velocity, 0.0, 0.0, 0.0])


DOWN, FORWARD = (0.0, 0.0, -0.01), (0.01, 0.0, 0.0)


@pytest.mark.parametrize("velocity", [DOWN, FORWARD, (0.0, 0.0, 0.0)])
def test_unknown_ground_is_the_level_plane_exactly(velocity):
    surface = SUPPORT.local_surface(HeightMap.unknown(CELL), state(velocity), level=0.12)
    assert surface[:3] == (0.12, (0.0, 0.0), 0.0)


@given(sx=st.floats(-0.26, 0.26), sy=st.floats(-0.26, 0.26), h=st.floats(-0.01, 0.01))
def test_a_tilted_bed_under_a_sinking_tool_is_found_as_it_is(sx, sy, h):
    bed = ground(lambda x, y: h + sx * x + sy * y)
    surface = SUPPORT.local_surface(bed, state(DOWN, z=h - 0.02), level=0.0)
    assert_allclose((surface.height, *surface.slope), (h, sx, sy), atol=1e-5)
    assert surface.roughness < 1e-5


def test_the_ground_ahead_resists_and_not_the_hole_behind():
    step = ground(lambda x, _: np.where(x > 0.02, 0.0, -0.03))
    heights = []
    for velocity in (FORWARD, (-0.01, 0.0, 0.0)):
        surface = SUPPORT.local_surface(step, state(velocity, z=-0.02, x=0.03), level=0.0)
        heights.append(surface.height + surface.slope[0] * 0.03)
    assert heights[0] > heights[1] + 0.005


def test_a_tool_on_a_pile_is_below_its_surface():
    pile = ground(lambda x, y: np.maximum(0.03 - np.hypot(x, y) * 0.4, 0.0))
    assert SUPPORT.local_surface(pile, state(DOWN, z=0.01), level=0.0).depth > 0.0
    assert SUPPORT.local_surface(pile, state(DOWN, z=0.06), level=0.0).depth < 0.0


@given(turn=st.floats(0.0, 6.3))
def test_turning_the_scene_turns_the_plane(turn):
    surfaces = []
    for angle in (0.0, turn):
        a, b = np.cos(angle), np.sin(angle)
        bed = ground(lambda x, y, a=a, b=b: 0.01 * np.tanh(60.0 * (a * x + b * y)), half=0.1)
        pose = 0.0, 0.0, -0.02, 0.0, 0.0, np.sin(angle / 2.0), np.cos(angle / 2.0)
        moved = np.array([*pose, 0.01 * a, 0.01 * b, 0.0, 0.0, 0.0, 0.0])
        surfaces.append(SUPPORT.local_surface(bed, moved, level=0.0))
    assert surfaces[0].height == pytest.approx(surfaces[1].height, abs=2e-4)
    assert np.hypot(*surfaces[0].slope) == pytest.approx(np.hypot(*surfaces[1].slope), abs=0.02)


def test_the_height_is_continuous_along_a_path():
    bed = ground(lambda x, y: 0.008 * np.sin(100.0 * x) * np.cos(80.0 * y))
    step = 1e-5
    places = np.arange(0.0, 0.02, step)
    planes = [SUPPORT.local_surface(bed, state(FORWARD, z=-0.02, x=x), level=0.0) for x in places]
    at_tool = [plane.height + plane.slope[0] * x for plane, x in zip(planes, places, strict=True)]
    assert np.abs(np.diff(at_tool)).max() < 2.0 * step


@given(
    st.lists(st.floats(allow_nan=True, allow_infinity=True, width=32), min_size=0, max_size=60),
    st.tuples(*(st.floats(-1e300, 1e300) for _ in range(6))),
)
def test_any_ground_and_any_state_give_numbers(values, numbers):
    n = len(values) // 3
    x, y, z = (np.array(values[k * n : (k + 1) * n]) for k in range(3))
    bed = HeightMap.unknown(CELL).with_points(x, y, z)
    x, y, z, vx, vy, vz = numbers
    surface = SUPPORT.local_surface(bed, np.array([x, y, z, 0, 0, 0, 1.0, vx, vy, vz, 0, 0, 0]), level=0.0)
    assert np.isfinite([surface.height, *surface.slope, surface.roughness]).all()
