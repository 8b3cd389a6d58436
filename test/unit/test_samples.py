"""How a stamp follows the last one of its input."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_plate import SECOND, START, pose, push, twist, wrench
from test_estimator_ground import cloud, on_map
from test_transforms import moving

from rft_ros.estimator import Reason
from rft_ros.estimator.timeline import LATE, NEW_RUN, NEXT, REPEATED, succession

stamps = st.integers(0, 2**62)


@given(stamps, st.integers(1, SECOND - 1), st.integers(0, 2**62))
def test_a_stamp_is_the_next_one_repeated_late_or_the_first_of_a_new_run(last, less, more):
    assert succession(last, after=last) is REPEATED
    assert succession(last + 1 + more, after=last) is NEXT
    assert succession(last - less, after=last) is LATE
    assert succession(last - SECOND - more, after=last) is NEW_RUN


INPUTS = {
    "pose": (pose, Reason.POSE_OUT_OF_ORDER),
    "twist": (twist, Reason.TWIST_OUT_OF_ORDER),
    "wrench": (wrench, Reason.WRENCH_OUT_OF_ORDER),
    "cloud": (cloud, Reason.SURFACE_OUT_OF_ORDER),
    "transform": (lambda stamp: moving(stamp, "world", "arm"), Reason.TF_OUT_OF_ORDER),
}


@pytest.mark.parametrize("name", INPUTS)
@pytest.mark.parametrize("behind", [-1 * SECOND, 1, SECOND - 1, SECOND])
def test_every_input_refuses_a_late_sample_and_takes_the_first_of_a_new_run(name, behind):
    sample, late = INPUTS[name]
    e = on_map()
    push(e, twist(START - 2 * SECOND), sample(START), sample(START - behind))
    expected = [late] if succession(START - behind, after=START) is LATE else []
    assert [reason for reason in e.counts if reason.endswith("_out_of_order")] == expected
