"""Near rest: a force that knows only the direction of motion flips with it, and follows the noise of a tool at rest."""

import numpy as np
from scipy.spatial.transform import Rotation

from rft_ros.rft import Memory, wrenches, wrenches_in_time
from rft_ros.studies.figure import BLACK, GREEN, label_axes, new_figure
from rft_ros.studies.outcome import Outcome
from rft_ros.studies.paper import law
from rft_ros.studies.stability.drawing import RULE_COLOUR, Unit, draw_lines, jump_outcome
from rft_ros.studies.stability.sweep import Array, Sweep, evenly, measured, scene_states, shipped

__all__ = ["SPEEDS", "reversal", "reversal_sweep"]

SPEEDS = Unit(name="mm/s", per_si=1e3)
"""What this sweep is drawn over."""

_STEP = 1e-5  # [m/s]

_RATE = 200.0  # [Hz] of the stroke in time

_MOBILIZATION_LENGTH = 0.002  # [m], an example of what calibration finds


def reversal_sweep() -> Sweep:
    """A plate whose vertical speed passes through zero while it drifts sideways at a hundredth of a mm/s."""
    values = evenly(-200.0 * _STEP, 200.0 * _STEP, _STEP)

    def states(speed: Array) -> Array:
        drift = np.full_like(speed, 1e-5)
        return scene_states(Rotation.identity(), velocity=np.column_stack([drift, 0.0 * drift, speed]))

    return Sweep(name="vertical speed through 0", tool=shipped("plate"), values=values, states=states)


def reversal() -> Outcome:
    """Force against speed through zero, and over a stroke down, rest, and up, with and without memory."""
    lines = measured(reversal_sweep())
    figure = new_figure(8.4, 3.6)
    against_speed, over_time = figure.subplots(1, 2)
    draw_lines(against_speed, lines, SPEEDS, shown=lambda forces: forces[:, 2])
    label_axes(against_speed, x="Vertical speed [mm/s]", y="Vertical force [N]", legend={})
    against_speed.set_title("However slow, the sign decides", fontsize=10)

    times, states = _stroke()
    for rule, plates in reversal_sweep().tool.items():
        force = wrenches(plates, law("constant", zeta=1.0), states)[:, 2]
        over_time.plot(times, force, color=RULE_COLOUR[rule], lw=2.2 if rule == "centroid" else 1.0, label=rule)
        if rule == "refined":
            memory = Memory.of(plates)
            durations = np.diff(times, prepend=times[0])
            held = wrenches_in_time(
                plates,
                law("constant", zeta=1.0),
                states,
                durations,
                memory,
                mobilization_length=_MOBILIZATION_LENGTH,
            )[:, 2]
            label = f"with memory, λ = {1e3 * _MOBILIZATION_LENGTH:g} mm"
            over_time.plot(times, held, color=GREEN, lw=2.0, ls="--", label=label, zorder=5)
    over_time.set_ylim(-95.0, 145.0)
    over_time.axvspan(2.0, 3.0, color="0.93")
    over_time.axhline(0.0, color=BLACK, lw=0.5)
    label_axes(over_time, x="Time [s]", y="Vertical force [N]", legend={"loc": "lower left"})
    over_time.set_title("Down, rest (shaded) with noise, up", fontsize=10)
    return jump_outcome("fails_reversal", "Rest and reversal", figure, lines, SPEEDS)


def _stroke() -> tuple[Array, Array]:
    """Times [s] and states of a plate that goes 20 mm down, rests for a second, and goes up; noise of 0.03 mm/s."""
    times = np.arange(0.0, 5.0, 1.0 / _RATE)
    random = np.random.default_rng(0)
    speed = np.where(times < 2.0, -0.01, np.where(times < 3.0, 0.0, 0.01))
    height = -0.03 + np.concatenate([[0.0], np.cumsum(speed)[:-1]]) / _RATE
    noisy = random.normal(0.0, 3e-5, (len(times), 3))
    noisy[:, 2] += speed
    return times, scene_states(Rotation.identity(), velocity=noisy, height=height)
