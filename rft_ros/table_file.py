"""Reads tables of numbers: CSV files whose header names the columns, in any order, and their units."""

import csv
import io
import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError, shown
from rft_ros.files import MAX_BYTES, read_text

_SEPARATORS = ",;\t "
_QUOTES = "\"'"
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-", "--", "nodata"}
_LETTERS = str.maketrans({
    "β": "beta", "γ": "gamma", "α": "alpha", "³": "3", "⁻": "-", "µ": "u", "μ": "u"
})  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """A column of a table.

    `units`: for each unit that may follow the name in the header (without spaces and brackets), its factor to the
    reader's unit. `wanted`: what the column holds, for a sentence. `gaps`: whether an empty cell or nan is a missing
    number, which becomes NaN.
    """

    name: str
    units: Mapping[str, float] = field(default_factory=lambda: {"": 1.0})
    wanted: str = ""
    gaps: bool = False

    def places(self, headings: Sequence[str]) -> list["_Place"]:
        """Where headings name this column, with one of its units; if it has a `wanted` one, with any unit."""
        name = self.name.replace("_", "[ _]?")
        places_found = []
        for index, heading in enumerate(headings):
            match = re.match(f"{name}(?![a-z])(.*)$", heading.lower().translate(_LETTERS))
            if match:
                unit = re.sub(r"[\s_\[\]()^*·]", "", match[1].replace("per", "/"))
                if unit in self.units or self.wanted:
                    places_found.append(_Place(self, index, unit))
        return places_found


def columns_named(names: Sequence[str], *, gaps: bool = False) -> tuple[Column, ...]:
    """Columns of these names, without units in the header."""
    return tuple(Column(name, gaps=gaps) for name in names)


@dataclass(frozen=True, slots=True, eq=False)
class TableColumns:
    """The rows of a table, with their `lines` in the file, counted from 1, shape [n].

    `columns`: by name in the reader's order, the numbers of each column in the reader's unit, shape [n]. `units`: the
    unit of each in the header, "" without one.
    """

    columns: dict[str, NDArray[np.float64]]
    units: dict[str, str]
    lines: NDArray[np.int64]

    def at(self, is_chosen: NDArray[np.bool_]) -> "TableColumns":
        """Some of the rows: of each whether it is one, shape [n]."""
        columns = {name: values[is_chosen] for name, values in self.columns.items()}
        return TableColumns(columns=columns, units=self.units, lines=self.lines[is_chosen])

    def has_any(self, names: Sequence[str]) -> NDArray[np.bool_]:
        """Of each row whether a number of the named columns is there, shape [n]."""
        missing = np.isnan([self.columns[name] for name in names])
        return np.asarray(~missing.all(axis=0))


class _Place(NamedTuple):
    """A column, the number of its cell in a line, and its unit."""

    column: Column
    cell: int
    unit: str


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """A table whose header is read. `named`: it in a sentence; `headings`: the names in its first line."""

    named: str
    headings: list[str]
    _lines: Iterator[tuple[int, str]]
    _separator: str | None

    def read(
        self,
        columns: Sequence[Column],
        *optional: Sequence[Column],
        headings: Sequence[str] | None = None,
    ) -> TableColumns:
        """The `columns`, and those of the groups `optional` that it has, in this order; once.

        `headings`: other names for all columns of the file. Raises InputError, which quotes no row of the file.
        """
        names = self.headings if headings is None else headings
        places: list[_Place] = []
        for group in (columns, *optional):
            if group is columns or any(column.places(names) for column in group):
                places += [_place(column, names, group, self.named) for column in group]
        return _rows(
            self._lines,
            self.named,
            places=places,
            separator=self._separator,
            width=len(self.headings),
        )


def open_table(file: Path, what: str, *, limit: int = MAX_BYTES) -> Table:
    """Read the header of a `checked_file` in CSV format.

    Empty lines and lines that begin with # are skipped. The first other line names the columns, of which more may
    stand there. It also tells what separates cells: commas, semicolons, tabs or spaces. Between semicolons a number may
    have a decimal comma. `limit`: most bytes.
    """
    lines = _lines(read_text(file, what, limit=limit))
    _, header = next(lines, (0, ""))
    separator = _separator(header)
    headings = [heading.strip().strip(_QUOTES) for heading in header.split(separator)]
    return Table(f"{what} '{file}'", headings, lines, separator)


def read_table(
    file: Path,
    what: str,
    columns: Sequence[Column],
    *optional: Sequence[Column],
    limit: int = MAX_BYTES,
) -> TableColumns:
    """The `columns` of a table, and those of the groups `optional` that it has, as `Table.read` gives them."""
    return open_table(file, what, limit=limit).read(columns, *optional)


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """The lines that are no comment and not empty, with their numbers."""
    for number, line in enumerate(io.StringIO(text, newline=None), start=1):
        content = line.strip("\r\n")
        if content.strip() and not content.startswith("#"):
            yield number, content


def _separator(header: str) -> str | None:
    """What separates cells; None: any white space."""
    try:
        separator = csv.Sniffer().sniff(header, _SEPARATORS).delimiter
    except csv.Error:  # a single column
        return None
    return None if separator == " " else separator


def _place(column: Column, headings: Sequence[str], group: Sequence[Column], named: str) -> _Place:
    """The place of a column of a group. Raises InputError where it is missing, or there twice."""
    places_found = [place for place in column.places(headings) if place.unit in column.units]
    if len(places_found) == 1:
        return places_found[0]
    has = f"several columns {column.name}" if places_found else f"no column {column.name}"
    must = f"its first line must name {','.join(column_of_group.name for column_of_group in group)}, without #"
    if column.wanted:
        must += f"; {column.name} must be {column.wanted}"
    headings_of_it = [headings[place.cell] for place in column.places(headings)]
    if headings_of_it:
        must += f", and the first line has {shown(', '.join(headings_of_it))}"
    raise InputError(f"{named} has {has}; {must}")


def _rows(
    lines: Iterator[tuple[int, str]],
    named: str,
    *,
    places: Sequence[_Place],
    separator: str | None,
    width: int,
) -> TableColumns:
    """The rows below the header. `width`: how many cells a line has."""
    numbers = array("d")
    line_numbers = array("q")
    for number, line in lines:
        cells = (line.replace(",", ".") if separator == ";" else line).split(separator)
        if len(cells) != width:
            raise InputError(f"{named} line {number} is not {width} numbers; correct or remove it")
        try:
            numbers.extend([float(cells[place.cell]) for place in places])
        except ValueError:
            where = f"{named} line {number} is not {width} numbers"
            numbers.extend([_number(cells[place.cell], place.column, where) for place in places])
        line_numbers.append(number)
    if not line_numbers:
        raise InputError(f"{named} has a header and no rows; it needs at least one")
    table = np.frombuffer(numbers).reshape(len(line_numbers), -1)
    return TableColumns(
        columns={
            place.column.name: values * place.column.units[place.unit]
            for place, values in zip(places, table.T, strict=True)
        },
        units={place.column.name: place.unit for place in places},
        lines=np.frombuffer(line_numbers, dtype=np.int64),
    )


def _number(cell: str, column: Column, where: str) -> float:
    """The number in a cell, which may be missing or in quotes."""
    text = cell.strip().strip(_QUOTES)
    if column.gaps and text.lower() in _MISSING:
        return np.nan
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{where} ({column.name}); correct or remove it") from None
