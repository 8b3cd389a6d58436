"""The wrench that the paper's authors' released code gave for their root tip, under GNU Octave."""

import numpy as np
import pytest

from rft_ros.rft import MEDIA, alpha_y_model, checked_states, treers2021, wrenches
from rft_ros.tool import load_tool

ZETA = 0.33
ROTATION_CENTRE = (0.0, 0.0, 35.5)  # mm, in the STL file


@pytest.fixture(scope="module")
def root_tip(shared_data):
    return load_tool(str(shared_data / "paper" / "root-tip.stl"), origin=ROTATION_CENTRE, integration="centroid")


@pytest.fixture(scope="module")
def states(shared_data):
    file = shared_data / "paper" / "circumnutation_P40_states.csv"
    return checked_states(np.loadtxt(file, delimiter=",", skiprows=1)[:, 1:])


@pytest.mark.parametrize("alpha_y", ["constant", "linear"])
def test_force_and_torque_agree_with_the_released_code_to_1e_9_of_the_largest_component(
    shared_data, root_tip, states, alpha_y
):
    file = shared_data / f"paper/circumnutation_P40_expected_{alpha_y}.csv"
    expected = np.loadtxt(file, delimiter=",", skiprows=1)[:, 1:]
    generic = MEDIA["generic"]
    law = treers2021(generic, alpha_y_model(alpha_y, generic), zeta=ZETA)
    actual = wrenches(root_tip.plates, law, states)[:, :6]
    assert actual.shape == expected.shape == (85, 6)
    for columns in (slice(0, 3), slice(3, 6)):
        largest = np.abs(expected[:, columns]).max()
        np.testing.assert_allclose(actual[:, columns], expected[:, columns], rtol=0, atol=1e-9 * largest)
