"""The estimator takes stamped samples and answers each pose with an estimate or a reason, without a clock or ROS."""

import math
from collections import Counter, deque
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator import samples
from rft_ros.estimator.intake import Intake
from rft_ros.estimator.learning import Learning
from rft_ros.estimator.load_cell import HISTORY, Comparison, LoadCellFrame, Prediction
from rft_ros.estimator.motion import UNKNOWN_VELOCITY, Kinematics, Motion
from rft_ros.estimator.pose_noise import NOISY, NOISY_SENTENCE
from rft_ros.estimator.quality import QualityMonitor
from rft_ros.estimator.samples import Answer, Estimate, PoseSample, Reason, RefusedError, Wrench
from rft_ros.estimator.sigma import Withdrawal, predict_without_learning
from rft_ros.estimator.tare import AirReading, PastPose, mean_in_air
from rft_ros.estimator.timeline import NEW_RUN
from rft_ros.ground import GroundMapper, HeightMap, LocalSurface
from rft_ros.parameters import LoadCell, Model, Settings
from rft_ros.rft import QUATERNION, STATE, TWIST, Memory, rotation_matrix
from rft_ros.rft.arguments import number
from rft_ros.rft.frames import WIDTH
from rft_ros.rft.traction import packed_law
from rft_ros.rft.wrench import prepared

__all__ = ["Estimator"]

Array = NDArray[np.float64]

_SLIVER = 0.01  # of a tool's area: merged plates reach beyond the tool; some are submerged while it is still 6 mm above


