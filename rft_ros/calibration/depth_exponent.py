"""Whether the pressure grows linearly with depth, as the model says, and alike under small and large tools.

The model's stress is α d. Here it becomes α d (d / 1 cm)^(p - 1), so that α keeps its unit and its value 1 cm deep.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.findings import mean_of
from rft_ros.calibration.penetration import Penetration, footprint
from rft_ros.calibration.regression import fit_profile
from rft_ros.rft import Law, plate_forces, rotation_matrix

__all__ = ["Exponent", "PowerOfDepth", "depth_notes", "fit_exponent"]

_REFERENCE = 0.01
"""Depth [m] at which every exponent gives the same stress."""

_ROWS = 160
"""Moments of a penetration that are used; each costs the force on every plate."""

_LOWEST, _HIGHEST = 0.3, 3.0
_NOTEWORTHY = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class Exponent:
    """Exponent of depth with its standard error, ζ that goes with it, and RMS over the peak for it and for p = 1."""

    value: float
    error: float
    zeta: float
    misfit: float
    linear_misfit: float


class PowerOfDepth:
    """A penetration's predicted vertical force at ζ = 1 for any exponent of depth."""

    def __init__(self, penetration: Penetration, law: Law, *, surface: float | None = None) -> None:
        rows = np.unique(np.linspace(0, len(penetration.depth) - 1, _ROWS).round().astype(int))
        surface = penetration.surface if surface is None else surface
        self.measured = penetration.measured[rows]
        self.peak = penetration.peak
        forces, depths = [], []
        for state in penetration.states[rows]:
            forces.append(plate_forces(penetration.plates, law, state, surface_height=surface)[:, 2])
            heights = state[2] + rotation_matrix(state[3:7])[2] @ penetration.plates.packed[:3]
            depths.append(np.maximum(surface - heights, 1e-9))
        self._forces, self._ratio = np.array(forces), np.array(depths) / _REFERENCE

    def predicted(self, exponent: float) -> NDArray[np.float64]:
        """Vertical force at ζ = 1 [N], shape [rows]."""
        return np.asarray((self._forces * self._ratio ** (exponent - 1.0)).sum(axis=1))

    def zeta(self, exponent: float) -> float:
        """ζ by least squares with this exponent."""
        g = self.predicted(exponent)
        return float(g @ self.measured / (g @ g))

    def misfit(self, zeta: float, exponent: float) -> float:
        """RMS residual over the penetration's peak."""
        return float(np.sqrt(np.mean((self.measured - zeta * self.predicted(exponent)) ** 2))) / self.peak


def fit_exponent(penetration: Penetration, law: Law, *, surface_error: float = 0.0) -> Exponent:
    """Exponent and ζ of one penetration by least squares; the error includes that of the surface height [m]."""

    def best(power: PowerOfDepth) -> tuple[float, float, float]:
        found = fit_profile(power.measured, power.predicted, low=_LOWEST, high=_HIGHEST, offset=False)
        return found.parameter, found.error, float(found.linear.coefficients[0])

    power = PowerOfDepth(penetration, law)
    value, error, zeta = best(power)
    if surface_error > 0.0:
        moved = best(PowerOfDepth(penetration, law, surface=penetration.surface + surface_error))[0]
        error = float(np.hypot(error, moved - value))
    return Exponent(
        value=value,
        error=error,
        zeta=zeta,
        misfit=power.misfit(zeta, value),
        linear_misfit=power.misfit(power.zeta(1.0), 1.0),
    )


def depth_notes(penetrations: Sequence[Penetration], law: Law, *, surface_error: float = 0.0) -> list[str]:
    """Sentences, with numbers, on what one ζ hides: pressure that is not linear in depth, or depends on the tool."""
    notes = []
    fits = [fit_exponent(p, law, surface_error=surface_error) for p in penetrations]
    value, error = mean_of([f.value for f in fits], [f.error for f in fits])
    if abs(value - 1.0) > max(_NOTEWORTHY, 3.0 * error):
        each = ", ".join(f"{p.bag} {f.value:.2f}" for p, f in zip(penetrations, fits, strict=True))
        notes.append(
            f"The pressure does not grow linearly with depth: its exponent is {value:.2f} ± {error:.2f} ({each}); with"
            f" it the residual falls from {100 * np.mean([f.linear_misfit for f in fits]):.1f} to"
            f" {100 * np.mean([f.misfit for f in fits]):.1f} % of the peak. ζ holds for depths like these only."
        )
    groups: dict[float, list[Penetration]] = {}
    for p in penetrations:
        groups.setdefault(round(footprint(p.plates, p.states[-1]) * 1e4, 1), []).append(p)
    if len(groups) > 1:
        means = {area: mean_of([p.zeta for p in g], [p.error for p in g]) for area, g in sorted(groups.items())}
        (small, small_error), (large, large_error) = min(means.values()), max(means.values())
        if large - small > max(_NOTEWORTHY * small, 3.0 * np.hypot(small_error, large_error)):
            each = ", ".join(
                f"{np.mean([p.pressure_slope() for p in groups[area]]):.2f} N/cm³ under {area:g} cm² (ζ {zeta:.2f})"
                for area, (zeta, _) in means.items()
            )
            notes.append(f"The pressure depends on the tool's size: it grows by {each}. One ζ cannot hold both.")
    return notes
