"""The surface height, from the first contact of each way straight down: where the vertical force begins."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import Curve, NotIdentifiable, best_start, fit_curve, fit_each
from rft_ros.calibration.track import FEWEST, Indices, Track, down_strokes
from rft_ros.estimator import LoadCell
from rft_ros.rft import FORCE, STATE, TWIST, Law, wrenches

__all__ = ["Contact", "find_contacts"]

Array = NDArray[np.float64]

_AIR = 0.02  # height [m] up to which the force in the air is used: further up the load cell may have drifted
_SHALLOW, _AT_LEAST = 0.25, 0.004
"""First contact is fitted to this share of the stroke's depth, but at least this depth [m]. Over the whole depth, a
pressure that grows faster than linearly would shift the surface down."""

_GRID = 24  # heights that are tried before the best one is refined
_UNKNOWN = np.array([np.inf])


class Contact(NamedTuple):
    """A first contact: the number of its track, and the rows around it.

    `surface`: its height by a fit without memory [m]. `misfit`: RMS residual of that fit over the rise of the force.
    """

    number: int
    rows: Indices
    surface: float
    misfit: float


def _find(number: int, track: Track, stroke: Indices, cell: LoadCell, law: Law) -> Contact:
    """Find the contact of one stroke: fit the vertical force with a free scale and bias, without memory."""
    up = track.sensor_rotations(cell)[stroke][:, 2]
    force = cell.sign * np.einsum("nj,nj->n", up, track.readings[stroke, FORCE])
    height = track.heights()[stroke]
    low, high = float(height.min()), float(height.max())
    # the force over the depth of the lowest point, in the orientation at the bottom
    depths = np.linspace(0.0, high - low, 256)
    states = np.repeat(track.states[stroke[-1:]], len(depths), axis=0)
    states[:, STATE.index("pz")] -= height[-1] + depths
    states[:, TWIST] = (0.0, 0.0, -1.0, 0.0, 0.0, 0.0)  # straight down
    predicted = wrenches(track.tool.plates, law, states, threads=1)[:, 2]

    used, least, most = np.ones(len(stroke), dtype=np.bool_), low, high
    for _ in range(6):
        z = height[used]

        def columns(parameters: Array, z: Array = z) -> Array:
            force_of_law = np.interp(parameters[0] - z, depths, predicted)
            return np.stack([force_of_law, np.ones_like(z)], axis=-1)[:, None]

        step, bounds = np.array([1e-4 * (most - least)]), (np.array([least]), np.array([most]))
        curve = Curve(columns, step, *bounds, expected=np.zeros(1), expected_error=_UNKNOWN)
        observed = force[used][:, None]
        found = fit_curve(curve, observed, best_start(curve, observed, np.linspace(least, most, _GRID)[:, None]))
        surface = float(found.coefficients[0])
        least = surface - max(_SHALLOW * (surface - low), min(_AT_LEAST, surface - low))
        most = min(high, surface + 0.5 * _AIR)
        near = (height > least) & (height < surface + _AIR)
        if near.sum() < FEWEST or (near == used).all():
            break
        used = near
    rise = float(found.coefficients[1] * np.interp(surface - z.min(), depths, predicted))
    in_air = int((z > surface).sum())
    if in_air < 10 or surface >= high - 1e-6 or not rise > 6.0 * found.rms:
        raise NotIdentifiable(
            f"{track.name}: no first contact between z = {high:.4f} and {low:.4f} m: {in_air} samples in the air, and a"
            f" vertical force that rises by {rise:.2f} N with {found.rms:.2f} N of scatter; it needs 10 samples, and a"
            " rise of 6 times the scatter"
        )
    return Contact(number, stroke[used], surface, found.rms / rise)


def find_contacts(tracks: Sequence[Track], cell: LoadCell, law: Law) -> list[Contact]:
    """The first contacts, by fits without memory. Raises NotIdentifiable if there are none."""
    strokes = ((k, track, stroke, cell, law) for k, track in enumerate(tracks) for stroke in down_strokes(track))
    return fit_each(_find, strokes, none="the tool never goes straight down")
