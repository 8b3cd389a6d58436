"""The intake: checks each sample that arrives, transforms it to the expected frame, and keeps it by its stamp."""

import math
from collections import Counter, deque

from rft_ros.estimator import samples
from rft_ros.estimator.comparison import Comparison
from rft_ros.estimator.lifetimes import Lifetimes
from rft_ros.estimator.load_cell import LoadCellFrame
from rft_ros.estimator.samples import (
    ABSURD,
    PoseSample,
    Reason,
    RefusedError,
    TransformSample,
    TwistSample,
    WrenchSample,
)
from rft_ros.estimator.timeline import (
    LATE,
    NEW_RUN,
    NEXT,
    PATIENCE_NS,
    REPEATED,
    S,
    Succession,
    Timeline,
    succession,
)
from rft_ros.estimator.transforms import Transforms
from rft_ros.ground import CLOUD_DELAY_NS, Cloud
from rft_ros.parameters import Config
from rft_ros.rft import AXES, FORCE, unit_quaternion
from rft_ros.rft.frames import Placement, Wrench

# ns; a cloud that follows another one sooner is dropped: 5 Hz are enough
_CLOUD_PERIOD_NS = 190_000_000
_MAX_WANTED_COUNT = 4096  # stamps that wait for transforms

_LINK = "set the parameter to an existing frame, or publish the transform between the two on /tf_static"
_CORRECT = "stop or correct one of its publishers"
_UNKNOWN = {
    Reason.POSE_FRAME_UNKNOWN: "pose frame_id {!r} is not world_frame {!r}",
    Reason.TWIST_FRAME_UNKNOWN: "twist frame_id {!r} is neither world_frame {!r} nor tool_frame {!r}",
    Reason.SURFACE_FRAME_UNKNOWN: "surface_points frame_id {!r} is not world_frame {!r}, nor fixed in it",
    Reason.WRENCH_FRAME_UNKNOWN: "wrench frame_id {!r} is not sensor_frame {!r}, nor fixed to it or world_frame {!r}",
}


