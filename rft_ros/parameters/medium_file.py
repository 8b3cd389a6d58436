"""Reads and writes the files that define a medium: nine coefficients (YAML), a stress map or a table of α_y (CSV).

The coefficients of a stress map are fitted when it is read.
"""

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from rft_ros.errors import InputError, shown
from rft_ros.files import whole
from rft_ros.parameters.stress_map import MediumFit, StressMap, fit_medium
from rft_ros.rft import MEDIA, Medium, Table
from rft_ros.table_file import Column, Rows, read_table
from rft_ros.yaml_file import read_yaml, yaml_text

LEAST = 1e-3
GREATEST = 50.0
"""Plausible range of the greatest stress per depth [N/cm³]; loose poppy seeds have 0.25, the generic medium 1."""

_MOST_BYTES = 4 * 2**20  # of a table; a grid of 180 x 360 angles takes 2 MB
_MOST_CELLS = 5_000  # of a map
_WIDEST_RADIANS = 3.2  # a table in degrees reaches further
_FEW_ANGLES = 4  # this many different values of an angle within _WIDEST_RADIANS are in radians
_WIDEST_DEGREES = 720.0

_DEGREES = dict.fromkeys(("", "deg", "degree", "degrees", "°"), 1.0)
_DEGREES |= dict.fromkeys(("rad", "radian", "radians"), float(np.rad2deg(1.0)))
_NEWTONS_PER_CM3 = {
    "": 1.0,
    "n/cm3": 1.0,
    "ncm3": 1.0,
    "ncm-3": 1.0,
    "n/m3": 1e-6,
    "nm3": 1e-6,
    "nm-3": 1e-6,
}
_NEWTONS_PER_CM3 |= {
    "pa/m": 1e-6,
    "pam-1": 1e-6,
    "kpa/m": 1e-3,
    "mpa/m": 1.0,
    "kpa/cm": 0.1,
    "kn/m3": 1e-3,
}
_NEWTONS_PER_CM3 |= {"n/mm3": 1e3}


def _angle(name: str) -> Column:
    return Column(name, _DEGREES, "in deg or rad")


def _stress(name: str, *, gaps: bool = False) -> Column:
    return Column(name, _NEWTONS_PER_CM3, "a stress per depth in N/cm3 (1 N/cm3 = 1e6 Pa/m)", gaps)


_BETA = _angle("beta")
_GAMMA = _angle("gamma")
_MAP = (_BETA, _GAMMA, _stress("alpha_x", gaps=True), _stress("alpha_z", gaps=True))
_ALPHA_Y = _stress("alpha_y")


def read_stress_map(file: Path) -> StressMap:
    """A map from a CSV file with the columns beta_deg, gamma_deg, alpha_x, alpha_z in any order.

    A name may end in a unit, such as beta_rad or alpha_z_N/m3; without one the unit is degrees or N/cm³. An empty cell
    or nan is a missing stress. Raises InputError for a file that cannot be used.
    """
    named = f"stress map '{file}'"
    rows = _read(file, "stress map", _MAP)
    count = len(rows.lines)
    if count > _MOST_CELLS:
        raise InputError(
            f"{named} has {count:,} rows; the limit is {_MOST_CELLS:,}: take the mean of repeated cells"
        )
    _check_angles(rows, named)
    beta, gamma, alpha_x, alpha_z = rows.numbers.T
    widest = max(float(np.abs(beta).max()), float(np.abs(gamma).max()))
    if widest <= _WIDEST_RADIANS and rows.factors["beta"] == rows.factors["gamma"] == 1.0:
        advice = "these seem to be radians: name the columns beta_rad and gamma_rad, or give more angles"
        raise InputError(f"{named} has no angle beyond {widest:.3g} degrees; {advice}")
    stresses = np.abs([alpha_x, alpha_z])
    if np.isnan(stresses).all():
        raise InputError(
            f"{named} has no stress in any row; give alpha_x and alpha_z at some angles"
        )
    greatest = float(np.nanmax(stresses))
    if not LEAST <= greatest <= GREATEST:
        unit = "1 N/cm³ = 1e6 Pa/m; a pressure in Pa must be divided by the depth"
        raise InputError(
            f"{named} has stresses per depth of up to {greatest:.3g} N/cm³; no grains have that ({unit})"
        )
    return StressMap(
        beta=np.deg2rad(beta), gamma=np.deg2rad(gamma), alpha_x=alpha_x, alpha_z=alpha_z
    )


