"""The load cell: its frame, its tare, and how its samples are compared with the predictions."""

from collections import Counter, deque
from itertools import islice
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.estimator.samples import Measurement, Reason, Wrench, WrenchSample
from rft_ros.estimator.settings import LoadCell
from rft_ros.rft.compilation import compiled
from rft_ros.rft.frames import rotation

__all__ = ["GRAVITY", "HISTORY", "Comparison", "LoadCellFrame", "Tare"]

GRAVITY = 9.80665
"""Standard gravity [m/s²] (ISO 80000-3)."""

HISTORY = 8192
"""Load-cell samples kept: 8 s of a 1 kHz stream for the tare."""

_LOOK_BACK = 1024
_MOST_PENDING = 4096
_FEWEST_FOR_TARE = 10


@compiled
def _into_sensor(mount, quaternion, world_wrench, out):  # type: ignore[no-untyped-def]
    """Wrench in world axes about the tool frame's origin into sensor axes about the sensor's origin; and the weight.

    `mount`: position (3), quaternion (4) of the sensor in the tool frame, weight [N], centre of mass (3).
    `out`: 12 numbers, the wrench and then the weight's wrench, both in the sensor frame.
    """
    a = rotation(quaternion[0], quaternion[1], quaternion[2], quaternion[3])
    b = rotation(mount[3], mount[4], mount[5], mount[6])
    fx, fy, fz, tx, ty, tz = world_wrench[:6]
    # into tool axes, then about the sensor's origin: torque - position x force
    gx, gy, gz = a[0] * fx + a[3] * fy + a[6] * fz, a[1] * fx + a[4] * fy + a[7] * fz, a[2] * fx + a[5] * fy + a[8] * fz
    ux, uy, uz = a[0] * tx + a[3] * ty + a[6] * tz, a[1] * tx + a[4] * ty + a[7] * tz, a[2] * tx + a[5] * ty + a[8] * tz
    px, py, pz = mount[0], mount[1], mount[2]
    ux, uy, uz = ux - (py * gz - pz * gy), uy - (pz * gx - px * gz), uz - (px * gy - py * gx)
    out[0], out[1], out[2] = (
        b[0] * gx + b[3] * gy + b[6] * gz,
        b[1] * gx + b[4] * gy + b[7] * gz,
        b[2] * gx + b[5] * gy + b[8] * gz,
    )
    out[3], out[4], out[5] = (
        b[0] * ux + b[3] * uy + b[6] * uz,
        b[1] * ux + b[4] * uy + b[7] * uz,
        b[2] * ux + b[5] * uy + b[8] * uz,
    )
    # weight: -E3 in tool axes is minus the third row of the tool's rotation
    w = mount[7]
    gx, gy, gz = -w * a[6], -w * a[7], -w * a[8]
    wx, wy, wz = b[0] * gx + b[3] * gy + b[6] * gz, b[1] * gx + b[4] * gy + b[7] * gz, b[2] * gx + b[5] * gy + b[8] * gz
    cx, cy, cz = mount[8], mount[9], mount[10]
    out[6], out[7], out[8] = wx, wy, wz
    out[9], out[10], out[11] = cy * wz - cz * wy, cz * wx - cx * wz, cx * wy - cy * wx


class LoadCellFrame:
    """A load cell's mounting and tool weight, prepared once."""

    def __init__(self, cell: LoadCell) -> None:
        self.sign = cell.sign
        self.bias = cell.bias
        self._mount = np.array([*cell.position, *cell.quaternion, cell.mass * GRAVITY, *cell.center_of_mass])
        self._out = np.zeros(12)

    def into_sensor(self, quaternion: NDArray[np.float64], world_wrench: NDArray[np.float64]) -> list[float]:
        """Twelve numbers in the sensor frame: the wrench (given in world axes, about the tool) and the weight's."""
        _into_sensor(self._mount, quaternion, world_wrench, self._out)
        return self._out.tolist()


class _Pending(NamedTuple):
    """An estimate that waits for load-cell samples: `numbers` as from `LoadCellFrame.into_sensor`."""

    stamp: int
    numbers: list[float]
    frame: LoadCellFrame


