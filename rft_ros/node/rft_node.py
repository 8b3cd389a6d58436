"""The node `rft`: converts messages, calls the estimator once per pose, publishes."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import PointCloud2

from rft_ros.errors import InputError
from rft_ros.estimator import Estimate, Estimator, Measurement, Model, PoseSample, Reason, Sample, Stamped
from rft_ros.estimator.messages import TYPES, UNREADABLE, Role, decoder, wrench_cdr
from rft_ros.estimator.warm_up import needed, prepare
from rft_ros.files import checked_file
from rft_ros.ground import write_height_map
from rft_ros.node.diagnostics import DIAGNOSTICS_PERIOD, Diagnostics
from rft_ros.node.feedforward import FEEDFORWARD_PERIOD, FeedForward
from rft_ros.node.learned_medium import LearnedMedium
from rft_ros.node.markers import Markers
from rft_ros.node.node_parameters import NodeParameters
from rft_ros.node.services import save, serve
from rft_ros.node.stiffness import Stiffness
from rft_ros.node.tool_worker import ToolSwap, ToolWorker
from rft_ros.node.transforms import TRANSFORMS_QOS, transform_message
from rft_ros.parameters import TOOL_PARAMETERS, ModelFiles, Value, Values, model_files, model_of, settings_of
from rft_ros.tool import locate_mesh

__all__ = ["RftNode"]

_INPUTS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Best effort matches every publisher, reliable or not; the depth holds bursts of a 1,000 Hz stream."""

_CLOUDS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=2, reliability=ReliabilityPolicy.BEST_EFFORT)
"""A cloud has megabytes."""

_OUTPUTS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=200, reliability=ReliabilityPolicy.RELIABLE)

_TARE_WINDOW = 1.0  # s
_SWAP_POLL_PERIOD = 0.05  # s
_MARKER_PERIOD = 0.1  # s
_NO_GROUND = "the ground is a level plane; set ground.cell"
_IN_FILES = frozenset({*TOOL_PARAMETERS.values(), "alpha_y.model", "alpha_y.table", "ground.cell", "ground.file"})


def _in_model(changed: frozenset[str]) -> bool:
    settings_only = {"medium.zeta_error", "medium.calibrated_depth"}
    return any(name.startswith(("law", "medium.", "alpha_y.")) for name in changed - settings_only)