def read_alpha_y_table(file: str) -> Table:
    """A table from a CSV file with the columns beta, alpha_y, or beta, gamma, alpha_y on a full grid.

    Units are as in `read_stress_map`. Raises InputError.
    """
    if not file:
        raise InputError(
            "alpha_y.model 'table' needs alpha_y.table to name a CSV file; set that first"
        )
    named = f"alpha_y.table '{file}'"
    rows = _read(Path(file), "alpha_y.table", (_BETA, _ALPHA_Y), (_GAMMA,))
    stresses = rows.column("alpha_y")
    if stresses.min() < 0.0:
        raise InputError(
            f"{named} has a negative alpha_y ({stresses.min():g}); give the size of a stress that resists"
        )
    if stresses.max() > GREATEST:
        unit = f"over {GREATEST:g} N/cm³, which no grains have; check the order of the columns, and the unit"
        raise InputError(
            f"{named} has alpha_y up to {stresses.max():.4g}, {unit} (1 N/cm³ = 1e6 Pa/m)"
        )
    _check_angles(rows, named)
    gammas = rows.column("gamma") if "gamma" in rows.factors else np.zeros(len(stresses))
    beta, row = np.unique(rows.column("beta"), return_inverse=True)
    gamma, column = np.unique(gammas, return_inverse=True)
    pairs = len(beta) * len(gamma)
    different = len(np.unique(np.column_stack([row, column]), axis=0))
    if different != pairs or len(stresses) != pairs:
        grid = f"a grid of {len(beta)} beta x {len(gamma)} gamma values needs each pair once ({pairs} rows)"
        raise InputError(f"{named} has {len(stresses)} rows; {grid}")
    values = np.empty((len(beta), len(gamma)))
    values[row, column] = stresses
    table = Table.sampled(np.deg2rad(beta), np.deg2rad(gamma), values)
    if not np.isfinite([table.beta_nodes, table.gamma_nodes]).all():
        raise InputError(
            f"{named} has angles that are too close together; space them further apart"
        )
    return table


def _read(file: Path, what: str, *columns: Sequence[Column]) -> Rows:
    """As `read_table`. Raises InputError also for numbers that are not finite."""
    rows = read_table(file, what, *columns, limit=_MOST_BYTES)
    for column in itertools.chain(*columns):
        if column.name in rows.factors:
            values = rows.column(column.name)
            wrong = np.flatnonzero(np.isinf(values) if column.gaps else ~np.isfinite(values))
            if len(wrong):
                where = f"{what} '{file}' line {rows.lines[wrong[0]]}"
                raise InputError(
                    f"{where}: {column.name} is {values[wrong[0]]:g}; it must be a finite number"
                )
    return rows


def _check_angles(rows: Rows, named: str) -> None:
    """Raise InputError if angles are implausible in the unit that the header names."""
    for name in ("beta", "gamma"):
        if name not in rows.factors:
            continue
        angles = rows.column(name)
        widest = float(np.abs(angles).max())
        different = len(np.unique(angles))
        in_radians = rows.factors[name] != 1.0
        if widest > _WIDEST_DEGREES:
            advice = f"name the column {name}_deg" if in_radians else "it is no angle in degrees"
            raise InputError(f"{named} has {name} up to {widest:.4g} degrees; {advice}")
        if widest <= _WIDEST_RADIANS and different >= _FEW_ANGLES and not in_radians:
            found = f"{different} different {name}, none beyond {widest:.3g} degrees"
            raise InputError(
                f"{named} has {found}; these seem to be radians: name the column {name}_rad"
            )


_YAML = (".yaml", ".yml")


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
    content = read_yaml(file, "medium.file")
    if not isinstance(content, Mapping):
        raise InputError(
            f"{what} has no coefficients; it needs {', '.join(MEDIA['generic'].coefficients)}"
        )
    given = content.get("coefficients", content)
    if not isinstance(given, Mapping):
        raise InputError(
            f"{what}: coefficients is {shown(given)}; it must have names and numbers [N/cm³]"
        )
    given = {
        str(name).replace("-", "m"): value for name, value in given.items()
    }  # Li et al. write B-11
    found = {}
    for name in MEDIA["generic"].coefficients:
        value = given.get(name)
        if value is None:
            raise InputError(
                f"{what} has no coefficient {name}; give all nine, and 0.0 for one that is zero"
            )
        if (
            isinstance(value, bool)
            or not isinstance(value, int | float)
            or not abs(value) <= GREATEST
        ):
            raise InputError(
                f"{what}: {name} is {shown(value)}; it must be a number of at most {GREATEST:g} N/cm³"
            )
        found[name] = float(value)
    medium = Medium.of(str(content.get("name", file.stem)), found)
    if max(map(abs, found.values())) < 0.1 * LEAST:
        raise InputError(
            f"{what}: its coefficients are below {0.1 * LEAST:g}; they must be in N/cm³"
        )
    if medium.strength <= 0.0:
        raise InputError(
            f"{what}: with these coefficients the force points along the motion; check the signs"
        )
    return medium


def write_medium(file: Path, fit: MediumFit, *, source: str) -> None:
    """Write a fitted medium for `read_medium`, with standard errors and misfit. `source`: the map of the fit."""

    def rounded(value: float) -> float | None:
        return None if np.isnan(value) else float(f"{value:.4g}")

    tree = {
        "name": fit.medium.name,
        "coefficients": {name: round(value, 6) for name, value in fit.medium.coefficients.items()},
        "errors": {name: rounded(value) for name, value in fit.errors.items()},
        "misfit": {
            "measured": rounded(fit.size),
            "fitted": rounded(fit.misfit),
            "generic_scaled": rounded(fit.misfit_scaled),
            "zeta_of_generic": rounded(fit.zeta),
        },
    }
    head = [
        f"A medium for medium.file: Eq. (4) of docs/method.md, fitted by rft fit-medium to {source}.",
        "All in N/cm³. errors: standard errors of the coefficients; null: the map does not determine it.",
        "misfit: RMS of the stress (alpha_x, alpha_z), as measured, and of the residual of the fit or of the generic",
        "medium times zeta_of_generic.",
        *fit.medium.doubts,
        *fit.remarks,
    ]
    with whole(file, "medium") as part:
        lines = "".join(f"# {' '.join(sentence.split())}\n" for sentence in head)
        part.write_text(lines + yaml_text(tree), encoding="utf-8")
