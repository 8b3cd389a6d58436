"""A calibration for the reader: a table on the terminal, and a figure of the penetrations."""

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

from rft_ros.calibration.calibrate import Calibration
from rft_ros.calibration.zeta import ZetaFit
from rft_ros.errors import InputError, reason_of

__all__ = ["draw_penetrations", "print_overview"]

_WIDE = 120
"""Columns of a terminal from which goodness and source stand side by side."""

_ACROSS = 3


def _number(value: float, error: float) -> str:
    """Value ± standard error, to two digits of the error."""
    if not error > 0.0:
        return f"{value:.6g}"
    places = max(0, 1 - int(np.floor(np.log10(error))))
    return f"{value:.{places}f} ± {error:.{places}f}"


def print_overview(result: Calibration, console: Console) -> None:
    """Print the fitted values with standard error and goodness of fit, what is not identifiable and why, the notes."""
    if result.fitted:
        wide = console.width >= _WIDE
        whole = [Column(head, no_wrap=True) for head in ("fitted", "value ± error", "unit")]
        heads = ("goodness of fit", "from") if wide else ("goodness of fit; from",)
        table = Table(*whole, *(Column(head, overflow="fold") for head in heads), box=None, pad_edge=False)
        for f in result.fitted:
            values = "\n".join(_number(v, e) for v, e in zip(f.values, f.errors, strict=True))
            how = (f.goodness, f.source) if wide else ("; from ".join(filter(None, (f.goodness, f.source))),)
            table.add_row(*(Text(cell) for cell in (f.name, values, f.unit, *how)))
        console.print(table)
    if result.not_identifiable:
        console.print()
        table = Table(Column("not identifiable", no_wrap=True), "why", box=None, pad_edge=False)
        for name, why in result.not_identifiable.items():
            table.add_row(Text(name), Text(why))
        console.print(table)
    for note in result.notes:
        console.print(Text(f"note: {note}"))


def draw_penetrations(fit: ZetaFit, file: Path) -> None:
    """Draw to a PNG: force over depth, measured and predicted with each ζ; one panel a penetration."""
    from matplotlib.figure import Figure

    count = len(fit.penetrations)
    across = min(count, _ACROSS)
    down = -(-count // across)
    figure = Figure(figsize=(5.2 * across, 4.6 * down), layout="constrained")
    for number, p in enumerate(fit.penetrations):
        axes = figure.add_subplot(down, across, number + 1)
        depth = 1e3 * p.depth
        axes.plot(depth, p.measured, color="0.25", lw=1.6, label="measured, less bias and tool weight")
        own = f"RFT, its own ζ = {p.zeta:.2f}"
        axes.plot(depth, p.zeta * p.predicted, color="tab:green", lw=1.1, ls="--", label=own)
        if count > 1:
            zeta = fit.zeta_of_others(number)
            label = f"RFT, ζ = {zeta:.2f} from the other{'s' if count > 2 else ''}"
            axes.plot(depth, zeta * p.predicted, color="tab:red", lw=1.4, label=label)
            rest = f"residual of that: RMS {100 * p.misfit(zeta):.1f} % of the peak"
            axes.plot(depth, p.measured - zeta * p.predicted, color="tab:blue", lw=0.9, label=rest)
        axes.axhline(0.0, color="0.6", lw=0.6)
        axes.set(title=p.bag, xlabel="Depth of the tool's lowest point below the surface [mm]")
        axes.set_ylabel("Vertical force on the tool, up [N]")
        axes.grid(alpha=0.3)
        axes.legend(loc="upper left", fontsize=8)
    plural = "s" if count > 1 else ""
    figure.suptitle(f"Vertical penetration: ζ = {fit.zeta:.3f} ± {fit.error:.3f} over {count} penetration{plural}")
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(file, dpi=110, metadata={"Software": None})
    except (OSError, ValueError) as error:
        raise InputError(f"figure '{file}' cannot be written: {reason_of(error)}") from None
