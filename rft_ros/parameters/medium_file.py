"""Reads and writes the files that define a medium: nine coefficients (YAML), a stress map or a table of α_y (CSV).

The coefficients of a stress map are fitted when it is read.
"""

import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.parameters.parameter import Parameter
from rft_ros.parameters.stress_map import (
    MediumFit,
    StressMap,
    checked_medium,
    fit_medium,
)
from rft_ros.rft import MEDIA, Medium, Table
from rft_ros.table_file import Column, TableColumns, read_table
from rft_ros.yaml_file import read_yaml, write_yaml

Array = NDArray[np.float64]

_MIN_STRESS_N_CM3_LIMIT = 1e-3
_MAX_STRESS_N_CM3_LIMIT = 50.0
"""Plausible range of the greatest stress per depth [N/cm³]; loose poppy seeds have 0.25, the generic medium 1."""

_MAX_TABLE_BYTES = 4 * 2**20  # of a table; a grid of 180 x 360 angles takes 2 MB
_MAX_MAP_CELLS = 5_000  # of a map
_MAX_ANGLE_RAD = 3.2  # several angles without a unit, of which none is beyond, are in radians
_MAX_ANGLE_DEG = 720.0

_DEGREES = {"": 1.0, "deg": 1.0, "°": 1.0, "rad": float(np.rad2deg(1.0))}
_NEWTONS_PER_CM3 = {"": 1.0, "n/cm3": 1.0, "n/m3": 1e-6, "pa/m": 1e-6, "kpa/m": 1e-3}
_STRESS = "a stress per depth in N/cm3 (1 N/cm3 = 1e6 Pa/m)"

_BETA = Column("beta", _DEGREES, "in deg or rad")
_GAMMA = Column("gamma", _DEGREES, "in deg or rad")
_ALPHA_X = Column("alpha_x", _NEWTONS_PER_CM3, _STRESS, gaps=True)
_ALPHA_Z = Column("alpha_z", _NEWTONS_PER_CM3, _STRESS, gaps=True)
_ALPHA_Y = Column("alpha_y", _NEWTONS_PER_CM3, _STRESS)


def read_stress_map(file: Path) -> StressMap:
    """A map from a CSV file with the columns beta_deg, gamma_deg, alpha_x, alpha_z in any order.

    A name may end in a unit, such as beta_rad or alpha_z_N/m3; without one the unit is degrees or N/cm³. An empty cell
    or nan is a missing stress. Raises InputError for a file that cannot be used.
    """
    named = f"stress map '{file}'"
    rows = _read(file, "stress map", (_BETA, _GAMMA, _ALPHA_X, _ALPHA_Z))
    if len(rows.lines) > _MAX_MAP_CELLS:
        raise InputError(
            f"{named} has {len(rows.lines):,} rows; the limit is {_MAX_MAP_CELLS:,}: take the mean of repeated cells"
        )
    beta, gamma, alpha_x, alpha_z = rows.columns.values()
    greatest = float(np.abs(np.nan_to_num([alpha_x, alpha_z])).max())
    if not _MIN_STRESS_N_CM3_LIMIT <= greatest <= _MAX_STRESS_N_CM3_LIMIT:
        raise InputError(
            f"{named} has stresses per depth of up to {greatest:.3g} N/cm³; no grains have that "
            "(1 N/cm³ = 1e6 Pa/m; a pressure in Pa must be divided by the depth)"
        )
    return StressMap(
        beta=np.deg2rad(beta), gamma=np.deg2rad(gamma), alpha_x=alpha_x, alpha_z=alpha_z
    )


def read_alpha_y_table(file: str) -> Table:
    """A table from a CSV file with the columns beta, alpha_y, or beta, gamma, alpha_y on a full grid.

    Units are as in `read_stress_map`. Raises InputError.
    """
    named = f"alpha_y.table '{file}'"
    rows = _read(Path(file), "alpha_y.table", (_BETA, _ALPHA_Y), (_GAMMA,))
    stresses = rows.columns["alpha_y"]
    least = stresses.min()
    greatest = stresses.max()
    if least < 0.0 or greatest > _MAX_STRESS_N_CM3_LIMIT:
        raise InputError(
            f"{named} has alpha_y from {least:.4g} to {greatest:.4g} N/cm³ (1e6 Pa/m); it must lie between 0 and"
            f" {_MAX_STRESS_N_CM3_LIMIT:g}: check the order of the columns, the unit and the sign"
        )
    gammas = rows.columns.get("gamma", np.zeros(len(stresses)))
    beta, row = np.unique(rows.columns["beta"], return_inverse=True)
    gamma, column = np.unique(gammas, return_inverse=True)
    pairs = len(beta) * len(gamma)
    different = len(np.unique(row * len(gamma) + column))
    if not different == len(stresses) == pairs:
        raise InputError(
            f"{named} has {len(stresses)} rows; "
            f"a grid of {len(beta)} beta x {len(gamma)} gamma values needs each pair once ({pairs} rows)"
        )
    values = np.empty((len(beta), len(gamma)))
    values[row, column] = stresses
    table = Table.sampled(np.deg2rad(beta), np.deg2rad(gamma), values)
    if not np.isfinite([table.beta_nodes, table.gamma_nodes]).all():
        raise InputError(
            f"{named} has angles that are too close together; space them further apart"
        )
    return table


