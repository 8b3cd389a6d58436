"""Reads and writes the files that define a user's medium: nine coefficients (YAML), or a measured stress map (CSV).

The coefficients of a stress map are fitted when it is read.
"""

import re
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from rft_ros.errors import InputError, shown
from rft_ros.files import read_text, read_yaml, whole
from rft_ros.parameters.stress_map import MediumFit, StressMap, fit_medium
from rft_ros.rft import MEDIA, Medium

__all__ = ["is_medium_file", "read_medium", "read_stress_map", "write_medium"]

Array = NDArray[np.float64]

_YAML = (".yaml", ".yml")
_MAX_COEFFICIENTS = 16 * 2**10  # bytes; YAML takes 12 s for 1 MB
_MAX_MAP = 2 * 2**20  # bytes; a node reads it between two ticks
_MAX_CELLS = 5_000
_LEAST, _MOST = 1e-3, 50.0
"""Plausible range of a medium's greatest stress per depth [N/cm³]; loose poppy seeds have 0.25, generic 1."""

_RADIANS = 3.2  # a map whose angles are all smaller is in radians, since a map in degrees reaches further
_STEPS = 4  # this many different values of one angle within _RADIANS are in radians, whatever the other angle's unit is
_MOST_DEGREES = 720.0


def is_medium_file(text: str) -> bool:
    """Whether a medium is given by a file, rather than by a name of `MEDIA`."""
    return text not in MEDIA and (bool(Path(text).suffix) or "/" in text)


def read_medium(file: str) -> Medium:
    """The medium that a file defines, with the file's stem as its name unless the file gives one.

    A YAML file is a mapping with the nine coefficients [N/cm³], as `write_medium` writes it. Any other file is a stress
    map. Raises InputError for a file that cannot be used.
    """
    path = Path(file)
    if path.suffix.lower() in _YAML:
        return _of_yaml(path)
    measured = read_stress_map(path)
    try:
        return fit_medium(measured, name=path.stem).medium
    except ValueError as error:
        raise InputError(f"medium.file '{file}': {error}") from None


def _of_yaml(file: Path) -> Medium:
    what = f"medium.file '{file}'"
    content = read_yaml(file, "medium.file", limit=_MAX_COEFFICIENTS)
    if not isinstance(content, Mapping):
        raise InputError(f"{what} has no coefficients; it needs {', '.join(MEDIA['generic'].coefficients)}")
    given = content.get("coefficients", content)
    if not isinstance(given, Mapping):
        raise InputError(f"{what}: coefficients is {shown(given)}; it must have names and numbers [N/cm³]")
    given = {str(name).replace("-", "m"): value for name, value in given.items()}  # Li et al. write B-11
    found = {}
    for name in MEDIA["generic"].coefficients:
        value = given.get(name)
        if value is None:
            raise InputError(f"{what} has no coefficient {name}; give all nine, and 0.0 for one that is zero")
        if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= _MOST:
            raise InputError(f"{what}: {name} is {shown(value)}; it must be a number of at most {_MOST:g} N/cm³")
        found[name] = float(value)
    medium = Medium.of(str(content.get("name", file.stem)), found)
    if max(map(abs, found.values())) < 0.1 * _LEAST:
        raise InputError(f"{what}: its coefficients are below {0.1 * _LEAST:g}; they must be in N/cm³")
    if medium.strength <= 0.0:
        raise InputError(f"{what}: with these coefficients the force points along the motion; check the signs")
    return medium


