"""The estimator takes stamped samples and answers each pose with an estimate or a reason, without a clock or ROS."""

import math
from collections import Counter
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator import samples
from rft_ros.estimator.comparison import Comparison
from rft_ros.estimator.intake import Intake
from rft_ros.estimator.learning import UNEXPLAINED_SENTENCE, Learning
from rft_ros.estimator.lifetimes import TABLE, Change, Lifetimes, changes, compared
from rft_ros.estimator.load_cell import LoadCellFrame, Prediction
from rft_ros.estimator.motion import UNKNOWN_VELOCITY, Motion
from rft_ros.estimator.pose_noise import NOISY, NOISY_SENTENCE
from rft_ros.estimator.quality import sentence_on
from rft_ros.estimator.samples import (
    Answer,
    Estimate,
    PoseSample,
    Reason,
    RefusedError,
    TransformSample,
    WrenchSample,
)
from rft_ros.estimator.sigma import predict_without_learning
from rft_ros.estimator.tare import TarePose, mean_in_air
from rft_ros.estimator.timeline import NEW_RUN, patience
from rft_ros.ground import HeightMap, LocalSurface, ToolPlace
from rft_ros.parameters import Config, LoadCell, Model
from rft_ros.rft import QUATERNION, SUBMERGED_AREA, rotation_matrix
from rft_ros.rft.arguments import number
from rft_ros.rft.frames import FORCE, WIDTH, Vector, Wrench
from rft_ros.rft.traction import packed_law

Array = NDArray[np.float64]

_SLIVER_SHARE = 0.01
"""Of a tool's area: merged plates reach beyond the tool; some are submerged while it is still 6 mm above."""


