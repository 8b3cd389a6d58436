"""Reduced tools: the fewest plates whose wrench stays within a tolerance of the full tool's.

The error is measured on motions that were not used for the choice. The same tool always gives the same plates.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.rft import Plates, checked_states, wrenches
from rft_ros.tool.fewer_plates import LAWS, Merger, chosen_plates

__all__ = ["Reduction", "random_motions", "reduced_for_any_motion", "reduced_for_scene"]

Array = NDArray[np.float64]

_CHOOSING, _MEASURING = 1, 2  # seeds
_STATES = 1000  # for each; the percentile scatters by about 5 % of itself
_SHALLOWEST, _DEEPEST = 0.25, 2.0  # depth of the lowest point over the tool's height
_FEEBLE = 0.01  # of the median force: errors are divided by at least this force

_FIRST = 16  # plates tried first; then doubled
_WORTH = 0.7  # of the facets: the most plates of a reduced tool; beyond, keep the full tool
_STEPS = 5  # of the bisection between two numbers of plates
_MORE = 1.1  # times the plates, where the measured error exceeds the tolerance

_FEWEST_STATES = 20  # of a scene: of each six, four select plates, one decides when to stop, one measures the error
_NEAR = 0.3  # rad, and of the tool's reach: the largest gap between samples that may be interpolated


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


class _Errors:
    """The error of reduced tools against the full tool over the same motions.

    Relative to each state's own force (with one law) if `own_force`, else to the greatest force (with all laws).
    """

    def __init__(self, plates: Plates, states: Array, *, own_force: bool) -> None:
        self._laws, self._states = LAWS[-1:] if own_force else LAWS, states
        self._full = np.stack([wrenches(plates, law, states) for law in self._laws])
        force = np.linalg.norm(self._full[..., :3], axis=2)
        self.any_force = bool(force.any())
        places = plates.packed[:3].T
        center = 0.5 * (places.min(axis=0) + places.max(axis=0))
        self._lever = _rotated(states[:, 3:7], center)
        self._radius = float(np.linalg.norm(places - center, axis=1).max()) or plates.reach or 1.0
        if own_force:
            self._scale = np.maximum(force, _FEEBLE * float(np.median(force[force > 0.0])) if self.any_force else 1.0)
        else:
            self._scale = np.maximum(force.max(axis=1, keepdims=True), 1e-300)

    def percentile_95(self, plates: Plates) -> float:
        """Of the larger of two errors, no unit: of the force; of the torque about the center over the radius."""
        off = np.stack([wrenches(plates, law, self._states) for law in self._laws]) - self._full
        force = off[..., :3]
        torque = off[..., 3:6] - np.cross(self._lever, force)
        either = np.maximum(np.linalg.norm(force, axis=2), np.linalg.norm(torque, axis=2) / self._radius)
        return float(np.percentile(either / self._scale, 95.0))


def reduced_for_any_motion(
    plates: Plates, corners: Array, tolerance: float, *, count: int | None = None
) -> tuple[Plates, Reduction]:
    """The fewest plates within the tolerance, or about `count` plates regardless of their error.

    `corners`: of the tool's convex hull [m], shape [k, 3].
    """
    merger = Merger(plates)
    choosing, measuring = (
        _Errors(plates, random_motions(corners, _STATES, seed=seed), own_force=True) for seed in (_CHOOSING, _MEASURING)
    )
    if count is None:
        few = _fewest(merger, choosing, measuring, tolerance, most=min(int(_WORTH * len(plates)), merger.most))
    else:
        few, tolerance = merger.merged(count), 0.0
    return _reported(plates, few, measuring, tolerance, "any motion")


def _fewest(merger: Merger, choosing: _Errors, measuring: _Errors, tolerance: float, *, most: int) -> Plates | None:
    """The smallest number of plates within the tolerance, by doubling and bisection; None if there is none."""

    def within(count: int) -> Plates | None:
        plates = merger.merged(count)
        return plates if choosing.percentile_95(plates) <= tolerance else None

    low, high = 0, min(_FIRST, most)
    while (best := within(high) if high else None) is None:
        if high >= most:
            return None
        low, high = high, min(2 * high, most)
    for _ in range(_STEPS):
        middle = (low + high) // 2
        if middle == low or high < 1.02 * low:
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
    stopping, measuring = (_Errors(plates, between[part == k], own_force=False) for k in (2, 5))
    if not (stopping.any_force and measuring.any_force):
        raise InputError("the scene has no force: the tool never moves in the grains (the surface is at z = 0)")
    few = None
    most, tolerance = (int(_WORTH * len(plates)), tolerance) if count is None else (count, 0.0)
    for candidate in chosen_plates(plates, states[(part != 2) & (part != 5)]):
        if len(candidate) > most:
            break
        if count is not None:
            few = candidate
        elif max(c.percentile_95(candidate) for c in (stopping, measuring)) <= tolerance:
            few = candidate
            break
    return _reported(plates, few, measuring, tolerance, f"a scene of {len(states):,} states")


def _reported(
    plates: Plates, few: Plates | None, measuring: _Errors, tolerance: float, motions: str
) -> tuple[Plates, Reduction]:
    facets, error, plates = len(plates), measuring.percentile_95(few) if few else 0.0, few or plates
    return plates, Reduction(facets=facets, plates=len(plates), error=error, tolerance=tolerance, motions=motions)


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


def random_motions(corners: Array, count: int, *, seed: int) -> Array:
    """States of a tool in any attitude, moving in any direction and turning about any axis, shape [count, 13].

    `corners`: of the tool's convex hull [m], shape [k, 3]. The lowest point is a quarter to twice the tool's height
    below the surface at z = 0. Points of the tool turn about its center at most as fast as the center moves, 1 m/s.
    The same seed gives the same states.
    """
    random = np.random.default_rng(seed)

    def directions(dimensions: int) -> Array:
        vectors = random.normal(size=(count, dimensions))
        return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])

    center = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    radius = float(np.linalg.norm(corners - center, axis=1).max())
    states = np.zeros((count, 13))
    states[:, 3:7] = directions(4)
    up = _rotated(states[:, 3:7] * [-1.0, -1.0, -1.0, 1.0], np.array([0.0, 0.0, 1.0]))
    heights = up @ (corners - center).T
    top, bottom = heights.max(axis=1), heights.min(axis=1)
    depth = (top - bottom) * random.uniform(_SHALLOWEST, _DEEPEST, count)
    lever = _rotated(states[:, 3:7], center)
    states[:, :3] = -lever
    states[:, 2] -= depth + bottom
    states[:, 10:13] = directions(3) * (random.uniform(0.0, 1.0, count) / radius)[:, None]
    states[:, 7:10] = directions(3) - np.cross(states[:, 10:13], lever)
    return checked_states(states)


def _rotated(quaternions: Array, vector: Array) -> Array:
    """A vector rotated by each unit quaternion xyzw, shape [n, 3]."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(quaternions).apply(vector))
