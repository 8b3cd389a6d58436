"""Li, Zhang, Goldman 2013: the stresses measured on a plate in loose poppy seeds, and the fit that RFT uses."""

import math

import numpy as np
import pytest
from single_plate import traction_per_depth

from rft_ros.rft import MEDIA, alpha_y_model, treers2021


@pytest.fixture(scope="module")
def grid(shared_data):
    """γ [deg], β [deg], measured α_x, measured α_z [N/cm³] of the plates that lead."""
    rows = np.loadtxt(shared_data / "li2013_poppyLP_grid.csv", delimiter=",")
    rows[:, :2] = rows[:, :2].round()
    return rows[np.sin(np.deg2rad(rows[:, 0] + rows[:, 1])) > 1e-9]


def stresses(gamma, beta):
    """α_x, α_z of the model [N/cm³]: the normal lies β from straight down towards +x, the velocity γ below +x."""
    g, b = math.radians(gamma), math.radians(beta)
    medium = MEDIA["poppy_seeds_loose"]
    law = treers2021(medium, alpha_y_model("constant", medium))
    tx, ty, tz = traction_per_depth(
        law, math.sin(b), 0.0, -math.cos(b), math.cos(g), 0.0, -math.sin(g)
    )
    assert abs(ty) < 1e-6
    return -tx / 1e6, tz / 1e6


@pytest.fixture(scope="module")
def fitted(grid):
    return np.array([stresses(gamma, beta) for gamma, beta in grid[:, :2]])


def test_the_fit_costs_28_percent_of_the_stress_on_a_flat_plate_pushed_straight_down(grid):
    ((*_, measured),) = grid[(grid[:, 0] == 90) & (grid[:, 1] == 0)]
    _, model = stresses(90, 0)
    assert measured == pytest.approx(0.351, abs=5e-4)
    assert model == pytest.approx(0.051 + 0.047 + 0.053 + 0.083 + 0.020, abs=1e-9)
    assert model / measured - 1.0 == pytest.approx(-0.28, abs=0.005)


def test_signs_agree_with_the_measurement_wherever_the_stress_is_not_small(grid, fitted):
    """The convention in one statement: α_x opposes motion along e2, α_z lifts, on either side of the plate."""
    for k in (0, 1):
        measured, model = grid[:, 2 + k], fitted[:, k]
        large = np.abs(measured) > 0.25 * np.abs(measured).max()
        assert (measured[large] * model[large] > 0.0).all()
        assert large.sum() > 20


def test_over_all_leading_plates_the_fit_errs_by_7_and_11_percent_of_the_largest_stress(
    grid, fitted
):
    """Root mean square of α_x and α_z: the cost of nine terms."""
    rms = np.sqrt(((fitted - grid[:, 2:4]) ** 2).mean(axis=0))
    assert rms / np.abs(grid[:, 2:4]).max() == pytest.approx([0.07, 0.11], abs=0.01)
