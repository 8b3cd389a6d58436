"""Turns in the grains are found, and λ is fitted with the forces that the node computes."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic_track import REST, TOOL, Path, law, track_of

from rft_ros.calibration.memory_length import forces_in_time
from rft_ros.calibration.segments import turns_in_grains
from rft_ros.estimator import Estimate, Estimator, Model, PoseSample, Settings, TwistSample

UPRIGHT = Rotation.from_euler("x", 90, degrees=True)


def still_readings(path):
    time, states = path.states()
    return track_of(time, states, np.zeros((len(time), 6)))


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
    track = still_readings(path)
    found = [track.time[turn.at] for turn in turns_in_grains(track, 0.0)]
    assert found == pytest.approx(seconds, abs=0.1)


def test_the_forces_are_those_of_the_estimator():
    """A fitted λ suits the node only if the fit uses the forces that the node computes."""
    path = Path((0.0, 0.0, 0.02)).move((0.0, 0.0, -0.05), 0.01).wait(0.5).move((0.02, 0.0, 0.01), 0.01)
    track = still_readings(path)
    settings = Settings(surface_height=0.0, rest_speed=REST)
    model = Model(tool=TOOL, law=law(0.8), medium="generic", zeta=0.8, alpha_y="constant", mobilization_length=0.003)
    estimator = Estimator(settings, model)
    predicted = []
    for t, state in zip(track.time, track.states, strict=True):
        stamp = 10**12 + round(t * 1e9)
        estimator.push_twist(TwistSample(stamp, "world", tuple(state[7:10]), tuple(state[10:13])))
        answer = estimator.push_pose(PoseSample(stamp, "world", tuple(state[:3]), tuple(state[3:7])))
        assert isinstance(answer, Estimate)
        predicted.append(answer.predicted[:3])
    forces = forces_in_time(track, law(0.8), first=0, last=len(track.time) - 1, length=0.003, surface=0.0)
    assert np.abs(forces).max() > 10.0
    assert np.allclose(forces, predicted, rtol=1e-9, atol=1e-9)
