"""How much of the speed along and across a plate becomes force (Treers et al. 2021, eqs. 5 and 6)."""

import numpy as np
import published_rule as rule
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rft_ros.rft import velocity_weights as vw

WEIGHTS = pytest.mark.parametrize("name", ["f1", "f23"])


def weights(name):
    """The kernel's rational weight, the one by library calls, and the published formula."""
    place = ("f1", "f23").index(name)
    return (lambda share: vw.f1_and_f23(share, share)[place]), getattr(vw, f"exact_{name}"), getattr(rule, name)


@WEIGHTS
def test_a_weight_is_exactly_zero_at_zero_and_one_at_one(name):
    rational, by_library, _ = weights(name)
    assert rational(0.0) == 0.0
    assert by_library(0.0) == 0.0
    assert by_library(1.0) == 1.0
    assert rational(1.0) == pytest.approx(1.0, abs=1e-13)


@WEIGHTS
@given(share=st.floats(0.0, 1.0))
def test_the_rational_weight_is_the_published_one_to_1e_12(name, share):
    rational, by_library, published = weights(name)
    assert rational(share) == pytest.approx(published(share), abs=1e-12)
    assert by_library(share) == pytest.approx(published(share), abs=1e-14)


@WEIGHTS
def test_a_weight_rises_with_its_share_of_the_speed(name):
    """The published slope is positive everywhere: f1' > 0 as sech² > 0, f23' > 0 as abs(B2 w - B3) < 1."""
    rational, _, _ = weights(name)
    values = np.array([rational(float(share)) for share in np.linspace(0.0, 1.0, 2001)])
    assert (np.diff(values) > 0.0).all()


@WEIGHTS
@given(excess=st.floats(0.0, 1e-9))
def test_rounding_of_the_share_above_one_does_not_raise_the_weight(name, excess):
    rational, _, _ = weights(name)
    assert rational(1.0 + excess) == pytest.approx(rational(1.0), abs=1e-15)
