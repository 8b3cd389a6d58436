"""Work over a stroke against the time step, and the order at which it converges."""

import numpy as np

from rft_ros.rft import INTEGRATIONS, Integration, wrenches
from rft_ros.studies.figure import BLACK, label_axes, new_figure
from rft_ros.studies.motions import Circumnutation, Motion, OscillatingInsertion, sample
from rft_ros.studies.outcome import Outcome, TextTable
from rft_ros.studies.paper import law
from rft_ros.studies.stability.drawing import RULE_COLOUR
from rft_ros.studies.stability.sweep import Array, shipped
from rft_ros.studies.work import work

__all__ = ["STROKES", "errors_of_work", "order", "time_step"]

STROKES: dict[str, tuple[str, Motion]] = {
    "ellipsoid, oscillating, from the surface": ("ellipsoid", OscillatingInsertion(travel=0.032)),
    "root tip, helix of 40 mm": ("root_tip", Circumnutation()),
}
"""A shipped mesh and a motion, by name."""

_STEPS = (50, 100, 200, 400, 800, 1600)
_FINEST = 12_800


def errors_of_work(name: str, rule: Integration) -> tuple[Array, Array]:
    """Time steps [s] and relative errors of the total work of a stroke, shape [n] both, against 12,800 steps."""
    mesh, motion = STROKES[name]
    plates = shipped(mesh)[rule]

    def total(steps: int) -> float:
        times, states = sample(motion, steps + 1)
        return work(times, states, wrenches(plates, law("constant"), states)).total

    exact = total(_FINEST)
    errors = np.array([abs(total(steps) / exact - 1.0) for steps in _STEPS])
    return motion.duration / np.array(_STEPS), errors


def order(steps: Array, errors: Array) -> float:
    """Slope of log error over log step."""
    return float(np.polyfit(np.log(steps), np.log(np.maximum(errors, 1e-16)), 1)[0])


def time_step() -> Outcome:
    """Errors over steps, with the observed orders."""
    figure = new_figure(8.4, 3.6)
    rows: list[tuple[str, str, float, float, float]] = []
    for axes, name in zip(figure.subplots(1, 2), STROKES, strict=True):
        for rule in INTEGRATIONS:
            steps, errors = errors_of_work(name, rule)
            rows += [(name, rule, dt, e, order(steps, errors)) for dt, e in zip(steps, errors, strict=True)]
            marker = "o-" if rule == "centroid" else "s--"
            label = f"{rule}: order {order(steps, errors):.1f}"
            axes.loglog(1e3 * steps, 100.0 * errors, marker, ms=4, color=RULE_COLOUR[rule], label=label)
        axes.loglog(1e3 * steps, 100.0 * errors[0] * (steps / steps[0]) ** 2, ":", color=BLACK, lw=1, label="order 2")
        axes.minorticks_off()
        label_axes(axes, x="Time step [ms]", y="Error of the work [%]", title=name, legend={})
    return Outcome(
        name="fails_time_step",
        title="Work against the time step",
        figure=figure,
        numbers={
            "fails_time_step": {
                "stroke": [r[0] for r in rows],
                "rule": [r[1] for r in rows],
                "step_s": [float(r[2]) for r in rows],
                "error_of_work": [float(r[3]) for r in rows],
                "order": [r[4] for r in rows],
            }
        },
        table=TextTable(
            header=("stroke", "rule", "step", "error of the work", "observed order"),
            rows=tuple((r[0], r[1], f"{1e3 * r[2]:.1f} ms", f"{100.0 * r[3]:.2g} %", f"{r[4]:.1f}") for r in rows),
        ),
    )
