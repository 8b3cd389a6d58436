"""The estimator: stamped samples in; at each pose, an estimate or a named reason. It reads no clock and no ROS."""

import math
from collections import Counter, deque
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.load_cell import LoadCellFrame
from rft_ros.estimator.pose_difference import PoseDifference
from rft_ros.estimator.samples import Estimate, NoEstimate, PoseSample, Reason, TwistSample, Wrench, WrenchSample
from rft_ros.estimator.settings import Model, Settings
from rft_ros.estimator.tare import Tare
from rft_ros.estimator.validity import Validity
from rft_ros.rft import COLUMNS, STATE, Memory, rotation_matrix, unit_quaternion, wrenches, wrenches_in_time

__all__ = ["TIME_JUMP", "Estimator"]

TIME_JUMP = 1_000_000_000
"""A stamp this far [ns] before the last one of its stream is a new beginning (a bag that loops), not a late sample."""


_ABSURD = 1e100
"""Forces [N] and torques [N m] from here on are not finite in effect: their squares overflow in any statistics."""

_HISTORY = 256
"""Twists and wrenches kept, so that a pose that waited in a queue of 200 is answered from those of its own time."""

_Sample = TypeVar("_Sample", TwistSample, WrenchSample)


def _at(history: "deque[_Sample]", stamp: int) -> _Sample | None:
    """The last sample stamped before or at `stamp`; the first one after it, if there is none; None without samples."""
    for sample in reversed(history):
        if sample.stamp <= stamp:
            return sample
    return history[0] if history else None


