"""Known parameters come back from noisy synthetic recordings: within three standard errors in 38 of 40 trials."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from synthetic_track import (
    GENERIC,
    LOAD_CELL,
    NOISE,
    Path,
    differenced,
    grain_wrenches,
    known,
    law,
    noisy,
    read_by,
    shaken,
    track_of,
)

from rft_ros.calibration.calibrate import calibrate
from rft_ros.calibration.fitting import Measurement
from rft_ros.calibration.grains import difference, spread_of
from rft_ros.calibration.smoothing import interpolated
from rft_ros.calibration.track import turns_in_grains
from rft_ros.rft import Agarwal2023, treers2021
from rft_ros.tool import load_tool

UPRIGHT = Rotation.from_euler("x", 90, degrees=True)
SURFACE, ZETA, LENGTH = 0.0123, 0.8, 0.003


@pytest.fixture(autouse=True)
def _without_the_judge(monkeypatch):
    """It takes seconds for each of hundreds of trials, and changes no fitted value."""
    monkeypatch.setattr("rft_ros.calibration.calibrate.judge_fitted", lambda *_: None)


def assert_recovered(fit, exact, truth, *, count=40):
    """Of seeded trials of noise on the `exact` readings, each number of `truth` lies in 95 % within 3 errors."""
    trials = [
        {f.name: f for f in fit(noisy(exact, np.random.default_rng(k), NOISE))}
        for k in range(count)
    ]
    for name, values in truth.items():
        off = [
            np.abs(np.subtract(t[name].values, values)) / t[name].errors if name in t else np.inf
            for t in trials
        ]
        assert (np.mean(np.array(off) <= 3.0, axis=0) >= 0.95).all(), name


def test_the_mobilization_length_is_recovered_from_a_start_from_rest(tmp_path):
    trimesh.creation.box((50.0, 30.0, 5.0)).export(tmp_path / "blade.stl")
    blade = load_tool(str(tmp_path / "blade.stl"))
    time, states = Path((0, 0, -0.03), UPRIGHT).wait(0.3).move((0, 0.015, 0), 0.01).states()
    grains = grain_wrenches(time, states, law(ZETA), surface=0.0, length=LENGTH, tool=blade)

    def fit(readings):
        track = track_of(time, states, readings, tool=blade)
        return calibrate([track], known(), parts=("mobilization",)).fitted_values

    assert_recovered(
        fit,
        read_by(LOAD_CELL, states, grains),
        {"medium.mobilization_length": (LENGTH,)},
        count=160,
    )


def test_a_late_force_has_the_attitude_in_which_it_was_felt():
    turn = Rotation.from_euler("z", 90, degrees=True)
    time, states = Path((0.0, 0.0, 0.0)).turn_to(turn, seconds=2.0).states(1000.0)
    along_x = np.tile((5.0, 0.0, 0.0, 0.0, 0.0, 0.0), (len(time), 1))
    readings = interpolated(time - 0.1, time, read_by(LOAD_CELL, states, along_x))
    track = replace(track_of(time, states, readings), cell=LOAD_CELL).without_delay(0.1)
    np.testing.assert_allclose(track.forces[:-100], along_x[:-100, :3], atol=1e-3)


@pytest.mark.parametrize(
    ("path", "seconds"),
    [
        (Path((0, 0, 0.02)).move((0, 0, -0.05), 0.01).move((0, 0, 0.04), 0.01), [5.0]),
        (Path((0, 0, 0.02)).move((0, 0, -0.05), 0.01).wait(2.0).move((0, 0, 0.04), 0.01), [5.0]),
        (Path((0, 0, 0.02)).move((0, 0, -0.05), 0.01).wait(2.0).move((0, 0, -0.02), 0.01), []),
        (
            Path((0, 0, 0.02))
            .move((0, 0, -0.05), 0.01)
            .move((0.03, 0, 0), 0.01)
            .move((0, 0, 0.03), 0.01),
            [5.0, 8.0],
        ),
        (Path((0, 0, 0.02)).move((0, 0, -0.05), 0.01).move((0.02, 0, -0.02), 0.01), []),
        (Path((0, 0, -0.03), UPRIGHT).wait(1.0).move((0, 0.03, 0), 0.01), [1.0]),
        (Path((0, 0, 0.06)).move((0, 0, -0.04), 0.01).move((0, 0, 0.04), 0.01), []),
    ],
    ids=[
        "turn",
        "rest and turn",
        "pause",
        "two turns",
        "45 degrees",
        "start in the grains",
        "in the air",
    ],
)
def test_turns_are_found_where_the_tool_turns_in_the_grains(path, seconds):
    time, states = path.states()
    track = track_of(time, states, np.zeros((len(time), 6)))
    found = [float(turn.where.split()[1]) for turn in turns_in_grains(track, 0.0)]
    assert found == pytest.approx(seconds, abs=0.1)


def test_velocities_from_poses_give_lambda_within_15_percent():
    """3 mm; a turn to the side at 10 mm/s, the grains computed at 1 kHz and the poses taken at 125 Hz."""
    path = Path((0, 0, 0.03)).move((0, 0, -0.06), 0.01).move((0.015, 0, -0.002), 0.01)
    time, states = path.states(1000.0)
    grains = grain_wrenches(time, states, law(0.8), surface=0.0, length=0.003)
    time, states, grains = time[3::8], states[3::8], grains[3::8]
    rng = np.random.default_rng(1)
    poses = shaken(states, rng, 3e-6, 3e-5)
    poses = differenced(time, poses)
    track = track_of(time, poses, read_by(LOAD_CELL, states, grains, rng, noise=NOISE))
    (found,) = calibrate([track], known(), parts=("mobilization",)).fitted_values
    assert found.values[0] == pytest.approx(0.003, rel=0.15)
    assert abs(found.values[0] - 0.003) < 3.0 * found.errors[0]


@pytest.mark.parametrize(
    ("zetas", "error", "sizes", "told"),
    [
        ((1.0, 1.2), 0.01, (60, 60), False),
        ((1.0, 1.5), 0.01, (60, 60), True),
        ((1.0, 1.31, 1.62), 0.01, (60, 80, 100), True),
        (
            (1.3, 1.58, 1.85),
            0.13,
            (60, 80, 100),
            True,
        ),  # 2.98 errors apart are enough where ζ follows the size
        ((1.3, 1.58, 1.85), 0.13, (80, 80, 80), False),
    ],
)
def test_penetrations_whose_zeta_differs_are_told(zetas, error, sizes, told):
    found = [Measurement("a", zeta, error, 0.0) for zeta in zetas]
    assert (difference(found, [1e-3 * size for size in sizes]) != "") == told
    growing = [1e-3 * size for size in sorted(sizes, reverse=True)]
    assert ("ζ grows with the tool's size, 60 to 100 mm" in difference(found, growing[::-1])) == (
        told and sizes[0] < sizes[-1]
    )
    assert "grows" not in difference(found, growing)


def test_the_spread_of_zeta_covers_the_tools():
    found = [Measurement("a", zeta, 0.01, 0.0) for zeta in (1.0, 1.31, 1.62)]
    assert spread_of(found, ["a", "b", "c"]) == pytest.approx(0.31)
    assert spread_of(found[:1], ["a"]) == 0.0


@pytest.mark.parametrize("second", [False, True], ids=["treers2021", "agarwal2023"])
def test_the_grains_inertia_is_not_taken_for_strength_or_depth(second):
    """At 0.5 m/s it is a fifth of the force; without it the surface rises by 2.7 mm."""
    time, states = (
        Path((0.0, 0.0, 0.03)).wait(1.0).move((0.0, 0.0, -0.09), 0.5).wait(1.0).states(1000.0)
    )
    density = {"density": 1500.0}
    grains = (
        Agarwal2023(zeta=0.4, **density)
        if second
        else treers2021(GENERIC, law().alpha_y, zeta=0.4, **density)
    )
    readings = read_by(LOAD_CELL, states, grain_wrenches(time, states, grains, surface=SURFACE))
    values = known(medium__density=1500.0, law="agarwal2023" if second else "treers2021")
    result = calibrate([track_of(time, states, readings)], values)
    found = {f.name: f.values[0] for f in result.fitted_values}
    assert found["surface_height"] == pytest.approx(SURFACE, abs=2e-4)
    assert found["medium.zeta"] == pytest.approx(0.4, rel=0.01)
