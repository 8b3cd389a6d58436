"""Errors from sampling a motion: noise and delay of differenced poses, and work over the time step."""

from collections.abc import Sequence
from dataclasses import astuple, dataclass
from typing import NamedTuple

import numpy as np
from scipy.integrate import trapezoid
from scipy.spatial.transform import Rotation

from rft_ros.estimator import PoseSample
from rft_ros.estimator.pose_difference import PoseDifference
from rft_ros.parameters import Settings
from rft_ros.rft import ANGULAR_VELOCITY, INTEGRATIONS, QUATERNION, TWIST, VELOCITY, Integration, Plates, wrenches
from rft_ros.sweeps.motions import Trajectory, circumnutation, oscillating_insertion, sample, straight
from studies.paper import law
from studies.parameter_sweep import RULE_COLOUR, Array, shipped
from studies.result import BLACK, BLUE, GREY, ORANGE, VERMILION, StudyResult, label_axes, new_figure, result_of_rows

__all__ = ["NOISE", "RATES", "STROKES", "WINDOWS", "Error", "Work", "WorkConvergence", "differenced"]
__all__ += ["measured_errors", "sample_every", "stroke_convergence", "time_step", "window", "work"]
__all__ += ["work_convergence", "work_of"]

NOISE = 1e-5
"""Noise of each coordinate of a pose [m]; its attitude has this at 100 mm from the flange: 1e-4 rad."""

RATES = (125.0, 500.0, 1000.0)
"""Rates of the poses [Hz]."""

WINDOWS = (0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5)
"""Longest time spans of the fitted curve [s]."""

_ATTITUDE_NOISE = NOISE / 0.1

_COLOURS = {125.0: ORANGE, 500.0: BLUE, 1000.0: VERMILION}


@dataclass(frozen=True, slots=True, kw_only=True)
class Error:
    """RMS error of the force with differenced twists, over the RMS force with true twists.

    `noise`: noisy against true poses, same window. `lag`: true poses against true twists. `both`: noisy poses against
    true twists. `moves_at_rest`: share of ticks at rest whose fastest point exceeds `rest_speed`.
    `rest_speed_needed`: 99th percentile of that apparent speed [m/s].
    """

    motion: str
    rate: float
    window: float
    noise: float
    lag: float
    both: float
    moves_at_rest: float
    rest_speed_needed: float


def _motions() -> dict[str, tuple[Trajectory, Plates]]:
    return {
        "plate, down at 10 mm/s": (straight(start_height=-0.01, travel=0.03), shipped("plate")["refined"]),
        "ellipsoid, 5 mm/s, ±9° at 0.625 Hz": (
            oscillating_insertion(start_height=-0.03, travel=0.02),
            shipped("ellipsoid")["refined"],
        ),
    }


def sample_every(motion: Trajectory, step: float) -> tuple[Array, Array]:
    """Times 0, step, 2 step .. up to the end [s], shape [n], and states, shape [n, 13]."""
    times = np.arange(int(motion.duration / step + 1e-9) + 1, dtype=np.float64) * step
    return times, motion.at(times)


def measured_errors(*, seed: int = 0) -> list[Error]:
    """Every motion at every rate with every window."""
    errors = []
    for name, (motion, plates) in _motions().items():
        for rate in RATES:
            _, states = sample_every(motion, 1.0 / rate)
            random = np.random.default_rng(seed)
            noisy = _with_noise(states, random)
            still = _with_noise(np.repeat(states[-1:], len(states), axis=0), random)
            true = _force(plates, states)
            first = _settled(rate)
            scale = _rms(true[first:])
            for width in WINDOWS:
                smooth = _force(plates, differenced(states, rate, width))
                shaken = _force(plates, differenced(noisy, rate, width))
                apparent = _fastest(differenced(still, rate, width)[first:], plates.reach)
                errors.append(
                    Error(
                        motion=name,
                        rate=rate,
                        window=width,
                        noise=_rms((shaken - smooth)[first:]) / scale,
                        lag=_rms((smooth - true)[first:]) / scale,
                        both=_rms((shaken - true)[first:]) / scale,
                        moves_at_rest=float((apparent >= Settings().rest_speed).mean()),
                        rest_speed_needed=float(np.percentile(apparent, 99.0)),
                    )
                )
    return errors


def differenced(states: Array, rate: float, width: float) -> Array:
    """The states with twists from the estimator's pose differencing; zero until it has three poses."""
    difference = PoseDifference()
    difference.span(window=width, max_age=Settings().max_input_age)
    out = states.copy()
    out[:, 7:13] = 0.0
    for k, row in enumerate(states):
        stamp = 1 + round(k * 1e9 / rate)
        if difference.push(PoseSample(stamp, "world", tuple(row[:3].tolist()), tuple(row[QUATERNION].tolist()))):
            out[k, 7:13] = difference.twist
    return out


def _with_noise(states: Array, random: np.random.Generator) -> Array:
    out = states.copy()
    out[:, :3] += random.normal(0.0, NOISE, (len(states), 3))
    turned = Rotation.from_rotvec(random.normal(0.0, _ATTITUDE_NOISE, (len(states), 3)))
    out[:, QUATERNION] = (turned * Rotation.from_quat(states[:, QUATERNION])).as_quat()
    return out


