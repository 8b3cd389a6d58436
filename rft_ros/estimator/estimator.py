"""The estimator: stamped samples in; for each pose an estimate or a named reason out. It uses no clock and no ROS."""

import math
from collections import Counter, deque
from concurrent.futures import Executor
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.learning import Learning
from rft_ros.estimator.load_cell import HISTORY, Comparison, LoadCellFrame, Tare
from rft_ros.estimator.quality import QualityMonitor, Withdrawal, inertial_speed, write_prior_sigma
from rft_ros.estimator.samples import (
    ABSURD,
    TIME_JUMP,
    Estimate,
    Measurement,
    NoEstimate,
    PoseSample,
    Reason,
    TransformSample,
    TwistSample,
    Wrench,
    WrenchSample,
)
from rft_ros.estimator.transforms import Placement, Transforms
from rft_ros.estimator.velocity import PoseDifference
from rft_ros.ground import DELAY, Cloud, Ground, HeightMap, LocalSurface, Support, ToolBox
from rft_ros.parameters import Model, Settings
from rft_ros.rft import (
    COLUMNS,
    LEVEL,
    SENSITIVITIES,
    SLACK,
    STATE,
    Memory,
    rotation_matrix,
    unit_quaternion,
    wrenches,
    wrenches_in_time,
)

__all__ = ["Estimator"]

_OF_SURFACE = ("surface_height", "world_frame", "tool_frame")  # settings that void what was learned of the surface
_UNKNOWN_ZETA_ERROR = 1.0  # prior of an uncalibrated ζ: wide enough to learn any grains from ζ = 1 within centimetres

_CLOUDS = 16
_CLOUD_PERIOD = 190_000_000  # ns; clouds that follow sooner are not needed
_PLACES = 2048
"""Poses kept to find the tool's place at the stamp of a cloud: `DELAY` at 1,000 Hz, four times."""

_TWISTS = 256
"""Twists kept: a pose that waited in a queue of 200 messages still finds the twist of its own time."""

_Sample = TypeVar("_Sample", TwistSample, WrenchSample)


