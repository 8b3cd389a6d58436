"""Twist from differenced poses: encoder noise against lag, over the window that the line is fitted to."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from rft_ros.estimator import PoseSample
from rft_ros.estimator.settings import Settings
from rft_ros.estimator.velocity import PoseDifference
from rft_ros.rft import Plates, wrenches
from rft_ros.studies.figure import BLACK, BLUE, GREY, ORANGE, VERMILION, label_axes, new_figure
from rft_ros.studies.motions import Motion, OscillatingInsertion, Straight, sample_every
from rft_ros.studies.outcome import Outcome, TextTable
from rft_ros.studies.paper import law
from rft_ros.studies.stability.sweep import Array, shipped

__all__ = ["NOISE", "RATES", "WINDOWS", "Error", "differenced", "measured_errors", "window"]

NOISE = 1e-5
"""Of each coordinate of a pose [m]; of its attitude, this at 100 mm from the flange [rad]: 1e-4."""

RATES = (125.0, 500.0, 1000.0)
"""Of the poses [Hz]."""

WINDOWS = (0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3)
"""Spans of poses that the line is fitted to [s]."""

_ATTITUDE_NOISE = NOISE / 0.1

_COLOURS = {125.0: ORANGE, 500.0: BLUE, 1000.0: VERMILION}


@dataclass(frozen=True, slots=True, kw_only=True)
class Error:
    """Of the force with differenced twists, RMS over RMS of the force with true ones.

    `noise`: noisy poses against true ones by the same window; `lag`: true poses against true twists; `both`: noisy
    poses against true twists. `moves_at_rest`: share of ticks at rest whose fastest point is over `rest_speed`;
    `rest_speed_needed`: what 99 % of them stay below [m/s].
    """

    motion: str
    rate: float
    window: float
    noise: float
    lag: float
    both: float
    moves_at_rest: float
    rest_speed_needed: float


def _motions() -> dict[str, tuple[Motion, Plates]]:
    return {
        "plate, down at 10 mm/s": (Straight(start_height=-0.01, travel=0.03), shipped("plate")["refined"]),
        "ellipsoid, 5 mm/s, ±9° at 0.625 Hz": (
            OscillatingInsertion(start_height=-0.03, travel=0.02),
            shipped("ellipsoid")["refined"],
        ),
    }


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
    """The states with the twists that the estimator's differencing makes of their poses; zero until it has three."""
    difference = PoseDifference()
    difference.span(window=width, max_age=1.0)
    out = states.copy()
    out[:, 7:13] = 0.0
    for k, row in enumerate(states):
        stamp = 1 + round(k * 1e9 / rate)
        if difference.push(PoseSample(stamp, "world", tuple(row[:3].tolist()), tuple(row[3:7].tolist()))):
            out[k, 7:13] = difference.twist
    return out


def _with_noise(states: Array, random: np.random.Generator) -> Array:
    out = states.copy()
    out[:, :3] += random.normal(0.0, NOISE, (len(states), 3))
    turned = Rotation.from_rotvec(random.normal(0.0, _ATTITUDE_NOISE, (len(states), 3)))
    out[:, 3:7] = (turned * Rotation.from_quat(states[:, 3:7])).as_quat()
    return out


def _settled(rate: float) -> int:
    """The first pose whose window is full, whichever it is."""
    return int(max(WINDOWS) * rate) + 1


def _force(plates: Plates, states: Array) -> Array:
    return wrenches(plates, law("constant"), states)[:, :3]


def _rms(vectors: Array) -> float:
    return float(np.sqrt((vectors**2).sum(axis=1).mean()))


def _fastest(states: Array, reach: float) -> Array:
    """What the estimator compares with `rest_speed` [m/s]."""
    return np.asarray(np.linalg.norm(states[:, 7:10], axis=1) + reach * np.linalg.norm(states[:, 10:13], axis=1))


def window() -> Outcome:
    """Lag against noise, and what passes for motion at rest."""
    errors = measured_errors()
    motions = list(dict.fromkeys(error.motion for error in errors))
    figure = new_figure(9.0, 3.4)
    panels = figure.subplots(1, 3)
    for axes, motion in zip(panels, motions, strict=False):
        for rate in RATES:
            mine = [e for e in errors if e.motion == motion and e.rate == rate]
            axes.loglog(
                WINDOWS, [100.0 * e.both for e in mine], "o-", ms=3, color=_COLOURS[rate], label=f"{rate:.0f} Hz"
            )
            axes.loglog(WINDOWS, [100.0 * e.noise for e in mine], ":", lw=1, color=_COLOURS[rate])
        if any(e.lag > 1e-4 for e in mine):
            axes.loglog(WINDOWS, [100.0 * e.lag for e in mine], "--", lw=1, color=BLACK, label="lag alone")
        axes.plot([], [], ":", color=GREY, label="noise alone")
        label_axes(axes, x="Window [s]", y="RMS error of the force [%]", title=motion, legend={})
    for rate in RATES:
        rest = [1e3 * e.rest_speed_needed for e in errors if e.motion == motions[0] and e.rate == rate]
        panels[2].loglog(WINDOWS, rest, "o-", ms=3, color=_COLOURS[rate], label=f"{rate:.0f} Hz")
    panels[2].axhline(1e3 * Settings().rest_speed, color=BLACK, ls="--", lw=1, label="default rest_speed")
    label_axes(panels[2], x="Window [s]", y="Apparent speed, 99 % below [mm/s]", title="Plate at rest", legend={})
    for axes in panels:
        axes.axvline(Settings().twist_window, color=GREY, lw=1.0)
        axes.title.set_fontsize(9)
    figure.suptitle(f"Twist from poses with noise of {1e6 * NOISE:.0f} µm; grey: the default window", fontsize=10)
    return Outcome(
        name="fails_window",
        title="Noise of differenced poses",
        figure=figure,
        numbers={
            "fails_window": {
                name: [getattr(e, field) for e in errors]
                for name, field in (
                    ("motion", "motion"),
                    ("rate_hz", "rate"),
                    ("window_s", "window"),
                    ("noise", "noise"),
                    ("lag", "lag"),
                    ("both", "both"),
                    ("moves_at_rest", "moves_at_rest"),
                    ("rest_speed_needed_m_s", "rest_speed_needed"),
                )
            }
        },
        table=TextTable(
            header=(
                "motion",
                "rate",
                "window",
                "noise alone",
                "lag alone",
                "both",
                "at rest, taken for motion",
                "apparent speed at rest",
            ),
            rows=tuple(
                (
                    e.motion,
                    f"{e.rate:.0f} Hz",
                    f"{1e3 * e.window:.0f} ms",
                    *(f"{100.0 * value:.2g} %" for value in (e.noise, e.lag, e.both, e.moves_at_rest)),
                    f"{1e3 * e.rest_speed_needed:.2g} mm/s",
                )
                for e in errors
            ),
        ),
    )
