"""A root tip on a helix: forces, and work over the pitch of the helix (paper Fig. 8)."""

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from rft_ros.rft import Integration, wrenches
from rft_ros.sweeps.motions import Trajectory, circumnutation, sample
from rft_ros.tool import Tool, load_tool
from studies.paper import NOT_STATED, law, root_tip
from studies.result import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    VERMILION,
    StudyResult,
    label_axes,
    new_figure,
    published_against_ours,
)
from studies.sampling import Work, WorkConvergence, work_convergence, work_of

__all__ = ["PITCHES", "RE_INTERACTION", "SHOWN", "TILTS", "step_errors", "straight_limit", "study"]

Array = NDArray[np.float64]

TILTS = (10.0, 20.0)
"""η, the root's axis from the vertical [deg]."""

PITCHES = (
    np.array([20, 25, 30, 35, 40, 45, 50, 60, 70, 80, 90, 100, 115, 130, 145, 167, 180, 200])
    * 1e-3
)
"""P, depth gained in a turn [m]."""

SHOWN = (0.040, 0.167)
"""The pitches of Fig. 8B [m]."""

RE_INTERACTION = 0.040
"""Pitch [m] below which the paper doubts its model, because the root meets its own wake. The model has no wake."""

_COUNT = 401  # states of a stroke
_LENGTH = 0.0345  # of the root below its base [m]


def step_errors(integration: Integration) -> WorkConvergence:
    """Work from the surface to 35 mm over the time step, for the shipped root tip at η = 10°, P = 40 mm.

    The root starts with its tip at the surface: once it is submerged, the power is linear in time and any step exact.
    """
    tool = load_tool("root_tip", origin=(0.0, 0.0, 1.25), integration=integration)
    return work_convergence(
        tool.plates, circumnutation(start_height=_LENGTH), [20 * 2**k for k in range(8)]
    )


def straight_limit(motion: Trajectory) -> Trajectory:
    """The same root pushed straight down: the limit of infinite pitch, because forces do not depend on speed."""
    return replace(motion, turning=0.0)


def study() -> StudyResult:
    """Forces and work over the pitch, and convergence of the work in the time step."""
    tool = root_tip()
    works = {
        tilt: [
            work_of(tool.plates, circumnutation(tilt_deg=tilt, pitch=p), _COUNT) for p in PITCHES
        ]
        for tilt in TILTS
    }
    limits = {
        tilt: work_of(tool.plates, straight_limit(circumnutation(tilt_deg=tilt)), _COUNT)
        for tilt in TILTS
    }
    converging: dict[Integration, WorkConvergence] = {
        "centroid": step_errors("centroid"),
        "refined": step_errors("refined"),
    }
    rows = [row for tilt in TILTS for row in _rows_of_tilt(tilt, works[tilt], limits[tilt])]
    figure = new_figure(12.5, 9.0)
    panels = figure.subplots(2, 2)
    for axes, pitch in zip(panels[0], SHOWN, strict=True):
        _draw_forces(axes, tool, pitch)
    _draw_work(panels[1, 0], works, limits)
    _draw_steps(panels[1, 1], converging)
    figure.suptitle(
        "Root tip, 15 °/s, 35 mm down, from the base at the surface, ζ = 0.33, α_y constant unless said"
    )
    return StudyResult(
        name="circumnutation",
        title="Circumnutating root tip: forces, and work against the pitch (Fig. 8)",
        figure=figure,
        table=published_against_ours(
            (
                "pitch below which the paper doubts its model because of the wake",
                "40 mm",
                "not in the model; shaded",
            ),
            (
                "work of the insertion, as the pitch P is reduced",
                "decreases",
                _as_pitch_is_reduced(works, limits),
            ),
            *rows,
            (
                f"observed order of the work in Δt: {', '.join(converging)}",
                NOT_STATED,
                ", ".join(f"{found.order:.2f}" for found in converging.values()),
            ),
        ),
    )


