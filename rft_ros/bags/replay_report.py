"""Report and figures of a replay, from its rows, model and summary."""

import math
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.estimates import PHASES
from rft_ros.bags.phases import Phase
from rft_ros.bags.replay_charts import Figure, ground_chart, replay_charts
from rft_ros.bags.summary import METRIC_HEADS, Summary, metric_rows
from rft_ros.estimator import Model
from rft_ros.estimator.quality import QualityFlag, flag_names, sentences, trust
from rft_ros.ground import HeightMap
from rft_ros.parameters import PARAMETERS
from rft_ros.report.animation import Animation, animate, animation_figure
from rft_ros.report.page import Table, write_page

__all__ = ["decimated", "draw"]

_BUCKETS = 1500
_FRACTIONS = (0.25, 0.5, 0.75)
_MOST_FACES = 4000
_TOOL = (
    "The tool coloured by the predicted traction on its leading faces, in world axes (x and y from the tool's origin),"
    " the surface of the grains, and the predicted force as an arrow. The slider selects a moment of the recording."
)
_PACKAGES = ("rft_ros", "numpy", "numba", "rosbags", "trimesh", "plotly")


def draw(
    summary: Summary,
    rows: NDArray[np.void],
    model: Model,
    file: Path,
    *,
    vertical: tuple[str, str],
    ground: HeightMap | None = None,
) -> None:
    """Write the report from the replay's rows, shape [n], columns `rft_ros.bags.estimates.ROW`.

    `ground`: at the end, if it is a map. `vertical`: the sensor axis nearest to vertical, and where it points ("up" or
    "down").
    """
    rows = decimated(rows)
    figures = replay_charts(rows, vertical)
    if ground is not None and model.ground is not None:
        figures.append(ground_chart(model.ground, ground))
    surface = summary.parameters["surface_height"]
    assert isinstance(surface, float)
    tool = _tool_animation(rows, model, surface_height=surface, ground=ground)
    if tool is not None:
        figures.append(Figure("tool", tool.title, _TOOL, animation_figure(tool)))
    _write_page(summary, file, figures)


def decimated(rows: NDArray[np.void]) -> NDArray[np.void]:
    """At most some thousand of the rows, shape [n]; columns and units: `ROW`.

    Of each bucket of successive rows it keeps the first and those with the greatest depth, measured force and residual
    force.
    """
    size = math.ceil(len(rows) / _BUCKETS)
    if size <= 4:
        return np.array(rows)
    force = rows["compensated"][:, :3]
    starts = np.arange(0, len(rows), size)
    kept = set(starts.tolist())
    for values in (
        rows["depth"],
        np.linalg.norm(force, axis=1),
        np.linalg.norm(force - rows["predicted"][:, :3], axis=1),
    ):
        filled = np.full(len(starts) * size, -math.inf)
        filled[: len(rows)] = np.where(np.isnan(values), -math.inf, values)
        kept.update((starts + filled.reshape(-1, size).argmax(axis=1)).tolist())
    return rows[sorted(kept)]


def _write_page(summary: Summary, file: Path, figures: list[Figure]) -> None:
    minutes, seconds = divmod(summary.duration, 60.0)
    write_page(
        file,
        title=f"Replay of {summary.bag}",
        sentence=f"The force and torque that the grains put on the tool, measured by the load cell and predicted by 3D"
        f" granular Resistive Force Theory, at {summary.estimates:,} of {summary.messages['pose']:,} poses in"
        f" {f'{minutes:.0f} min ' if minutes else ''}{seconds:.1f} s of recording. Both are on the tool by the grains,"
        " in the axes and about the origin of the sensor frame.",
        warnings=[*([f"reading stopped early: {summary.damage}"] if summary.damage else []), *summary.warnings],
        tables=_tables(summary),
        figures=figures,
    )


