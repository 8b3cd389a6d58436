"""A user's α_y table from a CSV file: columns β [deg], α_y [N/cm³], or β, γ [deg], α_y on a full grid."""

from pathlib import Path

import numpy as np

from rft_ros.errors import InputError
from rft_ros.files import read_text
from rft_ros.rft import Table

__all__ = ["read_alpha_y_table"]

_MAX_BYTES = 4 * 2**20  # 180 x 360 pairs have half of it


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def read_alpha_y_table(file: str) -> Table:
    """Read and check a table; lines that begin with # and a header line before the numbers are skipped.

    Raises InputError that names the file and what is wrong in it.
    """
    rows: list[list[float]] = []
    names_may_come = True
    text = read_text(Path(file), "alpha_y.table", limit=_MAX_BYTES)
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        cells = [_number(cell) for cell in line.split(",")]
        numbers = [cell for cell in cells if cell is not None]
        if len(numbers) == len(cells):
            rows.append(numbers)
        elif numbers or not names_may_come:
            raise InputError(f"alpha_y.table '{file}' line {number} is not numbers")
        names_may_come = False
    widths = {len(row) for row in rows}
    if widths not in ({2}, {3}):
        raise InputError(f"alpha_y.table '{file}' needs rows of 2 numbers (beta, alpha_y) or 3 (beta, gamma, alpha_y)")
    data = np.array(rows)
    if not np.isfinite(data).all():
        raise InputError(f"alpha_y.table '{file}' has a value that is not finite")
    if (data[:, -1] < 0.0).any():
        raise InputError(
            f"alpha_y.table '{file}' has a negative alpha_y ({data[:, -1].min():g}); it opposes the motion"
        )
    gammas = data[:, 1] if data.shape[1] == 3 else np.zeros(len(data))
    beta, i = np.unique(data[:, 0], return_inverse=True)
    gamma, j = np.unique(gammas, return_inverse=True)
    values = np.full((len(beta), len(gamma)), np.nan)
    values[i, j] = data[:, -1]
    if len(data) != values.size or np.isnan(values).any():
        raise InputError(
            f"alpha_y.table '{file}' has {len(data)} rows; a grid of {len(beta)} beta x {len(gamma)} gamma values"
            f" needs each pair once ({values.size} rows)"
        )
    table = Table.sampled(np.deg2rad(beta), np.deg2rad(gamma), values)
    if not np.isfinite([table.beta_nodes, table.gamma_nodes]).all():
        raise InputError(f"alpha_y.table '{file}' has angles that are too close together")
    return table
