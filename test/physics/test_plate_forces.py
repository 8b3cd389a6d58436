"""Forces on single plates: what the markers draw is what the wrench sums."""

import numpy as np
import pytest

from rft_ros.rft import MEDIA, Table, alpha_y_model, checked_states, plate_forces, treers2021, wrenches
from rft_ros.tool import load_tool

TABLE = Table.sampled(np.array([0.0, 1.0, 3.0]), np.array([-1.0, 1.0]), np.array([[0.1, 0.2], [0.05, 0.3], [0.0, 0.1]]))


@pytest.mark.parametrize("model", ["constant", "linear", "table"])
def test_the_forces_on_plates_add_up_to_the_wrench(model):
    tool = load_tool("ellipsoid")
    law = treers2021(MEDIA["generic"], alpha_y_model(model, MEDIA["generic"], TABLE), zeta=0.33)
    state = checked_states([0.0, 0.0, -0.005, 0.1, 0.2, 0.3, 0.92736185, 0.003, 0.004, -0.005, 0.2, 0.1, 0.3])
    forces = plate_forces(tool.plates, law, state[0], surface_height=0.001)
    assert forces.shape == (len(tool.plates), 3)
    expected = wrenches(tool.plates, law, state, surface_height=0.001)[0, :3]
    np.testing.assert_allclose(forces.sum(axis=0), expected, rtol=0, atol=1e-12 * np.abs(forces).sum())
    assert 0 < (np.abs(forces).sum(axis=1) > 0).sum() < len(forces)
