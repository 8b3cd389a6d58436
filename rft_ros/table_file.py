"""Reads tables of numbers: CSV files whose header names the columns, in any order, and their units."""

import csv
import io
import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError, shown
from rft_ros.files import MAX_BYTES, read_text

_SEPARATORS = ",;\t "
_QUOTES = "\"'"
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-", "--", "nodata"}
_LETTERS = str.maketrans({"β": "beta", "γ": "gamma", "α": "alpha", "³": "3", "⁻": "-"})


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """A column of a table.

    `units`: for each unit that may follow the name in the header (without spaces and brackets), its factor to the
    reader's unit; None: the header has the bare name. `wanted`: what the column holds, for a sentence. `gaps`: whether
    an empty cell or nan is a missing number, which becomes NaN.
    """

    name: str
    units: Mapping[str, float] | None = None
    wanted: str = ""
    gaps: bool = False

    def unit(self, heading: str) -> str | None:
        """The unit that a heading gives to this column; None if the heading is of another column."""
        if self.units is None:
            return "" if heading == self.name else None
        name = self.name.replace("_", "[ _]?")
        match = re.match(f"{name}(?![a-z])(.*)$", heading.lower().translate(_LETTERS))
        return (
            None if match is None else re.sub(r"[\s_\[\]()^*·]", "", match[1].replace("per", "/"))
        )


def columns_named(names: Sequence[str]) -> tuple[Column, ...]:
    """Columns of these names, without units in the header."""
    return tuple(map(Column, names))


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """The numbers of a table, shape [n, columns], in the reader's units, and the line of each row, counted from 1.

    `factors`: of each column, in their order, from the unit in the header to the reader's unit.
    """

    numbers: NDArray[np.float64]
    lines: NDArray[np.int64]
    factors: dict[str, float]

    def column(self, name: str) -> NDArray[np.float64]:
        """The numbers of a column, shape [n]."""
        numbers: NDArray[np.float64] = self.numbers[:, [*self.factors].index(name)]
        return numbers


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a column stands in a line, and the factor of its unit."""

    column: Column
    index: int
    factor: float


def read_table(
    file: Path,
    what: str,
    columns: Sequence[Column],
    *optional: Sequence[Column],
    limit: int = MAX_BYTES,
) -> Rows:
    """The `columns` of a `checked_file` in CSV format, and those of the groups `optional` that it has, in this order.

    Empty lines and lines that begin with # are skipped. The first other line names the columns, of which more may
    stand there. It also tells what separates cells: commas, semicolons, tabs or spaces. Between semicolons a number may
    have a decimal comma. `limit`: most bytes. Raises InputError, which quotes no row of the file.
    """
    named = f"{what} '{file}'"
    lines = _lines(read_text(file, what, limit=limit))
    _, header = next(lines, (0, ""))
    separator = _separator(header)
    headings = [heading.strip().strip(_QUOTES) for heading in header.split(separator)]
    places: list[_Place] = []
    for group in (columns, *optional):
        if group is columns or _names_any(headings, group):
            places += [_place(column, headings, group, named) for column in group]
    return _rows(lines, named, places=places, separator=separator, width=len(headings))


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


def _names_any(headings: Sequence[str], group: Sequence[Column]) -> bool:
    return any(column.unit(heading) is not None for column in group for heading in headings)


def _place(column: Column, headings: Sequence[str], group: Sequence[Column], named: str) -> _Place:
    """The place of a column of a group. Raises InputError where it is missing, or there twice."""
    units = column.units or {"": 1.0}
    found = []
    for index, heading in enumerate(headings):
        unit = column.unit(heading)
        if unit is not None and unit in units:
            found.append(_Place(column, index, units[unit]))
    if len(found) == 1:
        return found[0]
    must = f"its first line must name {','.join(other.name for other in group)}, without #"
    if found:
        raise InputError(f"{named} has several columns {column.name}; {must}")
    if column.wanted and _names_any(headings, group):
        must = f"it must be {column.wanted}; the columns are {shown(', '.join(headings))}"
    raise InputError(f"{named} has no column {column.name}; {must}")


def _rows(
    lines: Iterator[tuple[int, str]],
    named: str,
    *,
    places: Sequence[_Place],
    separator: str | None,
    width: int,
) -> Rows:
    """The rows below the header. `width`: how many cells a line has."""
    indices = [place.index for place in places]
    numbers = array("d")
    counted = array("q")
    for number, line in lines:
        cells = (line.replace(",", ".") if separator == ";" else line).split(separator)
        if len(cells) != width:
            raise InputError(f"{named} line {number} is not {width} numbers; correct or remove it")
        try:
            numbers.extend([float(cells[index]) for index in indices])
        except ValueError:
            where = f"{named} line {number} is not {width} numbers"
            numbers.extend([_number(cells[place.index], place.column, where) for place in places])
        counted.append(number)
    if not counted:
        raise InputError(f"{named} has a header and no rows; it needs at least one")
    factors = {place.column.name: place.factor for place in places}
    table = np.frombuffer(numbers).reshape(len(counted), -1) * np.array([*factors.values()])
    return Rows(table, np.frombuffer(counted, dtype=np.int64), factors)


def _number(cell: str, column: Column, where: str) -> float:
    """The number in a cell, which may be missing or in quotes."""
    text = cell.strip().strip(_QUOTES)
    if column.gaps and text.lower() in _MISSING:
        return np.nan
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{where} ({column.name}); correct or remove it") from None