def write_medium(file: Path, fit: MediumFit, *, source: str) -> None:
    """Write a fitted medium for `read_medium`, with standard errors and misfit. `source`: the map of the fit."""

    def rounded(value: float) -> float | None:
        return None if np.isnan(value) else float(f"{value:.4g}")

    tree: dict[str, Any] = {"name": fit.medium.name}
    tree["coefficients"] = {name: round(value, 6) for name, value in fit.medium.coefficients.items()}
    tree["errors"] = {name: rounded(value) for name, value in fit.errors.items()}
    tree["misfit"] = {"measured": rounded(fit.size), "fitted": rounded(fit.misfit)}
    tree["misfit"] |= {"generic_scaled": rounded(fit.misfit_scaled), "zeta_of_generic": rounded(fit.zeta)}
    if fit.left_out is not None:
        tree["left_out"] = {"fitted": rounded(fit.left_out.fitted)}
        tree["left_out"]["generic_scaled"] = rounded(fit.left_out.scaled)
    head = [
        f"A medium for medium.file: Eq. (4) of docs/method.md, fitted by rft fit-medium to {source}.",
        "All in N/cm³. errors: standard errors of the coefficients; null: the map does not determine it.",
        "misfit: RMS of the stress (alpha_x, alpha_z), as measured, and of the residual of the fit or of the generic",
        "medium times zeta_of_generic. left_out: RMS of the residual on cells that were left out of the fit.",
        *fit.medium.doubts,
        *fit.remarks,
    ]
    with whole(file, "medium") as part:
        lines = "".join(f"# {' '.join(sentence.split())}\n" for sentence in head)
        part.write_text(lines + yaml.safe_dump(tree, sort_keys=False, allow_unicode=True), encoding="utf-8")


_QUANTITIES = ("beta", "gamma", "alpha_x", "alpha_z")
_DEGREES = {"": 1.0, "deg": 1.0, "degree": 1.0, "degrees": 1.0, "°": 1.0}
_OF_ANGLES = _DEGREES | {"rad": np.rad2deg(1.0), "radian": np.rad2deg(1.0), "radians": np.rad2deg(1.0)}
_OF_STRESSES = {"": 1.0, "n/cm3": 1.0, "ncm3": 1.0, "ncm-3": 1.0, "n/m3": 1e-6, "nm3": 1e-6, "nm-3": 1e-6}
_OF_STRESSES |= {"pa/m": 1e-6, "pam-1": 1e-6, "kpa/m": 1e-3, "mpa/m": 1.0, "kpa/cm": 0.1, "kn/m3": 1e-3, "n/mm3": 1e3}
_MISSING = {"", "nan", "na", "n/a", "null", "none", "-", "--", "nodata"}


class _Column(NamedTuple):
    """A column of a map: its quantity, its place in a row, and the factor from its unit to degrees or N/cm³."""

    quantity: str
    place: int
    factor: float


def read_stress_map(file: Path) -> StressMap:
    """A map from a CSV file with the columns beta_deg, gamma_deg, alpha_x, alpha_z in any order.

    The header may be a comment. A name may end in a unit, such as beta_rad or alpha_z_N/m3; without one the unit is
    degrees or N/cm³. Other columns and lines that begin with # are skipped. An empty cell or nan is a missing stress.
    Raises InputError for a file that cannot be used.
    """
    what = f"stress map '{file}'"
    lines = [line.strip() for line in read_text(file, "stress map", limit=_MAX_MAP).splitlines()]
    header, columns = _header(lines, what)
    rows = []
    for number, line in enumerate(lines[header.line :], start=header.line + 1):
        if line and not line.startswith("#"):
            rows.append(_row(line.split(header.separator), columns, f"{what} line {number}"))
    if not rows:
        raise InputError(f"{what} has a header and no rows; it needs a row for each pair of angles")
    if len(rows) > _MAX_CELLS:
        raise InputError(f"{what} has {len(rows):,} rows; the limit is {_MAX_CELLS:,}: take the mean of repeated cells")
    beta, gamma, alpha_x, alpha_z = np.array(rows).T
    _check_units(np.array([beta, gamma]), np.array([alpha_x, alpha_z]), columns, what)
    return StressMap(beta=np.deg2rad(beta), gamma=np.deg2rad(gamma), alpha_x=alpha_x, alpha_z=alpha_z)


class _Header(NamedTuple):
    """The names of the columns, what separates them, and the number of their line, from 1."""

    names: list[str]
    separator: str
    line: int


def _header(lines: list[str], what: str) -> tuple[_Header, list[_Column]]:
    """The header and its columns.

    The header is the first line that is no comment, or the last comment before it that names all four columns.
    """
    in_a_comment = None
    for number, line in enumerate(lines, start=1):
        if not line:
            continue
        separator = next((mark for mark in ",;\t" if mark in line), ",")
        header = _Header([cell.strip().strip("\"'") for cell in line.lstrip("# ").split(separator)], separator, number)
        if line.startswith("#"):
            with suppress(InputError):
                in_a_comment = header, _columns(header.names, what)
        elif any(_quantity(name)[0] for name in header.names):
            return header, _columns(header.names, what)
        else:
            break
    if in_a_comment is None:
        names = "beta_deg,gamma_deg,alpha_x,alpha_z"
        raise InputError(f"{what} has no header; a line before the numbers must name its columns, such as {names}")
    return in_a_comment