def _read(file: Path, what: str, *columns: Sequence[Column]) -> TableColumns:
    """As `read_table`. Raises InputError also for numbers that are not finite, and for implausible angles."""
    rows = read_table(file, what, *columns, limit=_MAX_TABLE_BYTES)
    for column in itertools.chain(*columns):
        if column.name in rows.columns:
            values = rows.columns[column.name]
            wrong = np.flatnonzero(np.isinf(values) if column.gaps else ~np.isfinite(values))
            if len(wrong):
                raise InputError(
                    f"{what} '{file}' line {rows.lines[wrong[0]]}: "
                    f"{column.name} is {values[wrong[0]]:g}; it must be a finite number"
                )
            if column.units is _DEGREES:
                _check_angles(values, rows.units[column.name], f"{what} '{file}'", column.name)
    return rows


def _check_angles(degrees: Array, unit: str, named: str, name: str) -> None:
    """Raise InputError if angles are implausible in the `unit` of the header; "" without one, for degrees."""
    widest = float(np.abs(degrees).max())
    different = len(np.unique(degrees))
    if widest > _MAX_ANGLE_DEG:
        advice = (
            "it is no angle in degrees" if _DEGREES[unit] == 1.0 else f"name the column {name}_deg"
        )
        raise InputError(f"{named} has {name} up to {widest:.4g} degrees; {advice}")
    if widest <= _MAX_ANGLE_RAD and different > 1 and not unit:
        raise InputError(
            f"{named} has {different} different {name}, none beyond {widest:.3g} degrees, as radians are; "
            f"name the column {name}_rad or {name}_deg, and check the order of the columns"
        )


def is_medium_file(text: str) -> bool:
    """Whether a medium is given by a file, rather than by a name of `MEDIA`."""
    return text not in MEDIA and (bool(Path(text).suffix) or "/" in text)


def read_medium(file: str) -> Medium:
    """The medium that a file defines, with the file's stem as its name unless the file gives one.

    A YAML file is a mapping with the nine coefficients [N/cm³], as `write_medium` writes it. Any other file is a stress
    map. Raises InputError for a file that cannot be used.
    """
    path = Path(file)
    try:
        if path.suffix.lower() in (".yaml", ".yml"):
            return checked_medium(_of_yaml(path))
        return fit_medium(read_stress_map(path), name=path.stem).medium
    except InputError:  # names the file already
        raise
    except ValueError as error:
        raise InputError(f"medium.file '{file}': {error}") from None


def _of_yaml(file: Path) -> Medium:
    names = list(MEDIA["generic"].coefficients)
    content = read_yaml(file, "medium.file")
    given = content.get("coefficients", content) if isinstance(content, Mapping) else None
    if not isinstance(given, Mapping):
        raise ValueError(f"it has no coefficients; it needs {', '.join(names)} [N/cm³]")
    named = {
        name.replace("-", "m"): value for name, value in given.items()
    }  # Li et al. write B-11
    found: dict[str, Any] = {}
    try:
        for name in names:
            number = Parameter(
                name, 0.0, bounds=(-_MAX_STRESS_N_CM3_LIMIT, _MAX_STRESS_N_CM3_LIMIT)
            )
            found[name] = number.checked(named.get(name))
    except InputError as error:
        raise ValueError(f"{error} [N/cm³]; give all nine, and 0.0 for one that is zero") from None
    return Medium.of(str(content.get("name", file.stem)), found)


def write_medium(file: Path, fit: MediumFit, *, source: str) -> None:
    """Write a fitted medium for `read_medium`, with standard errors and misfit. `source`: the map of the fit."""

    def rounded(value: float) -> float | None:
        return float(f"{value:.4g}") if np.isfinite(value) else None

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
    ]
    write_yaml(file, "medium", tree, [*head, *fit.medium.doubts, *fit.remarks])
