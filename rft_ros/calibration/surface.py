"""The surface height, from where the force begins in each stroke down."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import FittedValue, NotIdentifiable, ProfileFit, fit_each, fit_profile, mean_of
from rft_ros.calibration.segments import Stroke, down_strokes
from rft_ros.calibration.track import Track
from rft_ros.estimator import LoadCell
from rft_ros.rft import Law, wrenches

__all__ = ["Contact", "SurfaceFit", "first_contact", "fit_surface"]

_AIR = 0.02
"""Height above the surface [m] up to which the force in the air is used: further up the load cell may have drifted."""

_CLEAR = 0.001  # height above the surface [m] from which samples at rest are used as well
_SHALLOW = 0.25
_SHALLOWEST = 0.004
"""The fit uses this share of the stroke's depth, but at least this depth [m]. Over the whole depth, a pressure that
grows faster than linearly would shift the surface down."""

_DEPTHS = 256
_SCATTERED = 0.002  # greatest difference of heights of first contact [m] without a note


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """World z of the surface [m] with its standard error, and the RMS residual over the force's rise within the fit."""

    bag: str
    height: float
    error: float
    misfit: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SurfaceFit:
    """Mean world z of the surface over first contacts [m] and its standard error."""

    height: float
    error: float
    contacts: tuple[Contact, ...]

    def value(self) -> FittedValue:
        """`surface_height`."""
        goodness = f"RMS up to {100 * max(c.misfit for c in self.contacts):.1f} % of the force's rise"
        source = f"first contact of {len(self.contacts)} ways down"
        return FittedValue("surface_height", (self.height,), (self.error,), "m", goodness, source)

    def notes(self) -> list[str]:
        """A sentence if the contacts lie at different heights."""
        if float(np.ptp([c.height for c in self.contacts])) <= _SCATTERED:
            return []
        each = ", ".join(f"{c.bag} {1e3 * c.height:.1f} ± {1e3 * c.error:.1f} mm" for c in self.contacts)
        return [f"First contact lies at different heights: {each}."]


def _force_over_depth(
    track: Track, row: int, law: Law, reach: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Depths of the lowest point from 0 to `reach` [m] and the predicted vertical force [N], shape [256] each.

    The tool sinks in its orientation at `row`.
    """
    depths = np.linspace(0.0, reach, _DEPTHS)
    states = np.repeat(track.states[[row]], _DEPTHS, axis=0)
    states[:, 2] = states[:, 2] - track.heights()[row] - depths
    states[:, 7:13] = (0.0, 0.0, -1.0, 0.0, 0.0, 0.0)
    return depths, wrenches(track.tool.plates, law, states, threads=1)[:, 2]


def first_contact(track: Track, stroke: Stroke, cell: LoadCell, law: Law) -> Contact:
    """Height at which a stroke meets the surface: fit the predicted force over depth with a free scale plus a constant.

    The constant absorbs bias and weight, which do not change in one orientation. Raises NotIdentifiable if the force
    does not rise, or too few samples are above the surface.
    """
    rows, moving = stroke.rows, stroke.moving
    up = track.sensor_rotations(cell)[rows][:, 2]
    force = cell.sign * np.einsum("nj,nj->n", up, track.readings[rows, :3])
    height = track.heights()[rows]
    low, high = float(height.min()), float(height.max())
    depths, shape = _force_over_depth(track, int(rows[-1]), law, high - low)

    def fit(used: NDArray[np.bool_], least: float, most: float) -> ProfileFit:
        z = height[used]
        return fit_profile(force[used], lambda s: np.interp(s - z, depths, shape), low=least, high=most, offset=True)

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
        raise NotIdentifiable(
            f"{track.name}: {int(in_air.sum())} samples above the surface on the way down; first contact needs 10"
        )
    if not rise > 6.0 * found.linear.rms:
        raise NotIdentifiable(
            f"{track.name}: no first contact between z = {high:.4f} and {low:.4f} m: the vertical force rises by"
            f" {rise:.2f} N with {found.linear.rms:.2f} N of scatter; it must rise by 6 times that"
        )
    return Contact(bag=track.name, height=surface, error=found.error, misfit=found.linear.rms / rise)


def fit_surface(tracks: Sequence[Track], cell: LoadCell, law: Law) -> SurfaceFit:
    """The mean over first contacts. Raises NotIdentifiable without one. `law`: at any ζ."""
    contacts = fit_each(
        lambda track, stroke: first_contact(track, stroke, cell, law),
        [(track, stroke) for track in tracks for stroke in down_strokes(track)],
        none="the tool never goes straight down",
    )
    height, error = mean_of([c.height for c in contacts], [c.error for c in contacts])
    return SurfaceFit(height=height, error=error, contacts=tuple(contacts))
