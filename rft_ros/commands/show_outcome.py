"""Print what a study came to: its table, what it left out, and where it was written."""

from collections.abc import Iterable
from pathlib import Path

from rich.console import Console
from rich.table import Table

from rft_ros.studies.outcome import Outcome

__all__ = ["show_outcome"]


def show_outcome(console: Console, outcome: Outcome, files: Iterable[Path]) -> None:
    """Print an outcome that was written to these files."""
    table = Table(title=outcome.title, title_justify="left")
    for name in outcome.table.header:
        table.add_column(name)
    for row in outcome.table.rows:
        table.add_row(*row)
    console.print(table)
    for sentence in outcome.left_out:
        console.print(f"left out: {sentence}")
    console.print("\n".join(f"-> {file}" for file in files), soft_wrap=True, highlight=False)
