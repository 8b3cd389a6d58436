"""Show a calibration: a table in the terminal, and a figure of the penetrations."""

from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

from rft_ros.calibration.calibrate import Calibration
from rft_ros.calibration.zeta import ZetaFit
from rft_ros.errors import InputError, reason_of
from rft_ros.report.charts import Chart, Line, Panel
from rft_ros.report.pictures import draw_chart

__all__ = ["draw_penetrations", "print_overview"]

_WIDE = 120
"""Least width of a terminal [columns] for goodness and source side by side."""


def _number(value: float, error: float) -> str:
    """Value ± standard error, to two digits of the error."""
    if not error > 0.0:
        return f"{value:.6g}"
    places = max(0, 1 - int(np.floor(np.log10(error))))
    return f"{value:.{places}f} ± {error:.{places}f}"


def print_overview(result: Calibration, console: Console) -> None:
    """Print the fitted values with standard errors and goodness of fit, what is not identifiable and why, and notes."""
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
    """Draw measured and predicted force over depth to a PNG, one panel for each penetration."""
    rows = []
    for number, p in enumerate(fit.penetrations):
        lines = {
            "measured, less bias and tool weight": ("measured", p.measured),
            "RFT with its own ζ": ("z", p.zeta * p.predicted),
        }
        name = f"{p.bag}: own ζ {p.zeta:.2f}"
        if len(fit.penetrations) > 1:
            others = fit.zeta_of_others(number)
            lines["RFT with the mean ζ of the others"] = ("predicted", others * p.predicted)
            lines["residual of that"] = ("residual", p.measured - others * p.predicted)
            name += f", ζ of the others {others:.2f} (RMS {100 * p.misfit(others):.1f} % of the peak)"
        panel = Panel(
            x_label=f"Depth of the lowest point [mm]; {name}",
            y_label="Vertical force [N]",
            lines=tuple(Line(label=k, colour=c, x=1e3 * p.depth, y=y) for k, (c, y) in lines.items()),
        )
        rows.append((panel,))
    chart = Chart(
        name="penetrations",
        title="Vertical penetration",
        panels=tuple(rows),
        same_x=False,
        height=330 * len(rows),
    )
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        draw_chart(chart, file, title=f"ζ = {fit.zeta:.3f} ± {fit.error:.3f}")
    except (OSError, ValueError) as error:
        raise InputError(f"figure '{file}' cannot be written: {reason_of(error)}") from None