def _quantity(cell: str) -> tuple[str, str]:
    """The quantity and the unit in a name of the header; ("", "") if it begins with none of `_QUANTITIES`."""
    name = cell.lower().replace("β", "beta").replace("γ", "gamma").replace("α", "alpha")
    match = re.match(r"(beta|gamma|alpha[ _]?[xz])(?![a-z])(.*)$", name)
    if match is None:
        return "", ""
    rest = match[2].replace("³", "3").replace("⁻", "-").replace("per", "/")
    return re.sub(r"alpha[ _]?", "alpha_", match[1]), re.sub(r"[\s_\[\]()^*·]", "", rest)


def _columns(names: list[str], what: str) -> list[_Column]:
    """The columns of the four quantities, in their order."""
    columns = []
    for quantity in _QUANTITIES:
        units = _OF_ANGLES if quantity in ("beta", "gamma") else _OF_STRESSES
        found = []
        for place, name in enumerate(names):
            named, unit = _quantity(name)
            if named == quantity and unit in units:
                found.append(_Column(quantity, place, units[unit]))
        if len(found) > 1:
            raise InputError(f"{what} has several columns {quantity}; keep one")
        if not found:
            wanted = "in deg or rad" if units is _OF_ANGLES else "a stress per depth in N/cm3 (1 N/cm3 = 1e6 Pa/m)"
            raise InputError(f"{what} has no column {quantity}, {wanted}; its columns are {', '.join(names)}")
        columns += found
    return columns


def _row(cells: list[str], columns: list[_Column], where: str) -> list[float]:
    """The four values of a row, in degrees and N/cm³."""
    if len(cells) <= max(column.place for column in columns):
        raise InputError(f"{where} has {len(cells)} cells, fewer than the header")
    values = []
    for column in columns:
        text = cells[column.place].strip().strip("\"'")
        if text.lower() in _MISSING and column.quantity.startswith("alpha"):
            values.append(np.nan)
            continue
        try:
            value = float(text) * column.factor
        except ValueError:
            value = np.inf
        if not np.isfinite(value):
            raise InputError(f"{where}: {column.quantity} is {shown(text)}; it must be a finite number")
        values.append(value)
    return values


def _check_units(angles: Array, stresses: Array, columns: list[_Column], what: str) -> None:
    """Raise InputError if angles or stresses are implausible in the units that the header names."""
    widest = float(np.abs(angles).max())
    in_radians = columns[0].factor != 1.0 or columns[1].factor != 1.0
    if widest > _MOST_DEGREES:
        advice = "name the columns beta_deg and gamma_deg" if in_radians else "it is no angle in degrees"
        raise InputError(f"{what} has an angle of {widest:.4g} degrees; {advice}")
    if widest <= _RADIANS and not in_radians:
        advice = "these seem to be radians: name the columns beta_rad and gamma_rad, or give more angles"
        raise InputError(f"{what} has no angle beyond {widest:.3g} degrees; {advice}")
    for column, values in zip(columns[:2], angles, strict=True):
        widest, different = float(np.abs(values).max()), len(np.unique(values))
        if widest <= _RADIANS and different >= _STEPS and column.factor == 1.0:
            found = f"{different} different {column.quantity}, none beyond {widest:.3g} degrees"
            raise InputError(f"{what} has {found}; these seem to be radians: name the column {column.quantity}_rad")
    if not np.isfinite(stresses).any():
        raise InputError(f"{what} has no stress in any row; give alpha_x and alpha_z at some angles")
    greatest = float(np.nanmax(np.abs(stresses)))
    if not _LEAST <= greatest <= _MOST:
        unit = "1 N/cm³ = 1e6 Pa/m; a pressure in Pa must be divided by the depth"
        raise InputError(f"{what} has stresses per depth of up to {greatest:.3g} N/cm³; no grains have that ({unit})")
