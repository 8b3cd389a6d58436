"""The ABB recordings, replayed with the shipped file: a real plate in real sand; `test_calibration.py` adds memory."""

from pathlib import Path

import numpy as np
import pytest

from rft_ros.bags.options import read_replay_options
from rft_ros.bags.replay import replay
from rft_ros.parameters import read_parameter_file

FILE = Path(__file__).resolve().parents[2] / "config" / "abb_plate.yaml"
POSES = {2: 7378, 3: 7017}


@pytest.fixture(scope="module")
def runs(shared_data, tmp_path_factory):
    """Of each trial: summary; of the poses of the penetration, prediction per ζ and measured downward force [N]."""
    found = {}
    values = {**read_parameter_file(FILE).values, "medium.mobilization_length": 0.0}
    for trial in POSES:
        folder = tmp_path_factory.mktemp("abb")
        summary = replay(
            shared_data / "abb_plate" / f"abb_plate_{trial}",
            folder,
            values,
            read_replay_options(FILE),
        )
        table = np.genfromtxt(
            folder / "estimates.csv", delimiter=",", names=True, dtype=None, encoding="utf-8"
        )
        sinking = table[table["predicted_fz"] < -0.5]  # z points down: the sand pushes up
        found[trial] = (
            summary,
            sinking["predicted_fz"] / values["medium.zeta"],
            sinking["compensated_fz"],
        )
    return found


@pytest.mark.parametrize("trial", POSES)
def test_every_pose_has_an_estimate_or_a_reason_and_the_bias_is_the_reading_in_the_air(
    runs, trial
):
    summary, *_ = runs[trial]
    assert summary.messages["pose"] == POSES[trial]
    assert summary.estimates + sum(summary.reasons.values()) == POSES[trial]
    assert set(summary.reasons) == {"at_rest", "pose_history_short"}
    assert summary.reasons["at_rest"] > 1000
    assert summary.damage is None
    assert summary.bias[2] == pytest.approx(1.81, abs=0.03)


@pytest.mark.parametrize(
    ("fitted", "zeta", "percents"), [(2, 1.18, {2: 2.1, 3: 9.4}), (3, 1.03, {2: 8.3, 3: 3.6})]
)
def test_one_trials_zeta_predicts_the_others_penetration_within_15_percent(
    runs, fitted, zeta, percents
):
    """RMS of the vertical residual over the peak."""
    _, per_zeta, measured = runs[fitted]
    found = (per_zeta @ measured) / (per_zeta @ per_zeta)
    assert found == pytest.approx(zeta, abs=0.01)
    for trial, percent in percents.items():
        _, per_zeta, measured = runs[trial]
        rms = np.sqrt(np.mean((measured - found * per_zeta) ** 2))
        assert 100.0 * rms / np.abs(measured).max() == pytest.approx(percent, abs=0.3)
