"""ζ from vertical penetrations: measured over predicted vertical force, as in Treers et al. 2021, IV."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import FittedValue, NotIdentifiable, fit_each, fit_series, mean_of
from rft_ros.calibration.segments import Stroke, down_strokes
from rft_ros.calibration.tool_weight import Sensor
from rft_ros.calibration.track import Track
from rft_ros.rft import Law, wrenches

__all__ = ["Penetration", "ZetaFit", "fit_zeta"]

_SHALLOWEST = 0.005
"""Least depth of a penetration [m]: the force of a shallower one depends more on the surface height than on ζ."""

_ALIKE = 0.9
"""Least correlation of the measured and the modelled force, over components and moments: below it the RMS residual is
over a quarter of the peak of a force that grows with depth."""

_BEDS_DIFFER = 0.1  # standard deviation of ζ between beds of the same grains (docs/accuracy.md)
_NOTEWORTHY = 0.25  # greatest relative difference of ζ between penetrations without a note


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Penetration:
    """One vertical penetration, n moments in time order.

    `depth` of the tool's lowest point [m], shape [n]. `measured`, `predicted`: vertical force of the grains, and the
    model's at ζ = 1 [N], shape [n]. `error`: standard error of `zeta`, including those of the surface height and of the
    load cell's zero.
    """

    bag: str
    depth: NDArray[np.float64]
    measured: NDArray[np.float64]
    predicted: NDArray[np.float64]
    zeta: float
    error: float

    def misfit(self, zeta: float) -> float:
        """RMS residual at a ζ, relative to the greatest measured force."""
        return float(np.sqrt(np.mean((self.measured - zeta * self.predicted) ** 2)) / np.abs(self.measured).max())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ZetaFit:
    """Mean ζ of the penetrations and its standard error. `surface_error`: standard error of the depths [m]."""

    zeta: float
    error: float
    surface_error: float
    penetrations: tuple[Penetration, ...]

    def relative_error(self) -> float:
        """Of ζ in another bed of the same grains, for `medium.zeta_error`."""
        return max(self.error / self.zeta, _BEDS_DIFFER)

    def zeta_of_others(self, number: int) -> float:
        """Mean ζ of all penetrations but one. Needs two or more."""
        return float(np.mean([p.zeta for k, p in enumerate(self.penetrations) if k != number]))

    def values(self) -> tuple[FittedValue, ...]:
        """`medium.zeta` and `medium.calibrated_depth`."""
        found = self.penetrations
        goodness = f"RMS {100 * max(p.misfit(self.zeta) for p in found):.1f} % of the peak at worst"
        if len(found) > 1:
            held_out = max(p.misfit(self.zeta_of_others(k)) for k, p in enumerate(found))
            goodness += f"; each predicted by the others' ζ: {100 * held_out:.1f} %"
        deepest = max(found, key=lambda p: float(p.depth.max()))
        each = ", ".join(f"{p.bag} {p.zeta:.3f} ± {p.error:.3f}" for p in found)
        depth, source = float(deepest.depth.max()), f"deepest penetration, {deepest.bag}"
        return (
            FittedValue("medium.zeta", (self.zeta,), (self.error,), "", goodness, each),
            FittedValue("medium.calibrated_depth", (depth,), (self.surface_error,), "m", "", source),
        )

    def notes(self) -> list[str]:
        """A sentence if ζ differs between penetrations, and one if the fit is surer than beds are alike."""
        notes = []
        if (own := self.error / self.zeta) < _BEDS_DIFFER:
            notes.append(
                f"medium.zeta_error is {_BEDS_DIFFER:g}, although the fit's own relative error is {own:.2g}: ζ differs"
                f" by {100 * _BEDS_DIFFER:g} % from one levelling of the same grains to the next."
            )
        low, high = (f(self.penetrations, key=lambda p: p.zeta) for f in (min, max))
        apart = high.zeta - low.zeta
        if apart > max(_NOTEWORTHY * low.zeta, 3.0 * float(np.hypot(low.error, high.error))):
            notes.append(
                f"ζ differs by {100 * apart / low.zeta:.0f} % between {low.bag} ({low.zeta:.2f}) and {high.bag}"
                f" ({high.zeta:.2f}): tools of different size, and grains that differ, need a ζ of their own."
            )
        return notes


def _cause(forces: NDArray[np.float64], alike: float) -> str:
    """Why measured forces, shape [n, 3], are probably not like those of the model."""
    x, y, z = forces.mean(axis=0)
    if np.hypot(np.hypot(x, y), z) < 0.5 * np.sqrt(np.mean(np.sum(forces**2, axis=1))):
        return "they are mostly noise; check that the load cell measures and that the tool is in the grains"
    if np.hypot(x, y) > abs(z):
        return "the force points sideways; check sensor.quaternion"
    if alike < -_ALIKE:
        return "the force pulls the sinking tool down; check sensor.sign and sensor.quaternion"
    return "the force grows otherwise; check surface_height, the tare and mesh.file"


def _penetration(
    track: Track, stroke: Stroke, sensor: Sensor, law: Law, *, surface: float, surface_error: float
) -> Penetration:
    """ζ of the part of a stroke in which the tool moves down below the surface.

    Raises NotIdentifiable if it is too short or shallow, or the model does not explain the force.
    """
    bag, plates = track.name, track.tool.plates
    depths = surface - track.heights()[stroke.rows]
    used = stroke.moving & (depths > 0.0)
    rows, depth = stroke.rows[used], depths[used]
    if len(depth) < 20 or depth.max() < _SHALLOWEST:
        deepest = 1e3 * float(depth.max(initial=0.0))
        raise NotIdentifiable(
            f"{bag}: a penetration of {deepest:.1f} mm in {len(depth)} samples is too shallow; ζ needs"
            f" {1e3 * _SHALLOWEST:g} mm and 20 samples"
        )
    states, forces = track.smooth_states()[rows], track.grain_forces(sensor.cell)[rows]

    def predicted(surface: float) -> NDArray[np.float64]:
        return wrenches(plates, law, states, surface_height=surface, threads=1)[:, :3]

    modelled = predicted(surface)
    measured, g = forces[:, 2], modelled[:, 2]
    if not g @ g > 0.0:
        raise NotIdentifiable(f"{bag}: the model predicts no vertical force for this penetration; check mesh.file")
    fit = fit_series(g[:, None], measured)
    zeta = float(fit.coefficients[0])
    step = max(surface_error, 1e-5)
    high, low = predicted(surface + step)[:, 2], predicted(surface - step)[:, 2]
    per_metre = float(high @ measured / (high @ high) - low @ measured / (low @ low)) / (2.0 * step)
    per_newton = float(g.sum() / (g @ g))
    force_error = sensor.vertical_error(track, int(stroke.rows[-1]))
    error = float(np.sqrt(fit.covariance[0, 0] + (per_metre * surface_error) ** 2 + (per_newton * force_error) ** 2))
    scale = float(np.linalg.norm(forces) * np.linalg.norm(modelled))
    alike = float(np.sum(forces * modelled)) / scale if scale > 0.0 else 0.0
    if not (zeta > error and alike > _ALIKE):
        raise NotIdentifiable(
            f"{bag}: the fitted ζ is {zeta:.3f} ± {error:.3f}, and measured and modelled force correlate by"
            f" {alike:.2f}; ζ must exceed its error and the correlation {_ALIKE:g}: {_cause(forces, alike)}"
        )
    return Penetration(bag=bag, depth=depth, measured=measured, predicted=g, zeta=zeta, error=error)


def fit_zeta(tracks: Sequence[Track], sensor: Sensor, law: Law, *, surface: float, surface_error: float) -> ZetaFit:
    """The mean ζ over the penetrations of the tracks. Raises NotIdentifiable if no penetration is usable.

    `law`: at ζ = 1. `surface`, `surface_error`: its height and standard error [m].
    """
    found = fit_each(
        lambda track, stroke: _penetration(track, stroke, sensor, law, surface=surface, surface_error=surface_error),
        [
            (track, stroke)
            for track in tracks
            for stroke in down_strokes(track)
            if track.heights()[stroke.rows].min() < surface
        ],
        none="no vertical penetration in the grains",
    )
    zeta, error = mean_of([p.zeta for p in found], [p.error for p in found])
    return ZetaFit(zeta=zeta, error=error, surface_error=surface_error, penetrations=tuple(found))