class Comparison:
    """Compare each prediction with the load cell at its stamp, once the samples around it have come.

    The reading is interpolated linearly between the samples on both sides of the stamp, each within `max_age` [ns].
    Without a sample after the stamp, the last one before it counts. `samples`: the load cell's, in the order of their
    stamps; `counts` gets the reasons.
    """

    def __init__(self, samples: deque[WrenchSample], counts: "Counter[str]") -> None:
        self._samples = samples
        self._counts = counts
        self._pending: deque[_Pending] = deque()
        self._final: list[Measurement] = []
        self.max_age = 0

    def add(self, stamp: int, numbers: list[float], frame: LoadCellFrame) -> None:
        """Add an estimate: its stamp [ns], and the prediction and the weight in the sensor frame, 12 numbers."""
        if len(self._pending) >= _MOST_PENDING:
            self._final.append(self._measured(self._pending.popleft()))
        self._pending.append(_Pending(stamp, numbers, frame))
        self.settle(stamp)

    def settle(self, now: float) -> None:
        """Compare what can be compared; `now` [ns]: the stamp of the sample of any kind that has just come."""
        newest = self._samples[-1].stamp if self._samples else 0
        pending = self._pending
        while pending and (pending[0].stamp <= newest or now > pending[0].stamp + self.max_age):
            self._final.append(self._measured(pending.popleft()))

    def take(self) -> list[Measurement]:
        """The measurements that became final since the last call, in the order of the estimates."""
        final = self._final
        if final:
            self._final = []
        return final

    def _measured(self, pending: _Pending) -> Measurement:
        stamp, numbers, frame = pending
        before = after = None
        for sample in islice(reversed(self._samples), _LOOK_BACK):
            if sample.stamp <= stamp:
                before = sample
                break
            after = sample
        if before is None or stamp - before.stamp > self.max_age:
            reason = Reason.WRENCH_MISSING if before is None else Reason.WRENCH_STALE
            self._counts[reason.value] += 1
            return Measurement(stamp, None, None, reason)
        m: Wrench = before.wrench
        if before.stamp < stamp and after is not None and after.stamp - stamp <= self.max_age:
            share, n = (stamp - before.stamp) / (after.stamp - before.stamp), after.wrench
            m = (
                m[0] + share * (n[0] - m[0]),
                m[1] + share * (n[1] - m[1]),
                m[2] + share * (n[2] - m[2]),
                m[3] + share * (n[3] - m[3]),
                m[4] + share * (n[4] - m[4]),
                m[5] + share * (n[5] - m[5]),
            )
        s, b, p = frame.sign, frame.bias, numbers  # p: the prediction, then the weight
        compensated = c = (
            s * (m[0] - b[0]) - p[6],
            s * (m[1] - b[1]) - p[7],
            s * (m[2] - b[2]) - p[8],
            s * (m[3] - b[3]) - p[9],
            s * (m[4] - b[4]) - p[10],
            s * (m[5] - b[5]) - p[11],
        )
        residual = (c[0] - p[0], c[1] - p[1], c[2] - p[2], c[3] - p[3], c[4] - p[4], c[5] - p[5])
        return Measurement(stamp, compensated, residual, None)


class Tare:
    """When the tool was last seen moving, in the grains, or without a known velocity: a tare is wrong then."""

    def __init__(self) -> None:
        self._seen = False
        self._still = 0
        self._disturbed = 0
        self._disturbance = ""

    def disturb(self, stamp: int, what: str) -> None:
        """Note that at `stamp` [ns] a tare would be wrong, and why."""
        self._seen, self._disturbed, self._disturbance = True, stamp, what

    def still(self, stamp: int) -> None:
        """Note that at `stamp` [ns] the tool hung still in the air."""
        self._seen, self._still = True, stamp
        if stamp < self._disturbed:  # time jump
            self._disturbed = 0

    def mean(self, samples: deque[WrenchSample], window: float) -> Wrench:
        """Mean of the raw samples over the last `window` [s]; InputError says why a tare would be wrong now."""
        if not self._seen:
            raise InputError("tare refused: no pose with a known velocity has come yet")
        newest = samples[-1].stamp if samples else self._disturbed
        start = newest - round(window * 1e9)
        if self._disturbed > start:
            raise InputError(f"tare refused: within the last {window:g} s {self._disturbance}")
        if self._still <= start:
            raise InputError(f"tare refused: within the last {window:g} s no pose has shown the tool at rest")
        used = [s.wrench for s in samples if s.stamp > start]
        if len(used) < _FEWEST_FOR_TARE:
            raise InputError(
                f"tare refused: {len(used)} load-cell samples in the last {window:g} s; it needs {_FEWEST_FOR_TARE}"
            )
        n = len(used)
        fx, fy, fz, tx, ty, tz = (sum(column) / n for column in zip(*used, strict=True))
        return fx, fy, fz, tx, ty, tz
