"""Memory on the ABB recordings, by the replay: the force that the sand keeps at rest, and lets go on the way out."""

from pathlib import Path

import numpy as np
import pytest

from rft_ros.bags.playback import read_replay_options
from rft_ros.bags.replay import replay
from rft_ros.parameters import read_parameter_file

FILE = Path(__file__).resolve().parents[2] / "config" / "abb_plate.yaml"
LENGTH = 0.0052  # m, as calibrated on both trials (docs/calibrate.md)


class Run:
    """A trial's table by columns, without the poses that have no estimate, and its summary."""

    def __init__(self, shared_data, folder, trial, length):
        options, values = read_replay_options(FILE), read_parameter_file(FILE)
        bag = shared_data / "abb_plate" / f"abb_plate_{trial}"
        values["medium.mobilization_length"] = length
        self.summary = replay(bag, folder, values, options)
        table = np.genfromtxt(folder / "estimates.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
        table = table[table["reason"] == ""]
        self.time, self.depth, self.phase = table["t"] - table["t"][0], table["depth"], table["phase"]
        self.predicted, self.measured = table["predicted_fz"], table["compensated_fz"]
        self.peak = np.abs(self.measured).max()


@pytest.fixture(scope="module", params=[2, 3])
def runs(request, shared_data, tmp_path_factory):
    """Without memory, and with it."""
    return [Run(shared_data, tmp_path_factory.mktemp("abb"), request.param, length) for length in (0.0, LENGTH)]


def test_a_tool_at_rest_has_an_estimate_with_memory_only(runs):
    without, remembering = (run.summary for run in runs)
    assert without.reasons["at_rest"] > 1000
    assert "at_rest" not in remembering.reasons
    assert remembering.estimates == without.estimates + without.reasons["at_rest"]


def test_the_force_at_rest_is_kept_and_is_the_measured_peak_within_10_percent(runs):
    run = runs[1]
    deep = (run.phase == "dwell") & (run.depth > 0.04)
    held = run.predicted[deep & (run.time > run.time[deep][0] + 0.2)]
    assert len(held) > 500
    assert np.ptp(held) < 0.01 * np.abs(held).mean()
    assert np.abs(held).mean() / run.peak == pytest.approx(1.0, abs=0.1)


def test_3_mm_into_the_withdrawal_the_force_is_gone(runs):
    run = runs[1]
    up = run.phase == "withdrawal"
    risen = run.depth[up][0] - run.depth[up]
    at = np.argmax(risen >= 0.003)
    assert risen[at] == pytest.approx(0.003, abs=2e-4)
    assert abs(run.predicted[up][at]) < 0.05 * run.peak
    assert abs(run.measured[up][at]) < 0.05 * run.peak


def test_memory_changes_the_prediction_of_penetration_by_less_than_a_tenth_of_a_percent(runs):
    """RMS of the residual force over the peak; of its vertical component alone trial 2 gains nothing (4.18, 4.20 %)."""
    without, remembering = (run.summary.phases["penetration"].rms_over_peak for run in runs)
    assert without < 0.07
    assert remembering <= without + 0.001
