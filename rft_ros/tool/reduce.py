"""Reduced tools: the fewest plates whose wrench stays within a tolerance of the full tool's.

Neighbouring plates are merged. k-means on plates drawn by area finds groups of similar position, over the tool's
radius, and outward normal. They are small where the tool bends and large where it is flat. The error is measured on
random motions. The same tool always gives the same plates.
"""

import warnings
from bisect import bisect_left
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import (
    FORCE,
    MEDIA,
    TORQUE,
    WRENCH,
    Plates,
    alpha_y_model,
    checked_states,
    treers2021,
    wrenches,
)
from rft_ros.rft.plates import (
    AREA,
    CENTROID,
    FIRST_CORNER,
    HALF_ANGLE,
    NORMAL,
    SECOND_CORNER,
)

Array = NDArray[np.float64]
Labels = NDArray[np.int64]

_GENERIC = MEDIA["generic"]
_LAWS = [treers2021(_GENERIC, alpha_y_model(name, _GENERIC)) for name in ("constant", "linear")]
"""The error is the worse of these two laws: plates chosen with one α_y model have errors of 2 % with the other."""

_STATE_COUNT = 2000  # random motions; the percentile scatters by about 4 % of itself
_MIN_DEPTH_RATIO = 0.25  # depth of the lowest point over the tool's height
_MAX_DEPTH_RATIO = 2.0  # likewise
_MIN_FORCE_RATIO = 0.01  # of the median force: a relative error is taken over at least this force

_COUNTS = np.unique(np.geomspace(4, 4096, 142).astype(int))  # numbers of plates that are tried
_MAX_PLATES_SHARE = 0.7  # of the facets; a reduction that needs more plates saves too little, and the full tool is kept
_SAMPLE_COUNT = 4096  # plates drawn for k-means
_ROUND_COUNT = 10  # of k-means; further ones change the error by less than its scatter
# a shorter mean normal has no direction: the normals cancel, as those of the two sides of a sheet
_MIN_MEAN_NORMAL_RATIO = 1e-6


def reduced_for_any_motion(plates: Plates, corners: Array, tolerance: float) -> tuple[Plates, str]:
    """The fewest plates that meet the tolerance in random motions, and a sentence that describes the reduction.

    `corners`: of the tool's convex hull [m], shape [k, 3]. `tolerance`: error over the force of the same state.
    """
    error_of = _error_over(random_motions(corners, _STATE_COUNT, seed=1), plates)

    def within(count: int) -> bool:
        return error_of(merged_plates(plates, count)) <= tolerance

    counts = _COUNTS[_MAX_PLATES_SHARE * len(plates) >= _COUNTS].tolist()
    best = bisect_left(counts, True, key=within)
    reduced_plates = merged_plates(plates, counts[best]) if best < len(counts) else plates
    percent = 100.0 * error_of(reduced_plates)
    counts_text = f"{len(plates):,} facets -> {len(reduced_plates):,} plates"
    reduction = f"{counts_text}, {percent:.1f} % at the 95th percentile of any motion"
    return reduced_plates, reduction


def _error_over(states: Array, plates: Plates) -> Callable[[Plates], float]:
    """A function that returns the relative error of fewer plates over these states: the worse law's 95th percentile.

    The error of a state is the larger of two: of the force, and of the torque over the tool's reach.
    """

    def wrenches_of(some: Plates) -> Array:
        return np.stack([wrenches(some, law, states)[:, WRENCH] for law in _LAWS])

    full = wrenches_of(plates)
    force = np.linalg.norm(full[..., FORCE], axis=2)
    least = _MIN_FORCE_RATIO * float(np.median(force[force > 0.0])) if force.any() else 1.0
    scale = np.maximum(force, least)

    def error_of(reduced_plates: Plates) -> float:
        off = wrenches_of(reduced_plates) - full
        force_error = np.linalg.norm(off[..., FORCE], axis=2)
        torque_error = np.linalg.norm(off[..., TORQUE], axis=2) / plates.reach
        error = np.maximum(force_error, torque_error) / scale
        return float(np.percentile(error, 95.0, axis=1).max())

    return error_of


def merged_plates(plates: Plates, count: int) -> Plates:
    """Merge neighbouring plates into at most `count`; each has the area and the first moment of its parts.

    For the refined rule it also has their second moments about the centroid and the spread of their normals.
    """
    from scipy.cluster.vq import kmeans2
    from scipy.spatial import KDTree

    total = plates.areas.sum()
    place = plates.centroids - (plates.centroids @ plates.areas / total)[:, None]
    radius = float(np.linalg.norm(place, axis=0).max())
    features = np.vstack([place / (radius or 1.0), plates.normals]).T
    most = min(len(features), _SAMPLE_COUNT)
    random = np.random.default_rng(0)
    samples = random.choice(features, most, replace=False, p=plates.areas / total)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of empty groups, which equal centres lead to
        centres, _ = kmeans2(samples, samples[:count], iter=_ROUND_COUNT, minit="matrix")
    _, nearest = KDTree(centres).query(features)
    _, groups = np.unique(nearest, return_inverse=True)
    return Plates(_united(plates.rows, groups))


