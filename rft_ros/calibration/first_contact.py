"""The height at which the force begins: where a stroke down first meets the grains."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.findings import CannotTell
from rft_ros.calibration.load_cell_weight import sensor_rotations
from rft_ros.calibration.regression import ProfileFit, fit_profile
from rft_ros.calibration.stretches import Stroke
from rft_ros.calibration.track import Track
from rft_ros.estimator import LoadCell
from rft_ros.rft import Law, wrenches

__all__ = ["Contact", "first_contact", "vertical_shape"]

_AIR = 0.02
"""The force in the air is taken from this far [m] above the surface: further away the load cell has drifted."""

_CLEAR = 0.001
"""Above the surface by this much [m], the tool is in the air also where it does not move."""

_SHALLOW = 0.25
_SHALLOWEST = 0.004
"""The surface is fitted to this share of the way down in the grains, at least this much [m]: pressure that grows faster
than depth would push the surface of a straight line down."""

_DEPTHS = 256


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """World z of the surface [m] with its standard error, and the RMS residual over the force's rise within the fit."""

    bag: str
    height: float
    error: float
    misfit: float


def vertical_shape(track: Track, row: int, law: Law, reach: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Depths of the lowest point [m] to `reach` and the model's vertical force there [N], the tool sinking as in `row`.

    Both of shape [256]; the first is depth 0.
    """
    depths = np.linspace(0.0, reach, _DEPTHS)
    states = np.repeat(track.states[[row]], _DEPTHS, axis=0)
    states[:, 2] = states[:, 2] - track.heights()[row] - depths
    states[:, 7:13] = (0.0, 0.0, -1.0, 0.0, 0.0, 0.0)
    return depths, wrenches(track.tool.plates, law, states, threads=1)[:, 2]


def first_contact(track: Track, stroke: Stroke, cell: LoadCell, law: Law) -> Contact:
    """Where a stroke meets the surface: the model's force over depth, its scale free, and a constant in the air.

    The constant takes up bias and weight, which stay the same in one orientation. Raises CannotTell where the force
    does not rise.
    """
    rows, moving = stroke.rows, stroke.moving
    up = sensor_rotations(track, cell)[rows][:, 2]
    force = cell.sign * np.einsum("nj,nj->n", up, track.readings[rows, :3])
    height = track.heights()[rows]
    low, high = float(height.min()), float(height.max())
    depths, shape = vertical_shape(track, int(rows[-1]), law, high - low)

    def fit(used: NDArray[np.bool_], low: float, high: float) -> ProfileFit:
        z = height[used]
        return fit_profile(force[used], lambda s: np.interp(s - z, depths, shape), low=low, high=high, offset=True)

    used, found = moving, fit(moving, low, high)
    bottom = low
    for _ in range(6):
        surface = found.parameter
        bottom = surface - max(_SHALLOW * (surface - low), min(_SHALLOWEST, surface - low))
        used = (height > bottom) & (height < surface + _AIR) & (moving | (height > surface + _CLEAR))
        if used.sum() < 20 or surface <= low:
            break
        found = fit(used, bottom, min(high, surface + 0.5 * _AIR))
        if abs(found.parameter - surface) < 1e-6:
            break
    surface = found.parameter
    rise = float(found.linear.coefficients[0] * np.interp(surface - bottom, depths, shape))
    in_air = used & (height > surface)
    if in_air.sum() < 10 or surface >= high - 1e-6:
        raise CannotTell(
            f"{track.name}: {int(in_air.sum())} samples above the surface on the way down; first contact needs 10"
        )
    if not rise > 6.0 * found.linear.rms:
        raise CannotTell(
            f"{track.name}: no first contact between z = {high:.4f} and {low:.4f} m: the vertical force rises by"
            f" {rise:.2f} N with {found.linear.rms:.2f} N of scatter; it must rise by 6 times that"
        )
    return Contact(bag=track.name, height=surface, error=found.error, misfit=found.linear.rms / rise)
