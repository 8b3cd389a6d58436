"""Reads tables of α_y."""

from pathlib import Path

import numpy as np

from rft_ros.errors import InputError
from rft_ros.files import read_text
from rft_ros.rft import Table

__all__ = ["read_alpha_y_table"]

_MOST = 50.0  # N/cm³, as for a medium
_RADIANS, _STEPS = 3.2, 4  # this many different values of beta, none beyond this, are in radians
_MAX_TABLE = 4 * 2**20  # bytes; a grid of 180 x 360 pairs takes half of them


def read_alpha_y_table(file: str) -> Table:
    """A table from a CSV file with the columns β [deg], α_y [N/cm³], or β, γ [deg], α_y on a full grid.

    Lines that begin with #, and a first line of words, are skipped. Raises InputError.
    """
    if not file:
        raise InputError("alpha_y.model 'table' needs alpha_y.table to name a CSV file; set that first")
    name, rows = f"alpha_y.table '{file}'", list[list[float]]()
    lines = enumerate(read_text(Path(file), "alpha_y.table", limit=_MAX_TABLE).splitlines(), start=1)
    numbered = [(k, line) for k, line in lines if line.strip() and line.lstrip()[0] != "#"]
    for number, line in numbered:
        try:
            rows.append([float(cell) for cell in line.split(",")])
        except ValueError:
            if number != numbered[0][0] or not line.lstrip(' "')[:1].isalpha():
                raise InputError(f"{name} line {number} is not numbers; correct or remove it") from None
    if {len(row) for row in rows} not in ({2}, {3}):
        raise InputError(f"{name} needs rows of 2 numbers (beta, alpha_y) or 3 (beta, gamma, alpha_y)")
    *angles, stresses = np.array(rows).T
    if not np.isfinite(rows).all():
        raise InputError(f"{name} has a value that is not finite; remove its row or give a number")
    if stresses.min() < 0.0:
        raise InputError(f"{name} has a negative alpha_y ({stresses.min():g}); give the size of a stress that resists")
    if stresses.max() > _MOST:
        unit = f"over {_MOST:g} N/cm³, which no grains have; check the order of the columns, and the unit"
        raise InputError(f"{name} has alpha_y up to {stresses.max():.4g}, {unit} (1 N/cm³ = 1e6 Pa/m)")
    widest = float(np.abs(angles).max())
    if widest <= _RADIANS and len(np.unique(angles[0])) >= _STEPS:
        raise InputError(f"{name} has no angle beyond {widest:.3g}; these seem to be radians: give degrees")
    beta, i = np.unique(angles[0], return_inverse=True)
    gamma, j = np.unique(angles[1] if len(angles) > 1 else np.zeros(len(rows)), return_inverse=True)
    pairs = len(beta) * len(gamma)
    values = np.full((len(beta), len(gamma)) if pairs == len(rows) else (1, 1), np.nan)
    if pairs == len(rows):
        values[i, j] = stresses
    if np.isnan(values).any():
        grid = f"a grid of {len(beta)} beta x {len(gamma)} gamma values needs each pair once ({pairs} rows)"
        raise InputError(f"{name} has {len(rows)} rows; {grid}")
    table = Table.sampled(np.deg2rad(beta), np.deg2rad(gamma), values)
    if not np.isfinite([table.beta_nodes, table.gamma_nodes]).all():
        raise InputError(f"{name} has angles that are too close together; space them further apart")
    return table