def _as_pitch_is_reduced(works: dict[float, list[Work]], limits: dict[float, Work]) -> str:
    series = [[w.vertical for w in (*works[tilt], limits[tilt])] for tilt in TILTS]
    totals = [[w.total for w in (*works[tilt], limits[tilt])] for tilt in TILTS]
    decreases = all((np.diff(s) > 0.0).all() for s in series)
    # beyond 100 mm the total comes down to the straight insertion's, at 10 degrees to 0.3 % below it
    below = [np.array(t)[:-1][PITCHES <= 0.1] for t in totals]
    increases = all((np.diff(t) < 0.0).all() for t in below)
    vertical = "decreases" if decreases else "does not decrease"
    total = "increases" if increases else "does not increase"
    return f"vertical work {vertical}; total work {total} (below 100 mm)"


def _rows_of_tilt(tilt: float, works: list[Work], limit: Work) -> list[tuple[str, str, str]]:
    rows = []
    for pitch in SHOWN:
        w = works[int(np.argmin(np.abs(PITCHES - pitch)))]
        less, more = (
            100.0 * (w.vertical / limit.vertical - 1.0),
            100.0 * (w.total / limit.total - 1.0),
        )
        text = f"{1e3 * w.vertical:.1f} mJ ({less:+.0f} %), {1e3 * w.total:.1f} mJ ({more:+.0f} %)"
        rows.append(
            (
                f"η {tilt:g}°, P {1e3 * pitch:g} mm: vertical, total work (against straight)",
                NOT_STATED,
                text,
            )
        )
    return rows


def _draw_forces(axes: Axes, tool: Tool, pitch: float) -> None:
    for tilt, style in zip(TILTS, ("-", "--"), strict=True):
        motion = circumnutation(tilt_deg=tilt, pitch=pitch)
        _, states = sample(motion, _COUNT)
        depth = 1e3 * (states[0, 2] - states[:, 2])
        for model, width in (("constant", 1.8), ("linear", 0.8)):
            forces = wrenches(tool.plates, law(model), states)
            for name, force, colour in (
                ("up", forces[:, 2], BLUE),
                ("sideways, magnitude", np.hypot(forces[:, 0], forces[:, 1]), VERMILION),
                ("along x", forces[:, 0], ORANGE),
            ):
                label = f"{name}, η {tilt:g}°" if model == "constant" else None
                axes.plot(depth, force, style, color=colour, lw=width, label=label)
    title = f"P = {1e3 * pitch:g} mm (thin: α_y linear)"
    label_axes(
        axes,
        x="Depth gained [mm]",
        y="Force [N]",
        title=title,
        legend={"loc": "upper left", "ncols": 2},
    )


def _draw_work(axes: Axes, works: dict[float, list[Work]], limits: dict[float, Work]) -> None:
    axes.axvspan(
        0.0, 1e3 * RE_INTERACTION, color="0.9", label="the paper doubts its model (P < 40 mm)"
    )
    for tilt, colour, marker in zip(TILTS, (BLUE, VERMILION), ("o", "s"), strict=True):
        for name, style, values in (
            ("total", "-", [w.total for w in works[tilt]]),
            ("vertical", "--", [w.vertical for w in works[tilt]]),
        ):
            label = f"{name}, η {tilt:g}°"
            axes.plot(
                1e3 * PITCHES,
                1e3 * np.array(values),
                style,
                marker=marker,
                ms=4,
                color=colour,
                label=label,
            )
        axes.axhline(
            1e3 * limits[tilt].total,
            color=colour,
            ls=":",
            lw=1.0,
            label=f"straight (P → ∞), η {tilt:g}°",
        )
    axes.set_xlim(0.0, 205.0)
    axes.set_ylim(bottom=0.0)
    label_axes(
        axes,
        x="Pitch P [mm]",
        y="Work over 35 mm [mJ]",
        title="Work",
        legend={"loc": "upper right"},
    )


def _draw_steps(axes: Axes, converging: dict[Integration, WorkConvergence]) -> None:
    for (rule, found), colour, marker in zip(
        converging.items(), (BLACK, GREEN), ("o", "s"), strict=True
    ):
        axes.loglog(
            found.steps, found.errors, marker=marker, color=colour, label=f"{rule}: observed order {found.order:.2f}"
        )  # fmt: skip
    steps = converging["refined"].steps
    axes.loglog(
        steps,
        converging["refined"].errors[0] * (steps / steps[0]) ** 2,
        ":",
        color=GREY,
        label="order 2",
    )
    title = "Work from the surface on, η = 10°, P = 40 mm"
    label_axes(
        axes,
        x="Time step Δt [s]",
        y="Error of the total work",
        title=title,
        legend={"loc": "lower right"},
    )
