"""The estimator's inputs (samples) and outputs (estimates, measurements, and the reasons for having none)."""

from enum import Enum, unique
from typing import NamedTuple

from rft_ros.ground import Cloud
from rft_ros.rft.frames import Placement, Quaternion, Vector, Wrench

ABSURD = 1e100
"""Larger numbers [m, N, N m] count as not finite: their squares would overflow."""


class PoseSample(NamedTuple):
    """Pose of the tool frame in `frame`: stamp [ns], position [m], quaternion xyzw."""

    stamp: int
    frame: str
    position: Vector
    quaternion: Quaternion

    @property
    def place(self) -> Placement:
        """The placement of the tool frame in `frame`."""
        return Placement(self.position, self.quaternion)


class TwistSample(NamedTuple):
    """Velocity of the tool frame's origin [m/s] and angular velocity [rad/s]; stamp [ns].

    Both are in the axes of `frame`, which is the world or the tool frame.
    """

    stamp: int
    frame: str
    linear: Vector
    angular: Vector


class WrenchSample(NamedTuple):
    """The load cell's raw reading, from which bias and tool weight are not subtracted; stamp [ns].

    `wrench`: force [N] and torque [N m], in `frame`.
    """

    stamp: int
    frame: str
    wrench: Wrench


class TransformSample(NamedTuple):
    """Pose of the frame `child` in the frame `parent`: stamp [ns], position [m], quaternion xyzw.

    `fixed`: the transform is valid at all stamps.
    """

    stamp: int
    parent: str
    child: str
    position: Vector
    quaternion: Quaternion
    fixed: bool = False


Stamped = PoseSample | TwistSample | WrenchSample | Cloud
Sample = Stamped | tuple[TransformSample, ...]
"""A sample of any kind that an estimator takes."""


_NOT_FINITE = "NaN, infinity or an absurdly large number"
_FRAME_UNKNOWN = "the frame_id is not the expected one, and no fixed transforms link the two"
DOCTOR_ON_FRAMES = "rft doctor proposes the frames"
"""What node and replay add to a sentence on an unknown frame."""
_STAMP_ZERO = "the stamp is zero"
_OUT_OF_ORDER = (
    "the stamp is not after that of this input's last sample. A sample whose stamp is 1 s or more earlier is used:"
    " it starts a new run"
)
_MISSING = "no sample stamped at or before the pose has arrived"
_STALE = "the last sample is older than the pose by more than `max_input_age`"


