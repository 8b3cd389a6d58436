"""What the facets of a tool see: rays against triangles (Möller and Trumbore 1997)."""

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["blocked", "seen_share"]

Array = NDArray[np.float64]

_FACETS, _RAYS = 400, 64  # that `seen_share` looks at, and from each

_INSIDE = 1e-9  # of a triangle: a ray that grazes its edge passes


@numba.njit(cache=True)
def _cross(a, b):  # type: ignore[no-untyped-def]
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True)
def _dot(a, b):  # type: ignore[no-untyped-def]
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@numba.njit(cache=True)
def _minus(a, b):  # type: ignore[no-untyped-def]
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@numba.njit(cache=True)
def _blocked(triangles, origins, directions):  # type: ignore[no-untyped-def]
    """Which rays meet a triangle beyond a millionth of the largest coordinate."""
    near = 1e-6 * np.abs(triangles).max()
    out = np.zeros(len(origins), dtype=np.bool_)
    for k in range(len(origins)):
        for i in range(len(triangles)):
            corner = triangles[i, 0]
            first, second = _minus(triangles[i, 1], corner), _minus(triangles[i, 2], corner)
            across = _cross(directions[k], second)
            determinant = _dot(first, across)
            if abs(determinant) < 1e-12 * _dot(first, first):
                continue
            to = _minus(origins[k], corner)
            aside = _cross(to, first)
            u, v = _dot(to, across) / determinant, _dot(directions[k], aside) / determinant
            if min(u, v, 1.0 - u - v) > _INSIDE and _dot(second, aside) / determinant > near:
                out[k] = True
                break
    return out


def blocked(triangles: Array, directions: Array) -> NDArray[np.bool_]:
    """Whether a ray from each facet's middle in its direction meets another facet; shapes [n, 3, 3], [n, 3] -> [n]."""
    corners = np.ascontiguousarray(triangles)
    return np.asarray(_blocked(corners, corners.mean(axis=1), np.ascontiguousarray(directions)))


def seen_share(triangles: Array) -> float:
    """Concavity: share of what facets see that is the tool itself, by area, cosine weighted; shape [n, 3, 3].

    0 of a convex tool, 1/2 inside a hemisphere. At most 400 facets are looked at, each along 64 rays.
    """
    corners = np.ascontiguousarray(triangles)
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = 0.5 * np.linalg.norm(doubled, axis=1)
    some = np.flatnonzero(area > 0.0)[:: 1 + len(area) // _FACETS]
    normal = doubled[some] / (2.0 * area[some, None])
    least = np.eye(3)[np.abs(normal).argmin(axis=1)]
    first = np.cross(normal, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(normal, first)
    # a spiral that fills the unit disc evenly: lifted to the half sphere it is cosine weighted (Malley's method)
    k = np.arange(_RAYS) + 0.5
    radius, angle = np.sqrt(k / _RAYS), k * np.pi * (3.0 - np.sqrt(5.0))
    x, y, z = radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1.0 - radius * radius)
    rays = x[:, None] * first[:, None] + y[:, None] * second[:, None] + z[:, None] * normal[:, None]
    middles = np.repeat(corners[some].mean(axis=1), _RAYS, axis=0)
    seen = _blocked(corners, middles, np.ascontiguousarray(rays.reshape(-1, 3))).reshape(-1, _RAYS).mean(axis=1)
    return float((seen * area[some]).sum() / area[some].sum())
