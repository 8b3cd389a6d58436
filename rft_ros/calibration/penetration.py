"""ζ from vertical penetrations: measured on predicted vertical force (Treers et al. 2021, IV: the mean over five)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.findings import CannotTell, mean_of
from rft_ros.calibration.load_cell_weight import grain_forces
from rft_ros.calibration.regression import fit_lines
from rft_ros.calibration.stretches import Stroke
from rft_ros.calibration.track import Track
from rft_ros.estimator import LoadCell
from rft_ros.rft import Law, Plates, wrenches

__all__ = ["Penetration", "ZetaFit", "fit_zeta", "footprint", "penetration", "penetration_of"]

_SHALLOWEST = 0.005
"""A penetration that ends above this depth [m] says more of the surface than of ζ."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Penetration:
    """One vertical penetration, n moments in time order.

    `depth` of the tool's lowest point [m], `measured` vertical force of the grains and `predicted` at ζ = 1 [N], shape
    [n]; `states`, shape [n, 13]; `surface`: world z that the depths count from [m]. `zeta` and its standard `error`,
    that of surface and bias included.
    """

    bag: str
    plates: Plates
    states: NDArray[np.float64]
    surface: float
    depth: NDArray[np.float64]
    measured: NDArray[np.float64]
    predicted: NDArray[np.float64]
    zeta: float
    error: float

    @property
    def peak(self) -> float:
        """Greatest measured force [N]."""
        return float(np.abs(self.measured).max())

    def misfit(self, zeta: float) -> float:
        """RMS residual with a ζ, over the peak."""
        return float(np.sqrt(np.mean((self.measured - zeta * self.predicted) ** 2))) / self.peak

    def pressure_slope(self) -> float:
        """Mean vertical pressure over depth [N/cm³]: least squares through the origin, on the tool's footprint."""
        column = footprint(self.plates, self.states[-1]) * self.depth
        return float(column @ self.measured / (column @ column)) * 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ZetaFit:
    """Mean ζ over penetrations and its standard error."""

    zeta: float
    error: float
    penetrations: tuple[Penetration, ...]

    def held_out(self) -> list[float]:
        """RMS residual over the peak of each penetration, predicted with the mean ζ of the others; [] for one alone."""
        zetas = np.array([p.zeta for p in self.penetrations])
        if len(zetas) < 2:
            return []
        others = (zetas.sum() - zetas) / (len(zetas) - 1)
        return [p.misfit(float(z)) for p, z in zip(self.penetrations, others, strict=True)]


def footprint(plates: Plates, state: NDArray[np.float64]) -> float:
    """Area of the facets that face down in a state, projected on the horizontal [m²]."""
    x, y, z, w = state[3:7]
    third_row = np.array([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)])
    down = -third_row @ plates.packed[3:6]
    return float(plates.packed[6] @ np.maximum(down, 0.0))


def penetration_of(
    bag: str,
    plates: Plates,
    states: NDArray[np.float64],
    depth: NDArray[np.float64],
    measured: NDArray[np.float64],
    *,
    law: Law,
    surface: float,
    surface_error: float = 0.0,
    force_error: float = 0.0,
) -> Penetration:
    """A penetration from states, depths [m] and vertical forces [N]; `law` at ζ = 1.

    `surface_error` [m] and `force_error` [N]: standard errors of the surface height and of the vertical zero. Raises
    CannotTell where it is too short or shallow, or pushes the wrong way.
    """
    if len(depth) < 20 or depth.max() < _SHALLOWEST:
        deepest = 1e3 * float(depth.max()) if len(depth) else 0.0
        raise CannotTell(
            f"{bag}: a penetration of {deepest:.1f} mm in {len(depth)} samples is too shallow; ζ needs"
            f" {1e3 * _SHALLOWEST:g} mm and 20 samples"
        )

    def predicted(surface: float) -> NDArray[np.float64]:
        return wrenches(plates, law, states, surface_height=surface, threads=1)[:, 2]

    g = predicted(surface)
    if not g @ g > 0.0:
        raise CannotTell(f"{bag}: the model predicts no vertical force for this penetration; check mesh.file")
    fit = fit_lines(g[:, None], measured)
    zeta = float(fit.coefficients[0])
    step = max(surface_error, 1e-5)
    high, low = predicted(surface + step), predicted(surface - step)
    per_metre = float(high @ measured / (high @ high) - low @ measured / (low @ low)) / (2.0 * step)
    per_newton = float(g.sum() / (g @ g))
    error = float(np.sqrt(fit.covariance[0, 0] + (per_metre * surface_error) ** 2 + (per_newton * force_error) ** 2))
    if zeta <= 0.0:
        raise CannotTell(
            f"{bag}: ζ comes out as {zeta:.3f} ± {error:.3f}; the grains push a sinking tool up: check sensor.sign and"
            " sensor.quaternion"
        )
    return Penetration(
        bag=bag,
        plates=plates,
        states=states,
        surface=surface,
        depth=depth,
        measured=measured,
        predicted=g,
        zeta=zeta,
        error=error,
    )


def penetration(
    track: Track,
    stroke: Stroke,
    cell: LoadCell,
    law: Law,
    *,
    surface: float,
    surface_error: float = 0.0,
    force_error: float = 0.0,
) -> Penetration:
    """What a stroke says below the surface while it goes down, bias and weight of `cell` taken off."""
    depth = surface - track.heights()[stroke.rows]
    rows = stroke.rows[stroke.moving & (depth > 0.0)]
    return penetration_of(
        track.name,
        track.tool.plates,
        track.smooth_states()[rows],
        surface - track.heights()[rows],
        grain_forces(track, cell)[rows, 2],
        law=law,
        surface=surface,
        surface_error=surface_error,
        force_error=force_error,
    )


def fit_zeta(penetrations: Sequence[Penetration]) -> ZetaFit:
    """The mean over penetrations; CannotTell without any."""
    if not penetrations:
        raise CannotTell("no vertical penetration in the grains")
    zeta, error = mean_of([p.zeta for p in penetrations], [p.error for p in penetrations])
    return ZetaFit(zeta=zeta, error=error, penetrations=tuple(penetrations))
