"""The published model against discrete-element simulations, by the error measure of test/data/dem/README.md."""

import numpy as np
import pytest

from studies.dem import ALONG_ITSELF, RUNS, accuracy

ZETA = 0.24


@pytest.fixture(scope="module")
def found():
    return accuracy()


def test_zeta_from_the_flat_plates_penetration_is_0_24(found):
    assert found.zeta == ZETA


@pytest.mark.parametrize("name", [name for name in RUNS if "plate" in name and name != ALONG_ITSELF])
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


def test_memory_takes_14_percent_of_the_mean_error_and_harms_no_run_by_over_1_5_points(found):
    """Over the ten runs that its form was chosen on, without the plate that moves along itself."""
    assert found.mean("memory") <= 0.86 * found.mean("constant")
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


def test_memory_halves_the_error_of_small_retreats_and_reloads(found):
    """28.4 and 48.4 % without memory, 16.1 and 16.7 % with it; α_y constant, published rule."""
    assert all(errors["memory"] < 0.6 * errors["constant"] for errors in found.cycles.values())
    assert all(errors["memory"] < 0.18 for errors in found.cycles.values())
