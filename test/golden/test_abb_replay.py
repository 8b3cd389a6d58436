"""The ABB recordings: a real plate in real sand, one ζ from trial 2, and what it leaves on trial 3."""

from pathlib import Path

import pytest

from rft_ros.bags.replay import read_replay_options, replay
from rft_ros.estimator.parameter_file import read_parameter_file

FILE = Path(__file__).resolve().parents[2] / "config" / "abb_plate.yaml"


@pytest.fixture(scope="module", params=["abb_plate_2", "abb_plate_3"])
def summary(request, shared_data, tmp_path_factory):
    options = read_replay_options(FILE)
    out = tmp_path_factory.mktemp(request.param)
    bag = shared_data / "abb_plate" / request.param
    return replay(bag, out, read_parameter_file(FILE), remap=options.remap, tare=options.tare)


def test_every_pose_is_an_estimate_or_a_reason(summary):
    poses = {"abb_plate_2": 7378, "abb_plate_3": 7017}[summary.bag]
    assert summary.messages["pose"] == poses
    assert summary.estimates + sum(summary.withheld.values()) == poses
    assert set(summary.withheld) == {"at_rest", "pose_history_short"}
    assert summary.damage is None


def test_the_bias_is_what_the_load_cell_reads_in_the_air(summary):
    assert summary.bias[2] == pytest.approx(1.81, abs=0.03)


def test_the_vertical_residual_in_penetration_is_within_15_percent_of_the_peak(summary):
    """RMS, with ζ = 1.11 for both; 4.2 % on trial 2, where it was fitted, and 6.0 % on trial 3."""
    fz = summary.penetration["fz"]
    assert fz.measured.peak == pytest.approx(80.9, abs=4.0)
    ratio = fz.residual.rms / fz.measured.peak
    assert ratio < 0.15
    assert ratio == pytest.approx({"abb_plate_2": 0.042, "abb_plate_3": 0.060}[summary.bag], abs=0.005)
