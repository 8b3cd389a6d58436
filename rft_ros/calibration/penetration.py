"""From the tool's ways down: the surface height, where the force begins, and ζ, measured over predicted force.

ζ as in Treers et al. 2021, IV, by least squares through the origin.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import (
    FittedValue,
    Measurement,
    NotIdentifiable,
    fit_curve,
    fit_each,
    fit_series,
    mean_of,
)
from rft_ros.calibration.tool_weight import Sensor
from rft_ros.calibration.track import Rows, Track, down_strokes
from rft_ros.estimator import LoadCell
from rft_ros.rft import Law, wrenches

__all__ = ["BEDS_DIFFER", "difference", "fit_surface", "fit_zeta"]

Array = NDArray[np.float64]

BEDS_DIFFER = 0.1
"""Relative standard deviation of ζ between beds of the same grains (docs/accuracy.md)."""

_NOTEWORTHY = 0.25  # greatest relative difference of ζ between penetrations without a note

_AIR = 0.02  # height [m] up to which the force in the air is used: further up the load cell may have drifted
_SHALLOW, _AT_LEAST = 0.25, 0.004
"""First contact is fitted to this share of the stroke's depth, but at least this depth [m]. Over the whole depth, a
pressure that grows faster than linearly would shift the surface down."""

_SHALLOWEST = 0.005  # a penetration's least depth [m]: below it the force depends more on the surface height than on ζ
_ALIKE = 0.9
"""Least correlation of the measured and the modelled force, over components and moments: below it the RMS residual is
over a quarter of the peak of a force that grows with depth."""


def _first_contact(track: Track, stroke: Rows, cell: LoadCell, law: Law) -> Measurement:
    """Height at which a stroke meets the surface: the vertical force fitted with a free scale and bias."""
    up = track.sensor_rotations(cell)[stroke][:, 2]
    force = cell.sign * np.einsum("nj,nj->n", up, track.readings[stroke, :3])
    height = track.heights()[stroke]
    low, high = float(height.min()), float(height.max())
    # the force over the depth of the lowest point, in the orientation at the bottom
    depths = np.linspace(0.0, high - low, 256)
    states = np.repeat(track.states[stroke[-1:]], len(depths), axis=0)
    states[:, 2] -= height[-1] + depths
    states[:, 7:13] = (0.0, 0.0, -1.0, 0.0, 0.0, 0.0)
    predicted = wrenches(track.tool.plates, law, states, threads=1)[:, 2]

    def columns(surface: float) -> Array:
        return np.column_stack([np.interp(surface - z, depths, predicted), np.ones_like(z)])

    used, least, most = np.ones(len(stroke), dtype=np.bool_), low, high
    for _ in range(6):
        z = height[used]
        found = fit_curve(force[used], columns, low=least, high=most)
        surface = float(found.coefficients[0])
        least = surface - max(_SHALLOW * (surface - low), min(_AT_LEAST, surface - low))
        most = min(high, surface + 0.5 * _AIR)
        near = (height > least) & (height < surface + _AIR)
        if near.sum() < 20 or (near == used).all():
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
    return Measurement(track.name, surface, float(found.errors[0]), found.rms / rise)


def fit_surface(tracks: Sequence[Track], cell: LoadCell, law: Law) -> tuple[FittedValue, float]:
    """`surface_height`, the mean over first contacts, and the highest [m]; raises NotIdentifiable without."""
    contacts = fit_each(
        _first_contact,
        ((track, stroke, cell, law) for track in tracks for stroke in down_strokes(track)),
        none="the tool never goes straight down",
    )
    goodness = f"RMS up to {100 * max(c.misfit for c in contacts):.1f} % of the force's rise"
    return mean_of("surface_height", contacts, "m", goodness), max(c.value for c in contacts)


def _penetration(
    track: Track, stroke: Rows, sensor: Sensor, law: Law, surface: float, surface_error: float
) -> tuple[float, Measurement]:
    """The depth of a stroke [m], and ζ of its part below the surface, with the errors of surface and load cell."""
    bag, depths = track.name, surface - track.heights()[stroke]
    rows, depth = stroke[depths > 0.0], float(depths.max())
    if len(rows) < 20 or depth < _SHALLOWEST:
        raise NotIdentifiable(
            f"{bag}: a penetration of {1e3 * depth:.1f} mm in {len(rows)} samples is too shallow; ζ needs"
            f" {1e3 * _SHALLOWEST:g} mm and 20 samples"
        )
    states, forces = track.smooth_states()[rows], track.grain_forces(sensor.cell)[rows]
    modelled, higher = (
        wrenches(track.tool.plates, law, states, surface_height=z, threads=1)[:, :3]
        for z in (surface, surface + surface_error)
    )
    measured, g, above = forces[:, 2], modelled[:, 2], higher[:, 2]
    fit = fit_series(g[:, None], measured)
    zeta = float(fit.coefficients[0])
    by_surface = above @ measured / max(float(above @ above), 1e-12) - zeta
    by_zero = fit.inverse.sum() * sensor.zero_error
    error = float(np.linalg.norm((fit.errors[0], by_surface, by_zero)))
    scale = float(np.linalg.norm(forces) * np.linalg.norm(modelled))
    alike = float(np.sum(forces * modelled)) / scale if scale > 0.0 else 0.0
    if not (zeta > error and alike > _ALIKE):
        raise NotIdentifiable(
            f"{bag}: the fitted ζ is {zeta:.3f} ± {error:.3f}, and measured and modelled force correlate by"
            f" {alike:.2f}; ζ must exceed its error and the correlation {_ALIKE:g}: check sensor.quaternion,"
            " sensor.sign, surface_height, sensor.bias and mesh.file, as rft doctor does"
        )
    return depth, Measurement(bag, zeta, error, fit.rms / float(np.abs(measured).max()))


def fit_zeta(
    tracks: Sequence[Track], sensor: Sensor, law: Law, *, surface: float, surface_error: float
) -> list[FittedValue]:
    """`medium.zeta`, the mean over the penetrations, and `medium.calibrated_depth`; raises NotIdentifiable without.

    `law`: at ζ = 1. `surface`, `surface_error`: its height and standard error [m].
    """
    penetrations = fit_each(
        _penetration,
        ((t, stroke, sensor, law, surface, surface_error) for t in tracks for stroke in down_strokes(t, below=surface)),
        none="no vertical penetration in the grains",
    )
    found = [measurement for _, measurement in penetrations]
    goodness = f"RMS up to {100 * max(m.misfit for m in found):.1f} % of the peak{difference(found)}"
    depth, deepest = max(penetrations)
    source = f"deepest penetration, {deepest.bag}"
    return [
        mean_of("medium.zeta", found, "", goodness),
        FittedValue("medium.calibrated_depth", (depth,), (surface_error,), "m", "", source),
    ]


def difference(found: Sequence[Measurement]) -> str:
    """Words on a ζ that differs between penetrations; none where it does not."""
    low, high = (f(found, key=lambda p: p.value) for f in (min, max))
    apart = high.value - low.value
    if apart <= max(_NOTEWORTHY * low.value, 3.0 * float(np.hypot(low.error, high.error))):
        return ""
    percent = f"{100 * apart / low.value:.0f} %"
    return f"; ζ differs by {percent}: tools of different size, and grains that differ, need a ζ of their own"
