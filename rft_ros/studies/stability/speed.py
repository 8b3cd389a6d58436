"""Faster than quasi-static: what throwing grains aside would add, by order of magnitude."""

import numpy as np

from rft_ros.rft import MEDIA
from rft_ros.studies.figure import BLUE, GREEN, GREY, VERMILION, label_axes, new_figure
from rft_ros.studies.outcome import Outcome, TextTable
from rft_ros.studies.paper import ZETA
from rft_ros.studies.stability.sweep import Array

__all__ = ["inertia_over_weight", "speed"]

_DENSITY = 1500.0
"""Of packed glass beads or sand [kg/m³]."""

_TESTED, _INERTIAL = 0.025, 0.2
"""The fastest that the paper tested; where inertia is said to matter [m/s]."""

_SPEEDS = np.geomspace(0.005, 2.0, 60)

_DEPTHS = (0.005, 0.02, 0.08)
"""[m]"""


def inertia_over_weight(speed: Array, depth: float) -> Array:
    """ρ v² over the pressure ζ α_z(0, 90°) d under a level plate that goes down [1]; speeds [m/s], depth [m]."""
    m = MEDIA["generic"]
    alpha_z = m.A00 + m.A10 + m.B11 + m.B01 + m.Bm11
    return _DENSITY * speed**2 / (ZETA * alpha_z * 1e6 * depth)


def speed() -> Outcome:
    """The estimate over speed at three depths."""
    figure = new_figure(7.0, 3.6)
    axes = figure.subplots()
    for depth, colour, dash in zip(_DEPTHS, (VERMILION, BLUE, GREEN), ("-", "--", "-."), strict=True):
        share = 100.0 * inertia_over_weight(_SPEEDS, depth)
        axes.loglog(1e3 * _SPEEDS, share, dash, color=colour, label=f"{1e3 * depth:.0f} mm deep")
    for limit, text in ((_TESTED, "paper's fastest"), (_INERTIAL, "flagged: inertial")):
        axes.axvline(1e3 * limit, color=GREY, lw=1.0)
        axes.text(1e3 * limit * 0.97, 100.0, text, rotation=90, fontsize=8, va="top", ha="right")
    axes.set_ylim(1e-3, 200.0)
    label_axes(axes, x="Speed [mm/s]", y="Inertia, of the model's force [%]", legend={})
    axes.set_title("A level plate that goes down: ρ v² over the model's pressure", fontsize=10)
    rows = [(v, d, float(inertia_over_weight(np.array([v]), d)[0])) for v in (_TESTED, _INERTIAL, 1.0) for d in _DEPTHS]
    return Outcome(
        name="fails_speed",
        title="Faster than quasi-static",
        figure=figure,
        numbers={
            "fails_speed": {
                "speed_m_s": [v for v, _, _ in rows],
                "depth_m": [d for _, d, _ in rows],
                "inertia_over_force": [share for _, _, share in rows],
            }
        },
        table=TextTable(
            header=("speed", "depth", "inertia, of the model's force"),
            rows=tuple((f"{1e3 * v:.0f} mm/s", f"{1e3 * d:.0f} mm", f"{100.0 * s:.2g} %") for v, d, s in rows),
        ),
    )
