"""All bad places in one figure: the largest jump of each sweep by either rule."""

import numpy as np

from rft_ros.rft import INTEGRATIONS, Integration
from rft_ros.studies.figure import BLACK, label_axes, new_figure
from rft_ros.studies.outcome import Outcome
from rft_ros.studies.stability.drawing import RULE_COLOUR, by_rule_outcome
from rft_ros.studies.stability.plate_sweeps import level_sweeps, wheel_sweep
from rft_ros.studies.stability.reversal import reversal_sweep
from rft_ros.studies.stability.surface import height_sweeps
from rft_ros.studies.stability.sweep import measured
from rft_ros.studies.stability.turning import turning_sweep
from rft_ros.studies.stability.withdrawal import direction_sweeps
from rft_ros.studies.stability.yaw import yaw_sweeps

__all__ = ["LIMIT", "overview"]

LIMIT = 0.02
"""What a jump must not exceed under the refined rule, of the local force."""

_LEAST = 1e-7  # drawn in place of less


def overview() -> Outcome:
    """The largest jump of each sweep with either α_y model."""
    sweeps = (
        *level_sweeps(),
        *yaw_sweeps(),
        wheel_sweep(),
        *direction_sweeps(),
        *height_sweeps(),
        reversal_sweep(),
        turning_sweep(1),
        turning_sweep(8),
    )
    found: dict[str, dict[Integration, float]] = {}
    for sweep in sweeps:
        lines = measured(sweep)
        found[sweep.name] = {rule: max(line.jump for line in lines if line.rule == rule) for rule in INTEGRATIONS}
    figure = new_figure(8.0, 6.2)
    axes = figure.subplots()
    place = np.arange(len(found))
    for rule, marker in zip(INTEGRATIONS, ("o", "s"), strict=True):
        jumps = [100.0 * max(jump[rule], _LEAST) for jump in found.values()]
        axes.semilogx(jumps, place, marker, ms=5, color=RULE_COLOUR[rule], label=rule)
    axes.axvline(100.0 * LIMIT, color=BLACK, lw=1.0, ls="--", label=f"limit for refined, {100.0 * LIMIT:.0f} %")
    axes.set_yticks(place, list(found), fontsize=7)
    axes.invert_yaxis()
    label_axes(axes, x="Largest jump over a step of 1e-4 rad, 1e-5 m or 1e-5 m/s [% of the local force]", y="Sweep")
    axes.legend(fontsize=8, loc="lower left")
    return by_rule_outcome(
        "fails_overview", "The largest jump of each sweep", figure, of="sweep", what="jump", values=found
    )
