"""A figure of the penetrations: measured force over depth, each predicted with its own and with the others' ζ."""

from pathlib import Path

import numpy as np

from rft_ros.calibration.penetration import ZetaFit
from rft_ros.errors import InputError, reason_of

__all__ = ["draw_penetrations"]

_ACROSS = 3


def draw_penetrations(fit: ZetaFit, file: Path) -> None:
    """Draw to a PNG: one panel a penetration, with the residual that the others' ζ leaves."""
    from matplotlib.figure import Figure

    count = len(fit.penetrations)
    across = min(count, _ACROSS)
    down = -(-count // across)
    figure = Figure(figsize=(5.2 * across, 4.6 * down), layout="constrained")
    zetas = np.array([p.zeta for p in fit.penetrations])
    for number, p in enumerate(fit.penetrations):
        axes = figure.add_subplot(down, across, number + 1)
        depth = 1e3 * p.depth
        axes.plot(depth, p.measured, color="0.25", lw=1.6, label="measured, less bias and tool weight")
        axes.plot(
            depth, p.zeta * p.predicted, color="tab:green", lw=1.1, ls="--", label=f"RFT, its own ζ = {p.zeta:.2f}"
        )
        if count > 1:
            zeta = float((zetas.sum() - p.zeta) / (count - 1))
            label = f"RFT, ζ = {zeta:.2f} from the other{'s' if count > 2 else ''}"
            axes.plot(depth, zeta * p.predicted, color="tab:red", lw=1.4, label=label)
            rest = f"residual of that: RMS {100 * p.misfit(zeta):.1f} % of the peak"
            axes.plot(depth, p.measured - zeta * p.predicted, color="tab:blue", lw=0.9, label=rest)
        axes.axhline(0.0, color="0.6", lw=0.6)
        axes.set_title(p.bag)
        axes.set_xlabel("Depth of the tool's lowest point below the surface [mm]")
        axes.set_ylabel("Vertical force on the tool, up [N]")
        axes.grid(alpha=0.3)
        axes.legend(loc="upper left", fontsize=8)
    figure.suptitle(
        f"Vertical penetration: ζ = {fit.zeta:.3f} ± {fit.error:.3f} over {count} way{'s' * (count > 1)} down"
    )
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(file, dpi=110, metadata={"Software": None})
    except (OSError, ValueError) as error:
        raise InputError(f"figure '{file}' cannot be written: {reason_of(error)}") from None