def _tables(summary: Summary) -> Mapping[str, Table]:
    units = {parameter.name: parameter.unit for parameter in PARAMETERS}
    read = [(role, topic, f"{summary.messages[role]:,}") for role, topic in summary.topics.items()]
    trusted = ", ".join(f"{level} {count:,}" for level, count in summary.trust.items())
    unanswered = [(name, f"{count:,}") for name, count in summary.reasons.items()]
    return {
        "metrics": Table(
            title="Metrics",
            sentence="Of the force vector: greatest measured force; RMS and peak of the residual (measured less"
            " predicted); RMS over peak of the same line; median of the relative error where the measured force is over"
            f" 20 % of the recording's peak. Depth bins are those of {Phase.PENETRATION}. summary.json has every axis.",
            heads=("", *METRIC_HEADS),
            rows=metric_rows(summary),
        ),
        "quality_flags": Table(
            title="Quality flags",
            sentence=f"How many of the {summary.estimates:,} estimates have each flag (trust: {trusted})."
            " The band in the figures is one standard deviation of the prediction on each side.",
            heads=("flag", "estimates", "trust", "meaning"),
            rows=[
                (name, f"{summary.quality_flags[name]:,}", trust(flag).value, sentences(flag))
                for flag in QualityFlag
                for name in flag_names(flag)
                if summary.quality_flags[name]
            ]
            or [("none", "0", "", "")],
            words=True,
        ),
        "read": Table(title="Read", heads=("role", "topic", "messages"), rows=read, words=True),
        "reasons": Table(
            title="Not used or unanswered",
            sentence="Samples that were not used, poses without an estimate and estimates without a residual.",
            heads=("reason", "count"),
            rows=unanswered or [("none", "0")],
        ),
        "parameters": Table(
            title="Parameters",
            heads=("parameter", "value", "unit"),
            rows=[(name, _text(value), units.get(name, "")) for name, value in summary.parameters.items()],
            words=True,
            folded=True,
        ),
        "versions": Table(
            title="Versions",
            heads=("package", "version"),
            rows=[("Python", platform.python_version()), *((name, _version(name)) for name in _PACKAGES)],
            words=True,
            folded=True,
        ),
    }


def _text(value: object) -> str:
    if isinstance(value, tuple):
        return ", ".join(_text(v) for v in value)
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:  # run from a source folder
        return "not installed"


def _tool_animation(
    rows: NDArray[np.void], model: Model, *, surface_height: float, ground: HeightMap | None
) -> Animation | None:
    """The tool at some depths of the penetration, at its deepest (shown first), and during later phases.

    None if no estimate has the tool in the grains.
    """
    indices, chosen = _moments(rows)
    if not indices:
        return None
    states = np.array(rows["state"][indices])
    if ground is None:
        states[:, :2] = 0.0  # a recording may cross the bed
    return animate(
        f"Tool and traction{' (law without memory)' if model.mobilization_length > 0.0 else ''}",
        model.tool,
        model.law,
        states,
        [f"{1e3 * row['depth']:.1f} mm, {PHASES[row['phase']]}" for row in rows[indices]],
        surface_height=surface_height,
        ground=ground,
        first=chosen,
        most_faces=_MOST_FACES,
    )


def _moments(rows: NDArray[np.void]) -> tuple[list[int], int]:
    """Rows to show, in order, and the index among them of the deepest of penetration (without one, of all)."""
    answered = ~np.isnan(rows["predicted"][:, 0]) & (rows["depth"] > 0.0)
    sinking = answered & (rows["phase"] == PHASES.index(Phase.PENETRATION))
    use = np.flatnonzero(sinking if sinking.any() else answered)
    if not len(use):
        return [], 0
    depth = rows["depth"]
    deepest = int(use[np.argmax(depth[use])])
    before = use[use <= deepest]
    found = {deepest}
    for fraction in _FRACTIONS:
        found.add(int(before[np.argmin(np.abs(depth[before] - fraction * depth[deepest]))]))
    for phase in (Phase.PLOUGHING, Phase.WITHDRAWAL):
        after = np.flatnonzero(answered & (rows["phase"] == PHASES.index(phase)))
        if len(after):
            found.add(int(after[len(after) // 2]))
    ordered = sorted(found)
    return ordered, ordered.index(deepest)
