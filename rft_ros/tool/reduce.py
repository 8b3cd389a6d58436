"""Reduced tools: the fewest plates whose wrench stays within a tolerance of the full tool's.

For any motion, neighbours are merged (`merge`); for a known scene, some plates are selected (`cubature`). The error is
measured on motions that were not used for the choice. The same tool always gives the same plates.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.rft import Plates
from rft_ros.tool.cubature import chosen_plates
from rft_ros.tool.merge import Merger
from rft_ros.tool.random_motions import WrenchErrors, random_motions

__all__ = ["Reduction", "reduced_for_any_motion", "reduced_for_scene"]

Array = NDArray[np.float64]

_FEWEST_STATES = 20  # of a scene: of each six, four select plates, one decides when to stop, one measures the error
_CHOOSING, _MEASURING = 1, 2  # seeds
_STATES = 1000  # for each; the percentile scatters by about 5 % of itself
_FIRST = 16  # plates tried first; then doubled
_WORTH = 0.7  # of the facets: the most plates of a reduced tool; beyond, keep the full tool
_STEPS = 5  # of the bisection between two numbers of plates
_NEAR = 0.3  # rad, and of the tool's reach: the largest gap between samples that may be interpolated
_MORE = 1.1  # times the plates, where the measured error exceeds the tolerance


@dataclass(frozen=True, slots=True, kw_only=True)
class Reduction:
    """Result of a reduction.

    `facets`: number of plates of the full tool. `plates`: of the reduced tool. `error`: 95th percentile over `motions`,
    relative to each state's own force (any motion) or to the greatest force (a scene). `tolerance`: of that error; 0 if
    the number of plates was given instead.
    """

    facets: int
    plates: int
    error: float
    tolerance: float
    motions: str

    def __str__(self) -> str:
        """Such as "2,352 facets -> 148 plates, 1.8 % at the 95th percentile"."""
        if self.plates == self.facets and self.tolerance > 0.0:
            return f"{self.facets:,} facets, all of them needed for {100.0 * self.tolerance:g} %"
        return f"{self.facets:,} facets -> {self.plates:,} plates, {100.0 * self.error:.1f} % at the 95th percentile"


def reduced_for_any_motion(
    plates: Plates, corners: Array, tolerance: float, *, count: int | None = None
) -> tuple[Plates, Reduction]:
    """The fewest plates within the tolerance, or about `count` plates regardless of their error.

    `corners`: of the tool's convex hull [m], shape [k, 3].
    """
    merger = Merger(plates)
    measuring = WrenchErrors(plates, random_motions(corners, _STATES, seed=_MEASURING), own_force=True)
    if count is None:
        choosing = WrenchErrors(plates, random_motions(corners, _STATES, seed=_CHOOSING), own_force=True)
        few = _fewest(merger, choosing, measuring, tolerance, most=min(int(_WORTH * len(plates)), merger.most))
    else:
        few, tolerance = merger.merged(count), 0.0
    return _reported(plates, few, measuring, tolerance, "any motion")


def _fewest(
    merger: Merger, choosing: WrenchErrors, measuring: WrenchErrors, tolerance: float, *, most: int
) -> Plates | None:
    """The smallest number of plates within the tolerance, by doubling and bisection; None if there is none."""

    def within(count: int) -> Plates | None:
        plates = merger.merged(count)
        return plates if choosing.percentile_95(plates) <= tolerance else None

    low, high, best = 0, _FIRST, None
    while high < most and (best := within(high)) is None:
        low, high = high, 2 * high
    if best is None:
        high = most
        if most < 1 or (best := within(most)) is None:
            return None
    for _ in range(_STEPS):
        middle = (low + high) // 2
        if middle in (low, high) or high < 1.02 * low:
            break
        if (plates := within(middle)) is None:
            low = middle
        else:
            high, best = middle, plates
    while measuring.percentile_95(best) > tolerance:
        high = int(_MORE * high) + 1
        if high > most:
            return None
        best = merger.merged(high)
    return best


def reduced_for_scene(
    plates: Plates, states: Array, tolerance: float, *, count: int | None = None
) -> tuple[Plates, Reduction]:
    """The fewest plates within the tolerance over a scene's states, or at most `count` plates regardless of the error.

    `states`: shape [n, 13], units as `rft_ros.rft.STATE`, the surface at z = 0. InputError where there are too few
    states, or none with a force.
    """
    if len(states) < _FEWEST_STATES:
        raise InputError(f"the scene has {len(states)} states; it needs at least {_FEWEST_STATES}")
    part = np.arange(len(states)) % 6
    between = _halfway(states, plates.reach)
    stopping, measuring = (WrenchErrors(plates, between[part == k], own_force=False) for k in (2, 5))
    if not (stopping.full[..., :3].any() and measuring.full[..., :3].any()):
        raise InputError("the scene has no force: the tool never moves in the grains (the surface is at z = 0)")
    few = None
    most, tolerance = (int(_WORTH * len(plates)), tolerance) if count is None else (count, 0.0)
    for candidate in chosen_plates(plates, states[(part != 2) & (part != 5)]):
        if len(candidate) > most:
            break
        within = count is None and max(c.percentile_95(candidate) for c in (stopping, measuring)) <= tolerance
        if within or count is not None:
            few = candidate
        if within:
            break
    return _reported(plates, few, measuring, tolerance, f"a scene of {len(states):,} states")


def _halfway(states: Array, reach: float) -> Array:
    """Each state moved halfway to the next, where the next is near; shape as given.

    A periodic motion may be sampled at the same phases in every period. Held-out samples would then repeat those used
    for the choice, and their error would be a tenth of the error between samples.
    """
    here, there = states, np.concatenate([states[1:], states[-1:]])
    same_side = np.where((here[:, 3:7] * there[:, 3:7]).sum(axis=1) < 0.0, -1.0, 1.0)
    middle = 0.5 * (here + there)
    middle[:, 3:7] = here[:, 3:7] + same_side[:, None] * there[:, 3:7]
    cosine = 0.5 * np.linalg.norm(middle[:, 3:7], axis=1)  # of a quarter of the angle between the attitudes
    middle[:, 3:7] /= 2.0 * cosine[:, None]
    far = np.linalg.norm(there[:, :3] - here[:, :3], axis=1) > _NEAR * reach
    return np.where((far | (cosine < np.cos(_NEAR / 4.0)))[:, None], here, middle)


def _reported(
    plates: Plates, few: Plates | None, measuring: WrenchErrors, tolerance: float, motions: str
) -> tuple[Plates, Reduction]:
    plates, facets, error = few or plates, len(plates), measuring.percentile_95(few) if few else 0.0
    return plates, Reduction(facets=facets, plates=len(plates), error=error, tolerance=tolerance, motions=motions)
