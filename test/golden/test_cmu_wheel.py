"""A smooth wheel in sand: another group's code of the same model, and their measurements."""

import numpy as np
import pytest

from rft_ros.rft import MEDIA, alpha_y_model, checked_states, treers2021, wrenches
from rft_ros.tool import load_tool

SLIP_ANGLE, RIM_SPEED = 1, 2  # columns of smooth_expected.csv: [deg], [mm/s]
MODEL, MEASURED = slice(4, 7), slice(7, 10)


@pytest.fixture(scope="module")
def expected(shared_data):
    return np.loadtxt(shared_data / "cmu_wheel/smooth_expected.csv", delimiter=",", skiprows=1)


@pytest.fixture(scope="module")
def forces(shared_data):
    folder, generic = shared_data / "cmu_wheel", MEDIA["generic"]
    law = treers2021(generic, alpha_y_model("constant", generic), zeta=0.6)
    states = np.loadtxt(folder / "smooth_states.csv", delimiter=",", skiprows=1)[:, 1:]
    wheel = load_tool(str(folder / "smooth.stl"), integration="centroid")
    return wrenches(wheel.plates, law, checked_states(states))[:, :3]


def test_forces_agree_with_the_other_groups_code_to_1e_3_newton_in_all_but_three_cases(
    forces, expected
):
    """Those three move straight along the wheel's axle without turning."""
    knife_edge = (expected[:, SLIP_ANGLE] == 90.0) & (expected[:, RIM_SPEED] == 0.0)
    error = np.abs(forces - expected[:, MODEL]).max(axis=1)
    assert knife_edge.sum() == 3
    assert (error[~knife_edge] <= 1e-3).all()
    assert (error[knife_edge] > 1.0).all()


def test_the_models_median_error_against_the_measured_forces_is_35_percent(forces, expected):
    measured = expected[:, MEASURED]
    errors = np.linalg.norm(forces - measured, axis=1) / np.linalg.norm(measured, axis=1)
    assert np.median(errors) == pytest.approx(0.35, abs=0.01)
