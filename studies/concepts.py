"""The figure of docs/concepts.md: a tool in the grains, what ζ, α_y and λ mean, and what is said of each pose.

python -m studies.concepts docs/images/concepts.svg
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Polygon, Rectangle
from numpy.typing import NDArray

from rft_ros.estimator import (
    Estimator,
    NoEstimate,
    PoseSample,
    QualityFlag,
    Trust,
    TwistSample,
    trust,
)
from rft_ros.parameters import Config, Model
from studies.result import BLACK, BLUE, GREEN, GREY, ORANGE, VERMILION, label_axes

__all__ = ["draw_concepts", "write_concepts"]

_GRAINS, _SURFACE, _TOOL = "#C2A878", "#7a6640", "#8f99a8"
_TOOL_NAME = "plate"
_ZETAS = {0.33: "glass beads", 1.1: "a sand"}
_PERIOD_NS = 10_000_000
_START_NS = 1_000_000_000
_NO_NUMBER = float("nan")
_COLOURS = {Trust.OK: GREEN, Trust.CAUTION: ORANGE, Trust.NO: VERMILION}


@dataclass(frozen=True, slots=True)
class _Leg:
    """A part of the run: its name, its velocity [m/s] and its duration [s]; `lost`: its poses are not numbers."""

    name: str
    velocity: tuple[float, float, float]
    duration: float
    lost: bool = False


_RUN = (
    _Leg("in the air", (0.0, 0.0, -0.01), 0.6),
    _Leg("press", (0.0, 0.0, -0.01), 2.4),
    _Leg("rest", (0.0, 0.0, 0.0), 1.2),
    _Leg("drag", (0.01, 0.0, 0.0), 1.6),
    _Leg("poses that are NaN", (0.01, 0.0, 0.0), 1.5, lost=True),
    _Leg("drag", (0.01, 0.0, 0.0), 0.8),
    _Leg("fast drag", (0.3, 0.0, 0.0), 1.3),
    _Leg("withdrawal", (0.0, 0.0, 0.02), 1.6),
)
"""A plate is pressed 24 mm deep, rests, is dragged, and is pulled out."""


@dataclass(frozen=True, slots=True)
class _Moment:
    """The answer to a pose: force upwards and against the drag [N], and a trust, or none with a reason.

    `why`: the flags, or the reason.
    """

    time: float
    upwards: float
    backwards: float
    trust: Trust | None
    why: str


def _model(zeta: float, mobilization_length: float) -> Model:
    """The default model of the shipped plate, with all of its plates."""
    return Config.of(
        {
            **Config().values,
            "mesh.file": _TOOL_NAME,
            "medium.zeta": zeta,
            "medium.mobilization_length": mobilization_length,
            "tolerance": 0.0,
        }
    ).model()


def _moments(legs: Sequence[_Leg]) -> list[_Moment]:
    """What the estimator says along the run, pose by pose."""
    estimator = Estimator(Config(), _model(0.33, 0.003))
    place = np.array([0.0, 0.0, 0.0066])  # the plate is 3.2 mm thick
    stamp = _START_NS
    moments = []
    for leg in legs:
        for _ in range(round(leg.duration / (1e-9 * _PERIOD_NS))):
            stamp += _PERIOD_NS
            place = place + np.array(leg.velocity) * 1e-9 * _PERIOD_NS
            x, y, z = place.tolist()
            estimator.push(TwistSample(stamp, "world", leg.velocity, (0.0, 0.0, 0.0)))
            position = (_NO_NUMBER, y, z) if leg.lost else (x, y, z)
            answer = estimator.push_pose(
                PoseSample(stamp, "world", position, (0.0, 0.0, 0.0, 1.0))
            )
            time = 1e-9 * (stamp - _START_NS)
            if isinstance(answer, NoEstimate):
                moments.append(_Moment(time, _NO_NUMBER, _NO_NUMBER, None, answer.reason.value))
            else:
                fx, _, fz = answer.predicted[:3]
                flags = answer.quality_flags
                why = "+".join(f.label for f in QualityFlag if f & flags)
                moments.append(_Moment(time, fz, -fx, trust(flags), why))
    return moments


def _arrow(
    axes: Any, begin: tuple[float, float], end: tuple[float, float], colour: str, style: str = "->"
) -> None:
    arrow = {"arrowstyle": style, "lw": 2.0, "color": colour, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", end, begin, arrowprops=arrow)


def _draw_motions(axes: Any) -> None:
    """Side view: surface, depth, and the kinds of motion."""
    axes.set(xlim=(-78, 100), ylim=(-62, 52), aspect="equal")
    axes.axis("off")
    axes.add_patch(Rectangle((-78, -62), 178, 62, color=_GRAINS, alpha=0.45, lw=0))
    axes.plot([-78, 100], [0, 0], color=_SURFACE, lw=1.6)
    axes.text(98, 2, "surface", fontsize=9, color=_SURFACE, ha="right", va="bottom")
    axes.add_patch(Rectangle((-5, -24), 10, 70, fc="#e3e6ea", ec=_SURFACE, lw=0.8))
    axes.add_patch(Rectangle((-26, -30), 52, 6, fc=_TOOL, ec="#555555", lw=0.8))
    axes.text(9, 42, "tool", fontsize=9, va="top")
    _arrow(axes, (-48, 0), (-48, -30), BLACK, "<->")
    axes.plot([-54, -26], [-30, -30], color=BLACK, lw=0.7, ls=":")
    axes.text(-51, -15, "depth", fontsize=9, ha="right", va="center")
    _arrow(axes, (0, -31), (0, -49), BLUE)
    axes.text(3, -47, "press", fontsize=9, color=BLUE)
    _arrow(axes, (27, -27), (48, -27), BLUE)
    axes.text(50, -27, "drag", fontsize=9, color=BLUE, va="center")
    axes.add_patch(Arc((0, 8), 34, 14, theta1=190, theta2=350, color=BLUE, lw=2.0))
    _arrow(axes, (15.8, 4.4), (17.2, 8.0), BLUE)
    axes.text(20, 8, "turn", fontsize=9, color=BLUE, va="bottom")
    _arrow(axes, (18, -23), (18, -6), BLUE)
    axes.text(21, -9, "withdrawal", fontsize=9, color=BLUE, va="top")
    _arrow(axes, (-16, -54), (-16, -31), VERMILION)
    axes.text(
        -19, -46, "force on the tool,\nby the grains", fontsize=9, color=VERMILION, ha="right"
    )
    axes.set_title("Where the tool is, and how it moves\n(side view)", fontsize=10)


def _draw_alpha_y(axes: Any) -> None:
    """Top view of an upright plate that is dragged obliquely: what its face and what its own plane feel."""
    axes.set(xlim=(-80, 80), ylim=(-52, 50), aspect="equal")
    axes.axis("off")
    axes.add_patch(Rectangle((-80, -52), 160, 102, color=_GRAINS, alpha=0.45, lw=0))
    along = np.array([np.cos(np.deg2rad(60.0)), np.sin(np.deg2rad(60.0))])
    normal = np.array([along[1], -along[0]])
    corners = [26 * a * along + 3 * n * normal for a, n in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    axes.add_patch(Polygon(corners, fc=_TOOL, ec="#555555", lw=0.8))
    begin = tuple(3 * normal)
    _arrow(axes, begin, (begin[0] + 34, begin[1]), BLUE)
    axes.text(40, 0, "motion", fontsize=9, color=BLUE, va="center")
    centre = -3 * normal
    _arrow(axes, tuple(centre), tuple(centre - 32 * normal), VERMILION)
    axes.text(
        -30,
        20,
        "against the face:\nα_x, α_z",
        fontsize=9,
        color=VERMILION,
        ha="right",
        va="bottom",
    )
    _arrow(axes, tuple(centre), tuple(centre - 19 * along), ORANGE)
    axes.text(-17, -23, "along the plate:\nα_y", fontsize=9, ha="right", va="top")
    axes.set_title("α_y: an upright plate, dragged obliquely\n(seen from above)", fontsize=10)


def _draw_zeta(axes: Any) -> None:
    """Force over depth of a level plate that is pressed, for two grains."""
    from rft_ros.rft import checked_states, wrenches

    depths = np.linspace(0.0, 0.05, 51)
    for (zeta, grains), style in zip(_ZETAS.items(), ("-", "--"), strict=True):
        model = _model(zeta, 0.0)
        states = np.zeros((len(depths), 13))
        states[:, 2] = -model.tool.lowest_point(np.eye(3)) - depths
        states[:, 6] = 1.0
        states[:, 9] = -0.01
        force = wrenches(model.tool.plates, model.law, checked_states(states))[:, 2]
        axes.plot(1e3 * depths, force, style, color=BLUE, lw=2.0)
        axes.text(49, force[-1], f"ζ = {zeta:g}: {grains} ", fontsize=9, ha="right", va="bottom")
    axes.set_ylim(0.0, 165.0)
    label_axes(axes, x="Depth [mm]", y="Upward force [N]")
    axes.set_title("ζ: how strong the grains are\n(plate of 26 cm², pressed)", fontsize=10)


def _draw_run(axes: Any, strip: Any) -> None:
    """A run over time: the memory builds the force up, and each pose has a trust or a reason."""
    moments = _moments(_RUN)
    time: NDArray[np.float64] = np.array([m.time for m in moments])
    axes.plot(time, [m.upwards for m in moments], color=BLUE, lw=2.0, label="upwards")
    against = [m.backwards for m in moments]
    axes.plot(time, against, "--", color=BLACK, lw=1.5, label="against the drag")
    axes.annotate(
        "λ: the force against the drag\nbuilds up over a few mm",
        (4.45, 2.4),
        (4.7, 9.5),
        fontsize=9,
        arrowprops={"arrowstyle": "->", "lw": 0.7},
    )
    axes.legend(frameon=False, fontsize=9, loc="upper right")
    axes.tick_params(labelbottom=False)
    title = "λ (memory), and what is said of each pose: trust and flags, or the reason why there is no estimate"
    label_axes(axes, x="", y="Force [N]", title=title)
    begin = 0.0
    for leg in _RUN:
        end = begin + leg.duration
        middle = 0.5 * (begin + end)
        moment = moments[int(np.searchsorted(time, middle))]
        colour = GREY if moment.trust is None else _COLOURS[moment.trust]
        strip.axvspan(begin, end, color=colour, alpha=0.55, lw=0)
        verdict = "no estimate" if moment.trust is None else f"trust {moment.trust.name}"
        strip.text(middle, 0.5, f"{verdict}\n{moment.why}", fontsize=8, ha="center", va="center")
        axes.axvline(begin, color=GREY, lw=0.5, ls=":")
        axes.text(
            middle,
            1.0,
            leg.name,
            fontsize=8,
            ha="center",
            va="bottom",
            transform=strip.get_xaxis_transform(),
        )
        begin = end
    strip.set(xlabel="Time [s]", yticks=[], ylim=(0, 1))
    strip.sharex(axes)
    axes.set_xlim(0.0, begin)


def draw_concepts() -> Figure:
    """The figure with its four panels."""
    figure = Figure(figsize=(12.0, 7.6), layout="constrained")
    halves: Any = figure.subfigures(2, 1)
    above, below = halves
    motions, alpha_y, zeta = above.subplots(1, 3, width_ratios=(1.15, 1.0, 0.9))
    run, strip = below.subplots(2, 1, height_ratios=(0.8, 0.2))
    _draw_motions(motions)
    _draw_alpha_y(alpha_y)
    _draw_zeta(zeta)
    _draw_run(run, strip)
    return figure


def write_concepts(file: Path) -> None:
    """Write the figure as SVG, with text as text, and the same bytes each time."""
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "concepts"}):
        draw_concepts().savefig(file, metadata={"Date": None})


def main() -> None:
    """Write the figure to the file that the command line names."""
    (file,) = sys.argv[1:]
    write_concepts(Path(file))


if __name__ == "__main__":
    main()
