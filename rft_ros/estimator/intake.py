"""The intake: samples that have arrived are checked, brought into the expected frames, and kept in their order."""

import math
from collections import deque
from collections.abc import Callable
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.samples import (
    ABSURD,
    TIME_JUMP,
    PoseSample,
    Reason,
    RefusedError,
    TransformSample,
    TwistSample,
    WrenchSample,
)
from rft_ros.estimator.transforms import Placement, Transforms
from rft_ros.ground import DELAY, Cloud, Ground
from rft_ros.parameters import Settings
from rft_ros.rft import rotation_matrix, unit_quaternion

__all__ = ["HISTORY", "Intake"]

HISTORY = 8192
"""Load-cell samples kept: 8 s of a 1 kHz stream. A pose older than all of them counts as without any."""

_TWISTS = 256  # a pose that waited in a queue of 200 messages still finds the twist of its own time
_CLOUD_PERIOD = 190_000_000  # ns; clouds that follow sooner are not needed

Array = NDArray[np.float64]
_Sample = TypeVar("_Sample", TwistSample, WrenchSample)


class Intake:
    """Takes samples; each method returns one that can be used, or raises `RefusedError` with the reason.

    `twists`, `wrenches`: those kept, by stamp. A stamp that goes back by `TIME_JUMP` begins a new run: `before_jump` is
    called, and then a history is cleared.
    """

    def __init__(self, settings: Settings, *, before_jump: Callable[[], None]) -> None:
        self.transforms = Transforms()
        self.twists: deque[TwistSample] = deque(maxlen=_TWISTS)
        self.wrenches: deque[WrenchSample] = deque(maxlen=HISTORY)
        self._before_jump = before_jump
        self._pose = 0  # stamp of the last one
        self._unknown: dict[Reason, str] = {}
        self.use(settings)

    def use(self, settings: Settings) -> None:
        """Take new settings; samples in the axes of a frame that changes are dropped."""
        old = getattr(self, "_settings", settings)
        if settings.sensor_frame != old.sensor_frame:
            self._before_jump()
            self.wrenches.clear()
        if (settings.world_frame, settings.tool_frame) != (old.world_frame, old.tool_frame):
            self.twists.clear()
        self._settings = settings
        self._unknown.clear()
        self.transforms.keep(settings.world_frame, settings.tool_frame)

    def begin_again(self, stamp: int) -> None:
        """Drop the samples of the run before a pose that jumped back to `stamp` [ns]."""
        for history in (self.twists, self.wrenches):
            if history and history[-1].stamp - stamp >= TIME_JUMP:
                history.clear()

    def pose(self, sample: PoseSample) -> PoseSample:
        """The pose in world axes, its quaternion of unit length."""
        stamp, world = sample.stamp, self._settings.world_frame
        if stamp <= 0:
            raise RefusedError(Reason.POSE_STAMP_ZERO)
        if not math.hypot(*sample.position, *sample.quaternion) < ABSURD:
            raise RefusedError(Reason.POSE_NOT_FINITE)
        quaternion = unit_quaternion(*sample.quaternion)
        if quaternion is None:
            raise RefusedError(Reason.POSE_QUATERNION_NOT_UNIT)
        position = sample.position
        if sample.frame != world:
            base = self._placed(Reason.POSE_FRAME_UNKNOWN, sample.frame, world)
            position, quaternion = base.of(Placement(position, quaternion))
            if not math.hypot(*position) < ABSURD:
                raise RefusedError(Reason.POSE_NOT_FINITE)
        behind = self._pose - stamp
        if 0 <= behind < TIME_JUMP:
            raise RefusedError(Reason.POSE_OUT_OF_ORDER if behind else Reason.POSE_REPEATED)
        self._pose = stamp
        return PoseSample(stamp, world, position, quaternion)

    def twist(self, sample: TwistSample) -> TwistSample:
        """The twist in the axes of the world or the tool frame."""
        world, tool = self._settings.world_frame, self._settings.tool_frame
        if sample.stamp <= 0:
            raise RefusedError(Reason.TWIST_STAMP_ZERO)
        if not math.hypot(*sample.linear, *sample.angular) < ABSURD:
            raise RefusedError(Reason.TWIST_NOT_FINITE)
        if sample.frame not in (world, tool):
            into = world if self.transforms.fixed(world, sample.frame) is not None else tool
            axes = self._placed(Reason.TWIST_FRAME_UNKNOWN, sample.frame, into)
            sample = TwistSample(sample.stamp, into, axes.rotate(sample.linear), axes.rotate(sample.angular))
        return self._kept(self.twists, sample, Reason.TWIST_OUT_OF_ORDER)

    def wrench(self, sample: WrenchSample) -> WrenchSample:
        """The load cell's reading in the sensor frame."""
        frame = self._settings.sensor_frame
        if sample.stamp <= 0:
            raise RefusedError(Reason.WRENCH_STAMP_ZERO)
        if sample.frame != frame:
            there = self._placed(Reason.WRENCH_FRAME_UNKNOWN, sample.frame, frame)
            sample = sample._replace(frame=frame, wrench=there.wrench(sample.wrench))
        if not math.hypot(*sample.wrench) < ABSURD:
            raise RefusedError(Reason.WRENCH_NOT_FINITE)
        return self._kept(self.wrenches, sample, Reason.WRENCH_OUT_OF_ORDER)

    def cloud(self, cloud: Cloud, ground: Ground) -> tuple[Array, Array] | None:
        """Position [m], shape [3], and rotation to world, shape [3, 3], of the cloud's frame; None if it is that."""
        world, since = self._settings.world_frame, cloud.stamp - ground.last_cloud
        if ground.map is None:
            raise RefusedError(Reason.SURFACE_OFF)
        if cloud.stamp <= 0:
            raise RefusedError(Reason.SURFACE_STAMP_ZERO)
        camera = None if cloud.frame == world else self._placed(Reason.SURFACE_FRAME_UNKNOWN, cloud.frame, world)
        if -TIME_JUMP < since <= 0:
            raise RefusedError(Reason.SURFACE_OUT_OF_ORDER)
        if ground.newest - cloud.stamp >= DELAY:
            raise RefusedError(Reason.SURFACE_LATE)
        if 0 < since < _CLOUD_PERIOD:
            raise RefusedError(Reason.SURFACE_RATE_LIMITED)
        return None if camera is None else (np.array(camera.position), rotation_matrix(camera.quaternion))

    def transform(self, sample: TransformSample) -> None:
        """A transform into the tree; one with another parent is taken nevertheless."""
        if (reason := self.transforms.push(sample)) is not None:
            raise RefusedError(reason)

    def unknown_frames(self) -> dict[Reason, str]:
        """By reason: a sentence on the frame that it refused last, unless transforms have linked it since."""
        s = self._settings
        world, tool, sensor = f"world_frame {s.world_frame!r}", f"tool_frame {s.tool_frame!r}", s.sensor_frame
        expected = {
            Reason.POSE_FRAME_UNKNOWN: ("pose", f"not {world}", (s.world_frame,)),
            Reason.TWIST_FRAME_UNKNOWN: ("twist", f"neither {world} nor {tool}", (s.world_frame, s.tool_frame)),
            Reason.SURFACE_FRAME_UNKNOWN: ("surface_points", f"not {world}, nor fixed in it", (s.world_frame,)),
            Reason.WRENCH_FRAME_UNKNOWN: ("wrench", f"not sensor_frame {sensor!r}", (sensor,)),
        }
        return {
            reason: f"{expected[reason][0]} frame_id {frame!r} is {expected[reason][1]}"
            for reason, frame in self._unknown.items()
            if all(self.transforms.fixed(there, frame) is None for there in expected[reason][2])
        }

    def _placed(self, reason: Reason, frame: str, into: str) -> Placement:
        placement = self.transforms.fixed(into, frame)
        if placement is None:
            self._unknown[reason] = frame
            raise RefusedError(reason)
        return placement

    def _kept(self, history: deque[_Sample], sample: _Sample, late: Reason) -> _Sample:
        behind = history[-1].stamp - sample.stamp if history else 0
        if 0 < behind < TIME_JUMP:
            raise RefusedError(late)
        if behind > 0:
            self._before_jump()
            history.clear()
        history.append(sample)
        return sample
