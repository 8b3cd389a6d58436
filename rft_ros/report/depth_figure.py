"""Force over depth, measured and predicted."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

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


def draw_force_over_depth(trace: DepthTrace, file: Path, *, title: str) -> None:
    """Draw the vertical and lateral force over depth, and the residual, to a PNG."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(12, 4.2), layout="constrained")
    for axis, component, name in ((axes[0], 3, "sensor z (down)"), (axes[1], 1, "sensor x (sideways)")):
        for rows, label, style in (
            (trace.measured, "measured, bias and weight removed", {"color": "0.6", "lw": 1.0}),
            (trace.predicted, "predicted (RFT)", {"color": "tab:red", "lw": 1.5}),
        ):
            data = np.array(rows)
            axis.plot(data[:, 0] * 1e3, data[:, component], label=label, **style)
        axis.set_ylabel(f"Force on the tool along {name} [N]")
    data = np.array(trace.residual)
    for component, label in ((1, "x"), (2, "y"), (3, "z")):
        axes[2].plot(data[:, 0] * 1e3, data[:, component], lw=0.8, label=label)
    axes[2].set_ylabel("Residual: measured - predicted [N]")
    for axis in axes:
        if trace.swap is not None:
            axis.axvline(trace.swap * 1e3, color="tab:blue", ls="--", lw=1.0, label="α_y model swapped")
        axis.set_xlabel("Depth of the tool's lowest point [mm]")
        axis.grid(alpha=0.3)
    axes[0].legend(loc="lower left", fontsize=8)
    axes[2].legend(loc="lower left", fontsize=8, ncol=2)
    figure.suptitle(title)
    figure.savefig(file, dpi=120)
    plt.close(figure)