class Estimator:
    """Predicted, compensated and residual wrench from poses, twists and load-cell samples, in the order they come.

    A pose is answered from the twist and the wrench whose stamps come last before or at its own, of those pushed so far
    (the next one after it, if there is none); `max_input_age` bounds how far the stamps may lie apart. `counts` adds up
    estimates, and samples turned away or unanswered by reason.
    """

    def __init__(self, settings: Settings, model: Model) -> None:
        self.counts: Counter[str] = Counter()
        self._unknown_frames: dict[Reason, str] = {}
        self._state = np.zeros((1, len(STATE)))
        self._result = np.zeros((1, len(COLUMNS)))
        self._pose: PoseSample | None = None
        self._twists: deque[TwistSample] = deque(maxlen=_HISTORY)
        self._wrenches: deque[WrenchSample] = deque(maxlen=_HISTORY)
        self._difference = PoseDifference()
        self._tare = Tare()
        self._memory: Memory | None = None
        self._remembered = 0  # stamp up to which the memory is
        self._duration = np.zeros(1)
        self._validity = Validity(model.tool)
        self.model = model
        self._remember(model)
        self.settings = settings
        self._apply(settings)

    @property
    def state(self) -> NDArray[np.float64]:
        """State of the last answered pose, shape [13], columns `rft_ros.rft.STATE`; overwritten by the next."""
        row: NDArray[np.float64] = self._state[0]
        return row

    def depth(self) -> float:
        """Depth of the lowest point below the surface at the last pose [m]: negative above it, NaN before any."""
        if self._pose is None:
            return math.nan
        lowest = self._pose.position[2] + self.model.tool.lowest_point(rotation_matrix(self._pose.quaternion))
        return self.settings.surface_height - lowest

    def unknown_frames(self) -> dict[str, str]:
        """By reason: the last frame_id that was turned away under the settings in force, and why, in a sentence."""
        return {str(r): self.settings.frame_sentence(r, frame) for r, frame in self._unknown_frames.items()}

    def counted(self) -> list[str]:
        """What `counts` has, in words: ``pose_stamp_zero: 3``; beside an unknown frame, what it is."""
        frames = self.unknown_frames()
        return [f"{r}: {n} ({frames[r]})" if r in frames else f"{r}: {n}" for r, n in sorted(self.counts.items())]

    def use(self, *, settings: Settings | None = None, model: Model | None = None) -> None:
        """Take new settings or a new model from the next sample on; what was pushed before is kept."""
        if model is not None:
            if model.tool is not self.model.tool:
                self._validity = Validity(model.tool)
            if model.tool is not self.model.tool or (model.mobilization_length > 0.0) != (self._memory is not None):
                self._remember(model)
            self.model = model
        if settings is not None:
            self.settings = settings
            self._apply(settings)

    def _apply(self, settings: Settings) -> None:
        self._unknown_frames.clear()
        self._frame = LoadCellFrame(settings.load_cell)
        self._max_age = round(settings.max_input_age * 1e9)
        self._period = round(1e9 / settings.max_rate) if settings.max_rate > 0.0 else 0
        self._due = 0
        self._difference.span(window=settings.twist_window, max_age=settings.max_input_age)

    def _remember(self, model: Model) -> None:
        """Begin a memory for a model's tool, if its medium has one."""
        self._memory = Memory.of(model.tool.plates) if model.mobilization_length > 0.0 else None
        self._remembered = 0

    def push_twist(self, sample: TwistSample) -> Reason | None:
        """Take a twist; the reason if it cannot be used."""
        reason = None
        if sample.stamp <= 0:
            reason = Reason.TWIST_STAMP_ZERO
        elif not math.isfinite(sum(sample.linear) + sum(sample.angular)):
            reason = Reason.TWIST_NOT_FINITE
        elif sample.frame != self.settings.world_frame and sample.frame != self.settings.tool_frame:
            reason = Reason.TWIST_FRAME_UNKNOWN
            self._unknown_frames[reason] = sample.frame
        return self._taken(self._twists, sample, reason, Reason.TWIST_OUT_OF_ORDER)

    def push_wrench(self, sample: WrenchSample) -> Reason | None:
        """Take a load-cell sample; the reason if it cannot be used."""
        reason = None
        if sample.stamp <= 0:
            reason = Reason.WRENCH_STAMP_ZERO
        elif not math.hypot(*sample.wrench) < _ABSURD:
            reason = Reason.WRENCH_NOT_FINITE
        elif sample.frame != self.settings.sensor_frame:
            reason = Reason.WRENCH_FRAME_UNKNOWN
            self._unknown_frames[reason] = sample.frame
        reason = self._taken(self._wrenches, sample, reason, Reason.WRENCH_OUT_OF_ORDER)
        if reason is None:
            self._tare.push(sample)
        return reason

    def _taken(self, history: deque[_Sample], sample: _Sample, unusable: Reason | None, late: Reason) -> Reason | None:
        """Add a sample to the history of its kind; count and return the reason if it is unusable or late."""
        behind = history[-1].stamp - sample.stamp if history else 0
        if unusable is None and 0 < behind < TIME_JUMP:
            unusable = late
        if unusable is not None:
            self.counts[unusable.value] += 1
            return unusable
        if behind > 0:
            history.clear()
        history.append(sample)
        return None

    def push_pose(self, sample: PoseSample) -> Estimate | NoEstimate:
        """Answer a pose: an estimate, or the reason why there is none."""
        answer = self._answer(sample)
        if isinstance(answer, Reason):
            self.counts[answer.value] += 1
            return NoEstimate(sample.stamp, answer)
        self.counts["estimates"] += 1
        if answer.no_wrench is not None:
            self.counts[answer.no_wrench.value] += 1
        return answer

    def _answer(self, sample: PoseSample) -> Estimate | Reason:
        settings, model = self.settings, self.model
        stamp = sample.stamp
        if stamp <= 0:
            return Reason.POSE_STAMP_ZERO
        if not math.isfinite(sum(sample.position) + sum(sample.quaternion)):
            return Reason.POSE_NOT_FINITE
        quaternion = unit_quaternion(*sample.quaternion)
        if quaternion is None:
            return Reason.POSE_QUATERNION_NOT_UNIT
        if sample.frame != settings.world_frame:
            self._unknown_frames[Reason.POSE_FRAME_UNKNOWN] = sample.frame
            return Reason.POSE_FRAME_UNKNOWN
        if self._pose is not None and stamp <= self._pose.stamp:
            if stamp == self._pose.stamp:
                return Reason.POSE_REPEATED
            if self._pose.stamp - stamp < TIME_JUMP:
                return Reason.POSE_OUT_OF_ORDER
            self._pose, self._due = None, 0
            self._difference.reset()
            self._remember(model)
            self.counts[Reason.TIME_JUMP.value] += 1
        pose = self._pose = PoseSample(stamp, sample.frame, sample.position, quaternion)

        state = self._state[0]
        state[0:3] = pose.position
        state[3:7] = quaternion
        twist = self._twist_into_state(pose)
        # a little slack, so that a 125 Hz stream with jittering stamps passes a limit of 125 Hz
        if stamp + self._period // 10 < self._due:
            return Reason.POSE_RATE_LIMITED
        if twist is not None:
            self._tare.disturb(stamp, f"the tool's velocity was not known ({twist.value})")
            return twist
        self._due = max(self._due, stamp) + self._period

        vx, vy, vz, wx, wy, wz = state[7:13].tolist()
        speed = math.hypot(vx, vy, vz) + math.hypot(wx, wy, wz) * model.tool.plates.reach
        if self._memory is None:
            wrenches(
                model.tool.plates,
                model.law,
                self._state,
                surface_height=settings.surface_height,
                threads=1,
                out=self._result,
            )
        else:
            if speed < settings.rest_speed:  # the noise of a tool at rest must not make a path
                state[7:13] = 0.0
            self._duration[0] = (stamp - self._remembered) * 1e-9 if self._remembered > 0 else 0.0
            self._remembered = stamp
            wrenches_in_time(
                model.tool.plates,
                model.law,
                self._state,
                self._duration,
                self._memory,
                mobilization_length=model.mobilization_length,
                surface_height=settings.surface_height,
                out=self._result,
            )
        submerged = float(self._result[0, 6])
        if submerged > 0.0:
            self._tare.disturb(stamp, "the tool was in the grains")
            if speed < settings.rest_speed and self._memory is None:
                return Reason.AT_REST
        elif speed >= settings.rest_speed:
            self._tare.disturb(stamp, f"the tool moved at {speed:.4f} m/s")
        else:
            self._tare.still(stamp)

        quality_flags = self._validity.of(
            state, speed=speed, submerged=submerged > 0.0, depth=self.depth, settings=settings
        )
        numbers = self._frame.into_sensor(state[3:7], self._result[0])
        if not math.hypot(*numbers) < _ABSURD:
            return Reason.ESTIMATE_NOT_FINITE
        predicted = (numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5])
        wrench = _at(self._wrenches, stamp)
        no_wrench = None
        compensated: Wrench | None = None
        residual: Wrench | None = None
        if wrench is None:
            no_wrench = Reason.WRENCH_MISSING
        elif not -self._max_age <= stamp - wrench.stamp <= self._max_age:
            no_wrench = Reason.WRENCH_STALE
        else:
            s, b, m, w = self._frame.sign, self._frame.bias, wrench.wrench, numbers
            compensated = (
                s * (m[0] - b[0]) - w[6],
                s * (m[1] - b[1]) - w[7],
                s * (m[2] - b[2]) - w[8],
                s * (m[3] - b[3]) - w[9],
                s * (m[4] - b[4]) - w[10],
                s * (m[5] - b[5]) - w[11],
            )
            c, p = compensated, predicted
            residual = (c[0] - p[0], c[1] - p[1], c[2] - p[2], c[3] - p[3], c[4] - p[4], c[5] - p[5])
        return Estimate(
            stamp, predicted, compensated, residual, no_wrench, speed, submerged, model.generation, quality_flags
        )

    def tare(self, window: float) -> Wrench:
        """The bias that makes the mean compensated wrench of the last `window` [s] zero: raw sign, [N], [N m].

        Nothing is changed: give it back through `use` as the load cell's `bias`. InputError says why it is refused: the
        tool moved or was in the grains, its velocity is not known, or there are too few load-cell samples.
        """
        mean = self._tare.mean(window)
        sign, weight = self._frame.sign, self._frame.into_sensor(self._state[0, 3:7], self._result[0])[6:12]
        fx, fy, fz, tx, ty, tz = (m - sign * w for m, w in zip(mean, weight, strict=True))
        return fx, fy, fz, tx, ty, tz

    def _twist_into_state(self, pose: PoseSample) -> Reason | None:
        """Write the tool's velocity in world axes into the state, or say why there is none."""
        state = self._state[0]
        if self.settings.twist_source == "pose_difference":
            ready = self._difference.push(pose)
            state[7:13] = self._difference.twist
            return None if ready else Reason.POSE_HISTORY_SHORT
        twist = _at(self._twists, pose.stamp)
        if twist is None:
            return Reason.TWIST_MISSING
        if not -self._max_age <= pose.stamp - twist.stamp <= self._max_age:
            return Reason.TWIST_STALE
        state[7:10] = twist.linear
        state[10:13] = twist.angular
        if twist.frame == self.settings.tool_frame:
            to_world = rotation_matrix(pose.quaternion)
            state[7:10] = to_world @ state[7:10]
            state[10:13] = to_world @ state[10:13]
        return None
