"""Random bodies and states, laws to try them with, and hypothesis strategies for directions."""

import numpy as np
import pytest
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from rft_ros.rft import (
    INTEGRATIONS,
    MEDIA,
    QUATERNION,
    Agarwal2023,
    Integration,
    Plates,
    alpha_y_model,
    checked_states,
    rotation_matrix,
    treers2021,
)
from rft_ros.rft.traction import BLEND_TILT_DEG

Array = NDArray[np.float64]

GENERIC = MEDIA["generic"]
CONSTANT = treers2021(GENERIC, alpha_y_model("constant", GENERIC))
LINEAR = treers2021(GENERIC, alpha_y_model("linear", GENERIC))
AGARWAL = Agarwal2023()
INERTIAL = treers2021(GENERIC, alpha_y_model("constant", GENERIC), density=1500.0)

FLAT = 1.0 - 1e-3
"""Plates with abs(n·E3) at or above this follow the released code's rule for horizontal plates."""

LEVEL = {"centroid": FLAT, "refined": float(np.cos(np.radians(BLEND_TILT_DEG)))}
"""Where each rule begins to take e2 from the velocity, nudged along x."""

RULES = pytest.mark.parametrize("rule", INTEGRATIONS)

seeds = st.integers(0, 2**32 - 1)


def unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def random_plates(rng: np.random.Generator, n: int, rule: Integration = "centroid") -> Plates:
    if rule == "refined":
        corners = rng.uniform(-0.04, 0.04, (n, 1, 3)) + rng.uniform(-0.005, 0.005, (n, 3, 3))
        return Plates.from_triangles(corners, rng.uniform(0.01, 0.5, n))
    return Plates.from_arrays(
        rng.uniform(-0.04, 0.04, (n, 3)), unit(rng.normal(size=(n, 3))), rng.uniform(0, 1e-4, n)
    )


def facing(rule: Integration, places: ArrayLike, normals: ArrayLike) -> Plates:
    """Plates at places with these normals: points, or for the refined rule triangles."""
    places, normals = np.asarray(places, dtype=float), unit(np.asarray(normals, dtype=float))
    if rule == "centroid":
        return Plates.from_arrays(places, normals, np.full(len(places), 1e-4))
    first = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
    second = np.cross(normals, first)
    corners = 0.01 * np.stack(
        [-first - second, 2.0 * first - second, 2.0 * second - first], axis=1
    )
    return Plates.from_triangles(places[:, None] + corners, np.full(len(places), 0.02))


def random_scene(rng: np.random.Generator, n: int) -> Array:
    """States near the surface at z = 0: about half of a 4 cm body is under it."""
    return checked_states(
        np.hstack(
            [
                rng.uniform(-0.03, 0.03, (n, 3)),
                unit(rng.normal(size=(n, 4))),
                rng.normal(0, 0.02, (n, 3)),
                rng.normal(0, 0.5, (n, 3)),
            ]
        )
    )


def without_flat(plates: Plates, state: Array, margin: float = 1e-4) -> Plates:
    """The plates that are not within the horizontal cap in this state, where the nudge along x breaks symmetry."""
    rows = plates.rows
    nz = (rotation_matrix(state[QUATERNION]) @ rows[3:6])[2]
    return Plates(rows[:, np.abs(nz) < LEVEL[plates.integration] - margin])


def moved(plates: Plates, shift: Array) -> Plates:
    """The same plates seen from a tool frame whose origin lies elsewhere [m]."""
    rows = plates.rows.copy()
    rows[:3] -= shift[:, None]
    return Plates(rows)


def mirrored(plates: Plates) -> Plates:
    """The plates' image in the plane y = 0."""
    rows = plates.rows.copy()
    rows[[1, 4] if len(rows) == 7 else [1, 4, 8, 11]] *= -1.0
    return Plates(rows)


def listed(plates: Plates) -> list[tuple[list[float], list[float], float]]:
    """Plates as plain Python numbers, for the slow reference."""
    return [(c[:3], c[3:6], c[6]) for c in plates.rows[:7].T.tolist()]


@st.composite
def directions(
    draw: st.DrawFn, lowest: float = -1.0, highest: float = 1.0
) -> tuple[float, float, float]:
    """A unit vector with z between lowest and highest."""
    z = draw(st.floats(lowest, highest))
    azimuth = draw(st.floats(0.0, 2.0 * np.pi))
    h = np.sqrt(1.0 - z * z)
    x, y, z = unit(np.array([h * np.cos(azimuth), h * np.sin(azimuth), z])).tolist()
    return x, y, z


def unworn(plates: Plates, way: Array) -> Array:
    """The share 1 - u∞ of the law that each plate keeps in lasting motion along a unit vector, Eq. (10d).

    0 for a plate that trails: it has released its traction.
    """
    lead = plates.normals.T @ way
    least = max(0.75 * (1.0 - max(-way[2], 0.0)), 0.3)
    worn = 0.9 * np.maximum(-plates.normals[2], 0.0) * np.clip(1.0 - lead / least, 0.0, 1.0)
    return np.where(lead > 0.0, 1.0 - worn, 0.0)
