"""The ABB recordings: a real plate in real sand, one ζ from trial 2, and what it leaves on trial 3."""

import csv
from pathlib import Path

import numpy as np
import pytest

from rft_ros.bags.playback import read_replay_options
from rft_ros.bags.replay import replay
from rft_ros.parameters import read_parameter_file

FILE = Path(__file__).resolve().parents[2] / "config" / "abb_plate.yaml"


@pytest.fixture(scope="module")
def replays(shared_data, tmp_path_factory):
    """Of each trial: summary, and predicted and measured vertical force while it goes down in the sand."""
    options, values = read_replay_options(FILE), read_parameter_file(FILE)
    found = {}
    for trial in (2, 3):
        out = tmp_path_factory.mktemp("abb")
        bag = shared_data / "abb_plate" / f"abb_plate_{trial}"
        summary = replay(bag, out, values, options)
        with (out / "estimates.csv").open() as file:
            rows = [
                (float(r["predicted_fz"]), float(r["compensated_fz"])) for r in csv.DictReader(file) if not r["reason"]
            ]
        predicted, measured = np.array(rows).T
        sinking = predicted < -0.5  # z points down: the sand pushes up
        found[trial] = summary, predicted[sinking] / values["medium.zeta"], measured[sinking]
    return found


def fitted_zeta(replays, trial):
    _, per_zeta, measured = replays[trial]
    return (per_zeta @ measured) / (per_zeta @ per_zeta)


def residual_of_peak(replays, trial, zeta):
    _, per_zeta, measured = replays[trial]
    return np.sqrt(np.mean((measured - zeta * per_zeta) ** 2)) / np.abs(measured).max()


@pytest.mark.parametrize(("trial", "poses"), [(2, 7378), (3, 7017)])
def test_every_pose_is_an_estimate_or_a_reason(replays, trial, poses):
    summary = replays[trial][0]
    assert summary.messages["pose"] == poses
    assert summary.estimates + sum(summary.reasons.values()) == poses
    assert set(summary.reasons) == {"at_rest", "pose_history_short"}
    assert summary.damage is None


@pytest.mark.parametrize("trial", [2, 3])
def test_the_bias_is_what_the_load_cell_reads_in_the_air(replays, trial):
    assert replays[trial][0].bias[2] == pytest.approx(1.81, abs=0.03)


def test_zeta_of_each_trial(replays):
    assert fitted_zeta(replays, 2) == pytest.approx(1.18, abs=0.01)
    assert fitted_zeta(replays, 3) == pytest.approx(1.03, abs=0.01)


@pytest.mark.parametrize(("fitted", "predicted", "percent"), [(2, 3, 9.4), (3, 2, 8.3), (2, 2, 2.1), (3, 3, 3.6)])
def test_one_trials_zeta_predicts_the_others_penetration_within_15_percent(replays, fitted, predicted, percent):
    """RMS of the vertical residual over the peak."""
    ratio = residual_of_peak(replays, predicted, fitted_zeta(replays, fitted))
    assert ratio < 0.15
    assert 100.0 * ratio == pytest.approx(percent, abs=0.3)
