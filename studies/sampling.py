"""Sampling a motion: the error of the force with differenced poses, and the work over the time step."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.integrate import trapezoid
from scipy.spatial.transform import Rotation

from rft_ros.estimator import PoseDifference, PoseSample
from rft_ros.parameters import InputsConfig
from rft_ros.rft import POSITION, QUATERNION, TWIST, Plates, wrenches
from rft_ros.sweeps.motions import Trajectory, oscillating_insertion, sample, straight
from studies.paper import law
from studies.parameter_sweep import Array, shipped
from studies.result import StudyResult, TextTable

__all__ = [
    "Work",
    "WorkConvergence",
    "differenced",
    "window",
    "work",
    "work_convergence",
    "work_of",
]

_NOISE = 1e-5  # of each coordinate of a pose [m]; its attitude has this at 100 mm from the flange
_RATES = (125.0, 500.0, 1000.0)  # Hz
_WINDOWS = (0.05, 0.1, 0.2, 0.5)  # s


def differenced(states: Array, rate: float, width: float) -> Array:
    """The states with twists from the estimator's pose differencing; zero until it has three poses."""
    difference = PoseDifference()
    gap = InputsConfig().max_age
    out = states.copy()
    out[:, TWIST] = 0.0
    for k, row in enumerate(states):
        stamp = 1 + round(k * 1e9 / rate)
        pose = PoseSample(
            stamp, "world", tuple(row[POSITION].tolist()), tuple(row[QUATERNION].tolist())
        )
        if difference.push(pose, window=width, gap=gap):
            out[k, TWIST] = difference.twist
    return out


def _with_noise(states: Array, random: np.random.Generator) -> Array:
    out = states.copy()
    out[:, POSITION] += random.normal(0.0, _NOISE, (len(states), 3))
    turned = Rotation.from_rotvec(random.normal(0.0, _NOISE / 0.1, (len(states), 3)))
    out[:, QUATERNION] = (turned * Rotation.from_quat(states[:, QUATERNION])).as_quat()
    return out


def _error(motion: Trajectory, plates: Plates, rate: float, width: float) -> float:
    """RMS error of the force with twists from noisy poses, over the RMS force with true twists."""
    step = 1.0 / rate
    states = motion.at(step * np.arange(int(motion.duration / step + 1e-9) + 1))
    shaken = differenced(_with_noise(states, np.random.default_rng(0)), rate, width)
    settled = slice(int(max(_WINDOWS) * rate) + 1, None)
    true, found = (wrenches(plates, law("constant"), s)[settled, :3] for s in (states, shaken))
    return float(np.linalg.norm(found - true) / np.linalg.norm(true))


def window() -> StudyResult:
    """The error over the window and the rate."""
    ellipsoid = oscillating_insertion(start_height=-0.03, travel=0.02)
    cases = {
        "ellipsoid that pitches by ±9° at 0.625 Hz and sinks at 5 mm/s": (
            ellipsoid,
            shipped("ellipsoid"),
        ),
        "plate that moves down at 10 mm/s": (
            straight(start_height=-0.01, travel=0.03),
            shipped("plate"),
        ),
    }
    rows = []
    for name, (motion, tool) in cases.items():
        for width in _WINDOWS:
            errors = (100.0 * _error(motion, tool["refined"], rate, width) for rate in _RATES)
            rows.append((name, f"{width:g} s", *(f"{error:.2g}" for error in errors)))
    return StudyResult(
        name="fails_window",
        title="Noise of differenced poses",
        figure=None,
        table=TextTable(
            header=(
                "error of the force [%]",
                "`twist_window`",
                *(f"{rate:,.0f} Hz" for rate in _RATES),
            ),
            rows=tuple(rows),
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WorkConvergence:
    """Relative errors of the total work over time steps [s], shape [n] both, and the order of convergence."""

    steps: Array
    errors: Array
    order: float


class Work(NamedTuple):
    """Work done on the grains [J], positive where they resist, by the vertical force alone and in total."""

    vertical: float
    total: float


def work(times: Array, states: Array, wrenches: Array) -> Work:
    """Work over a motion: times [s], states, shape [n, 13], wrenches, shape [n, 6 or more] [N, N m], world axes."""
    by_component = trapezoid(-wrenches[:, :6] * states[:, TWIST], times, axis=0)
    return Work(float(by_component[2]), float(by_component.sum()))


def work_of(plates: Plates, motion: Trajectory, samples: int) -> Work:
    """Work of a motion; α_y constant."""
    times, states = sample(motion, samples)
    return work(times, states, wrenches(plates, law("constant"), states))


def work_convergence(
    plates: Plates, motion: Trajectory, intervals: Sequence[int]
) -> WorkConvergence:
    """Errors of the work with numbers of time steps, against eight times the last of them."""
    exact = work_of(plates, motion, 8 * intervals[-1] + 1).total
    errors = np.array([abs(work_of(plates, motion, n + 1).total / exact - 1.0) for n in intervals])
    steps = motion.duration / np.array(intervals)
    order = float(np.polyfit(np.log(steps), np.log(np.maximum(errors, 1e-16)), 1)[0])
    return WorkConvergence(steps=steps, errors=errors, order=order)
