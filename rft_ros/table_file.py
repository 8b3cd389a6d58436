"""Reads tables of numbers: CSV files whose header names the columns, in any order, and their units."""

import codecs
import io
import re
from array import array
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError, file_errors, shown
from rft_ros.files import MAX_BYTES, MAX_NUMBERS, read_file

__all__ = ["Column", "Rows", "columns_named", "read_table"]

_LONGEST_LINE = 2**16  # bytes; as a list of cells, a line of 60 MB would take 1.7 GB
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
class _Header:
    """For each column its place in a line and its factor; what separates cells, and how many a line has.

    `begin`: the line at which the rows begin.
    """

    places: dict[Column, tuple[int, float]]
    separator: str | None
    width: int
    begin: int


def read_table(
    file: Path,
    what: str,
    columns: Sequence[Column],
    *optional: Sequence[Column],
    limit: int = MAX_BYTES,
    without_header: Sequence[Sequence[Column]] = (),
) -> Rows:
    """The `columns` of a `checked_file` in CSV format, and those of the groups `optional` that it has, in this order.

    Other columns, empty lines and lines that begin with # are skipped; the header may be such a line. Cells are
    separated by commas, semicolons, tabs or spaces. Where not by commas, a number may have a decimal comma. `limit`:
    most bytes. `without_header`: orders of columns, of which one is taken if there is no header. Raises InputError,
    which quotes no row of the file.
    """
    data, named = read_file(file, what, limit=limit), f"{what} '{file}'"
    with file_errors(named, "read"):
        return _rows(data, named, _header(data, named, (columns, *optional), without_header))


def _lines(data: bytes, named: str) -> Iterator[tuple[int, bytes]]:
    """The lines with their numbers, one at a time: a list of all of them would have many times the file's size."""
    data = data.removeprefix(codecs.BOM_UTF8)
    stream = io.BytesIO(data if b"\n" in data else data.replace(b"\r", b"\n"))
    for number, line in enumerate(stream, start=1):
        if len(line) > _LONGEST_LINE:
            raise InputError(f"{named} line {number} has over {_LONGEST_LINE:,} bytes; write one row in each line")
        yield number, line


def _header(
    data: bytes, named: str, groups: Sequence[Sequence[Column]], without_header: Sequence[Sequence[Column]]
) -> _Header:
    """The first line that is no comment, or the last comment before it that names all columns."""
    in_a_comment = None
    for number, line in _lines(data, named):
        text = line.decode().strip()
        if not text:
            continue
        separator = next((mark for mark in ";\t," if mark in text), None)
        names = [cell.strip().strip("\"'") for cell in text.lstrip("# ").split(separator)]
        if text[0] == "#":
            with suppress(InputError):
                in_a_comment = _Header(_places(names, named, groups), separator, len(names), number + 1)
            continue
        if any(_unit(name, column) is not None for name in names for group in groups for column in group):
            return _Header(_places(names, named, groups), separator, len(names), number + 1)
        if in_a_comment is not None:
            break
        for order in without_header:
            if len(order) == len(names):
                return _Header({column: (k, 1.0) for k, column in enumerate(order)}, separator, len(names), number)
        break
    return in_a_comment or _Header(_places([], named, groups), None, 0, 0)


def _unit(name: str, column: Column) -> str | None:
    """The unit that a name in a header gives to a column; None if the name is not of this column."""
    if column.units is None:
        return "" if name == column.name else None
    match = re.match(f"{column.name.replace('_', '[ _]?')}(?![a-z])(.*)$", name.lower().translate(_LETTERS))
    return None if match is None else re.sub(r"[\s_\[\]()^*·]", "", match[1].replace("per", "/"))


def _places(names: Sequence[str], named: str, groups: Sequence[Sequence[Column]]) -> dict[Column, tuple[int, float]]:
    """The place and the factor of each column of the first group, and of those others that the header names."""
    places: dict[Column, tuple[int, float]] = {}
    for group in groups:
        if group is not groups[0] and not any(_unit(name, column) is not None for name in names for column in group):
            continue
        for column in group:
            units = column.units or {"": 1.0}
            of_names = [(k, _unit(name, column)) for k, name in enumerate(names)]
            found = [(k, units[unit]) for k, unit in of_names if unit is not None and unit in units]
            if len(found) == 1:
                places[column] = found[0]
                continue
            must = f"its first line must name {','.join(column.name for column in group)}"
            if found:
                raise InputError(f"{named} has several columns {column.name}; {must}")
            if names and column.wanted:
                must = f"it must be {column.wanted}; the columns are {shown(', '.join(names))}"
            raise InputError(f"{named} has no column {column.name}; {must}")
    return places


def _rows(data: bytes, named: str, header: _Header) -> Rows:
    places, decimal_comma = [place for place, _ in header.places.values()], header.separator != ","
    numbers, counted = array("d"), array("q")
    for number, line in _lines(data, named):
        if number < header.begin or line.startswith(b"#"):
            continue
        cells = (line.replace(b",", b".") if decimal_comma else line).decode().split(header.separator)
        if len(cells) != header.width:
            if not line.strip():
                continue
            raise InputError(f"{named} line {number} is not {header.width} numbers; correct or remove it")
        try:
            numbers.extend([float(cells[place]) for place in places])
        except ValueError:
            numbers.extend(_with_gaps(cells, header, f"{named} line {number}"))
        counted.append(number)
        if len(numbers) > MAX_NUMBERS:
            most = f"the limit is {MAX_NUMBERS // len(places):,} rows"
            raise InputError(f"{named} has too many rows; {most}; divide the file")
    if not counted:
        raise InputError(f"{named} has a header and no rows; it needs at least one")
    factors = {column.name: factor for column, (_, factor) in header.places.items()}
    table = np.frombuffer(numbers).reshape(len(counted), -1) * np.array([*factors.values()])
    return Rows(table, np.frombuffer(counted, dtype=np.int64), factors)


def _with_gaps(cells: list[str], header: _Header, where: str) -> list[float]:
    """The numbers of a line, some of which are missing or in quotes."""
    numbers = []
    for column, (place, _) in header.places.items():
        text = cells[place].strip().strip("\"'")
        try:
            numbers.append(np.nan if column.gaps and text.lower() in _MISSING else float(text))
        except ValueError:
            raise InputError(f"{where} is not {header.width} numbers ({column.name}); correct or remove it") from None
    return numbers