class Estimator:
    """Predicted, compensated and residual wrench from poses, twists and load-cell samples.

    `push_pose` answers at once. Its prediction uses the last twist stamped at or before the pose among those pushed so
    far. The compensated and the residual wrench follow in `measurements`, once the load-cell samples on both sides of
    the pose's stamp have arrived (`Comparison`); they do not depend on the order of arrival. No sample further than
    `max_input_age` from the pose is used. A sample in another frame than expected is transformed if fixed `transforms`
    link the two.
    With `learning_mode` observe or apply, `learning` follows the compensated force. An estimate uses what was learned
    at least `learning_lag` of path before.
    `counts`: under "estimates" the number of estimates; under each `Reason`, how often it refused a sample, or left a
    pose without an estimate or a residual.
    `background`: with an executor of one thread, maps of the ground are made there; the estimates are the same.
    """

    def __init__(self, settings: Settings, model: Model, *, background: Executor | None = None) -> None:
        self.counts: Counter[str] = Counter()
        self.transforms = Transforms()
        self._unknown_frames: dict[Reason, str] = {}
        self._state = np.zeros((1, len(STATE)))  # of the last answer
        self._candidate = np.zeros((1, len(STATE)))  # of the pose being answered; becomes `_state` with its answer
        self._result = np.zeros((1, len(COLUMNS) + len(SENSITIVITIES)))
        self._answer = np.zeros(12)  # wrench and its standard deviations, world axes, about the tool frame's origin
        self.learning: Learning | None = None
        """What was learned of the medium; None while `learning_mode` is off."""
        self._duration = np.zeros(1)
        self._pose: PoseSample | None = None
        self._due = 0
        self._twists: deque[TwistSample] = deque(maxlen=_TWISTS)
        self._wrenches: deque[WrenchSample] = deque(maxlen=HISTORY)
        self._difference = PoseDifference()
        self._comparison = Comparison(self._wrenches, self.counts, self._learn)
        self._tare = Tare()
        self._memory: Memory | None = None
        self._before: tuple[PoseSample, float] | None = None  # the last pose that was evaluated, and its speed
        self._withdrawal = Withdrawal()
        self._quality = QualityMonitor(model.tool)
        self.model = model
        self._background = background
        self._begin_ground(model)
        self._begin_memory(model)
        self.settings = settings
        self._begin_learning(settings, model)
        self._apply(settings)

    # --- queries

    @property
    def state(self) -> NDArray[np.float64]:
        """State of the last pose answered with an estimate or `at_rest`, shape [13], units and columns: `STATE`.

        A view that later poses overwrite: copy it to keep it.
        """
        row: NDArray[np.float64] = self._state[0]
        return row

    def depth(self) -> float:
        """Depth of the lowest point below the surface at the last pose [m]: negative above it, NaN before any."""
        if self._pose is None:
            return math.nan
        rotation = rotation_matrix(self._pose.quaternion)
        if self._ground is not None:
            height, (sx, sy), *_ = self.surface
            x, y, z = (self.model.tool.corners @ rotation.T + self._pose.position).T
            return float((height + sx * x + sy * y - z).max())
        lowest = self._pose.position[2] + self.model.tool.lowest_point(rotation)
        return self.settings.surface_height - lowest

    @property
    def surface(self) -> LocalSurface:
        """The surface around the tool at the last pose that was evaluated; level if the ground is no map."""
        return self._surface or LocalSurface(self.settings.surface_height, LEVEL, 0.0, math.nan)

    @property
    def ground(self) -> HeightMap | None:
        """The map of the ground that the last pose was evaluated on, or None."""
        return None if self._ground is None else self._ground.map

    def level_ground(self) -> bool:
        """Go back to the ground at the start; False if the ground is no map."""
        if self._ground is None:
            return False
        self._ground.level()
        self._clouds.clear()
        if self.learning is not None:
            self.learning.leave()
        return True

    def unknown_frames(self) -> dict[str, str]:
        """By reason: a sentence on the frames that it refused last under the present settings, and the expected ones.

        Of a frame that transforms have linked since there is none.
        """
        s, tree = self.settings, self.transforms
        found = {r: _frame_sentence(s, r, f) for r, f in self._unknown_frames.items() if not self._linked(r, f)}
        if not tree.linked(s.world_frame, s.tool_frame):
            found[Reason.TF_FRAME_UNKNOWN] = tree.unlinked("tool_frame", s.tool_frame, s.world_frame)
        if not self._placed:
            sensor = tree.unlinked("sensor_frame", s.sensor_frame, s.tool_frame, kind="fixed ")
            found[Reason.SENSOR_FRAME_UNKNOWN] = sensor
        return {str(r): sentence for r, sentence in (found | tree.sentences).items() if self.counts[r.value]}

    def _linked(self, reason: Reason, frame: str) -> bool:
        """Whether fixed transforms link a frame, which this reason refused, to where it is needed now."""
        s = self.settings
        needed = [s.sensor_frame if reason is Reason.WRENCH_FRAME_UNKNOWN else s.world_frame]
        needed += [s.tool_frame] if reason is Reason.TWIST_FRAME_UNKNOWN else []
        return any(self.transforms.fixed(there, frame) is not None for there in needed)

    def counted(self) -> list[str]:
        """`counts` as text, such as ``pose_stamp_zero: 3``; a reason for an unknown frame names the frame."""
        frames = self.unknown_frames()
        return [f"{r}: {n} ({frames[r]})" if r in frames else f"{r}: {n}" for r, n in sorted(self.counts.items())]

    # --- settings and model

    def use(self, *, settings: Settings | None = None, model: Model | None = None) -> None:
        """Apply new settings or a new model from the next sample on.

        Earlier samples are kept, except those in the axes of a frame that changes: the load cell's with `sensor_frame`,
        all others with `world_frame` or `tool_frame`. Another tool keeps what was learned of the bed's strength;
        another medium or law clears it.
        """
        old = self.model, self.settings
        if model is not None:
            if model.tool is not self.model.tool:
                self._quality = QualityMonitor(model.tool)
            if model.ground is not self.model.ground:
                self._begin_ground(model)
            elif model.ground is not None and model.tool is not self.model.tool:
                self._support = Support(model.tool.corners)
            if model.tool is not self.model.tool or (model.mobilization_length > 0.0) != (self._memory is not None):
                self._begin_memory(model)
            self.model = model
        if settings is not None:
            if settings.sensor_frame != self.settings.sensor_frame:
                self.finish()
                self._wrenches.clear()
            if settings.load_cell != self.settings.load_cell and self.learning is not None:
                self.learning.forget_air()
            if (settings.world_frame, settings.tool_frame) != (self.settings.world_frame, self.settings.tool_frame):
                self._twists.clear()
                self._leave()
            self.settings = settings
            self._apply(settings)
        self._keep_or_begin_learning(*old)

    def _keep_or_begin_learning(self, old_model: Model, old: Settings) -> None:
        """After new settings or a new model: keep what was learned as far as it still holds.

        A switch from or to off, or another error of ζ, begins again. Another law or mobilization length forgets.
        Another tool, surface height or frame keeps the strength.
        """
        model, new, learning = self.model, self.settings, self.learning
        if learning is None or new.learning_mode == "off" or new.zeta_error != old.zeta_error:
            if (new.learning_mode, new.zeta_error) != (old.learning_mode, old.zeta_error):
                self._begin_learning(new, model)
            return
        learning.lag = new.learning_lag
        learning.reach = model.tool.plates.reach
        if not _same(model.law, old_model.law) or model.mobilization_length != old_model.mobilization_length:
            learning.forget()
        elif model.tool is not old_model.tool or any(getattr(new, n) != getattr(old, n) for n in _OF_SURFACE):
            learning.leave()

    def _begin_learning(self, settings: Settings, model: Model) -> None:
        self.learning = None
        if settings.learning_mode != "off":
            error = settings.zeta_error or _UNKNOWN_ZETA_ERROR
            reach = model.tool.plates.reach
            self.learning = Learning(lag=settings.learning_lag, strength_error=error, reach=reach)

    def _apply(self, settings: Settings) -> None:
        self._unknown_frames.clear()
        self.transforms.keep(settings.world_frame, settings.tool_frame)
        self._place_sensor()
        self._max_age = self._comparison.max_age = round(settings.max_input_age * 1e9)
        self._period = round(min(1e9 / settings.max_rate, 1e18)) if settings.max_rate > 0.0 else 0
        self._due = 0
        self._difference.span(window=settings.twist_window, max_age=settings.max_input_age)

    def _place_sensor(self) -> None:
        """Take the sensor's place on the tool from fixed transforms, if the settings say so and they are known."""
        s = self.settings
        self._placed = s.sensor_source == "parameters"
        if not self._placed and (found := self.transforms.fixed(s.tool_frame, s.sensor_frame)) is not None:
            self._placed = True
            self.settings = replace(s, load_cell=replace(s.load_cell, **found._asdict()))
        self._frame = LoadCellFrame(self.settings.load_cell)

    def _begin_ground(self, model: Model) -> None:
        self._ground = None
        if model.ground is not None:
            self._ground = Ground(model.ground, self._background)
            self._support = Support(model.tool.corners)
        self._surface: LocalSurface | None = None
        self._clouds: deque[tuple[Cloud, Placement | None]] = deque(maxlen=_CLOUDS)
        self._last_cloud = 0
        self._places: deque[PoseSample] = deque(maxlen=_PLACES)  # where the tool was when a cloud was seen

    def _begin_memory(self, model: Model) -> None:
        self._memory = Memory(model.tool.plates, slack=SLACK) if model.mobilization_length > 0.0 else None
        self._before = None

    # --- transforms, twists and load cell

    def push_transform(self, sample: TransformSample) -> Reason | None:
        """Add a transform; returns the reason if it is refused."""
        reason = self.transforms.push(sample)
        if reason is not None:
            self.counts[reason.value] += 1
        if sample.fixed and self.settings.sensor_source == "tf":
            self._place_sensor()
        return reason

    def push_twist(self, sample: TwistSample) -> Reason | None:
        """Add a twist; returns the reason if it is refused."""
        reason = None
        if sample.stamp <= 0:
            reason = Reason.TWIST_STAMP_ZERO
        elif not math.hypot(*sample.linear, *sample.angular) < ABSURD:
            reason = Reason.TWIST_NOT_FINITE
        elif sample.frame != self.settings.world_frame and sample.frame != self.settings.tool_frame:
            for frame in (self.settings.world_frame, self.settings.tool_frame):
                if (axes := self.transforms.fixed(frame, sample.frame)) is not None:
                    turned = axes.rotate(sample.linear), axes.rotate(sample.angular)
                    sample = TwistSample(sample.stamp, frame, *turned)
                    break
            else:
                reason = Reason.TWIST_FRAME_UNKNOWN
                self._unknown_frames[reason] = sample.frame
        return self._taken(self._twists, sample, reason, Reason.TWIST_OUT_OF_ORDER)

    def push_wrench(self, sample: WrenchSample) -> Reason | None:
        """Add a load-cell sample; returns the reason if it is refused."""
        reason = None
        if sample.stamp <= 0:
            reason = Reason.WRENCH_STAMP_ZERO
        elif sample.frame != self.settings.sensor_frame:
            if (there := self.transforms.fixed(self.settings.sensor_frame, sample.frame)) is not None:
                sample = sample._replace(frame=self.settings.sensor_frame, wrench=there.wrench(sample.wrench))
            else:
                reason = Reason.WRENCH_FRAME_UNKNOWN
                self._unknown_frames[reason] = sample.frame
        if reason is None and not math.hypot(*sample.wrench) < ABSURD:
            reason = Reason.WRENCH_NOT_FINITE
        return self._taken(self._wrenches, sample, reason, Reason.WRENCH_OUT_OF_ORDER)

    def push_surface(self, cloud: Cloud) -> Reason | None:
        """Add points of the ground; returns the reason if they are refused.

        They change the ground at the first pose that is stamped `DELAY` or more after them.
        """
        newest = self._places[-1].stamp if self._places else 0
        since = cloud.stamp - self._last_cloud
        world = self.settings.world_frame
        place = None if cloud.frame == world else self.transforms.fixed(world, cloud.frame)
        reason = None
        if self._ground is None:
            reason = Reason.SURFACE_OFF
        elif cloud.stamp <= 0:
            reason = Reason.SURFACE_STAMP_ZERO
        elif cloud.frame != world and place is None:
            reason = Reason.SURFACE_FRAME_UNKNOWN
            self._unknown_frames[reason] = cloud.frame
        elif -TIME_JUMP < since <= 0:
            reason = Reason.SURFACE_OUT_OF_ORDER
        elif newest - cloud.stamp >= DELAY:
            reason = Reason.SURFACE_LATE
        elif 0 < since < _CLOUD_PERIOD:
            reason = Reason.SURFACE_RATE_LIMITED
        if reason is not None:
            self.counts[reason.value] += 1
            return reason
        if since < 0:
            self._clouds.clear()  # of the run before, or of a stamp in the future
        self._last_cloud = cloud.stamp
        self._clouds.append((cloud, place))
        self._use_clouds()
        return None

    def _use_clouds(self) -> None:
        """Give the ground the clouds whose pose, the first at or after their stamp, is known."""
        newest = self._places[-1].stamp if self._places else 0
        while self._ground is not None and self._clouds and self._clouds[0][0].stamp <= newest:
            cloud, camera = self._clouds.popleft()
            pose = next(place for place in self._places if place.stamp >= cloud.stamp)
            corners = self.model.tool.corners
            position, rotation = np.array(pose.position), rotation_matrix(pose.quaternion)
            box = ToolBox(position=position, rotation=rotation, low=corners.min(axis=0), high=corners.max(axis=0))
            placed = None if camera is None else (np.array(camera.position), rotation_matrix(camera.quaternion))
            self._ground.add(cloud, box, placed)

    def _taken(self, history: deque[_Sample], sample: _Sample, unusable: Reason | None, late: Reason) -> Reason | None:
        """Add a sample to its history, or count and return the reason why not: unusable, or `late` if out of order."""
        behind = history[-1].stamp - sample.stamp if history else 0
        if unusable is None and 0 < behind < TIME_JUMP:
            unusable = late
        if unusable is not None:
            self.counts[unusable.value] += 1
            return unusable
        if behind > 0:
            self.finish()
            history.clear()
        history.append(sample)
        self._comparison.settle(sample.stamp)
        return None

    def measurements(self) -> list[Measurement]:
        """The comparisons that became final since the last call: one for each estimate, in the estimates' order."""
        return self._comparison.take()

    def finish(self) -> None:
        """Make all pending measurements final: no more samples follow."""
        self._comparison.settle(math.inf)

    def tare(self, window: float) -> Wrench:
        """The bias that makes the mean compensated wrench of the last `window` [s] zero: raw sign, [N], [N m].

        The caller applies it: pass it to `use` as the load cell's `bias`. Raises InputError if the tool moved, was in
        the grains or had an unknown velocity, or if there are too few load-cell samples.
        """
        limits = {"rest_speed": self.settings.rest_speed, "reach": self.model.tool.plates.reach}
        mean = self._tare.mean(self._wrenches, window, **limits)
        # only the weight's wrench is used; it does not depend on the answer
        sign, weight = self._frame.sign, self._frame.into_sensor(self._state[0, 3:7], self._answer)[6:12]
        fx, fy, fz, tx, ty, tz = (m - sign * w for m, w in zip(mean, weight, strict=True))
        return fx, fy, fz, tx, ty, tz

    # --- poses

    def push_pose(self, sample: PoseSample) -> Estimate | NoEstimate:
        """The prediction at a pose, or the reason why there is none."""
        answer = self._tick(sample)
        if isinstance(answer, Reason):
            self.counts[answer.value] += 1
            return NoEstimate(sample.stamp, answer)
        self.counts["estimates"] += 1
        return answer

    def _tick(self, sample: PoseSample) -> Estimate | Reason:
        pose = self._accept(sample)
        if isinstance(pose, Reason):
            return pose
        if self._ground is not None:
            self._places.append(pose)
            if self._clouds:
                self._use_clouds()
            self._ground.advance(pose.stamp)
        if not self._placed:
            return Reason.SENSOR_FRAME_UNKNOWN
        self._comparison.settle(pose.stamp)
        no_velocity = self._write_state(pose)
        if self._limit_rate(pose.stamp, answered=no_velocity is None):
            return Reason.POSE_RATE_LIMITED
        if no_velocity is not None:
            self._tare.disturb(pose.stamp, f"the tool's velocity was unknown ({no_velocity.value})")
            return no_velocity
        speed = self._speed()
        path, duration = self._moved(pose, speed)
        area = self._evaluate(duration)
        in_grains = area > 0.0
        if in_grains:
            self._tare.disturb(pose.stamp, "the tool was in the grains")
        else:
            self._tare.hang(pose)
        self._correct(pose.stamp, path, speed)
        if in_grains and speed < self.settings.rest_speed and self._memory is None:
            self._state, self._candidate = self._candidate, self._state
            return Reason.AT_REST
        numbers = self._frame.into_sensor(self._candidate[0, 3:7], self._answer)
        if not math.hypot(*numbers[:12]) < ABSURD:
            return Reason.ESTIMATE_NOT_FINITE
        self._state, self._candidate = self._candidate, self._state
        self._comparison.add(pose.stamp, numbers[:12], self._frame, pose.quaternion, in_air=not in_grains)
        quality_flags = self._quality.flags(
            self._state[0],
            speed=speed,
            submerged=in_grains,
            depth=self.depth,
            settings=self.settings,
            law=self.model.law,
            surface=self._surface,
            withdraws=self._withdrawal.path > 0.0,
            learning=self.learning,
        )
        fx, fy, fz, tx, ty, tz = numbers[:6]
        sx, sy, sz, ux, uy, uz = numbers[12:]
        wrench, sigma = (fx, fy, fz, tx, ty, tz), (sx, sy, sz, ux, uy, uz)
        return Estimate(pose.stamp, wrench, sigma, speed, area, self.model.generation, quality_flags)

    def _accept(self, sample: PoseSample) -> PoseSample | Reason:
        """Store the pose as the last one, its quaternion made unit length; or return why it is refused."""
        stamp = sample.stamp
        if stamp <= 0:
            return Reason.POSE_STAMP_ZERO
        if not math.hypot(*sample.position, *sample.quaternion) < ABSURD:
            return Reason.POSE_NOT_FINITE
        quaternion = unit_quaternion(*sample.quaternion)
        if quaternion is None:
            return Reason.POSE_QUATERNION_NOT_UNIT
        position = sample.position
        if sample.frame != self.settings.world_frame:
            base = self.transforms.fixed(self.settings.world_frame, sample.frame)
            if base is None:
                self._unknown_frames[Reason.POSE_FRAME_UNKNOWN] = sample.frame
                return Reason.POSE_FRAME_UNKNOWN
            position, quaternion = base.of(Placement(position, quaternion))
            if not math.hypot(*position) < ABSURD:
                return Reason.POSE_NOT_FINITE
        if self._pose is not None and stamp <= self._pose.stamp:
            if stamp == self._pose.stamp:
                return Reason.POSE_REPEATED
            if self._pose.stamp - stamp < TIME_JUMP:
                return Reason.POSE_OUT_OF_ORDER
            self._begin_again(stamp)
        self._pose = PoseSample(stamp, self.settings.world_frame, position, quaternion)
        return self._pose

    def _begin_again(self, stamp: int) -> None:
        """Start a new run at `stamp` after a time jump: drop the samples of the run before."""
        self.counts[Reason.TIME_JUMP.value] += 1
        self._due = 0
        self.finish()
        self._leave()
        if self._twists and self._twists[-1].stamp - stamp >= TIME_JUMP:
            self._twists.clear()
        if self._wrenches and self._wrenches[-1].stamp - stamp >= TIME_JUMP:
            self._wrenches.clear()

    def _leave(self) -> None:
        """Drop what is told in world axes or of the time before: path, memory, map of the ground, where grains lie."""
        self._tare = Tare()
        self._quality = QualityMonitor(self.model.tool)
        self._withdrawal = Withdrawal()
        self._difference.reset()
        self._begin_memory(self.model)
        self._places.clear()
        self._last_cloud = 0
        self._surface = None
        self.level_ground()
        if self.learning is not None:
            self.learning.leave()

    def _write_state(self, pose: PoseSample) -> Reason | None:
        """Write the pose and its velocity, world axes, to the candidate state; return the reason if it has none."""
        state = self._candidate[0]
        if self.settings.twist_source == "pose_difference":
            ready = self._difference.push(pose)
            state[0:7] = (*pose.position, *pose.quaternion)
            state[7:13] = self._difference.twist
            return None if ready else Reason.POSE_HISTORY_SHORT
        for twist in reversed(self._twists):
            if twist.stamp <= pose.stamp:
                break
        else:
            return Reason.TWIST_MISSING
        if pose.stamp - twist.stamp > self._max_age:
            return Reason.TWIST_STALE
        state[:] = (*pose.position, *pose.quaternion, *twist.linear, *twist.angular)
        if twist.frame == self.settings.tool_frame:
            to_world = rotation_matrix(pose.quaternion)
            state[7:10] = to_world @ state[7:10]
            state[10:13] = to_world @ state[10:13]
        return None

    def _limit_rate(self, stamp: int, *, answered: bool) -> bool:
        """Whether to refuse a pose that comes sooner than `max_rate` allows. A pose that is `answered` starts a period.

        A tolerance of a tenth of a period lets a 125 Hz stream with jittering stamps pass a limit of 125 Hz.
        """
        if stamp + self._period // 10 < self._due:
            return True
        if answered:
            self._due = max(self._due, stamp) + self._period
        return False

    def _speed(self) -> float:
        """An upper bound on the speed of the tool's plates [m/s]."""
        vx, vy, vz, wx, wy, wz = self._candidate[0, 7:13].tolist()
        return math.hypot(vx, vy, vz) + math.hypot(wx, wy, wz) * self.model.tool.plates.reach

    def _moved(self, pose: PoseSample, speed: float) -> tuple[float, float]:
        """Path of the fastest point since the last pose [m], and its duration [s].

        After a gap over `max_input_age` the path is the poses' displacement, and the duration what it takes.
        """
        before, self._before = self._before, (pose, speed)
        if before is None:
            return 0.0, 0.0
        last, mean = before[0], 0.5 * sum(v if v >= self.settings.rest_speed else 0.0 for v in (before[1], speed))
        duration = (pose.stamp - last.stamp) * 1e-9
        if pose.stamp - last.stamp <= self._max_age or mean == 0.0:
            return mean * duration, duration
        cosine = abs(sum(a * b for a, b in zip(pose.quaternion, last.quaternion, strict=True)))
        turn = 2.0 * math.acos(min(cosine, 1.0))
        path = math.dist(pose.position, last.position) + self.model.tool.plates.reach * turn
        return path, path / mean

    def _evaluate(self, duration: float) -> float:
        """Write the model's wrench at the candidate state to the result; returns the submerged area [m²].

        With memory it also advances the memory; `duration` [s]: since the last pose, 0 if it does not follow it.
        """
        height, slope = self.settings.surface_height, LEVEL
        if self._ground is not None:
            self._surface = self._support.local_surface(self._ground.map, self._candidate[0], level=height)
            height, slope = self._surface.height, self._surface.slope
        scene = self.model.tool.plates, self.model.law, self._candidate
        if self._memory is None:
            wrenches(*scene, surface_height=height, slope=slope, threads=1, out=self._result)
            return float(self._result[0, 6])
        self._duration[0] = duration
        wrenches_in_time(
            *scene, self._duration, self._memory, mobilization_length=self.model.mobilization_length,
            surface_height=height, slope=slope, out=self._result,
        )  # fmt: skip
        return float(self._result[0, 6])

    def _correct(self, stamp: int, path: float, speed: float) -> None:
        """Write the wrench, corrected in mode apply, and its standard deviations to the answer."""
        result, answer, reach = self._result[0], self._answer, self.model.tool.plates.reach
        velocity = self._candidate[0, 7:10].tolist()
        if not math.hypot(*result.tolist()) < ABSURD:
            answer[:6] = result[:6]
            return
        rises = speed >= self.settings.rest_speed and self._withdrawal.rises(velocity[2], speed, result)
        if self.learning is None:
            answer[:6] = result[:6]
            write_prior_sigma(answer, zeta_error=self.settings.zeta_error, reach=reach)
        else:
            fast = math.hypot(*velocity) > inertial_speed(self.model.law)
            apply = self.settings.learning_mode == "apply"
            answer[:] = self.learning.predict(stamp, result, step=path, passing=rises or fast, apply=apply)
            if not apply:
                answer[:6] = result[:6]
        self._withdrawal.widen(answer, path, rises=rises, wet=bool(result[6] > 0.0))

    def _learn(self, stamp: int, force: NDArray[np.float64] | None, repeated: bool, in_air: bool) -> None:
        """Take a final comparison: the compensated force in world axes, shape [3], or None."""
        if self.learning is not None:
            self.learning.learn(stamp, force, repeated=repeated, in_air=in_air)


def _same(a: object, b: object) -> bool:
    """Whether two laws have the same type and numbers."""
    if isinstance(a, tuple) and isinstance(b, tuple):
        return a.__class__ is b.__class__ and len(a) == len(b) and all(map(_same, a, b))
    return np.array_equal(a, b)  # type: ignore[arg-type]


def _frame_sentence(settings: Settings, reason: Reason, frame: str) -> str:
    """A sentence for a reason ``*_frame_unknown``: the refused frame_id and the expected one."""
    world, tool = f"world_frame {settings.world_frame!r}", f"tool_frame {settings.tool_frame!r}"
    return {
        Reason.POSE_FRAME_UNKNOWN: f"pose frame_id {frame!r} is not {world}",
        Reason.TWIST_FRAME_UNKNOWN: f"twist frame_id {frame!r} is neither {world} nor {tool}",
        Reason.SURFACE_FRAME_UNKNOWN: f"surface_points frame_id {frame!r} is not {world}, nor fixed in it",
        Reason.WRENCH_FRAME_UNKNOWN: f"wrench frame_id {frame!r} is not sensor_frame {settings.sensor_frame!r}",
    }[reason]
