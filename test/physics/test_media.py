"""The three media of Li, Zhang, Goldman 2013."""

from dataclasses import astuple

import published_rule as rule
import pytest

from rft_ros.rft import MEDIA, medium_named


def test_the_media_have_the_nine_published_coefficients():
    assert {name: astuple(medium_named(name)) for name in MEDIA} == {n: (n, *c) for n, c in rule.MEDIA.items()}


def test_an_unknown_medium_is_refused_with_the_names_there_are():
    with pytest.raises(ValueError, match=r"medium\.name 'mars' is none of generic, poppy_seeds_loose, poppy_seeds"):
        medium_named("mars")