@unique
class Reason(str, Enum):
    """Why a sample was not used, or a pose has no estimate or no residual. Users read the values."""

    sentence: str
    """What went wrong, in words, for the documentation."""

    def __new__(cls, value: str, sentence: str = "") -> "Reason":
        """A reason and what went wrong; ``Reason("at_rest")`` finds one by its value."""
        reason = str.__new__(cls, value)
        reason._value_ = value
        reason.sentence = sentence
        return reason

    MESSAGE_UNREADABLE = (
        "message_unreadable",
        "the bytes are not a message of the topic's type, or its stamp is not a valid time",
    )
    POSE_NOT_FINITE = "pose_not_finite", _NOT_FINITE
    POSE_QUATERNION_NOT_UNIT = (
        "pose_quaternion_not_unit",
        "the quaternion's length differs from 1 by more than 1 %",
    )
    POSE_FRAME_UNKNOWN = "pose_frame_unknown", _FRAME_UNKNOWN
    POSE_STAMP_ZERO = "pose_stamp_zero", _STAMP_ZERO
    POSE_REPEATED = "pose_repeated", "the stamp is the same as that of the last pose"
    POSE_OUT_OF_ORDER = "pose_out_of_order", _OUT_OF_ORDER
    POSE_RATE_LIMITED = (
        "pose_rate_limited",
        "the pose came sooner after the last estimate than `max_rate` allows",
    )
    POSE_HISTORY_SHORT = (
        "pose_history_short",
        "`twist_source: pose_difference` does not have enough poses yet",
    )
    TIME_JUMP = (
        "time_jump",
        "the pose's stamp is 1 s or more before the last one's; the estimator starts a new run",
    )
    TWIST_MISSING = "twist_missing", _MISSING
    TWIST_STALE = "twist_stale", _STALE
    TWIST_NOT_FINITE = "twist_not_finite", _NOT_FINITE
    TWIST_FRAME_UNKNOWN = "twist_frame_unknown", _FRAME_UNKNOWN
    TWIST_STAMP_ZERO = "twist_stamp_zero", _STAMP_ZERO
    TWIST_OUT_OF_ORDER = "twist_out_of_order", _OUT_OF_ORDER
    AT_REST = (
        "at_rest",
        "the tool is in the grains, all of its points are slower than `rest_speed`, and the law has no memory",
    )
    ESTIMATE_NOT_FINITE = "estimate_not_finite", "the computed wrench is NaN or infinite"
    WRENCH_MISSING = "wrench_missing", _MISSING
    WRENCH_STALE = "wrench_stale", _STALE
    WRENCH_NOT_FINITE = (
        "wrench_not_finite",
        "a force is NaN, infinity or an absurdly large number; torques that are none are left out",
    )
    WRENCH_FRAME_UNKNOWN = "wrench_frame_unknown", _FRAME_UNKNOWN
    WRENCH_STAMP_ZERO = "wrench_stamp_zero", _STAMP_ZERO
    WRENCH_OUT_OF_ORDER = "wrench_out_of_order", _OUT_OF_ORDER
    SENSOR_FRAME_UNKNOWN = (
        "sensor_frame_unknown",
        "with `sensor.frame_source: tf`: no fixed transforms between tool and sensor have arrived yet",
    )
    TF_INVALID = (
        "tf_invalid",
        "a transform has NaN, infinity, a quaternion whose length is not 1, no name or no stamp",
    )
    TF_OUT_OF_ORDER = "tf_out_of_order", "a transform's stamp is not after the frame's last one"
    TF_TWO_PARENTS = (
        "tf_two_parents",
        "a transform gives a frame another parent than before, or makes a moving frame fixed, or a fixed one moving."
        " The new transform is used, as in tf2",
    )
    TF_LOOP = "tf_loop", "a transform would make a frame its own ancestor"
    TF_FRAME_UNKNOWN = "tf_frame_unknown", "no transforms link `tool_frame` and `world_frame`"
    TF_MISSING = (
        "tf_missing",
        "the stamp of the pose is before the oldest transform that the node keeps; it keeps the last 1,024 of each "
        "frame",
    )
    TF_STALE = (
        "tf_stale",
        "no transform stamped after the pose has come, although other inputs are stamped 1 s later",
    )
    TF_GAP = (
        "tf_gap",
        "the transform before the pose's stamp, or the one after it, is over `max_input_age` away",
    )
    SURFACE_OFF = "surface_off", "Python code pushed a cloud, but `ground.cell` is 0"
    SURFACE_LATE = "surface_late", "a cloud's stamp is 0.5 s or more before the last pose"
    SURFACE_FRAME_UNKNOWN = "surface_frame_unknown", _FRAME_UNKNOWN
    SURFACE_STAMP_ZERO = "surface_stamp_zero", _STAMP_ZERO
    SURFACE_OUT_OF_ORDER = "surface_out_of_order", _OUT_OF_ORDER
    SURFACE_RATE_LIMITED = (
        "surface_rate_limited",
        "a cloud came less than 0.19 s after the last one",
    )

    __str__ = str.__str__


STAMP_ZERO = frozenset(reason for reason in Reason if reason.value.endswith("_stamp_zero"))
"""Reasons for samples without a stamp."""

OF_TRANSFORMS = frozenset(reason for reason in Reason if reason.value.startswith("tf_"))
"""Reasons for transforms that are refused, and for poses that transforms do not give."""


class RefusedError(Exception):
    """A sample or a pose cannot be used; only the estimator catches it, and counts the reason."""

    def __init__(self, reason: Reason) -> None:
        super().__init__(reason.value)
        self.reason = reason


class Estimate(NamedTuple):
    """The immediate answer to one pose.

    `stamp`: of the pose [ns]. `predicted`: the wrench on the tool by the grains, in sensor axes about the sensor's
    origin [N], [N m]. `sigma`: one standard deviation of each of its components. `speed_bound`: an upper bound on the
    speed of the plates [m/s]. `submerged_area`: area of the plates in the grains [m²]. `generation`: number of the
    model. `quality_flags`: a bitwise or of `quality.QualityFlag`.
    """

    stamp: int
    predicted: Wrench
    sigma: Wrench
    speed_bound: float
    submerged_area: float
    generation: int
    quality_flags: int


class NoEstimate(NamedTuple):
    """The pose with this stamp [ns] has no estimate; `reason` says why."""

    stamp: int
    reason: Reason


Answer = Estimate | NoEstimate
"""The answer to a pose."""


class Measurement(NamedTuple):
    """The load cell's reading at the stamp of an estimate [ns]; wrenches in the frame of `Estimate.predicted`.

    `compensated`: the reading minus bias and tool weight, as a wrench on the tool. `residual`: compensated minus
    predicted. Without usable load-cell samples around the stamp both are None, and `reason` says why.
    """

    stamp: int
    compensated: Wrench | None
    residual: Wrench | None
    reason: Reason | None