class RftNode(Node):
    """Feeds poses, twists and wrenches to one estimator and publishes its results.

    `arguments`: ROS arguments of this node, from ``--ros-args`` on, beside those of the process.
    """

    def __init__(self, worker: ToolWorker, *, arguments: list[str] | None = None) -> None:
        super().__init__("rft", cli_args=arguments)
        self._table = NodeParameters(self, validate=self._validate, apply=self._apply)
        values = self._table.values
        files, settings = model_files(values), settings_of(values)
        self._loaded = needed(settings, ground=bool(values["ground.cell"]))
        prepare(self._loaded, on_cold_cache=self._announce_compilation)
        parts = worker.load(files).result()  # after it: the worker would compile the forces too
        model = model_of(values, **parts._asdict())
        # One thread for maps of the ground: numba's loops release the GIL, so that a tick does not wait for a cloud.
        self.estimator = Estimator(settings, model, background=ThreadPoolExecutor(1))
        self._swap = ToolSwap(files, parts, worker)
        self._next_model = model
        self._loading: tuple[frozenset[str], Future[None]] | None = None
        self._loader = ThreadPoolExecutor(1)
        self._diagnostics = Diagnostics(self, self.estimator, self._swap)
        self._last_measurement: Measurement | None = None
        self._decode = {role: decoder(role, ros1=False) for role in TYPES}

        self._predicted = self.create_publisher(WrenchStamped, "~/wrench_predicted", _OUTPUTS)
        self._compensated = self.create_publisher(WrenchStamped, "~/wrench_compensated", _OUTPUTS)
        self._residual = self.create_publisher(WrenchStamped, "~/wrench_residual", _OUTPUTS)
        self._sigma = self.create_publisher(WrenchStamped, "~/wrench_sigma", _OUTPUTS)
        self._stiffness = Stiffness(self, self.estimator, _OUTPUTS)
        self._medium = LearnedMedium(self, self.estimator, _OUTPUTS)
        self._feedforward = FeedForward(self, self.estimator, _OUTPUTS)
        self._feedforward.use(values)
        self._markers = Markers(self, self.estimator)
        self._serialise = wrench_cdr(str(values["sensor_frame"]))

        self._subscribe(WrenchStamped, "~/wrench_measured", partial(self._on_input, "wrench"))
        self._twists = self._subscribe(TwistStamped, "~/twist", self._on_twist)
        message = transform_message(needed="tf" in (values["pose_source"], values["sensor.frame_source"]))
        if message:
            self._subscribe(message, "/tf_static", partial(self._on_input, "tf_static"), TRANSFORMS_QOS["tf_static"])
        if values["pose_source"] == "tf":
            self._subscribe(message, "/tf", partial(self._on_input, "tf"), TRANSFORMS_QOS["tf"])
        else:
            self._subscribe(PoseStamped, "~/pose", self._on_pose)
        self._clouds: Subscription | None = None
        self._subscribe_to_clouds()

        serve(self, "tare", self._tare)
        serve(self, "status", self._diagnostics.summary)
        serve(self, "forget", self._medium.forget)
        serve(self, "save_medium", lambda: self._medium.save(self.values))
        serve(self, "level_ground", self._level_ground)
        serve(self, "save_ground", self._save_ground)

        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(DIAGNOSTICS_PERIOD, self._diagnostics.publish, clock=steady)
        self.create_timer(FEEDFORWARD_PERIOD, self._feedforward.without_estimate, clock=steady)
        self.create_timer(_MARKER_PERIOD, lambda: self._markers.publish(self._last_measurement), clock=steady)
        self._swap_timer = self.create_timer(_SWAP_POLL_PERIOD, self._on_swap_poll, clock=steady)
        self._swap_timer.cancel()

    def _subscribe(
        self, message: type, topic: str, callback: Callable[[bytes], None], qos: QoSProfile = _INPUTS
    ) -> Subscription:
        # Raw bytes: rclpy needs 16 us to build a message object, which the estimator does not use.
        overridable = QoSOverridingOptions.with_default_policies()
        return self.create_subscription(message, topic, callback, qos, raw=True, qos_overriding_options=overridable)

    def _subscribe_to_clouds(self) -> None:
        """Once the ground is a map."""
        if self.estimator.ground is not None and self._clouds is None:
            self._clouds = self._subscribe(PointCloud2, "~/surface_points", partial(self._on_input, "surface"), _CLOUDS)

    def _announce_compilation(self) -> None:
        self.get_logger().info("compiling, ten seconds or more, first start only; services answer after it")

    @property
    def values(self) -> Values:
        """The values of all parameters."""
        return self._table.values

    def announce(self, event: str) -> None:
        """Log the model that came into force, with the issues of its mesh; `event`: what the sentence begins with."""
        m = self.estimator.model
        plates = m.tool.reduction or f"{len(m.tool.plates):,} plates"
        law = f"law {m.law_name}, medium {m.medium}, zeta {m.zeta:g}, alpha_y {m.alpha_y}"
        self.get_logger().info(f"{event}: tool {m.tool.name} ({plates}), {law}")
        for issue in m.tool.issues:
            self.get_logger().warning(f"mesh {m.tool.name}: {issue.message}")

    def end(self) -> None:
        """Leave nothing standing: ramp the feed-forward to zero."""
        self._feedforward.end()

    # --- the tick

    def _received(self, role: Role, data: bytes) -> Sample | None:
        try:
            sample = self._decode[role](data)
        except UNREADABLE:
            self.estimator.counts[Reason.MESSAGE_UNREADABLE.value] += 1
            return None
        if isinstance(sample, Stamped):
            self._diagnostics.received(role, sample.stamp)
        return sample

    def _on_twist(self, data: bytes) -> None:
        if (sample := self._received("twist", data)) is not None:
            self.estimator.push(sample)

    def _on_input(self, role: Role, data: bytes) -> None:
        """Push a sample that is neither pose nor twist; answer the poses and measurements that it completes."""
        if (sample := self._received(role, data)) is None:
            return
        self.estimator.push(sample)
        for pose in self.estimator.poses_after(sample):
            self._diagnostics.received("pose", pose.stamp)
            self._answer(pose, perf_counter())
        self._publish_measurements()

    def _on_pose(self, data: bytes) -> None:
        start = perf_counter()
        if isinstance(sample := self._received("pose", data), PoseSample):
            self._answer(sample, start)

    def _answer(self, sample: PoseSample, start: float) -> None:
        # Push first the twists that arrived before this pose: rclpy may call back in another order. None costs 4 us.
        with self._twists.handle:
            while (taken := self._twists.handle.take_message(TwistStamped, True)) is not None:
                self._on_twist(taken[0])
        answer = self.estimator.push_pose(sample)
        if isinstance(answer, Estimate):
            self._predicted.publish(self._serialise(answer.stamp, answer.predicted))
            self._stiffness.publish(answer.stamp)
            self._feedforward.estimated(answer)
            self._sigma.publish(self._serialise(answer.stamp, answer.sigma))
            self._medium.publish(answer)
            self._diagnostics.answered(answer, perf_counter() - start)
            self._markers.estimated(answer)
        self._publish_measurements()

    def _publish_measurements(self) -> None:
        for measurement in self.estimator.measurements():
            if measurement.compensated is not None and measurement.residual is not None:
                self._compensated.publish(self._serialise(measurement.stamp, measurement.compensated))
                self._residual.publish(self._serialise(measurement.stamp, measurement.residual))
            self._last_measurement = measurement

    # --- parameters and swaps

    def _validate(self, values: Values, changed: frozenset[str]) -> None:
        settings_of(values)
        transform_message(needed=values["sensor.frame_source"] == "tf")
        files = model_files(values)
        if changed & _IN_FILES and not self._swap.knows(files):
            if "mesh.file" in changed:  # at once, although the process that loads it checks again
                checked_file(locate_mesh(str(values["mesh.file"])), "mesh.file")
            if table := self._swap.missing(files).table:
                checked_file(Path(table), "alpha_y.table")
        if _in_model(changed):
            self._model(values)

    def _apply(self, values: Values, changed: frozenset[str]) -> None:
        self._serialise = wrench_cdr(str(values["sensor_frame"]))
        self._feedforward.use(values)
        self._use(self._model(values) if _in_model(changed) else self._next_model)
        if changed & _IN_FILES:
            self._swap.want(model_files(values))
            self._swap_timer.reset()

    def _model(self, values: Values) -> Model:
        """The next model, of the files in force."""
        parts, (cell, file) = self._swap.parts, self._swap.in_force.ground or (0.0, "")
        known = {**values, "ground.cell": cell, "ground.file": file}
        if self._swap.missing(model_files(values)).table:
            known["alpha_y.model"] = self._next_model.alpha_y
        return model_of(known, **parts._asdict(), generation=self._next_model.generation + 1)

    def _use(self, model: Model) -> bool:
        """Bring a model and the settings into force, now or, if that needs more machine code, when that is loaded."""
        self._next_model, settings = model, settings_of(self.values)
        parts = needed(settings, ground=model.ground is not None)
        missing = parts - self._loaded
        if missing:  # the rest comes into force now
            settings = replace(settings, learning_mode=self.estimator.settings.learning_mode)
        now = "ground" not in missing and model is not self.estimator.model
        self.estimator.use(settings=settings, model=model if now else None)
        self._subscribe_to_clouds()
        if not missing:
            return True
        if self._loading is None:
            self._loading = parts, self._loader.submit(prepare, parts, at_low_priority=True)
            self._swap.code = f"machine code of {' and '.join(sorted(missing))}"
        self._swap_timer.reset()
        return False

    def _on_swap_poll(self) -> None:
        outcome = self._swap.poll()
        if isinstance(outcome, ModelFiles):
            self._undo(outcome)
        elif outcome is not None and self._use(self._model(self.values)):
            self.announce("in force")
        if self._loading is not None and self._loading[1].done():
            if error := self._loading[1].exception():
                self.get_logger().error(f"{self._swap.code} not loaded, it compiles at its first use: {error}")
            self._loaded |= self._loading[0]
            self._loading, self._swap.code = None, ""
            if self._use(self._next_model):
                self.announce("in force")
        if not self._swap.preparing:
            self._swap_timer.cancel()

    def _undo(self, failed: ModelFiles) -> None:
        """Reset the parameters to the files requested before the failed swap."""
        m, wanted = self.estimator.model, self._swap.wanted
        stays = f"tool {m.tool.name} and alpha_y {m.alpha_y} stay in force"
        self.get_logger().error(f"not swapped, {stays}: {self._swap.last_failure}")
        parameters: dict[str, Value] = {name: getattr(wanted.tool, field) for field, name in TOOL_PARAMETERS.items()}
        parameters["ground.cell"], parameters["ground.file"] = wanted.ground or (0.0, "")
        if wanted.table != failed.table:
            parameters["alpha_y.model"] = "table" if wanted.table else m.alpha_y
            parameters["alpha_y.table"] = wanted.table or self.values["alpha_y.table"]
        self._table.set_all(parameters, why=f"the swap to {failed} failed")
        self._swap.want(wanted)

    # --- services

    def _tare(self) -> str:
        bias = self.estimator.tare(_TARE_WINDOW)
        if refused := self._table.set_all({"sensor.bias": bias}, why="tare"):
            raise InputError(f"tare refused: {refused}")
        return "sensor.bias set to [" + ", ".join(f"{b:.6g}" for b in bias) + "] N, N m"

    def _level_ground(self) -> str:
        if not self.estimator.level_ground():
            raise InputError(_NO_GROUND)
        return "ground as at the start"

    def _save_ground(self) -> str:
        if (ground := self.estimator.ground) is None:
            raise InputError(f"not saved: {_NO_GROUND}")
        if np.isnan(ground.heights).all():
            raise InputError("not saved: no height is known yet")
        # Here and not in a thread: the answer tells what became of it, and the largest map takes 10 ms.
        return save("rft_ground_{}.npz", lambda file: write_height_map(file, ground))
