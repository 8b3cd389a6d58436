"""The scenes of the accuracy chart: bodies in motion, each body meshed at several levels."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import trimesh
from numpy.typing import NDArray

from rft_ros.rft import QUATERNION, Integration, Plates, checked_states
from rft_ros.sweeps.motions import circumnutation, oscillating_insertion, plate_drag, sample, straight
from rft_ros.tool.refine import refined_plates
from rft_ros.tool.tool import centroid_plates

__all__ = ["Mesh", "Scene", "lathe", "scenes"]

Array = NDArray[np.float64]
Mesh = tuple[Array, NDArray[np.int64]]
"""Vertices in the tool frame [m], shape [n, 3], and faces, shape [m, 3]."""

_COUNT = 600  # states of a motion
_ATTITUDES = 240

_RADIUS = 0.0254
_WALL, _BUCKET_RADIUS, _BUCKET_HEIGHT = 0.003, 0.05, 0.08


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """A body in motion.

    `mesh(level)`: the body, finer with each level. `levels`: how many the chart shows. `reference`: the converged
    level. `delivered`: the level that reductions start from. `states`: shape [n, 13], surface at z = 0. `known`: the
    states are one motion, for which plates can be chosen; otherwise they are samples of any motion.
    """

    name: str
    mesh: Callable[[int], Mesh]
    levels: int
    reference: int
    delivered: int
    states: Array
    known: bool = True

    def plates(self, level: int, integration: Integration) -> Plates:
        """The body's plates at a level, by a rule."""
        vertices, faces = self.mesh(level)
        return refined_plates(vertices, faces) if integration == "refined" else centroid_plates(vertices, faces)


def scenes() -> Iterator[Scene]:
    """All scenes in the order of the chart."""
    ball = {"mesh": _ball, "levels": 5, "reference": 6, "delivered": 3, "known": False}
    yield Scene(name="half-buried sphere", states=_attitudes(0.0), **ball)  # type: ignore[arg-type]
    yield Scene(name="deep sphere", states=_attitudes(-3.0 * _RADIUS), **ball)  # type: ignore[arg-type]
    yield Scene(
        name="oscillating ellipsoid",
        mesh=lambda level: _scaled(_ball(level), np.array([9.5, 9.5, 18.0]) / (1e3 * _RADIUS)),
        levels=5,
        reference=6,
        delivered=3,
        states=sample(oscillating_insertion(), _COUNT)[1],
    )
    yield Scene(
        name="circumnutating root tip",
        mesh=lambda level: lathe(_paraboloid(3 * 2**level), 6 * 2**level),
        levels=5,
        reference=5,
        delivered=3,
        states=sample(circumnutation(), _COUNT)[1],
    )
    yield Scene(
        name="inclined plate",
        mesh=_plate,
        levels=5,
        reference=6,
        delivered=4,
        states=sample(plate_drag(beta_deg=60.0, psi_deg=30.0, phi_deg=30.0, depth=0.0), _COUNT)[1],
    )
    yield Scene(
        name="bucket (concave)",
        mesh=lambda level: lathe(_bucket(8 * 2**level), 8 * 2**level),
        levels=5,
        reference=5,
        delivered=4,
        states=sample(
            straight(start_height=0.06, travel=0.14, descent_deg=40.0, tilt_deg=50.0, yaw_deg=10.0), _COUNT // 3
        )[1],
    )


def lathe(profile: Array, sections: int) -> Mesh:
    """The body of revolution about z of a profile of radius and z [m], shape [k, 2], its outside to the right.

    A profile that ends on the axis gives a closed body; facets without area on the axis are left out.
    """
    k = len(profile)
    turn = 2.0 * np.pi * np.arange(sections) / sections
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    vertices = np.zeros((sections, k, 3))
    vertices[:, :, :2] = ring[:, None] * profile[None, :, :1]
    vertices[:, :, 2] = profile[:, 1]
    here = np.arange(sections * k).reshape(sections, k)
    there = np.roll(here, -1, axis=0)
    a, b, c, d = here[:, :-1], there[:, :-1], there[:, 1:], here[:, 1:]
    lower, upper = np.stack([a, b, c], axis=2), np.stack([a, c, d], axis=2)
    wide = profile[:, 0] > 0.0
    faces = np.concatenate([lower[:, wide[:-1]].reshape(-1, 3), upper[:, wide[1:]].reshape(-1, 3)])
    return vertices.reshape(-1, 3), faces


def _ball(level: int) -> Mesh:
    mesh = trimesh.creation.icosphere(subdivisions=level + 1 if level < 5 else 6, radius=_RADIUS)
    return np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64)


def _plate(level: int) -> Mesh:
    mesh = trimesh.creation.box((0.051, 0.051, 0.0032))
    for _ in range(level):
        mesh = mesh.subdivide()
    return np.array(mesh.vertices), np.array(mesh.faces, dtype=np.int64)


def _scaled(mesh: Mesh, factors: Array) -> Mesh:
    return mesh[0] * factors, mesh[1]


def _paraboloid(rings: int) -> Array:
    """The root tip: 20 mm wide, 34.5 mm long, its base at z = 0."""
    share = np.linspace(0.0, 1.0, rings + 1)
    side = np.stack([0.01 * share, 0.0345 * (share * share - 1.0)], axis=1)
    base = np.stack([0.01 * share[::-1][1:], np.zeros(rings)], axis=1)
    return np.concatenate([side, base])


def _bucket(pieces: int) -> Array:
    """Open at the top: bottom, wall, rim and the same inside; `pieces` along the outside."""
    outside = _along([(0.0, 0.0), (_BUCKET_RADIUS, 0.0), (_BUCKET_RADIUS, _BUCKET_HEIGHT)], pieces)
    inner = _BUCKET_RADIUS - _WALL
    return np.concatenate([outside, _along([(inner, _BUCKET_HEIGHT), (inner, _WALL), (0.0, _WALL)], pieces)])


def _along(corners: list[tuple[float, float]], pieces: int) -> Array:
    """Points along a polyline: its corners, and nearly even points between them."""
    points = np.array(corners)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    parts = np.maximum(1, np.round(pieces * lengths / lengths.sum()).astype(int))
    pairs = zip(points[:-1], points[1:], parts, strict=True)
    return np.concatenate([*(np.linspace(a, b, n, endpoint=False) for a, b, n in pairs), points[-1:]])


def _attitudes(height: float) -> Array:
    """Random attitudes, all moving along +x, the origin at a height [m]."""
    states = np.zeros((_ATTITUDES, 13))
    states[:, QUATERNION] = np.random.default_rng(0).normal(size=(_ATTITUDES, 4))
    states[:, QUATERNION] /= np.linalg.norm(states[:, QUATERNION], axis=1)[:, None]
    states[:, 2], states[:, 7] = height, 0.01
    return checked_states(states)
