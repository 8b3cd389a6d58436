"""How much of the speed along and across a plate becomes force (Treers et al. 2021, eqs. 5 and 6)."""

import published_rule as rule
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rft_ros.rft import traction as vw


@pytest.mark.parametrize("place", [0, 1], ids=["f1", "f23"])
@given(share=st.floats(0.0, 1.0), excess=st.floats(0.0, 1e-9))
def test_a_weight_is_the_published_one_to_1e_12_exactly_0_at_0_and_no_more_than_1(
    place, share, excess
):
    published, by_library = ((rule.f1, vw.exact_f1), (rule.f23, vw.exact_f23))[place]
    assert vw.f1_and_f23(share, share)[place] == pytest.approx(published(share), abs=1e-12)
    assert by_library(share) == pytest.approx(published(share), abs=1e-14)
    assert vw.f1_and_f23(0.0, 0.0)[place] == by_library(0.0) == 0.0
    assert by_library(1.0) == 1.0
    assert vw.f1_and_f23(1.0 + excess, 1.0 + excess)[place] == pytest.approx(1.0, abs=1e-13)
