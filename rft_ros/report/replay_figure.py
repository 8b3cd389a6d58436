"""One figure of a replay: measured, predicted and residual force over time, and the vertical one over depth."""

import csv
import math
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["draw_replay"]

_POINTS = 4000
"""Rows drawn at most; more than a line of this figure can show."""

_LINES = (
    ("compensated", "measured, less bias and tool weight", {"color": "0.25", "lw": 1.4}),
    ("predicted", "predicted by RFT", {"color": "tab:red", "lw": 1.4}),
    ("residual", "residual: measured - predicted", {"color": "tab:blue", "lw": 0.8}),
)


def draw_replay(table: Path, picture: Path, *, title: str, vertical: tuple[str, str]) -> None:
    """Draw a replay's estimates.csv to a PNG.

    `vertical`: the sensor axis nearest to vertical at the greatest depth ("x", "y" or "z"), and where it points
    ("up" or "down").
    """
    from matplotlib.figure import Figure

    data = _columns(table)
    figure = Figure(figsize=(13.0, 7.0), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1.25, 1.0))
    time = data["t"] - data["t"][:1]
    depth = 1e3 * data["depth"]
    first = None
    for row, axis in enumerate("xyz"):
        axes = figure.add_subplot(grid[row, 0], sharex=first)
        first = first or axes
        _draw(axes, time, data, axis)
        silent = np.isnan(data["predicted_fx"])
        axes.fill_between(
            time, 0, 1, where=silent, transform=axes.get_xaxis_transform(), color="0.93", lw=0, label="no estimate"
        )
        axes.set_ylabel(f"Force along sensor {axis} [N]")
        axes.tick_params(labelbottom=row == 2)
    axes.set_xlabel("Time since the first pose [s]")
    assert first is not None
    figure.legend(*first.get_legend_handles_labels(), loc="outside lower center", ncols=4)

    axes = figure.add_subplot(grid[:, 1])
    axis, pointing = vertical
    for name in ("compensated", "predicted", "residual"):
        data[f"{name}_f{axis}"][~(depth > -1.0)] = math.nan
    _draw(axes, depth, data, axis)
    axes.set_xlabel("Depth of the tool's lowest point below the surface [mm]")
    axes.set_ylabel(f"Vertical force: along sensor {axis}, which points {pointing} [N]")
    figure.suptitle(f"Force on the tool by the grains: {title}")
    figure.savefig(picture, dpi=110)


def _draw(axes: Any, across: NDArray[np.float64], data: dict[str, NDArray[np.float64]], axis: str) -> None:
    for name, label, style in _LINES:
        axes.plot(across, data[f"{name}_f{axis}"], label=label, **style)
    axes.grid(alpha=0.3)
    axes.axhline(0.0, color="0.6", lw=0.6)


def _columns(table: Path) -> dict[str, NDArray[np.float64]]:
    """The columns of numbers, with NaN for empty cells, thinned out evenly."""
    with table.open(encoding="utf-8") as lines:
        every = max(1, math.ceil((sum(1 for _ in lines) - 1) / _POINTS))
        lines.seek(0)
        names = next(lines).rstrip("\n").split(",")
        wanted = [i for i, name in enumerate(names) if name in ("t", "depth") or "_f" in name]
        rows = [[float(cells[i] or "nan") for i in wanted] for cells in csv.reader(islice(lines, 0, None, every))]
    values = np.array(rows, dtype=np.float64).reshape(-1, len(wanted))
    return {names[i]: values[:, k].copy() for k, i in enumerate(wanted)}
