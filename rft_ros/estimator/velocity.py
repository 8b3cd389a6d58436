"""Twist by differencing poses on SE(3): the slope of a line through the last poses, which tames encoder noise."""

import math

import numpy as np

from rft_ros.estimator.samples import PoseSample
from rft_ros.rft.compilation import compiled

__all__ = ["PoseDifference"]

_CAPACITY = 2048  # the longest window, 1 s, at 2 kHz
_FEWEST = 3


@compiled
def _slopes(stamps, ring, newest, window, oldest_allowed, twist):  # type: ignore[no-untyped-def]
    """Least-squares slopes over the poses of the window; rotations as vectors from the newest pose, world axes.

    `stamps`, `window`, `oldest_allowed` [ns]; a stamp is 0 where there is no pose. `ring`: rows position, quaternion
    xyzw. Writes vx..wz to `twist`; returns the number of poses used.
    """
    capacity = ring.shape[0]
    ax, ay, az, aw = -ring[newest, 3], -ring[newest, 4], -ring[newest, 5], ring[newest, 6]
    n = 0
    st = stt = 0.0
    s = np.zeros(6)
    stx = np.zeros(6)
    x = np.zeros(6)
    for back in range(capacity):
        at = (newest - back) % capacity
        row = ring[at]
        age = stamps[newest] - stamps[at]
        if stamps[at] == 0 or age > oldest_allowed or (age > window and n >= _FEWEST):
            break
        t = -1e-9 * age  # from integers: the same whenever the run began
        # rotation from the newest pose to this one: q_row * conj(q_newest), as a rotation vector
        bx, by, bz, bw = row[3], row[4], row[5], row[6]
        rx = bw * ax + bx * aw + by * az - bz * ay
        ry = bw * ay - bx * az + by * aw + bz * ax
        rz = bw * az + bx * ay - by * ax + bz * aw
        rw = bw * aw - bx * ax - by * ay - bz * az
        if rw < 0.0:
            rx, ry, rz, rw = -rx, -ry, -rz, -rw
        sine = math.sqrt(rx * rx + ry * ry + rz * rz)
        scale = 2.0 * math.atan2(sine, rw) / sine if sine > 1e-12 else 2.0
        for k in range(3):
            x[k] = row[k] - ring[newest, k]
        x[3], x[4], x[5] = rx * scale, ry * scale, rz * scale
        n += 1
        st += t
        stt += t * t
        for k in range(6):
            s[k] += x[k]
            stx[k] += t * x[k]
    spread = n * stt - st * st
    for k in range(6):
        twist[k] = (n * stx[k] - st * s[k]) / spread if spread > 0.0 else 0.0
    return n


class PoseDifference:
    """Ring of the last poses. Causal: the twist is that of the window's middle, half a window ago."""

    def __init__(self) -> None:
        self._window = 0
        self._max_age = 0
        self._stamps = np.zeros(_CAPACITY, dtype=np.int64)
        self._ring = np.zeros((_CAPACITY, 7))
        self._newest = -1
        self.twist = np.zeros(6)

    def span(self, *, window: float, max_age: float) -> None:
        """Fit the line to the poses of the last `window` [s], at least three, none older than `max_age` [s]."""
        self._window = round(1e9 * window)
        self._max_age = max(round(1e9 * max_age), self._window)

    def push(self, pose: PoseSample) -> bool:
        """Add a pose; True once `twist` (vx, vy, vz, wx, wy, wz; world axes) holds the answer for it."""
        self._newest = (self._newest + 1) % _CAPACITY
        self._stamps[self._newest] = pose.stamp
        row = self._ring[self._newest]
        row[0:3] = pose.position
        row[3:7] = pose.quaternion
        used: int = _slopes(self._stamps, self._ring, self._newest, self._window, self._max_age, self.twist)
        return used >= _FEWEST

    def reset(self) -> None:
        """Forget all poses."""
        self._stamps.fill(0)
        self._newest = -1