class Estimator:
    """Computes the predicted, compensated and residual wrench from poses, twists and load-cell samples.

    `push_pose` returns the prediction at once. Of the twists that were pushed before, it uses the last one stamped at
    or before the pose. `measurements` returns the compensated and the residual wrench later, when the load-cell samples
    before and after the pose's stamp have been pushed, in any order. Samples whose stamps differ by more than
    `max_input_age` are not used together. If a sample is not in the expected frame, it is transformed by the fixed
    transforms that were pushed.

    `estimates`: how many poses had an estimate. `counts`: for each `Reason`, how many samples were refused, or how many
    poses had no estimate or no residual. `settings` and `model`: those in use. `learning`: the filter of the medium's
    strength; None while `learning_mode` is off. `transforms`: the tree of frames.
    """

    def __init__(self, settings: Settings, model: Model) -> None:
        self.counts, self.estimates = Counter[Reason](), 0
        self.settings, self.model = settings, model
        self.learning: Learning | None = None
        self._memory: Memory | None = None
        self._comparison, self._air = Comparison(self.counts, self._learn), AirReading()
        self._intake = Intake(settings, self.counts, self._comparison)
        self.transforms = self._intake.transforms
        self._kinematics = Kinematics(settings, self._intake.twists, reach=model.tool.plates.reach)
        self._use_ground()
        self._pose: PoseSample | None = None  # the last one that was accepted
        self.surface = LocalSurface(settings.surface_height)
        """The surface around the tool at the last pose that was evaluated; level if the ground is no map."""
        self._poses: deque[PastPose] = deque(maxlen=HISTORY)  # for a tare
        self._result = np.zeros((1, WIDTH))
        self.state: Array = np.zeros(len(STATE))
        """State of the last pose answered with an estimate or `at_rest`, shape [13], units and columns: `STATE`."""
        self._start_tool()
        self.use(settings=settings)

    # --- queries

    def depth(self) -> float:
        """Depth of the lowest point below the surface at the last pose [m]: negative above it, NaN before any."""
        if self._pose is None:
            return math.nan
        height, (sx, sy), *_ = self.surface
        up = np.array([-sx, -sy, 1.0])
        lowest = self.model.tool.lowest_point(rotation_matrix(self._pose.quaternion), (sx, sy))
        return float(height - up @ self._pose.position - lowest)

    @property
    def load_cell(self) -> LoadCell:
        """The load cell of the settings. With `sensor_source` tf, at the place that the transforms give, once known."""
        return self._intake.load_cell

    @property
    def ground(self) -> HeightMap | None:
        """The map of the ground that the last pose was evaluated on; None if the ground is a level plane."""
        return None if self._mapper is None else self._mapper.map

    def level_ground(self) -> bool:
        """Reset the map to the ground at the start. Returns False if the ground is a level plane, which has no map."""
        if self._mapper is None:
            return False
        self._mapper.reset()
        if self.learning is not None:
            self.learning.forget_place()
        return True

    def issues(self) -> list[str]:
        """The current issues: a sparse map, noisy poses, a force in the air, and with learning those of `ISSUES`."""
        of_inputs = [] if self.ground is None or not self.ground.issue else [self.ground.issue]
        if self.pose_noise > NOISY:
            of_inputs.append(NOISY_SENTENCE)
        return of_inputs + (self._air.issues() if self.learning is None else self.learning.issues())

    @property
    def pose_noise(self) -> float:
        """Standard deviation of a coordinate of the tool's farthest point, by the noise of the poses [m]."""
        return self._kinematics.noise.at_tip(self._kinematics.reach)

    @property
    def wrench_frame(self) -> str:
        """The frame of predicted, compensated and residual wrenches: `sensor_frame`, if it turns with the tool.

        If it does not, `tool_frame`, whose axes they then have if `LoadCell.quaternion` is the identity; the torque is
        about the sensor's origin all the same.
        """
        return self.settings.tool_frame if self._intake.sensor_is_in_world else self.settings.sensor_frame

    def unknown_frames(self) -> dict[Reason, str]:
        """For each reason that concerns frames, a sentence that names the frame refused last, and says what to do.

        Frames that transforms link in the meantime, and frames refused under earlier settings, are left out.
        """
        return self._intake.unknown_frames()

    def counted(self) -> list[str]:
        """`counts` as text, such as ``pose_stamp_zero: 3``; a reason for an unknown frame names the frame."""
        frames = self.unknown_frames()
        return [f"{r}: {n} ({frames[r]})" if r in frames else f"{r}: {n}" for r, n in sorted(self.counts.items())]

    # --- settings and model

    def use(self, *, settings: Settings | None = None, model: Model | None = None) -> None:
        """Apply new settings or a new model from the next sample on.

        Earlier samples are kept, unless their frame changes: another `sensor_frame`, `world_frame` or delay drops the
        load-cell samples; another `world_frame` or `tool_frame` drops all other samples, the path and the changes of
        the ground. Another tool keeps the learned strength of the bed; another medium, law or `zeta_error` resets it.
        """
        number("surface_height", (settings or self.settings).surface_height)
        old, old_model, old_cell = self.settings, self.model, self.load_cell
        self.settings, self.model = s, m = settings or old, model or old_model
        self._law, self._limits = packed_law(m.law), m.law.speed_limits
        self.surface = LocalSurface(s.surface_height)
        self._kinematics.reach = m.tool.plates.reach
        if settings is not None:
            self._intake.use_settings(s)
            self._kinematics.use_settings(s)
            self._comparison.use(max_age=round(s.max_input_age * 1e9))
        new_axes = (s.world_frame, s.tool_frame) != (old.world_frame, old.tool_frame)
        new_tool, new_ground = m.tool is not old_model.tool, m.ground is not old_model.ground
        if new_ground:
            self._use_ground()
        elif new_tool and self._mapper is not None:
            self._mapper.use_tool(m.tool.corners)
        if new_axes:
            self._start_run()
        elif new_tool:
            self._start_tool()
        elif m.law.has_memory != old_model.law.has_memory:
            self._start_memory()
        if self.load_cell != old_cell:
            self._air.forget()
        if (s.learning_mode == "off") != (self.learning is None) or s.zeta_error != old.zeta_error:
            is_off, error = s.learning_mode == "off", s.strength_error
            self.learning = None if is_off else Learning(strength_error=error, air=self._air)
        if self.learning is not None:
            self.learning.lag, self.learning.reach = s.learning_lag, m.tool.plates.reach
            if m.law != old_model.law:
                self.learning.forget()
            elif new_tool or new_axes or new_ground or s.surface_height != old.surface_height:
                self.learning.forget_place()

    def _use_ground(self) -> None:
        """Start with the model's map of the ground. A level plane needs no mapper."""
        ground, tool = self.model.ground, self.model.tool
        self._mapper = None if ground is None else GroundMapper(ground, tool.corners)

    def _start_tool(self) -> None:
        """Start with a tool that has not moved yet: no path, no memory, no flags."""
        self._sliver = _SLIVER * self.model.tool.plates.area
        self._air.start_run()
        self._start_memory()
        self._withdrawal = Withdrawal()
        self._quality = QualityMonitor(self.model.tool)

    def _start_memory(self) -> None:
        """Start with the memory of a tool that has not moved yet, or with none if the law has none."""
        plates, has_memory = self.model.tool.plates, self.model.law.has_memory
        self._memory = Memory(plates) if has_memory else None
        self._step = prepared(plates, self._memory)

    def _start_run(self) -> None:
        """Start a new run, or a run in new axes: no path, no memory, the ground at the start. The strength is kept."""
        self._start_tool()
        self._kinematics.start_run()
        if self._mapper is not None:
            self._mapper.start_run()
        self.surface = LocalSurface(self.settings.surface_height)
        self._poses.clear()
        if self.learning is not None:
            self.learning.forget_place()

    # --- samples

    def push(self, sample: samples.Sample) -> Answer | None:
        """Push a sample of any kind; returns the answer to a pose. An unusable sample is counted by its reason.

        Poses from transforms are left out; see `answers`.
        """
        if isinstance(sample, PoseSample):
            return self.push_pose(sample)
        parts = (sample,) if isinstance(sample, samples.Stamped) else sample
        for one in parts:
            try:
                self._intake.add(one, self._mapper)
            except RefusedError as refused:
                self.counts[refused.reason] += 1
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
        """Call this after the last sample: it makes the measurements final that still wait for load-cell samples."""
        self._comparison.settle(math.inf)
        self._air.settle(math.inf)

    def tare(self, window: float) -> Wrench:
        """The bias that makes the mean compensated wrench of the last `window` [s] zero, in the driver's sign.

        Units [N], [N m]. Pass it to `use` as the load cell's `bias`. Raises InputError if the tool moved, was in the
        grains or had an unknown velocity, or if there are too few load-cell samples.
        """
        rest, reach = self.settings.rest_speed, self.model.tool.plates.reach
        frame = LoadCellFrame(self.load_cell)
        readings = self._comparison.readings
        mean = mean_in_air(readings, self._poses, frame, window=window, rest_speed=rest, reach=reach)
        _, offset, _ = frame.into_sensor(self.state[QUATERNION], np.zeros(12))
        fx, fy, fz, tx, ty, tz = (mean - frame.sign * np.array(offset) + self.load_cell.bias).tolist()
        return fx, fy, fz, tx, ty, tz

    # --- poses

    def push_pose(self, sample: PoseSample) -> Answer:
        """The prediction at a pose, or the reason why there is none."""
        try:
            estimate = self._estimate(sample)
        except RefusedError as refused:
            self.counts[refused.reason] += 1
            if refused.reason in UNKNOWN_VELOCITY:
                self._poses.append(PastPose(sample, f"the tool's velocity was unknown ({refused.reason})"))
            return samples.NoEstimate(sample.stamp, refused.reason)
        self.estimates += 1
        return estimate

    def _estimate(self, sample: PoseSample) -> Estimate:
        """The estimate at a pose, in the steps of docs/architecture.md; `RefusedError` if a step has no result."""
        pose = self._accepted(sample)
        self._air.settle(pose.stamp - self._comparison.patience)
        frame = self._intake.load_cell_frame
        if frame is None:
            raise RefusedError(Reason.SENSOR_FRAME_UNKNOWN)
        motion = self._kinematics.at(pose)
        state = motion.state[0]
        if self._mapper is not None:
            self.surface = self._mapper.surface_at(state, self.settings.surface_height)
        row, force, area = self._model_wrench(motion)
        in_grains = area > 0.0
        self._poses.append(PastPose(pose, "the tool was in the grains" if in_grains else None))
        self._withdrawal.follow(motion, force, in_grains=in_grains)
        with_sigma = self._corrected(motion, row)
        self._withdrawal.widen(with_sigma)
        self.state = state
        if in_grains and motion.rests and self._memory is None:
            # refused only here: a tare and the phases need the state, and late readings still update the filter
            raise RefusedError(Reason.AT_REST)
        wrench, offset, sigma = frame.into_sensor(state[QUATERNION], with_sigma)
        # the reading at this pose may have come already; it decides flags
        self._comparison.add(Prediction(pose, wrench, offset, frame, in_air=not in_grains))
        learning = self.learning
        flags = self._quality.flags(
            motion, self.surface, self.settings, self._limits, force=force, in_grains=in_grains, depth=self.depth,
            withdrawn=self._withdrawal.active, surprises=learning is not None and learning.change != "",
            disagrees=self._air.is_offset if learning is None else learning.disagrees,
        )  # fmt: skip
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
            self.finish()
            self._intake.start_run(pose.stamp)
            self._start_run()
        self._pose = pose
        if self._mapper is not None:
            self._mapper.add_pose(pose.stamp, pose.position, pose.quaternion)
        self._comparison.settle(pose.stamp)
        return pose

    def _model_wrench(self, motion: Motion) -> tuple[Array, samples.Vector, float]:
        """Evaluate the model: its result, shape [19], its force [N] and the submerged area [m²]. Advances the memory.

        The result (wrench, area, sensitivities) is overwritten at the next pose.
        """
        surface, state = self.surface, motion.state
        if self._memory is not None and not motion.is_along:
            state = state.copy()
            state[0, TWIST] = 0.0  # the memory then keeps the direction of the last displacement
        step = self._law, state, surface.height, surface.slope, self._result
        if self._memory is None:
            self._step(*step)
        else:
            self._step(*step, slack=motion.dead_band)
        row: Array = self._result[0]
        fx, fy, fz, _, _, _, area, *_ = numbers = row.tolist()
        if 0.0 < area < self._sliver and self.depth() <= 0.0:
            row[:] = 0.0
            return row, (0.0, 0.0, 0.0), 0.0
        if not math.hypot(*numbers) < samples.ABSURD:
            raise RefusedError(Reason.ESTIMATE_NOT_FINITE)
        return row, (fx, fy, fz), area

    def _corrected(self, motion: Motion, row: Array) -> Array:
        """The wrench, corrected in mode apply, and one standard deviation of each component, shape [12]; world axes."""
        if self.learning is None:
            with_sigma = np.empty(12)
            predict_without_learning(row, self.settings.strength_error, self._kinematics.reach, with_sigma)
            return with_sigma
        fast = math.hypot(*motion.velocity) > self._limits.inertial
        passing, apply = self._withdrawal.active or fast, self.settings.learning_mode == "apply"
        return self.learning.predict(motion.pose.stamp, row, step=motion.path, passing=passing, apply=apply)

    def _learn(self, prediction: Prediction, force: samples.Vector, repeated: bool) -> None:
        """Update the filter with a reading."""
        self._air.add(prediction, force)
        if self.learning is not None:
            self.learning.learn(prediction.pose.stamp, force, repeated=repeated)
