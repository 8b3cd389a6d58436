"""Fits ζ, the measured over the predicted force in each penetration, by least squares through the origin.

As in Treers et al. 2021, IV.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.fitting import Measurement, NotIdentifiable, fit_linear
from rft_ros.calibration.recorded import BedValues, Recorded
from rft_ros.calibration.track import FEWEST, Indices

__all__ = ["BEDS_DIFFER", "Penetration", "deep_enough", "difference", "fit_penetration", "spread_of"]

Array = NDArray[np.float64]

BEDS_DIFFER = 0.1
"""Relative standard deviation of ζ between beds of the same grains (docs/accuracy.md)."""

_NOTEWORTHY = 0.25  # greatest relative difference of ζ between penetrations without a note

_GROWS = 0.8  # least correlation of ζ with the size of the tool that is reported
_SHALLOWEST = 0.005  # a penetration's least depth [m]: below it the force depends more on the surface height than on ζ
_ALIKE = 0.9
"""Least correlation of the measured and the modelled force, over all components and times. With less, the RMS residual
of a force that grows with depth is over a quarter of its peak."""


class Penetration(NamedTuple):
    """ζ of one penetration, with its own error and misfit; its depth [m].

    `by_zero`: derivative of ζ by an offset of the load cell, shape [3] [1/N]. `alike`: the correlation of measured and
    modelled force.
    """

    zeta: Measurement
    depth: float
    by_zero: Array
    alike: float

    def check(self, error: float) -> None:
        """Raises NotIdentifiable if ζ does not exceed this standard error, or if the forces do not correlate."""
        if not (self.zeta.value > error and self.alike > _ALIKE):
            raise NotIdentifiable(
                f"{self.zeta.bag}: the fitted ζ is {self.zeta.value:.3f} ± {error:.3f}, and measured and modelled force"
                f" correlate by {self.alike:.2f}; ζ must exceed its error and the correlation {_ALIKE:g}: check"
                " sensor.quaternion, sensor.sign, surface_height, sensor.bias and mesh.file, as rft doctor does"
            )


def deep_enough(number: int, recording: Recorded, stroke: Indices, surface: float) -> tuple[int, Indices]:
    """The number of the recording and the stroke, if it identifies ζ. Raises NotIdentifiable if it is too shallow."""
    depths = surface - recording.heights[stroke]
    count, depth = int((depths > 0.0).sum()), float(depths.max())
    if count < FEWEST or depth < _SHALLOWEST:
        raise NotIdentifiable(
            f"{recording.track.name}: a penetration of {1e3 * depth:.1f} mm in {count} samples is too shallow; ζ needs"
            f" {1e3 * _SHALLOWEST:g} mm and {FEWEST} samples"
        )
    return number, stroke


def fit_penetration(recording: Recorded, stroke: Indices, grains: BedValues) -> Penetration:
    """Fit ζ to the part of a stroke below the surface."""
    depths = grains.surface - recording.heights[stroke]
    rows, depth = stroke[depths > 0.0], float(depths.max())
    first = recording.before_contact(int(rows[0]), grains.surface)
    forces, modelled = recording.forces[rows], recording.predicted(grains, first, rows)
    measured = forces[:, 2:]
    fit = fit_linear(modelled[:, 2:, None], measured)
    scale = float(np.linalg.norm(forces) * np.linalg.norm(modelled))
    alike = float(np.sum(forces * modelled)) / scale if scale > 0.0 else 0.0
    peak = float(np.abs(measured).max())
    misfit = fit.rms / peak if peak > 0.0 else 0.0
    zeta = Measurement(recording.track.name, float(fit.coefficients[0]), float(fit.errors[0]), misfit)
    return Penetration(zeta, depth, np.array([0.0, 0.0, fit.inverse[0].sum()]), alike)


def spread_of(found: Sequence[Measurement], tools: Sequence[str]) -> float:
    """Relative scatter of ζ between the tools; if there is only one tool, between its measurements.

    `tools`: the name of the tool of each measurement.
    """
    values = np.array([measurement.value for measurement in found])
    of_tools = [values[[name == tool for name in tools]].mean() for tool in dict.fromkeys(tools)]
    if len(of_tools) == 1:
        return float(np.std(values, ddof=1) / values.mean()) if len(values) > 1 else 0.0
    return float(max(abs(values.mean() / zeta - 1.0) for zeta in of_tools))


def difference(found: Sequence[Measurement], sizes: Sequence[float] = ()) -> str:
    """Words on a ζ that differs between penetrations; none where it does not. `sizes` of their tools [m]."""
    low = min(found, key=lambda measurement: measurement.value)
    high = max(found, key=lambda measurement: measurement.value)
    apart = high.value - low.value
    grows = ""
    if len(sizes) == len(found) and np.ptp(sizes) > 0.1 * max(sizes):
        values = np.array([measurement.value for measurement in found])
        if np.corrcoef(sizes, values)[0, 1] > _GROWS:
            grows = f"; ζ grows with the tool's size, {1e3 * min(sizes):.0f} to {1e3 * max(sizes):.0f} mm wide"
    # That ζ follows the size is evidence of its own, so that fewer standard errors are enough.
    certain = (2.0 if grows else 3.0) * float(np.hypot(low.error, high.error))
    if apart <= max(_NOTEWORTHY * low.value, certain):
        return ""
    percent = f"{100 * apart / low.value:.0f} %"
    return f"; ζ differs by {percent}: tools of different size, and grains that differ, need a ζ of their own{grows}"