class Intake:
    """Checks samples, and keeps them. Raises `RefusedError` with the reason for one that cannot be used.

    The first sample of a new run (`Succession`) drops the earlier ones of its input. With `pose_source` tf, `counts`
    counts the reasons for which transforms give no pose. `load_cell_frame`: None until transforms give the sensor's
    place.
    """

    def __init__(self, config: Config, counts: Counter[Reason], comparison: Comparison) -> None:
        self.transforms = Transforms()
        self._counts = counts
        self._comparison = comparison
        self.pose_stamp = 0
        """Of the last pose that was accepted [ns]."""
        self._wanted: deque[int] = deque()  # stamps whose poses wait for transforms
        self._scheduled = 0  # stamp up to which poses were scheduled
        # the frame refused last, and those expected
        self._unknown: dict[Reason, tuple[str, ...]] = {}
        self.use(config)

    def use(self, config: Config) -> None:
        """Apply a new config to the samples that come."""
        self._frames = config.frames
        self._sensor = config.sensor
        self._inputs = config.inputs
        self._delay = round(1e9 * config.sensor.delay)
        self._unknown.clear()
        self.unknown_axes: list[str] = []
        """The axes on which the load cell's last reading has no number."""
        self.transforms.keep(config.frames.world, config.frames.tool)
        self._place_sensor()

    def _place_sensor(self) -> None:
        """Find the sensor in the world and on the tool. With `sensor.frame_source` tf, transforms give its place."""
        frames = self._frames
        self.sensor_is_in_world = (
            frames.sensor == frames.world
            or self.transforms.fixed(frames.world, frames.sensor) is not None
        )
        """Whether `sensor_frame` is the world frame, or fixed in it, and so does not turn with the tool."""
        self.load_cell = self._sensor
        self.load_cell_frame: LoadCellFrame | None = None
        if frames.sensor_source == "tf":
            on_tool = self.transforms.fixed(frames.tool, frames.sensor)
            if on_tool is None:
                return
            self.load_cell = self._sensor.at(on_tool)
        self.load_cell_frame = LoadCellFrame(self.load_cell)

    @property
    def readings_are_in_world(self) -> bool:
        """Whether readings are kept in world axes: the sensor does not turn with the tool, or the config says so."""
        return self.sensor_is_in_world or self._frames.sensor_source == "world"

    # --- samples

    def pose(self, sample: PoseSample) -> tuple[PoseSample, Succession]:
        """The pose in world axes, its quaternion of unit length, and whether it is the next one or begins a new run."""
        stamp = sample.stamp
        world = self._frames.world
        _, base = self._linked("pose", sample.stamp, sample.frame, world)
        position = sample.position
        quaternion = unit_quaternion(*sample.quaternion)
        if base is not None and quaternion is not None:
            position, quaternion = base.of(Placement(position, quaternion))
        if not math.hypot(*position, *sample.quaternion) < ABSURD:
            raise RefusedError(Reason.POSE_NOT_FINITE)
        if quaternion is None:
            raise RefusedError(Reason.POSE_QUATERNION_NOT_UNIT)
        follows = succession(stamp, after=self.pose_stamp)
        if follows is REPEATED:
            raise RefusedError(Reason.POSE_REPEATED)
        if follows is LATE:
            raise RefusedError(Reason.POSE_OUT_OF_ORDER)
        self.pose_stamp = stamp
        return PoseSample(stamp, world, position, quaternion), follows

    def add(
        self, sample: TwistSample | WrenchSample | Cloud | TransformSample, lifetimes: Lifetimes
    ) -> None:
        """Keep a sample that is no pose."""
        if isinstance(sample, TwistSample):
            self._add_twist(sample, lifetimes)
        elif isinstance(sample, WrenchSample):
            self._add_wrench(sample, lifetimes)
        elif isinstance(sample, Cloud):
            self._add_cloud(sample, lifetimes)
        else:
            reason = self.transforms.push(sample)
            if sample.fixed:
                self._place_sensor()
            if reason is not None:  # also TF_TWO_PARENTS, although that transform is used
                raise RefusedError(reason)

    def _add_twist(self, sample: TwistSample, lifetimes: Lifetimes) -> None:
        """Keep a twist, in the axes of the world or the tool frame."""
        if self._inputs.twist_source != "topic":
            return  # a replay does not read this topic either, so that both give the same result
        frames = self._frames
        target, axes = self._linked("twist", sample.stamp, sample.frame, frames.world, frames.tool)
        if not math.hypot(*sample.linear, *sample.angular) < ABSURD:
            raise RefusedError(Reason.TWIST_NOT_FINITE)
        if axes is not None:
            sample = TwistSample(
                sample.stamp, target, axes.rotate(sample.linear), axes.rotate(sample.angular)
            )
        self._keep(sample, lifetimes.twists, lifetimes, late=Reason.TWIST_OUT_OF_ORDER)

    def _add_wrench(self, sample: WrenchSample, lifetimes: Lifetimes) -> None:
        """Keep a reading of the load cell at the stamp of its event, in the axes of the sensor or the world frame."""
        sensor = self._frames.sensor
        world = self._frames.world
        stamp = sample.stamp - self._delay
        target, there = self._linked("wrench", stamp, sample.frame, sensor, world)
        if self.sensor_is_in_world:
            target = world
            there = self.transforms.fixed(world, sample.frame)
        in_world = self.readings_are_in_world or target == world
        wrench = self._with_known_axes(sample.wrench)
        if there is not None:
            if in_world:  # the torque is about the sensor's origin, not that of its frame
                there = there._replace(position=(0.0, 0.0, 0.0))
            wrench = there.wrench(wrench)
        reading = WrenchSample(stamp, world if in_world else sensor, wrench)
        # of several with one stamp the first one is kept, also if a pose came between them
        self._keep(reading, lifetimes.readings.samples, lifetimes, late=Reason.WRENCH_OUT_OF_ORDER)

    def _with_known_axes(self, wrench: Wrench) -> Wrench:
        """The wrench, with NaN for a torque that is no number. Raises `RefusedError` if a force is none."""
        if math.hypot(*wrench) < ABSURD:
            self.unknown_axes = []
            return wrench
        is_number = [abs(value) < ABSURD / 3.0 for value in wrench]  # of six, one is larger
        self.unknown_axes = [
            axis for axis, known in zip(AXES, is_number, strict=True) if not known
        ]
        if not all(is_number[FORCE]):
            raise RefusedError(Reason.WRENCH_NOT_FINITE)
        fx, fy, fz, tx, ty, tz = (
            value if known else math.nan for value, known in zip(wrench, is_number, strict=True)
        )
        return fx, fy, fz, tx, ty, tz

    def _keep(
        self, sample: S, timeline: Timeline[S], lifetimes: Lifetimes, *, late: Reason
    ) -> None:
        """Keep a sample if it is not late, and compare the predictions that have waited for it."""
        follows = timeline.follows(sample.stamp)
        if follows in (REPEATED, LATE):
            raise RefusedError(late)
        if follows is NEW_RUN:  # the predictions belong to the run before
            self._comparison.settle(math.inf, lifetimes)
            timeline.clear()
        timeline.append(sample)
        self._comparison.settle(sample.stamp, lifetimes)

    def _add_cloud(self, cloud: Cloud, lifetimes: Lifetimes) -> None:
        """Pass points of the ground to the mapper, with their frame's placement in the world if that is another one."""
        mapper = lifetimes.ground.mapper
        if mapper is None:
            raise RefusedError(Reason.SURFACE_OFF)
        _, camera = self._linked("surface", cloud.stamp, cloud.frame, self._frames.world)
        follows = succession(cloud.stamp, after=mapper.cloud_stamp)
        if follows in (REPEATED, LATE):
            raise RefusedError(Reason.SURFACE_OUT_OF_ORDER)
        if mapper.pose_stamp - cloud.stamp >= CLOUD_DELAY_NS:
            raise RefusedError(Reason.SURFACE_LATE)
        if follows is NEXT and cloud.stamp - mapper.cloud_stamp < _CLOUD_PERIOD_NS:
            raise RefusedError(Reason.SURFACE_RATE_LIMITED)
        mapper.add(cloud, camera)

    def _linked(
        self, role: str, stamp: int, frame: str, *expected_frames: str
    ) -> tuple[str, Placement | None]:
        """The first of the expected frames to which fixed transforms link a frame, and the frame's placement there.

        The placement is None if the frame is an expected one. Raises `RefusedError` if none is linked. `role`: as the
        names of the reasons begin.
        """
        if stamp <= 0:
            raise RefusedError(Reason(f"{role}_stamp_zero"))
        if frame in expected_frames:
            return frame, None
        for target in expected_frames:
            if (placement := self.transforms.fixed(target, frame)) is not None:
                return target, placement
        reason = Reason(f"{role}_frame_unknown")
        self._unknown[reason] = frame, *expected_frames
        raise RefusedError(reason)

    def unknown_frames(self) -> dict[Reason, str]:
        """For each reason the frame refused last under this config, unless it is linked now, and what to do."""
        frames = self._frames
        tree = self.transforms
        faults = dict[Reason, str]()
        for reason, (frame, *expected_frames) in self._unknown.items():
            if all(tree.fixed(target, frame) is None for target in expected_frames):
                faults[reason] = _UNKNOWN[reason].format(frame, *expected_frames)
        if tool := tree.unlinked("tool_frame", frames.tool, frames.world):
            faults[Reason.TF_FRAME_UNKNOWN] = tool
        sensor = tree.unlinked("sensor_frame", frames.sensor, frames.tool, fixed=True)
        if sensor and frames.sensor_source == "tf":
            faults[Reason.SENSOR_FRAME_UNKNOWN] = sensor
        sentences = {reason: f"{sentence}; {_LINK}" for reason, sentence in faults.items()}
        sentences |= {
            reason: f"{sentence}; {_CORRECT}" for reason, sentence in tree.sentences.items()
        }
        return {reason: sentence for reason, sentence in sentences.items() if self._counts[reason]}

    # --- poses from transforms

    def poses_after(self, sample: samples.Sample) -> list[PoseSample]:
        """With `pose_source` tf: the poses of `tool_frame` that are ready after a sample, even one that was refused.

        Their stamps are those of the load cell's events or, with `tf_rate`, multiples of its period. A pose is ready
        once the transforms on both sides of its stamp have come, so it depends on stamps only. If they do not come
        within `PATIENCE_NS`, the stamp has no pose, and the reason is counted.
        """
        inputs = self._inputs
        newest = None
        if inputs.pose_source != "tf" or isinstance(sample, TwistSample):
            return []
        if not isinstance(sample, samples.Stamped):
            now = max((transform.stamp for transform in sample), default=0)
            if inputs.tf_rate > 0.0:
                frames = self._frames
                newest = self.transforms.newest(frames.world, frames.tool)
                if newest is None and not self.transforms.links(frames.world, frames.tool):
                    # without a link the stamps of other frames say when the wait for one ends
                    moving = max(
                        (transform.stamp for transform in sample if not transform.fixed), default=0
                    )
                    newest = max(moving, self._scheduled)
        elif isinstance(sample, WrenchSample):
            now = sample.stamp - self._delay
            newest = now if inputs.tf_rate == 0.0 else None
        else:
            now = sample.stamp
        if newest is not None and newest > 0:
            self._schedule(newest)
        return self._ready(now)

    def _schedule(self, newest: int) -> None:
        """Schedule a pose at the stamp `newest` [ns] or, with `tf_rate`, at the multiples of its period up to it."""
        follows = succession(newest, after=self._scheduled)
        rate = self._inputs.tf_rate
        if follows in (REPEATED, LATE):
            return  # it was scheduled before, or has no pose
        if follows is NEW_RUN:
            self._wanted.clear()
            self.transforms.start_run(newest)
        if rate > 0.0:
            period = round(min(1e9 / rate, 1e18))
            is_gap = abs(newest - self._scheduled) >= PATIENCE_NS
            last = newest - 1 if is_gap else self._scheduled  # a gap has no poses
            self._wanted.extend(range((last // period + 1) * period, newest + 1, period))
        else:
            self._wanted.append(newest)
        self._scheduled = newest

    def _ready(self, now: int) -> list[PoseSample]:
        """The scheduled poses whose transforms have come. `now`: stamp of a sample [ns].

        A pose whose transforms will not come any more is dropped, and the reason is counted.
        """
        world = self._frames.world
        tool = self._frames.tool
        poses: list[PoseSample] = []
        may_come = (Reason.TF_STALE, Reason.TF_FRAME_UNKNOWN)
        while self._wanted:
            stamp = self._wanted[0]
            place = self.transforms.at(world, tool, stamp, self._inputs.max_age)
            if isinstance(place, Placement):
                poses.append(PoseSample(stamp, world, *place))
            elif (
                place in may_come
                and now <= stamp + PATIENCE_NS
                and len(self._wanted) < _MAX_WANTED_COUNT
            ):
                break
            else:
                self._counts[place] += 1
            self._wanted.popleft()
        return poses
