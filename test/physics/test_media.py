"""The three media of Li, Zhang, Goldman 2013."""

from dataclasses import astuple

import published_rule as rule
import pytest

from rft_ros.rft import MEDIA, medium_named


@pytest.mark.parametrize("name", rule.MEDIA)
def test_a_medium_has_the_nine_published_coefficients(name):
    assert astuple(medium_named(name)) == (name, *rule.MEDIA[name])


def test_the_media_are_those_that_were_published():
    assert set(MEDIA) == set(rule.MEDIA)


@pytest.mark.parametrize("name", rule.MEDIA)
def test_stress_of_a_flat_plate_dragged_flat_is_the_fit_at_zero_angles(name):
    assert MEDIA[name].alpha_x_flat == pytest.approx(rule.alpha_x(name, 0.0, 0.0), abs=1e-15)


def test_the_constant_alpha_y_of_the_generic_medium_is_0_136():
    assert MEDIA["generic"].alpha_x_flat == pytest.approx(0.136, abs=1e-15)


def test_an_unknown_medium_is_refused_with_the_names_there_are():
    with pytest.raises(ValueError, match=r"medium\.name 'mars' is none of generic, poppy_seeds_loose, poppy_seeds"):
        medium_named("mars")
