"""The families of motion: the twist is the pose's derivative, and they contain the motions of the reference data."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rft_ros.errors import InputError
from rft_ros.rft import POSITION, checked_states
from rft_ros.sweeps.design import motion_of
from rft_ros.sweeps.motions import (
    FAMILIES,
    circumnutation,
    oscillating_insertion,
    plate_drag,
    sample,
    straight,
)

DATA = Path(__file__).resolve().parents[1] / "data" / "dem"
MOTIONS = [
    straight(descent_deg=60.0, heading_deg=25.0, tilt_deg=10.0, yaw_deg=-40.0, start_height=0.02),
    straight(descent_deg=-90.0),
    plate_drag(psi_deg=30.0, beta_deg=60.0, phi_deg=30.0),
    oscillating_insertion(),
    oscillating_insertion(frequency=5.0, speed=0.04),
    circumnutation(),
    circumnutation(tilt_deg=20.0, pitch=0.167, rate_deg_s=-15.0),
]


@pytest.mark.parametrize("motion", MOTIONS)
def test_the_twist_is_the_derivative_of_the_pose(motion):
    times = np.linspace(0.0, motion.duration, 50)
    h = 1e-5
    before, now, after = (motion.at(times + shift) for shift in (-h, 0.0, h))
    assert (after[:, :3] - before[:, :3]) / (2 * h) == pytest.approx(now[:, 7:10], abs=1e-9)
    turned = Rotation.from_quat(after[:, 3:7]) * Rotation.from_quat(before[:, 3:7]).inv()
    assert turned.as_rotvec() / (2 * h) == pytest.approx(now[:, 10:13], abs=1e-7)
    assert checked_states(now) == pytest.approx(now, abs=1e-15)


@pytest.mark.parametrize("motion", MOTIONS)
def test_samples_run_from_the_start_to_the_end(motion):
    times, states = sample(motion, 7)
    assert (times[0], times[-1]) == (0.0, motion.duration)
    assert states[-1, POSITION] - states[0, POSITION] == pytest.approx(
        motion.duration * np.array(motion.velocity)
    )


def test_circumnutation_gives_the_85_states_of_the_released_code(shared_data):
    rows = np.loadtxt(
        shared_data / "paper" / "circumnutation_P40_states.csv", delimiter=",", skiprows=1
    )
    assert rows[:, 0] == pytest.approx(0.25 * np.arange(85), abs=1e-12)
    states = circumnutation(tilt_deg=10.0, pitch=0.04).at(rows[:, 0])
    assert states == pytest.approx(rows[:, 1:], abs=1e-14)


@pytest.mark.parametrize(
    ("run", "motion"),
    [
        ("pen_plate_seedA", straight(speed=0.1)),
        ("plate_b60_psi30_phi30", plate_drag(beta_deg=60, psi_deg=30, phi_deg=30, speed=0.1)),
        (
            "plate_b90_psi90_phi0",
            plate_drag(beta_deg=90, psi_deg=90, phi_deg=0, speed=0.1, depth=0.035),
        ),
        ("ellipsoid_osc9deg_5Hz", oscillating_insertion(frequency=5.0, speed=0.04)),
        ("root_insert_tilt10", straight(speed=0.1, tilt_deg=10.0)),
        ("root_helix_P40_tilt10", circumnutation(pitch=0.04, rate_deg_s=540.0)),
    ],
)
def test_the_families_contain_the_simulated_runs(run, motion):
    """Apart from where they start, to the seven digits of the files."""
    rows = np.loadtxt(DATA / f"{run}.csv", delimiter=",", skiprows=1)
    rows = rows[np.any(rows[:, 8:14] != 0.0, axis=1)]
    states = motion.at(rows[:, 0])
    shift = rows[:, 1:4] - states[:, POSITION]
    assert shift == pytest.approx(np.tile(shift[0], (len(rows), 1)), abs=2e-7)
    assert states[:, 3:] == pytest.approx(rows[:, 4:14], abs=1e-6)


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("value", [0.0, -0.01, float("nan"), float("inf")])
def test_a_travel_that_is_not_positive_is_refused_and_any_other_is_travelled(family, value):
    with pytest.raises(InputError, match=f"travel is {value}; it must be a number from 1e-09 to"):
        motion_of({"family": family, "travel": value})
    motion, _ = motion_of({"family": family, "travel": 0.02})
    assert motion.duration * np.linalg.norm(motion.velocity) == pytest.approx(0.02)


def test_a_helix_that_does_not_turn_is_refused():
    with pytest.raises(InputError, match="rate_deg_s is 0"):
        circumnutation(rate_deg_s=0.0)
