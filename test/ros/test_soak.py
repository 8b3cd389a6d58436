"""A short soak; ``make soak`` runs the long one."""

import pytest
from soak import soak

pytestmark = pytest.mark.repository


def test_every_pose_is_an_estimate_or_a_counted_reason_and_nothing_breaks(start_process):
    rft = start_process("-p", "mesh.file:=plate", "-p", "learning.mode:=apply").wait_ready()
    result = soak(rft, seconds=8.0, rate=250.0)
    assert result.unaccounted == 0, result
    assert result.answered == result.calls > 12
    assert result.estimates > 0.8 * result.poses
    assert {
        "pose_not_finite",
        "pose_frame_unknown",
        "pose_stamp_zero",
        "pose_out_of_order",
    } <= result.reasons.keys()
    assert {
        "twist_not_finite",
        "wrench_not_finite",
        "pose_quaternion_not_unit",
        "at_rest",
    } <= result.reasons.keys()
    assert rft.stop() == 0
    assert "Traceback" not in rft.said()