class Estimator:
    """Computes the predicted, compensated and residual wrench from poses, twists and load-cell samples.

    `push_pose` returns the prediction at once. Of the twists that were pushed before, it uses the last one stamped at
    or before the pose. `measurements` returns the compensated and the residual wrench later, when the load-cell samples
    before and after the pose's stamp have been pushed, in any order. Samples whose stamps differ by more than
    `max_input_age` are not used together. If a sample is not in the expected frame, it is transformed by the fixed
    transforms that were pushed.

    `estimates`: how many poses had an estimate. `counts`: for each `Reason`, how many samples were refused, or how many
    poses had no estimate or no residual. `config` and `model`: those in use; tool, law and ground are those of
    the model. `learning`: the filter of the medium's strength; None while `learning.mode` is off. `transforms`: the
    tree of frames.
    """

    def __init__(self, config: Config, model: Model) -> None:
        number("surface_height", config.surface_height)
        self.counts: Counter[Reason] = Counter()
        self.estimates = 0
        self.config = config
        self.model = model
        self._lifetimes = Lifetimes.begin(config, model)
        self._law = packed_law(model.law)
        self._comparison = Comparison(self.counts)
        self._intake = Intake(config, self.counts, self._comparison)
        self.transforms = self._intake.transforms
        self._compared = self._values_compared()
        self._result = np.zeros((1, WIDTH))

    # --- queries

    def depth(self) -> float:
        """Depth of the lowest point at the last pose below `surface` [m]: negative above it, NaN before any pose."""
        pose = self._lifetimes.motion.pose
        if pose is None:
            return math.nan
        height, (sx, sy), *_ = self.surface
        up = np.array([-sx, -sy, 1.0])
        lowest = self.model.tool.lowest_point(rotation_matrix(pose.quaternion), (sx, sy))
        return float(height - up @ pose.position - lowest)

    @property
    def state(self) -> Array:
        """State of the last pose answered with an estimate or `at_rest`, shape [13], units and columns: `STATE`.

        Zeros in a new run, and with other frames, before there is one.
        """
        return self._lifetimes.motion.state

    @property
    def surface(self) -> LocalSurface:
        """The surface around the tool at the last pose that was evaluated; level if the ground is no map."""
        ground = self._lifetimes.ground
        if ground.mapper is None or ground.surface is None:
            return LocalSurface(self.config.surface_height)
        return ground.surface

    @property
    def learning(self) -> Learning | None:
        """The filter of the medium's strength; None while `learning.mode` is off."""
        return self._lifetimes.learning

    @property
    def load_cell(self) -> LoadCell:
        """The load cell of the config. With `sensor.frame_source` tf, at the transforms' place, once known."""
        return self._intake.load_cell

    @property
    def ground(self) -> HeightMap | None:
        """The map of the ground that the last pose was evaluated on; None if the ground is a level plane."""
        mapper = self._lifetimes.ground.mapper
        return None if mapper is None else mapper.map

    def issues(self) -> list[str]:
        """The current issues of the inputs, the ground and the calibration, each a sentence.

        A sparse map; poses that jump or are noisy; axes of the load cell without numbers; a kind of motion that was not
        calibrated; a force in the air.

        With learning also readings that no strength of the grains explains.
        """
        sentences = []
        if self.ground is not None and self.ground.issue:
            sentences.append(self.ground.issue)
        jumps = self._lifetimes.motion.jumps.sentence
        if jumps:
            sentences.append(jumps)
        elif self.pose_noise > NOISY and not sentence_on(
            self.model.tool, depth=self.depth(), force=0.0
        ):
            sentences.append(NOISY_SENTENCE)
        if self._intake.unknown_axes:
            axes = ", ".join(self._intake.unknown_axes)
            sentences.append(
                f"the load cell gives no number on {axes}: check its driver and cable"
            )
        sentences += self._lifetimes.contact.unseen.sentences(
            self.config.medium.calibrated_motions
        )
        if self.learning is not None and self.learning.excludes_readings:
            sentences.append(UNEXPLAINED_SENTENCE)
        return sentences + self._lifetimes.air.issues()

    @property
    def pose_noise(self) -> float:
        """Standard deviation of a coordinate of the tool's farthest point, by the noise of the poses [m]."""
        return self._lifetimes.motion.kinematics.noise.at_tip(self.model.tool.plates.reach)

    @property
    def wrench_frame(self) -> str:
        """The frame of predicted, compensated and residual wrenches: `sensor_frame`, if it turns with the tool.

        If it does not, `tool_frame`, whose axes they then have if `LoadCell.quaternion` is the identity; the torque is
        about the sensor's origin all the same.
        """
        frames = self.config.frames
        return frames.tool if self._intake.sensor_is_in_world else frames.sensor

    @property
    def waits_for_readings(self) -> bool:
        """Whether predictions wait for load-cell samples; `finish` ends their wait."""
        return bool(self._lifetimes.readings.pending)

    @property
    def last_reading(self) -> WrenchSample | None:
        """The load-cell sample with the latest stamp, at the stamp of its event; None before there is one."""
        return self._lifetimes.readings.samples.last

    def unknown_frames(self) -> dict[Reason, str]:
        """For each reason that concerns frames, a sentence that names the frame refused last, and says what to do.

        Frames that transforms link in the meantime, and frames refused under an earlier config, are left out.
        """
        return self._intake.unknown_frames()

    def counted(self) -> list[str]:
        """`counts` as text, such as ``pose_stamp_zero: 3``; a reason for an unknown frame names the frame."""
        frames = self.unknown_frames()
        return [
            f"{r}: {n} ({frames[r]})" if r in frames else f"{r}: {n}"
            for r, n in sorted(self.counts.items())
        ]

    # --- config and model

    def use(self, *, config: Config | None = None, model: Model | None = None) -> None:
        """Apply a new config or a new model from the next sample on.

        Earlier samples are kept, unless their frame changes: another `sensor_frame` or delay drops the load-cell
        samples; another `world_frame` or `tool_frame` drops all samples, the path and the changes of the ground.
        Another tool keeps the learned strength of the bed; another medium, law or `medium.zeta_error` resets it.
        """
        if config is not None:
            number("surface_height", config.surface_height)
            self.config = config
            self._intake.use(config)
        if model is not None:
            self._law = packed_law(model.law)
            self.model = model
        self._follow_changes()
        if self.learning is not None:
            self.learning.use(lag=self.config.learning.lag, reach=self.model.tool.plates.reach)

    def level_ground(self) -> bool:
        """Reset the map to the ground at the start. Returns False if the ground is a level plane, which has no map."""
        if self._lifetimes.ground.mapper is None:
            return False
        self._end(Change.GROUND)
        return True

    def forget(self) -> None:
        """Go back to the calibration: forget the strength of the grains that was learned."""
        self._end(Change.PRIOR)

    def _values_compared(self) -> dict[Change, object]:
        return compared(
            self.config,
            self.load_cell,
            self.model,
            readings_in_world=self._intake.readings_are_in_world,
        )

    def _follow_changes(self) -> None:
        """End what ends with the changes since the last call: of the config, the model, or the sensor's place."""
        old_values = self._compared
        self._compared = self._values_compared()
        self._end(changes(old_values, self._compared))

    def _end(self, change: Change) -> None:
        """Make anew what ends with these changes."""
        if not change:
            return
        if change & (TABLE["readings"].ends_with | Change.JUMP):
            self._comparison.settle(math.inf, self._lifetimes)
        self._lifetimes = self._lifetimes.after(change, self.config, self.model)

    # --- samples

    def count_unreadable(self, number_of_messages: int = 1) -> None:
        """Count messages that could not be decoded, and so gave no sample."""
        self.counts[Reason.MESSAGE_UNREADABLE] += number_of_messages

    def push(self, sample: samples.Sample) -> Answer | None:
        """Push a sample of any kind; returns the answer to a pose. An unusable sample is counted by its reason.

        Poses from transforms are left out; see `answers`.
        """
        if isinstance(sample, PoseSample):
            return self.push_pose(sample)
        parts = (sample,) if isinstance(sample, samples.Stamped) else sample
        for one in parts:
            try:
                self._intake.add(one, self._lifetimes)
            except RefusedError as refused:
                self.counts[refused.reason] += 1
            if isinstance(one, TransformSample) and one.fixed:
                self._follow_changes()
        return None

    def answers(self, sample: samples.Sample) -> Iterator[tuple[PoseSample, Answer]]:
        """Push a sample of any kind, and answer the poses that it completes. Yields each pose with its answer.

        A pose completes itself. With `pose_source` tf a sample may complete poses from transforms. Each pose is
        answered when the iterator comes to it, so `state`, `surface` and `learning` belong to that answer.
        """
        if isinstance(sample, PoseSample):
            poses = [sample]
        else:
            self.push(sample)
            poses = self._intake.poses_after(sample)
        return ((pose, self.push_pose(pose)) for pose in poses)

    def measurements(self) -> list[samples.Measurement]:
        """The measurements that became final since the last call; each estimate gets one, in the order of estimates."""
        return self._comparison.measurements()

    def finish(self) -> None:
        """Make the measurements final that still wait for load-cell samples: after the last sample, or in a pause."""
        self._comparison.settle(math.inf, self._lifetimes)
        self._lifetimes.air.settle(math.inf)

    def tare(self, window: float) -> Wrench:
        """The bias that makes the mean compensated wrench of the last `window` [s] zero, in the driver's sign.

        Units [N], [N m]. A torque that the load cell does not give keeps its bias. Pass it to `use` as the load cell's
        `bias`. Raises InputError if the tool moved, was in the grains or had an unknown velocity, if there are too few
        load-cell samples, and if poses or samples have ended.
        """
        frame = LoadCellFrame(self.load_cell)
        inputs = self.config.inputs
        mean = mean_in_air(
            self._lifetimes.readings.samples,
            self._lifetimes.motion.poses,
            frame,
            newest_pose=self._intake.pose_stamp,
            longest_gap=patience(inputs.max_age),
            window=window,
            rest_speed=inputs.rest_speed,
            reach=self.model.tool.plates.reach,
        )
        _, offset, _ = frame.into_sensor(self.state[QUATERNION], np.zeros(12))
        bias = mean - frame.sign * np.array(offset) + self.load_cell.bias
        is_known = ~np.isnan(bias)
        fx, fy, fz, tx, ty, tz = np.where(is_known, bias, self.load_cell.bias).tolist()
        return fx, fy, fz, tx, ty, tz

    # --- poses

    def push_pose(self, sample: PoseSample) -> Answer:
        """The prediction at a pose, or the reason why there is none."""
        try:
            estimate = self._estimate(sample)
        except RefusedError as refused:
            self.counts[refused.reason] += 1
            if refused.reason in UNKNOWN_VELOCITY:
                self._lifetimes.motion.poses.append(
                    TarePose(sample, f"the tool's velocity was unknown ({refused.reason})")
                )
            return samples.NoEstimate(sample.stamp, refused.reason)
        self.estimates += 1
        return estimate

    def _estimate(self, sample: PoseSample) -> Estimate:
        """The estimate at a pose, in the steps of docs/architecture.md; `RefusedError` if a step has no result."""
        pose = self._accepted(sample)
        lifetimes = self._lifetimes
        contact = lifetimes.contact
        config = self.config
        inputs = config.inputs
        max_age = inputs.max_age
        lifetimes.air.settle(pose.stamp - patience(max_age))
        velocity = lifetimes.motion.kinematics.velocity(
            pose, lifetimes.twists, inputs, tool_frame=config.frames.tool
        )
        frame = self._intake.load_cell_frame
        if frame is None:
            raise RefusedError(Reason.SENSOR_FRAME_UNKNOWN)
        motion = self._motion(pose, velocity)
        state = motion.state[0]
        ground = lifetimes.ground
        if ground.mapper is not None:
            ground.surface = contact.footing.surface(
                ground.mapper.map, state, default_height=config.surface_height
            )
        surface = self.surface
        row, force, area = self._model_wrench(motion, surface)
        in_grains = area > 0.0
        lifetimes.motion.poses.append(
            TarePose(pose, "the tool was in the grains" if in_grains else None)
        )
        contact.withdrawal.follow(motion, force, in_grains=in_grains)
        contact.unseen.follow(motion, in_grains=in_grains)
        wrench_and_sigma = self._corrected(motion, row)
        contact.withdrawal.widen(wrench_and_sigma)
        lifetimes.motion.state = state
        if in_grains and motion.rests and not self.model.law.has_memory:
            # refused only here: a tare and the phases need the state, and late readings still update the filter
            raise RefusedError(Reason.AT_REST)
        wrench, offset, sigma = frame.into_sensor(state[QUATERNION], wrench_and_sigma)
        # the reading at this pose may have come already; it decides flags
        prediction = Prediction(pose, wrench, offset, frame, in_air=not in_grains, max_age=max_age)
        self._comparison.add(prediction, lifetimes)
        learning = lifetimes.learning
        flags = contact.quality.flags(
            motion,
            surface,
            config.medium,
            self.model.law.speed_limits,
            rest_speed=inputs.rest_speed,
            force=force,
            in_grains=in_grains,
            depth=self.depth,
            is_withdrawn=contact.withdrawal.active,
            surprises=learning is not None and learning.change != "",
            disagrees=lifetimes.air.is_offset
            or (learning is not None and learning.excludes_readings),
        )
        return Estimate(
            stamp=pose.stamp,
            predicted=wrench,
            sigma=sigma,
            speed_bound=motion.speed_bound,
            submerged_area=area,
            generation=self.model.generation,
            quality_flags=flags,
        )

    def _accepted(self, sample: PoseSample) -> PoseSample:
        """The pose in world axes, checked, and passed to ground and comparison; it may be the first of a new run."""
        pose, follows = self._intake.pose(sample)
        if follows is NEW_RUN:
            self.counts[Reason.TIME_JUMP] += 1
            self._end(Change.JUMP)
            self._lifetimes.begin_run(pose.stamp)
        lifetimes = self._lifetimes
        lifetimes.motion.pose = pose
        lifetimes.motion.jumps.follow(pose)
        if lifetimes.ground.mapper is not None:
            lifetimes.ground.mapper.add_place(
                ToolPlace(pose.stamp, pose.position, pose.quaternion, self.model.tool.corners)
            )
        self._comparison.settle(pose.stamp, lifetimes)
        return pose

    def _motion(self, pose: PoseSample, velocity: tuple[float, ...] | Reason) -> Motion:
        """The motion to a pose. Raises `RefusedError` without a velocity, or if `max_rate` allows no estimate yet."""
        tool_motion = self._lifetimes.motion
        inputs = self.config.inputs
        max_rate = inputs.max_rate
        if not tool_motion.pace.allows(pose.stamp, max_rate):
            raise RefusedError(Reason.POSE_RATE_LIMITED)
        if isinstance(velocity, Reason):
            raise RefusedError(velocity)
        tool_motion.pace.count(pose.stamp, max_rate)
        reach = self.model.tool.plates.reach
        return tool_motion.kinematics.motion(
            pose, velocity, reach=reach, rest_speed=inputs.rest_speed
        )

    def _model_wrench(self, motion: Motion, surface: LocalSurface) -> tuple[Array, Vector, float]:
        """Evaluate the model: its result, shape [19], its force [N] and the submerged area [m²]. Advances the memory.

        The result (wrench, area, sensitivities) is overwritten at the next pose.
        """
        state = motion.memory_state if self.model.law.has_memory else motion.state
        self._lifetimes.contact.step(
            self._law, state, surface.height, surface.slope, motion.displacement, self._result
        )
        row: Array = self._result[0]
        numbers = row.tolist()
        area = numbers[SUBMERGED_AREA]
        if 0.0 < area < _SLIVER_SHARE * self.model.tool.plates.area and self.depth() <= 0.0:
            row[:] = 0.0
            return row, (0.0, 0.0, 0.0), 0.0
        if not math.hypot(*numbers) < samples.ABSURD:
            raise RefusedError(Reason.ESTIMATE_NOT_FINITE)
        fx, fy, fz = numbers[FORCE]
        return row, (fx, fy, fz), area

    def _corrected(self, motion: Motion, row: Array) -> Array:
        """The wrench, corrected in mode apply, and one standard deviation of each component, shape [12]; world axes."""
        learning = self.learning
        if learning is None:
            wrench_and_sigma = np.empty(12)
            predict_without_learning(
                row, self.config.strength_error, self.model.tool.plates.reach, wrench_and_sigma
            )
            return wrench_and_sigma
        is_fast = math.hypot(*motion.velocity) > self.model.law.speed_limits.inertial
        return learning.predict(
            motion.pose.stamp,
            row,
            step=motion.path,
            passing=self._lifetimes.contact.withdrawal.active or is_fast,
            apply=self.config.learning.mode == "apply",
        )
