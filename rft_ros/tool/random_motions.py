"""Random motions, and the error of a reduced tool's wrench over motions."""

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import MEDIA, Law, Plates, alpha_y_model, checked_states, treers2021, wrenches

__all__ = ["LAWS", "WrenchErrors", "random_motions"]

Array = NDArray[np.float64]

LAWS: tuple[Law, ...] = tuple(
    treers2021(MEDIA["generic"], alpha_y_model(name, MEDIA["generic"])) for name in ("constant", "linear")
)
"""Laws that the error is measured with: plates chosen with one α_y model have errors of 2 % with the other."""

_SHALLOWEST, _DEEPEST = 0.25, 2.0  # depth of the lowest point over the tool's height

_FEEBLE = 0.01  # of the median force: errors are divided by at least this force


class WrenchErrors:
    """Compares reduced tools with the full tool, `plates`, over the same motions, `states` of shape [n, 13].

    Errors are relative to each state's own force (with one law) if `own_force`, else to the greatest force (with all
    laws). `full`: wrenches of the full tool, shape [laws, n, 7].
    """

    def __init__(self, plates: Plates, states: Array, *, own_force: bool) -> None:
        self._laws, self._states = LAWS[-1:] if own_force else LAWS, states
        self.full = np.stack([wrenches(plates, law, states) for law in self._laws])
        force = np.linalg.norm(self.full[..., :3], axis=2)
        places = plates.packed[:3].T
        self._center = 0.5 * (places.min(axis=0) + places.max(axis=0))
        self._radius = float(np.linalg.norm(places - self._center, axis=1).max()) or plates.reach or 1.0
        loaded = force[force > 0.0]
        if own_force:
            self._scale = np.maximum(force, _FEEBLE * float(np.median(loaded)) if len(loaded) else 1.0)
        else:
            self._scale = np.maximum(force.max(axis=1, keepdims=True), 1e-300)

    def errors(self, plates: Plates) -> Array:
        """Relative error at each state, shape [laws, n], no unit.

        The larger of the force's error and of the error of the torque about the tool's center over its radius.
        """
        off = np.stack([wrenches(plates, law, self._states) for law in self._laws]) - self.full
        force, lever = off[..., :3], _rotated(self._states[:, 3:7], self._center)
        torque = off[..., 3:6] - np.cross(lever, force)
        either = np.maximum(np.linalg.norm(force, axis=2), np.linalg.norm(torque, axis=2) / self._radius)
        return np.asarray(either / self._scale)

    def percentile_95(self, plates: Plates) -> float:
        """The error's 95th percentile, no unit."""
        return float(np.percentile(self.errors(plates), 95.0))


def random_motions(corners: Array, count: int, *, seed: int) -> Array:
    """States of a tool in any attitude, moving in any direction and turning about any axis, shape [count, 13].

    `corners`: of the tool's convex hull [m], shape [k, 3]. The lowest point is a quarter to twice the tool's height
    below the surface at z = 0. Points of the tool turn about its center at most as fast as the center moves, 1 m/s.
    The same seed gives the same states.
    """
    random = np.random.default_rng(seed)
    center = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    radius = float(np.linalg.norm(corners - center, axis=1).max())
    states = np.zeros((count, 13))
    states[:, 3:7] = _directions(random, count, 4)
    up = _rotated(states[:, 3:7] * [-1.0, -1.0, -1.0, 1.0], np.array([0.0, 0.0, 1.0]))
    heights = up @ (corners - center).T
    top, bottom = heights.max(axis=1), heights.min(axis=1)
    depth = (top - bottom) * random.uniform(_SHALLOWEST, _DEEPEST, count)
    lever = _rotated(states[:, 3:7], center)
    states[:, :3] = -lever
    states[:, 2] -= depth + bottom
    states[:, 10:13] = _directions(random, count, 3) * (random.uniform(0.0, 1.0, count) / radius)[:, None]
    states[:, 7:10] = _directions(random, count, 3) - np.cross(states[:, 10:13], lever)
    return checked_states(states)


def _directions(random: np.random.Generator, count: int, dimensions: int) -> Array:
    vectors = random.normal(size=(count, dimensions))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])


def _rotated(quaternions: Array, vector: Array) -> Array:
    """A vector rotated by each unit quaternion xyzw, shape [n, 3]."""
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_quat(quaternions).apply(vector))
