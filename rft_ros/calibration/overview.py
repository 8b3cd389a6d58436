"""What a calibration came to, as a table on the terminal."""

from rich.console import Console
from rich.table import Column, Table
from rich.text import Text

from rft_ros.calibration.outcome import Calibration

__all__ = ["print_overview"]

_ROOM = 120  # columns of a terminal in which goodness and source stand side by side


def _number(value: float, error: float) -> str:
    """Value ± standard error, to two digits of the error."""
    if not error > 0.0:
        return f"{value:.6g}"
    places = max(0, 1 - int(f"{error:e}".partition("e")[2]))
    return f"{value:.{places}f} ± {error:.{places}f}"


def print_overview(result: Calibration, console: Console) -> None:
    """Print what was fitted with its standard error and goodness of fit, what was refused and why, and the notes."""
    if result.findings:
        whole = [Column(head, no_wrap=True) for head in ("fitted", "value ± error", "unit")]
        wide = console.width >= _ROOM
        heads = ("goodness of fit", "from") if wide else ("goodness of fit; from",)
        last = [Column(head, overflow="fold") for head in heads]
        table = Table(*whole, *last, box=None, pad_edge=False)
        for f in result.findings:
            values = "\n".join(_number(v, e) for v, e in zip(f.values, f.errors, strict=True))
            how = (f.goodness, f.source) if wide else ("; from ".join(filter(None, (f.goodness, f.source))),)
            table.add_row(*(Text(cell) for cell in (f.name, values, f.unit, *how)))
        console.print(table)
    if result.refusals:
        console.print()
        table = Table(Column("not told", no_wrap=True), "why", box=None, pad_edge=False)
        for r in result.refusals:
            table.add_row(Text(r.name), Text(r.why))
        console.print(table)
    for note in result.notes:
        console.print(Text(f"note: {note}"))