def _settled(rate: float) -> int:
    """The first pose at which every window is full."""
    return int(max(WINDOWS) * rate) + 1


def _force(plates: Plates, states: Array) -> Array:
    return wrenches(plates, law("constant"), states)[:, :3]


def _rms(vectors: Array) -> float:
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))


def _fastest(states: Array, reach: float) -> Array:
    """The speed that the estimator compares with `rest_speed` [m/s]."""
    return np.asarray(
        np.linalg.norm(states[:, VELOCITY], axis=1) + reach * np.linalg.norm(states[:, ANGULAR_VELOCITY], axis=1)
    )


def window() -> StudyResult:
    """Lag and noise of the force over the window; the table also has the poses at rest that count as motion."""
    errors = measured_errors()
    motions = list(dict.fromkeys(error.motion for error in errors))
    figure = new_figure(8.4, 3.6)
    panels = figure.subplots(1, 2)
    for axes, motion in zip(panels, motions, strict=True):
        for rate in RATES:
            mine = [e for e in errors if e.motion == motion and e.rate == rate]
            axes.loglog(
                WINDOWS, [100.0 * e.both for e in mine], "o-", ms=3, color=_COLOURS[rate], label=f"{rate:.0f} Hz"
            )
        label_axes(axes, x="Window [s]", y="RMS error of the force [%]", title=motion, legend={})
    for axes in panels:
        axes.axvline(Settings().twist_window, color=GREY, lw=1.0)
        axes.minorticks_off()
        axes.set_xticks((0.05, 0.1, 0.2, 0.5), ("0.05", "0.1", "0.2", "0.5"))
        low, high = axes.get_ylim()
        axes.set_yticks(*zip(*((y, f"{y:g}") for y in (0.1, 0.3, 1.0, 3.0, 10.0, 30.0) if low < y < high), strict=True))
        axes.title.set_fontsize(9)
    figure.suptitle(f"Twist from poses with noise of {1e6 * NOISE:.0f} µm; grey: the default window", fontsize=10)
    return result_of_rows(
        "fails_window",
        "Noise of differenced poses",
        figure,
        [astuple(e) for e in errors],
        ("motion", "motion", "{}"),
        ("rate", "rate_hz", "{:.0f} Hz"),
        ("window", "window_s", "{:.0f} ms", 1e3),
        ("noise alone", "noise", "{:.2g} %", 100.0),
        ("lag alone", "lag", "{:.2g} %", 100.0),
        ("both", "both", "{:.2g} %", 100.0),
        ("at rest, taken for motion", "moves_at_rest", "{:.2g} %", 100.0),
        ("apparent speed at rest", "rest_speed_needed_m_s", "{:.2g} mm/s", 1e3),
    )


STROKES: dict[str, tuple[str, Trajectory]] = {
    "ellipsoid, oscillating, from the surface": ("ellipsoid", oscillating_insertion(travel=0.032)),
    "root tip, helix of 40 mm": ("root_tip", circumnutation()),
}
"""A shipped mesh and a motion, by name."""


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


def work_convergence(plates: Plates, motion: Trajectory, intervals: Sequence[int]) -> WorkConvergence:
    """Errors of the work with numbers of time steps, against eight times the last of them."""
    exact = work_of(plates, motion, 8 * intervals[-1] + 1).total
    errors = np.array([abs(work_of(plates, motion, n + 1).total / exact - 1.0) for n in intervals])
    steps = motion.duration / np.array(intervals)
    order = float(np.polyfit(np.log(steps), np.log(np.maximum(errors, 1e-16)), 1)[0])
    return WorkConvergence(steps=steps, errors=errors, order=order)


def stroke_convergence(name: str, rule: Integration) -> WorkConvergence:
    """Convergence of the work of one of `STROKES`, over 50 to 1,600 time steps."""
    mesh, motion = STROKES[name]
    return work_convergence(shipped(mesh)[rule], motion, [50 * 2**k for k in range(6)])


def time_step() -> StudyResult:
    """Errors over steps, with the observed orders."""
    figure = new_figure(8.4, 3.6)
    rows: list[tuple[str, str, float, float, float]] = []
    for axes, name in zip(figure.subplots(1, 2), STROKES, strict=True):
        for rule in INTEGRATIONS:
            found = stroke_convergence(name, rule)
            steps, errors = found.steps, found.errors
            rows += [(name, rule, dt, e, found.order) for dt, e in zip(steps, errors, strict=True)]
            marker = "o-" if rule == "centroid" else "s--"
            label = f"{rule}: order {found.order:.1f}"
            axes.loglog(1e3 * steps, 100.0 * errors, marker, ms=4, color=RULE_COLOUR[rule], label=label)
        axes.loglog(1e3 * steps, 100.0 * errors[0] * (steps / steps[0]) ** 2, ":", color=BLACK, lw=1, label="order 2")
        axes.minorticks_off()
        label_axes(axes, x="Time step [ms]", y="Error of the work [%]", title=name, legend={})
    return result_of_rows(
        "fails_time_step",
        "Work against the time step",
        figure,
        rows,
        ("stroke", "stroke", "{}"),
        ("rule", "rule", "{}"),
        ("step", "step_s", "{:.1f} ms", 1e3),
        ("error of the work", "error_of_work", "{:.2g} %", 100.0),
        ("observed order", "order", "{:.1f}"),
    )
