"""Random motions, and the error of a reduced tool's wrench over motions."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import MEDIA, Law, Plates, alpha_y_model, checked_states, treers2021, wrenches

__all__ = ["LAWS", "Comparison", "random_motions"]

Array = NDArray[np.float64]

LAWS: tuple[Law, ...] = tuple(
    treers2021(MEDIA["generic"], alpha_y_model(name, MEDIA["generic"])) for name in ("constant", "linear")
)
"""Laws that the error is measured with: plates chosen with one α_y model have errors of 2 % with the other."""

_SHALLOWEST, _DEEPEST = 0.25, 2.0  # depth of the lowest point over the tool's height

_FEEBLE = 0.01  # of the median force: errors are divided by at least this force


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Compares reduced tools with the full tool over the same motions.

    `laws`: each is applied to all states. `states`: shape [n, 13]. `full`: wrenches of the full tool, shape
    [laws, n, 7]. `center`: of the tool, in its frame [m]; `radius`: of the tool about `center` [m]. `scale`: force that
    each error is divided by [N], shape [laws, n].
    """

    laws: tuple[Law, ...]
    states: Array
    full: Array
    center: Array
    radius: float
    scale: Array

    @classmethod
    def of(cls, plates: Plates, states: Array, *, own_force: bool) -> "Comparison":
        """Divide errors by each state's own force (with one law), or by the greatest force (with all laws)."""
        laws = LAWS[-1:] if own_force else LAWS
        full = np.stack([wrenches(plates, law, states) for law in laws])
        force = np.linalg.norm(full[..., :3], axis=2)
        low, high = plates.packed[:3].min(axis=1), plates.packed[:3].max(axis=1)
        center = 0.5 * (low + high)
        radius = float(np.linalg.norm(plates.packed[:3].T - center, axis=1).max()) or plates.reach or 1.0
        loaded = force[force > 0.0]
        if own_force:
            scale = np.maximum(force, _FEEBLE * float(np.median(loaded)) if len(loaded) else 1.0)
        else:
            scale = np.repeat(np.maximum(force.max(axis=1), 1e-300), len(states)).reshape(force.shape)
        return cls(laws, states, full, center, radius, scale)

    def errors(self, plates: Plates) -> Array:
        """Relative error at each state, shape [laws, n], no unit.

        The larger of the force's error and of the error of the torque about `center` over `radius`.
        """
        off = np.stack([wrenches(plates, law, self.states) for law in self.laws]) - self.full
        force, lever = off[..., :3], _rotated(self.states[:, 3:7], self.center)
        torque = off[..., 3:6] - np.cross(lever, force)
        either = np.maximum(np.linalg.norm(force, axis=2), np.linalg.norm(torque, axis=2) / self.radius)
        return np.asarray(either / self.scale)

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
