"""Doubts of an estimate: what of its motion and tool lies outside of what the method was tested for."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.quality import QualityFlag
from rft_ros.estimator.settings import Settings
from rft_ros.rft import Plates, edge_shares
from rft_ros.tool import Tool

__all__ = ["Validity"]


# plain integers: an operation on flags costs a microsecond
_FAST, _INERTIAL, _NEAR, _WAKE = (
    int(d) for d in (QualityFlag.FAST, QualityFlag.INERTIAL, QualityFlag.NEAR_REST, QualityFlag.WAKE)
)
_CONCAVE, _FLAT, _EDGE, _DEEP = (
    int(d) for d in (QualityFlag.CONCAVE, QualityFlag.NEAR_FLAT, QualityFlag.KNIFE_EDGE, QualityFlag.DEEP)
)

FAST = 0.025  # m/s
INERTIAL = 0.2  # m/s
_NEAR_REST = 5.0  # times rest_speed
_FLAT_SHARE = 0.1  # of the wet area
_EDGE_SHARE = 0.4  # the narrow sides of a plate that goes straight down are no reason for distrust
_DEEPER = 1.02  # times the calibrated depth: the calibration's own bag, replayed, is no deeper than the calibration
_EVERY = 8  # estimates between two looks at what takes longer


class Validity:
    """Doubts of one tool's estimates, in the order of time."""

    def __init__(self, tool: Tool) -> None:
        self._plates: Plates = tool.plates
        self._path = _Path(tool)
        self._tool = _CONCAVE if any(f.kind == "concave" for f in tool.issues) else 0
        self._countdown = 0
        self._slow = 0

    def of(
        self,
        state: NDArray[np.float64],
        *,
        speed: float,
        submerged: bool,
        depth: Callable[[], float],
        settings: Settings,
    ) -> int:
        """Flags, an or of `QualityFlag`, of an estimate at a state, shape [13]; `depth()`: of the lowest point."""
        if not submerged:
            self._path.leave()
            self._countdown = 0
            return 0
        quality_flags = 0
        if speed > FAST:
            quality_flags = _FAST if speed <= INERTIAL else _FAST | _INERTIAL
        elif speed < _NEAR_REST * settings.rest_speed:
            quality_flags = _NEAR
        if self._countdown == 0:
            self._countdown = _EVERY
            self._slow = self._slower(state, depth, settings)
        self._countdown -= 1
        return quality_flags | self._slow

    def _slower(self, state: NDArray[np.float64], depth: Callable[[], float], settings: Settings) -> int:
        """The quality_flags that take longer to tell, and to come and go."""
        quality_flags = self._tool
        if self._path.crosses(state):
            quality_flags |= _WAKE
        if settings.calibrated_depth > 0.0 and depth() > _DEEPER * settings.calibrated_depth:
            quality_flags |= _DEEP
        if self._plates.integration == "centroid":  # the refined rule has neither
            flat, edge = edge_shares(self._plates, state, surface_height=settings.surface_height)
            quality_flags |= (_FLAT if flat > _FLAT_SHARE else 0) | (_EDGE if edge > _EDGE_SHARE else 0)
        return quality_flags


class _Path:
    """Where the tool's middle has been since it entered the grains, and whether it comes back there.

    On a straight path the distance from a former place is the path since then; where it falls behind that by `_BENT`,
    and is less than two widths of the tool, grains are passed again. Flags a root tip's helix of 20 mm pitch, at which
    its forces were seen to deviate, and not one of 40 mm (Treers et al. 2021, V-B).
    """

    _KEPT = 512
    _BENT = 0.85

    def __init__(self, tool: Tool) -> None:
        low, high = tool.vertices.min(axis=0), tool.vertices.max(axis=0)
        self._middle = 0.5 * (low + high)
        self._width = float(np.median(high - low))
        self._places = np.zeros((self._KEPT, 3))
        self._lengths = np.zeros(self._KEPT)
        self.leave()

    def leave(self) -> None:
        """Forget: the tool left the grains, which fall back."""
        self._count, self._length, self._crosses = 0, 0.0, False

    def crosses(self, state: NDArray[np.float64]) -> bool:
        """Take the next state, shape [13]; whether the tool passes where it has been."""
        x, y, z, qx, qy, qz, qw = state[:7].tolist()
        a, b, c = self._middle.tolist()
        # the middle of the tool, turned by the quaternion and moved
        tx, ty, tz = 2.0 * (qy * c - qz * b), 2.0 * (qz * a - qx * c), 2.0 * (qx * b - qy * a)
        x += a + qw * tx + qy * tz - qz * ty
        y += b + qw * ty + qz * tx - qx * tz
        z += c + qw * tz + qx * ty - qy * tx
        if self._count:
            last = self._places[(self._count - 1) % self._KEPT]
            dx, dy, dz = x - last[0], y - last[1], z - last[2]
            step = (dx * dx + dy * dy + dz * dz) ** 0.5
            if step < self._width / 8.0:
                return self._crosses
            self._length += step
        i = self._count % self._KEPT
        self._places[i] = x, y, z
        self._lengths[i] = self._length
        self._count += 1
        n = min(self._count, self._KEPT)
        since = self._length - self._lengths[:n]
        apart = np.linalg.norm(self._places[:n] - self._places[i], axis=1)
        near = (since >= 2.0 * self._width) & (apart < 2.0 * self._width) & (apart < self._BENT * since)
        self._crosses = bool(near.any())
        return self._crosses