def _means(groups: Labels, weights: Array, rows: Array) -> Array:
    """Weighted mean of each group; rows: shape [k, n]; result: shape [k, groups]."""
    totals = [np.bincount(groups, weights * row) for row in rows]
    return np.array(totals) / np.bincount(groups, weights)


def _united(rows: Array, groups: Labels) -> Array:
    """One plate for each group, rows as `Plates.rows`."""
    areas = rows[AREA]
    centroids = _means(groups, areas, rows[CENTROID])
    normals = _means(groups, areas, rows[NORMAL])
    length = np.linalg.norm(normals, axis=0)
    is_cancelled = length < _MIN_MEAN_NORMAL_RATIO
    _, one = np.unique(groups, return_index=True)  # a plate of each group
    normals[:, is_cancelled] = rows[NORMAL, one[is_cancelled]]
    normals /= np.linalg.norm(normals, axis=0)
    parts = [centroids, normals, np.bincount(groups, areas)]
    if len(rows) > HALF_ANGLE:
        # the half angle of the fade whose variance is that of the group's normals
        half = np.arcsin(np.minimum(0.5 / rows[HALF_ANGLE], 1.0))
        variance = 3.0 * (1.0 - length) + _means(groups, areas, half[None] ** 2)
        angle = np.minimum(np.sqrt(variance), 0.5 * np.pi)
        parts += [_triangles(rows, groups, centroids, normals), 0.5 / np.sin(angle)]
    return np.vstack(parts)


def _triangles(
    rows: Array,
    groups: Labels,
    centroids: Array,
    normals: Array,
) -> Array:
    """Two corners, relative to the centroid, of a triangle with each group's second moments, shape [6, m].

    Equal moments give a submerged plate the depth integral and the centre of pressure of its parts. `centroids`,
    `normals`: of the groups, shape [3, m].
    """
    away = rows[CENTROID] - centroids[:, groups]
    first = rows[FIRST_CORNER] / np.sqrt(12.0)
    second = rows[SECOND_CORNER] / np.sqrt(12.0)
    points = np.array([away, first, second, first + second])
    moments = np.einsum("pin,pjn->ijn", points, points).reshape(9, -1)
    mean = _means(groups, rows[AREA], moments).T.reshape(-1, 3, 3)
    in_plane = np.eye(3) - np.einsum("im,jm->mij", normals, normals)
    size, direction = np.linalg.eigh(in_plane @ mean @ in_plane)  # the first is along the normal
    spread = direction[:, :, 1:] * np.sqrt(np.maximum(size[:, None, 1:], 0.0))
    # a regular triangle inscribed in the unit circle has moments of 1/8; its corners are at 90, 210 and 330 degrees
    turn = np.pi * np.array([0.5, 0.5 + 2.0 / 3.0])
    regular = np.sqrt(8.0) * np.array([np.cos(turn), np.sin(turn)])
    corners: Array = np.einsum("mka,ac->ckm", spread, regular)
    return corners.reshape(6, -1)


def random_motions(corners: Array, count: int, *, seed: int) -> Array:
    """States of a tool in any attitude, moving in any direction and turning about any axis, shape [count, 13].

    `corners`: of the tool's convex hull [m], shape [k, 3]. The lowest point is a quarter to twice the tool's height
    below the surface at z = 0. Points of the tool turn about its center at most as fast as the center moves, 1 m/s.
    """
    from scipy.spatial.transform import Rotation

    random = np.random.default_rng(seed)

    def directions(dimensions: int) -> Array:
        vectors = random.normal(size=(count, dimensions))
        return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])

    center = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    arms = corners - center
    radius = float(np.linalg.norm(arms, axis=1).max())
    attitude = directions(4)
    rotations = Rotation.from_quat(attitude)
    # one state at a time: the heights of all corners in all states could fill the memory
    heights = (arms @ up for up in rotations.as_matrix()[:, 2])
    bottom, top = np.array([(z.min(), z.max()) for z in heights]).T
    depth = (top - bottom) * random.uniform(_MIN_DEPTH_RATIO, _MAX_DEPTH_RATIO, count)
    lever = rotations.apply(center)
    position = -lever
    position[:, 2] -= depth + bottom
    turning = directions(3) * (random.uniform(0.0, 1.0, count) / radius)[:, None]
    velocity = directions(3) - np.cross(turning, lever)
    return checked_states(np.column_stack([position, attitude, velocity, turning]))
