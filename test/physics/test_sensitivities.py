"""What a filter of the medium needs beside the wrench: dF/dh, and the sums of r_j f_l."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from scenes import CONSTANT, LINEAR, random_plates, random_scene, seeds, unworn

from rft_ros.rft import (
    COLUMNS,
    QUATERNION,
    SENSITIVITIES,
    TWIST,
    Memory,
    plate_forces,
    rotation_matrix,
    wrenches,
    wrenches_in_time,
)
from rft_ros.tool import load_tool

TOOLS = {
    integration: load_tool("ellipsoid", integration=integration).plates
    for integration in ("centroid", "refined")
}
DOWN = np.array(
    [[0.0, 0.0, -0.005, 0.1, 0.2, 0.3, 0.92736185, 0.003, 0.004, -0.005, 0.2, 0.1, 0.3]]
)


def column(result, *names):
    """The columns of these names."""
    return result[:, [(COLUMNS + SENSITIVITIES).index(name) for name in names]]


@given(seed=seeds)
def test_the_moments_are_the_sums_over_plates_of_place_times_force(seed):
    rng = np.random.default_rng(seed)
    plates, state = random_plates(rng, 40), random_scene(rng, 1)
    forces = plate_forces(plates, LINEAR, state[0])
    places = plates.centroids.T @ rotation_matrix(state[0, QUATERNION]).T
    moments = wrenches(plates, LINEAR, state, sensitivities=True)[0, 10:].reshape(3, 3)
    assert SENSITIVITIES[3:6] == ("x_fx", "x_fy", "x_fz")
    scale = np.abs(places).max() * np.abs(forces).sum() + 1e-30
    np.testing.assert_allclose(moments, places.T @ forces, rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("integration", TOOLS)
@pytest.mark.parametrize("height", [-0.05, -0.005])  # deep, and cut by the surface
def test_the_change_with_the_surface_height_is_that_of_finite_differences(integration, height):
    """Without rotation: else the refined rule's centre of pressure, and so its velocity, moves with the surface too."""
    plates, step = TOOLS[integration], 1e-8
    state = DOWN.copy()
    state[0, 2], state[0, 10:] = height, 0.0
    low, high = (wrenches(plates, CONSTANT, state, surface_height=h)[0, :3] for h in (-step, step))
    derivative = column(
        wrenches(plates, CONSTANT, state, sensitivities=True), "dfx_dh", "dfy_dh", "dfz_dh"
    )[0]
    np.testing.assert_allclose(derivative, (high - low) / (2.0 * step), rtol=1e-5, atol=1e-3)


def test_with_memory_at_constant_depth_the_change_with_height_is_traction_times_wet_area():
    """Deep and steady, with a law that pushes no plate onwards: all have its traction, less what sliding has worn."""
    path = np.linspace(0.0, 0.5, 4000)
    states = np.repeat(DOWN, len(path), axis=0)
    states[:, :3] = np.outer(path, [1.0, 0.0, 0.0]) - [0.0, 0.0, 0.05]
    states[:, QUATERNION] = 0.0, 0.0, 0.0, 1.0
    states[:, TWIST] = 0.01, 0.0, 0.0, 0.0, 0.0, 0.0
    law = replace(CONSTANT, mobilization_length=1e-3)
    for plates in TOOLS.values():
        kept = wrenches_in_time(plates, law, states, Memory(plates), sensitivities=True)
        per_depth = plate_forces(plates, CONSTANT, states[-1])[:, 0] / (0.05 - plates.centroids[2])
        expected = unworn(plates, np.array([1.0, 0.0, 0.0])) @ per_depth
        np.testing.assert_allclose(column(kept, "dfx_dh")[-1], expected, rtol=1e-4)
