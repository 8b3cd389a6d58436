"""A tool in the grains, and its force over depth, measured and predicted."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rft_ros.report.moving_tool import MovingTool
from rft_ros.report.tool_in_grains import draw_tool_in_grains

__all__ = ["DepthTrace", "draw_force_over_depth"]

Row = tuple[float, float, float, float]
"""Depth of the tool's lowest point below the surface [m] and force on the tool [N]: d, fx, fy, fz."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DepthTrace:
    """Rows over time of three wrenches' forces, in the sensor frame; `swap`: depth at which the model changed [m]."""

    measured: list[Row]
    predicted: list[Row]
    residual: list[Row]
    swap: float | None = None


def draw_force_over_depth(trace: DepthTrace, file: Path, *, title: str, scene: MovingTool) -> None:
    """Draw the demo's figure, a PNG: the scene's first moment, and beside it force over depth and the residual."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12.6, 5.6), layout="constrained")
    parts: Any = figure.subfigures(1, 2, width_ratios=(1.0, 1.15))
    left, right = parts
    draw_tool_in_grains(left, left.add_subplot(projection="3d", computed_zorder=False), scene)
    axes = right.subplots(3, 1, sharex=True, gridspec_kw={"height_ratios": (1.0, 1.0, 0.6)})
    for axis, component, name in ((axes[0], 3, "z (down)"), (axes[1], 1, "x (sideways)")):
        for rows, label, style in (
            (trace.measured, "virtual load cell, less bias and weight", {"color": "0.65", "lw": 1.0}),
            (trace.predicted, "predicted by RFT", {"color": "tab:red", "lw": 1.5}),
        ):
            data = np.array(rows)
            axis.plot(data[:, 0] * 1e3, data[:, component], label=label, **style)
        axis.set_ylabel(f"Force along\nsensor {name} [N]")
    data = np.array(trace.residual)
    for component, label in ((1, "x"), (2, "y"), (3, "z")):
        axes[2].plot(data[:, 0] * 1e3, data[:, component], lw=0.7, label=label)
    axes[2].set_ylabel("Residual [N]")
    drawn = 1e3 * float(scene.surface_height - scene.placed[0, :, 2].min())
    for axis in axes:
        if trace.swap is not None:
            axis.axvline(trace.swap * 1e3, color="tab:blue", ls="--", lw=1.0, label="α_y model swapped")
        axis.axvline(drawn, color="0.3", ls=":", lw=1.2, label="the moment on the left")
        axis.grid(alpha=0.3)
    axes[2].set_xlabel("Depth of the tool's lowest point [mm]")
    axes[0].legend(loc="lower left", fontsize=8)
    axes[2].legend(*(handles[:3] for handles in axes[2].get_legend_handles_labels()), fontsize=8, ncols=3)
    figure.suptitle(title)
    figure.savefig(file, dpi=110, metadata={"Software": None})
