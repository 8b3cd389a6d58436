"""The clock says what stamps cannot: that no messages come any more."""

import pytest

from rft_ros.node.arrivals import POLL_PERIOD, Arrivals


@pytest.mark.parametrize("role", ["pose", "wrench"])
def test_a_pose_or_a_reading_ends_the_quiet_time(role):
    arrivals = Arrivals()
    arrivals.count_quiet_time()
    arrivals.add(role)
    assert arrivals.quiet_time == 0.0


@pytest.mark.parametrize("role", ["twist", "surface", "tf"])
def test_other_messages_do_not_keep_the_last_residuals_of_a_run_from_being_published(role):
    """As a depth camera does, whose clouds go on when the arm has stopped."""
    arrivals = Arrivals()
    arrivals.count_quiet_time()
    arrivals.add(role)
    assert arrivals.quiet_time == pytest.approx(POLL_PERIOD)
