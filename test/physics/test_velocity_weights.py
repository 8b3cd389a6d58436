"""How much of the speed along and across a plate becomes force (Treers et al. 2021, eqs. 5 and 6)."""

import published_rule as rule
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rft_ros.rft.traction import f1_and_f23


@pytest.mark.parametrize("place", [0, 1], ids=["f1", "f23"])
@given(share=st.floats(0.0, 1.0), excess=st.floats(0.0, 1e-9))
def test_a_weight_is_the_published_one_to_1e_12_exactly_0_at_0_and_no_more_than_1(
    place, share, excess
):
    published = (rule.f1, rule.f23)[place]
    assert f1_and_f23(share, share)[place] == pytest.approx(published(share), abs=1e-12)
    assert f1_and_f23(0.0, 0.0)[place] == 0.0
    assert f1_and_f23(1.0 + excess, 1.0 + excess)[place] == pytest.approx(1.0, abs=1e-13)
