"""What a study leaves: a figure, its numbers, and a table for people."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from rft_ros.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["Columns", "Outcome", "TextTable", "published_against_ours", "write_outcome"]

Columns = Mapping[str, Sequence[object]]
"""A table of numbers by column, all of one length; names carry the unit."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TextTable:
    """A table for people: cells are text, already rounded."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def markdown(self) -> str:
        """The table in Markdown, lines ending in a newline."""
        lines = [self.header, tuple("---" for _ in self.header), *self.rows]
        return "".join("| " + " | ".join(line) + " |\n" for line in lines)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """A study's results. `numbers`: CSV tables by file stem. `left_out`: what was not computed, and why."""

    name: str
    title: str
    figure: "Figure"
    numbers: Mapping[str, Columns]
    table: TextTable
    left_out: tuple[str, ...] = field(default=())

    def markdown(self) -> str:
        """The table, and what was left out, in Markdown."""
        return self.table.markdown() + "".join(f"\nLeft out: {sentence}\n" for sentence in self.left_out)


def published_against_ours(*rows: tuple[str, str, str]) -> TextTable:
    """A table of quantity, published value and ours; a value that the project does not know is 'not stated here'."""
    return TextTable(header=("quantity", "published", "ours"), rows=rows)


def write_outcome(outcome: Outcome, folder: Path) -> list[Path]:
    """Write NAME.png, NAME.svg, NAME.md and the CSV tables into the folder, made if need be; returns the files.

    The same outcome gives the same bytes. Raises InputError where a file cannot be written.
    """
    from rft_ros.studies.figure import picture

    contents: dict[str, bytes] = {f"{outcome.name}.{kind}": picture(outcome.figure, kind) for kind in ("png", "svg")}
    contents[f"{outcome.name}.md"] = f"# {outcome.title}\n\n{outcome.markdown()}".encode()
    contents |= {f"{stem}.csv": _csv(columns) for stem, columns in outcome.numbers.items()}
    files = [folder / name for name in contents]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for file, data in zip(files, contents.values(), strict=True):
            file.write_bytes(data)
    except OSError as error:
        raise InputError(f"cannot write '{error.filename}': {error.strerror}") from None
    return files


def _csv(columns: Columns) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    for row in zip(*columns.values(), strict=True):
        writer.writerow([repr(float(v)) if isinstance(v, float) else v for v in row])
    return text.getvalue().encode()
