"""The published model against discrete-element simulations, by the error measure of test/data/dem/README.md."""

import numpy as np
import pytest

from studies.dem import ALONG_ITSELF, accuracy
from studies.paper import law

ZETA = 0.24


@pytest.fixture(scope="module")
def found():
    return accuracy()


def test_zeta_from_the_flat_plates_penetration_is_0_24(found):
    assert found.zeta == ZETA


@pytest.mark.parametrize(
    "name",
    [
        "pen_plate_seedA",
        "plate_b30_psi30_phi60",
        "plate_b60_psi0_phi30",
        "plate_b60_psi30_phi30",
        "plate_b90_psi0_phi0",
        "plate_b90_psi30_phi0",
    ],
)
def test_plates_are_predicted_to_8_to_17_percent(found, name):
    """Within 2 points, for the rounding of ζ and the plate's mesh: 9 to 19 % here."""
    assert 0.08 - 0.02 < found.errors[name]["constant"] < 0.17 + 0.02


@pytest.mark.parametrize(
    ("name", "published"),
    [
        ("ellipsoid_straight", 0.12),
        ("root_insert_tilt10", 0.18),
        ("ellipsoid_osc9deg_5Hz", 0.35),
        ("root_helix_P40_tilt10", 0.49),
        (ALONG_ITSELF, 0.71),
    ],
)
def test_bodies_and_the_plate_that_moves_along_itself_are_predicted_as_the_readme_says(found, name, published):
    assert found.errors[name]["constant"] == pytest.approx(published, abs=0.01)


def test_memory_takes_15_percent_of_the_mean_error_and_harms_no_run_by_over_1_5_points(found):
    """Over the ten runs that its form was chosen on, without the plate that moves along itself."""
    assert found.mean("memory") <= 0.85 * found.mean("constant")
    assert found.errors["ellipsoid_osc9deg_5Hz"]["memory"] <= 0.24
    ten = [errors for name, errors in found.errors.items() if name != ALONG_ITSELF]
    assert len(ten) == 10
    assert max(errors["memory"] - errors["constant"] for errors in ten) <= 0.015


def test_memory_does_not_help_the_plate_that_moves_along_itself(found):
    """That run lacks friction on its faces. Including it, the mean of all eleven falls by 10 to 11 %, not by 15."""
    errors = found.errors[ALONG_ITSELF]
    assert 0.0 < errors["memory"] - errors["constant"] < 0.02
    plain, remembered = (np.mean([e[column] for e in found.errors.values()]) for column in ("constant", "memory"))
    assert 0.10 < 1.0 - remembered / plain < 0.11


def test_the_plate_that_moves_along_itself_lacks_the_friction_of_its_faces(found):
    """Neither face leads: 0.28 N of the measured 1.0 N. One face would add ζ α_y d A: 0.8 N linear, 1.3 N constant."""
    run = next(run for run in found.runs if run.name == ALONG_ITSELF)
    predicted = np.median(np.linalg.norm(run.predicted(law("constant", zeta=ZETA)), axis=1))
    depth, face = -np.median(run.states[:, 2]), 0.03 * 0.03
    assert predicted == pytest.approx(0.28, abs=0.01)
    assert predicted + ZETA * 1e6 * (0.2035 - 0.0015 * 90) * depth * face == pytest.approx(0.8, abs=0.02)
    assert predicted + ZETA * 1e6 * 0.136 * depth * face == pytest.approx(1.3, abs=0.02)
    assert np.median(np.linalg.norm(run.forces, axis=1)) == pytest.approx(1.0, abs=0.15)


def test_memory_halves_the_error_of_small_retreats_and_reloads(found):
    """28.4 and 48.4 % without memory, 16.1 and 16.2 % with it; α_y constant, published rule."""
    assert all(errors["memory"] < 0.6 * errors["constant"] for errors in found.cycles.values())
    assert all(errors["memory"] < 0.18 for errors in found.cycles.values())
