"""Turns in the grains are found, and λ is fitted with the forces that the node computes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic_track import LOAD_CELL, Path, grain_wrenches, law, read_by, shaken, track_of

from rft_ros.calibration.memory_length import fit_memory_length
from rft_ros.calibration.tool_weight import Sensor
from rft_ros.calibration.track import turns_in_grains
from rft_ros.estimator import PoseSample
from rft_ros.estimator.motion import PoseDifference

UPRIGHT = Rotation.from_euler("x", 90, degrees=True)


@pytest.mark.parametrize(
    ("path", "seconds"),
    [
        (Path((0, 0, 0.02)).move((0, 0, -0.05), 0.01).move((0, 0, 0.04), 0.01), [5.0]),
        (Path((0, 0, 0.02)).move((0, 0, -0.05), 0.01).wait(2.0).move((0, 0, 0.04), 0.01), [5.0]),
        (Path((0, 0, 0.02)).move((0, 0, -0.05), 0.01).wait(2.0).move((0, 0, -0.02), 0.01), []),
        (Path((0, 0, 0.02)).move((0, 0, -0.05), 0.01).move((0.03, 0, 0), 0.01).move((0, 0, 0.03), 0.01), [5.0, 8.0]),
        (Path((0, 0, 0.02)).move((0, 0, -0.05), 0.01).move((0.02, 0, -0.02), 0.01), []),
        (Path((0, 0, -0.03), UPRIGHT).wait(1.0).move((0, 0.03, 0), 0.01), [1.0]),
        (Path((0, 0, 0.06)).move((0, 0, -0.04), 0.01).move((0, 0, 0.04), 0.01), []),
    ],
    ids=["turn", "rest and turn", "pause", "two turns", "45 degrees", "start in the grains", "in the air"],
)
def test_turns_are_found_where_the_tool_turns_in_the_grains(path, seconds):
    time, states = path.states()
    track = track_of(time, states, np.zeros((len(time), 6)))
    found = [track.time[turn.at] for turn in turns_in_grains(track, 0.0)]
    assert found == pytest.approx(seconds, abs=0.1)


@pytest.mark.parametrize(
    "path",
    [
        Path((0, 0, 0.03)).move((0, 0, -0.075), 0.01).move((0, 0, 0.02), 0.01),
        Path((0, 0, 0.03)).move((0, 0, -0.06), 0.01).move((0.015, 0, -0.002), 0.01),
    ],
    ids=["reversal", "turn to the side"],
)
def test_velocities_from_poses_give_lambda_within_15_percent(path, monkeypatch):
    """3 mm; turns at 10 mm/s, the grains computed at 1 kHz and the poses taken at 125 Hz."""
    monkeypatch.setattr("synthetic_track.RATE", 1000.0)
    time, states = path.states()
    grains = grain_wrenches(time, states, law(0.8), surface=0.0, length=0.003)
    time, states, grains = time[3::8], states[3::8], grains[3::8]
    rng = np.random.default_rng(1)
    poses = shaken(states, rng, 3e-6, 3e-5)
    difference = PoseDifference()
    difference.span(window=0.2, max_age=0.1)
    for row, t in zip(poses, time, strict=True):
        stamp = 1 + round(1e9 * t)
        known = difference.push(PoseSample(stamp, "world", tuple(row[:3].tolist()), tuple(row[3:7].tolist())))
        row[7:13] = difference.twist if known else 0.0
    track = track_of(time, poses, read_by(LOAD_CELL, states, grains, rng, noise=(0.1, 0.002)))
    found = fit_memory_length([track], Sensor(LOAD_CELL), law(), surface=0.0)
    assert found.values[0] == pytest.approx(0.003, rel=0.15)
