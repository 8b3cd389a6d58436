"""The estimator's inputs (samples) and outputs (estimates, measurements, and the reasons for having none)."""

from collections.abc import Reversible
from enum import Enum
from typing import NamedTuple, TypeVar

from rft_ros.ground import Cloud
from rft_ros.rft.placement import Quaternion, Vector, Wrench

__all__ = ["ABSURD", "PATIENCE", "TIME_JUMP", "Estimate", "Measurement", "NoEstimate", "PoseSample", "Reason"]
__all__ += ["RefusedError", "Sample", "Stamped", "TransformSample", "TwistSample", "Vector", "Wrench", "WrenchSample"]
__all__ += ["around"]

ABSURD = 1e100
"""Larger numbers [m, N, N m] count as not finite: their squares would overflow."""

TIME_JUMP = 1_000_000_000
"""A stamp that goes back by this much [ns] or more starts a new run (a bag played in a loop)."""

PATIENCE = 1_000_000_000
"""Time [ns] of other inputs' stamps to wait for a load-cell sample or a transform: a process may stall by less."""


class PoseSample(NamedTuple):
    """Pose of the tool frame in `frame`: stamp [ns], position [m], quaternion xyzw."""

    stamp: int
    frame: str
    position: Vector
    quaternion: Quaternion


class TwistSample(NamedTuple):
    """Velocity of the tool frame's origin [m/s] and angular velocity [rad/s], in the axes of `frame`; stamp [ns]."""

    stamp: int
    frame: str
    linear: Vector
    angular: Vector


class WrenchSample(NamedTuple):
    """The load cell's raw reading, bias and tool weight included: force [N], torque [N m], in `frame`; stamp [ns]."""

    stamp: int
    frame: str
    wrench: Wrench


class TransformSample(NamedTuple):
    """Pose of the frame `child` in the frame `parent`: stamp [ns], position [m], quaternion xyzw.

    `fixed`: it holds for all stamps.
    """

    stamp: int
    parent: str
    child: str
    position: Vector
    quaternion: Quaternion
    fixed: bool = False


_Kept = TypeVar("_Kept", TwistSample, WrenchSample, TransformSample)


def around(history: Reversible[_Kept], stamp: float) -> tuple[_Kept | None, _Kept | None]:
    """The last sample at or before a stamp [ns] and the first after it, of samples in the order of their stamps."""
    after = None
    for sample in reversed(history):
        if sample.stamp <= stamp:
            return sample, after
        after = sample
    return None, after


Stamped = PoseSample | TwistSample | WrenchSample | Cloud
Sample = Stamped | tuple[TransformSample, ...]
"""What an estimator is given."""


class Reason(str, Enum):
    """Why a sample was not used, or a pose has no estimate or no residual. Users read the values."""

    MESSAGE_UNREADABLE = "message_unreadable"
    POSE_NOT_FINITE = "pose_not_finite"
    POSE_QUATERNION_NOT_UNIT = "pose_quaternion_not_unit"
    POSE_FRAME_UNKNOWN = "pose_frame_unknown"
    POSE_STAMP_ZERO = "pose_stamp_zero"
    POSE_REPEATED = "pose_repeated"
    POSE_OUT_OF_ORDER = "pose_out_of_order"
    POSE_RATE_LIMITED = "pose_rate_limited"
    POSE_HISTORY_SHORT = "pose_history_short"
    TIME_JUMP = "time_jump"
    TWIST_MISSING = "twist_missing"
    TWIST_STALE = "twist_stale"
    TWIST_NOT_FINITE = "twist_not_finite"
    TWIST_FRAME_UNKNOWN = "twist_frame_unknown"
    TWIST_STAMP_ZERO = "twist_stamp_zero"
    TWIST_OUT_OF_ORDER = "twist_out_of_order"
    AT_REST = "at_rest"
    ESTIMATE_NOT_FINITE = "estimate_not_finite"
    WRENCH_MISSING = "wrench_missing"
    WRENCH_STALE = "wrench_stale"
    WRENCH_NOT_FINITE = "wrench_not_finite"
    WRENCH_FRAME_UNKNOWN = "wrench_frame_unknown"
    WRENCH_STAMP_ZERO = "wrench_stamp_zero"
    WRENCH_OUT_OF_ORDER = "wrench_out_of_order"
    SENSOR_FRAME_UNKNOWN = "sensor_frame_unknown"
    TF_INVALID = "tf_invalid"
    TF_OUT_OF_ORDER = "tf_out_of_order"
    TF_TWO_PARENTS = "tf_two_parents"
    TF_LOOP = "tf_loop"
    TF_FRAME_UNKNOWN = "tf_frame_unknown"
    TF_MISSING = "tf_missing"
    TF_STALE = "tf_stale"
    TF_GAP = "tf_gap"
    SURFACE_OFF = "surface_off"
    SURFACE_LATE = "surface_late"
    SURFACE_FRAME_UNKNOWN = "surface_frame_unknown"
    SURFACE_STAMP_ZERO = "surface_stamp_zero"
    SURFACE_OUT_OF_ORDER = "surface_out_of_order"
    SURFACE_RATE_LIMITED = "surface_rate_limited"

    __str__ = str.__str__


class RefusedError(Exception):
    """A sample or a pose cannot be used; only the estimator catches it, and counts the reason."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(reason.value)
        self.reason = reason


class Estimate(NamedTuple):
    """The immediate answer to one pose.

    `stamp`: the pose's [ns]. `predicted`: the RFT wrench on the tool by the grains, in sensor axes about the sensor's
    origin. `sigma`: one standard deviation of each of its components, same axes. `speed`: an upper bound on the
    plates' speeds [m/s]. `submerged_area` [m²]. `generation`: the model's.
    `quality_flags`: a bitwise or of `quality.QualityFlag`.
    """

    stamp: int
    predicted: Wrench
    sigma: Wrench
    speed: float
    submerged_area: float
    generation: int
    quality_flags: int


class NoEstimate(NamedTuple):
    """The pose with this stamp [ns] has no estimate; `reason` says why."""

    stamp: int
    reason: Reason


class Measurement(NamedTuple):
    """What the load cell says at the stamp of an estimate [ns]; wrenches in the frame of `Estimate.predicted`.

    `compensated`: measured minus bias and tool weight. `residual`: compensated - predicted. Without usable load-cell
    samples around the stamp both are None and `reason` says why.
    """

    stamp: int
    compensated: Wrench | None
    residual: Wrench | None
    reason: Reason | None
