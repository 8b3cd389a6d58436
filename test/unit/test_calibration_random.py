"""Surface, ζ and λ of random recordings lie within three of their standard errors in at least 95 % of the cases."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation
from synthetic_track import LOAD_CELL, ORIENTATIONS, TOOL, Path, law, read_by, shaken, track_of, unknown

from rft_ros.calibration.calibrate import calibrate
from rft_ros.estimator import PoseSample
from rft_ros.estimator.motion import PoseDifference
from rft_ros.rft import Memory, wrenches_in_time

NAMES = ("surface_height", "medium.zeta", "medium.mobilization_length")
KINDS = {
    "noise of 0.02 N": (10, {"noise": 0.02}),
    "noise of 0.3 N": (4, {"noise": 0.3}),
    "differenced poses": (5, {"noise": 0.02, "rate": 125.0, "place": 3e-6, "turn": 3e-5}),
    "tilted, at once back up": (3, {"noise": 0.05, "rate": 125.0, "tilt": 20.0, "rest": 0.0}),
}
"""22 recordings."""


def differenced(time, states):
    """The states with the velocities that the estimator finds from the poses."""
    difference = PoseDifference()
    difference.span(window=0.2, max_age=0.1)
    for row, t in zip(states, time, strict=True):
        pose = PoseSample(1 + round(1e9 * t), "world", tuple(row[:3].tolist()), tuple(row[3:7].tolist()))
        row[7:13] = difference.twist if difference.push(pose) else 0.0
    return states


def recording(seed, *, noise, rate=100.0, place=0.0, turn=0.0, tilt=0.0, rest=1.0):
    """Tilts in the air, straight down into grains with memory, a rest, and up; and the truth."""
    rng = np.random.default_rng(seed)
    zeta, length, surface = rng.uniform(0.3, 1.5), rng.uniform(0.001, 0.006), rng.uniform(-0.01, 0.02)
    depth, speed = rng.uniform(0.02, 0.05), rng.uniform(0.005, 0.015)
    path = Path((0.3, 0.1, surface - float(TOOL.corners[:, 2].min()) + 0.06))
    for angles in (*ORIENTATIONS, (tilt, 0.4 * tilt, 0.0)):
        path.turn_to(Rotation.from_euler("xyz", angles, degrees=True)).wait(0.8)
    path.move((0.0, 0.0, -0.06 - depth), speed)
    if rest:
        path.wait(rest)
    time, states = path.move((0.0, 0.0, 0.01 + depth), speed).states(rate)
    grains = replace(law(zeta), mobilization_length=length)
    durations = np.diff(time, prepend=0.0)
    force = wrenches_in_time(TOOL.plates, grains, states, durations, Memory(TOOL.plates), surface_height=surface)
    readings = read_by(LOAD_CELL, states, force, rng, noise=(noise, noise / 50.0))
    if place:
        states = differenced(time, shaken(states, rng, place, turn))
    return track_of(time, states, readings), (surface, zeta, length)


def test_the_truth_lies_within_three_standard_errors_of_random_recordings():
    """18 % of the cases did while the surface and ζ were fitted without memory: at most by 17, 9 and 22 errors."""
    scores = []
    for first, (count, given) in enumerate(KINDS.values()):
        for seed in range(count):
            track, truth = recording(1000 * first + seed, **given)
            found = {f.name: f for f in calibrate([track], unknown()).fitted}
            scores += [abs(found[n].values[0] - t) / found[n].errors[0] for n, t in zip(NAMES, truth, strict=True)]
    assert len(scores) == 66
    assert np.mean(np.array(scores) <= 3.0) >= 0.95
    assert max(scores) < 6.0
