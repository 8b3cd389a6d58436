"""The published model and the memory against discrete-element simulations (test/data/dem/README.md)."""

from statistics import mean

import pytest

from studies.choice import PUBLISHED, REMEMBERED
from studies.dem import ALONG_ITSELF, CYCLE_RUNS, RUNS, errors_of, modelled


def test_zeta_from_the_flat_plates_penetration_is_0_24():
    assert modelled(PUBLISHED)[1] == pytest.approx(0.24, abs=0.005)


@pytest.mark.parametrize(
    "name", [name for name in RUNS if "plate" in name and name != ALONG_ITSELF]
)
def test_plates_are_predicted_to_8_to_17_percent(name):
    """Within 2 points, for the rounding of ζ and the plate's mesh: 9 to 19 % here."""
    assert 0.08 - 0.02 < errors_of(PUBLISHED)[name] < 0.17 + 0.02


PUBLISHED_ERRORS = {
    "ellipsoid_straight": 0.12,
    "root_insert_tilt10": 0.18,
    "ellipsoid_osc9deg_5Hz": 0.35,
    "root_helix_P40_tilt10": 0.49,
    ALONG_ITSELF: 0.71,
}


@pytest.mark.parametrize("name", PUBLISHED_ERRORS)
def test_bodies_and_the_plate_that_moves_along_itself_are_predicted_as_the_readme_says(name):
    assert errors_of(PUBLISHED)[name] == pytest.approx(PUBLISHED_ERRORS[name], abs=0.012)


def test_the_default_model_is_better_on_average_and_harms_no_run_by_over_1_6_points():
    published, remembered = errors_of(PUBLISHED), errors_of(REMEMBERED)
    assert mean(remembered[name] for name in RUNS) <= 0.170
    assert max(remembered[name] - published[name] for name in RUNS) <= 0.016
    assert remembered[ALONG_ITSELF] < 0.5 * published[ALONG_ITSELF]


def test_memory_halves_the_error_of_small_retreats_and_reloads():
    published, remembered = errors_of(PUBLISHED), errors_of(REMEMBERED)
    for name in CYCLE_RUNS:
        assert remembered[name] < 0.6 * published[name]
    assert remembered["press_cycles"] <= 0.17
    assert remembered["drag_cycles"] <= 0.16
