"""The node `rft`: converts, calls the estimator once per pose, publishes."""

from collections.abc import Callable, Mapping
from time import perf_counter

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from std_srvs.srv import Trigger

from rft_ros.errors import InputError
from rft_ros.estimator import Estimate, Estimator, Model, PoseSample, Reason, TwistSample, Wrench, WrenchSample
from rft_ros.estimator.messages import TYPES, UNREADABLE, Role, Sample, decoder, wrench_cdr
from rft_ros.estimator.parameters import TOOL_PARAMETERS, Value, model_of, settings_of, tool_request
from rft_ros.node.diagnostics import Diagnostics
from rft_ros.node.markers import Markers
from rft_ros.node.node_parameters import NodeParameters
from rft_ros.prepare_tool import Preparation, Preparer
from rft_ros.tool import Tool, locate_mesh

__all__ = ["RftNode"]

_INPUTS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)
"""Best effort matches every publisher, reliable or not; the depth takes bursts of a 1,000 Hz stream."""

_OUTPUTS = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=200, reliability=ReliabilityPolicy.RELIABLE)

_TARE_WINDOW = 1.0  # s
_DIAGNOSTICS_PERIOD = 1.0  # s
_SWAP_POLL_PERIOD = 0.05  # s
_MARKER_PERIOD = 0.1  # s
_TOOL = frozenset(TOOL_PARAMETERS.values())


class RftNode(Node):
    """One estimator between three subscriptions and three publications."""

    def __init__(self, preparer: Preparer) -> None:
        super().__init__("rft")
        self._preparer = preparer
        self._table = NodeParameters(self, validate=self._validate, apply=self._apply)
        for name in self._table.undeclared():
            if not name.startswith("qos_overrides.") and name != "use_sim_time":
                self.get_logger().warning(f"there is no parameter '{name}'; it is ignored")
        values = self._table.values
        self._generation = 0
        self._tool_in_force = tool_request(values)
        self._preparation: Preparation | None = None
        self.estimator = Estimator(settings_of(values), model_of(values))
        self._with_memory = self.estimator.model.mobilization_length > 0.0
        self._diagnostics = Diagnostics(self.get_fully_qualified_name())
        self._last_estimate: Estimate | None = None
        self._last_measured: Wrench | None = None
        self._decode = {role: decoder(role, ros1=False) for role in TYPES}

        self._predicted = self.create_publisher(WrenchStamped, "~/wrench_predicted", _OUTPUTS)
        self._compensated = self.create_publisher(WrenchStamped, "~/wrench_compensated", _OUTPUTS)
        self._residual = self.create_publisher(WrenchStamped, "~/wrench_residual", _OUTPUTS)
        self._serialise = wrench_cdr(str(values["sensor_frame"]))
        overridable = QoSOverridingOptions.with_default_policies()

        def subscription(message: type, topic: str, callback: Callable[[bytes], None]) -> Subscription:
            # As bytes: rclpy takes 16 us to make a message of them, and the estimator wants none.
            return self.create_subscription(
                message, topic, callback, _INPUTS, raw=True, qos_overriding_options=overridable
            )

        self._before_pose = (
            ("wrench", subscription(WrenchStamped, "~/wrench_measured", self._on_wrench), self._on_wrench),
            ("twist", subscription(TwistStamped, "~/twist", self._on_twist), self._on_twist),
        )
        subscription(PoseStamped, "~/pose", self._on_pose)
        self.create_service(Trigger, "~/tare", self._on_tare)
        self.create_service(Trigger, "~/status", self._on_status)
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(_DIAGNOSTICS_PERIOD, self._on_diagnostics, clock=steady)
        markers = Markers(self, self.estimator)
        self.create_timer(
            _MARKER_PERIOD, lambda: markers.publish(self._last_estimate, self._last_measured), clock=steady
        )
        self._swap_timer = self.create_timer(_SWAP_POLL_PERIOD, self._on_swap_poll, clock=steady)
        self._swap_timer.cancel()

    @property
    def executor_name(self) -> str:
        """Which executor the parameters ask for."""
        return str(self._table.values["executor"])

    def describe(self) -> str:
        """Tool, medium and models in force, in one line."""
        m = self.estimator.model
        plates = m.tool.reduction or f"{len(m.tool.plates):,} plates"
        return f"tool {m.tool.name} ({plates}), medium {m.medium}, zeta {m.zeta:g}, alpha_y {m.alpha_y}"

    # --- the tick

    def _received(self, role: Role, data: bytes) -> Sample | None:
        try:
            sample = self._decode[role](data)
        except UNREADABLE:
            self.estimator.counts[Reason.MESSAGE_UNREADABLE.value] += 1
            return None
        self._diagnostics.received_one(role, sample.stamp)
        return sample

    def _on_wrench(self, data: bytes) -> None:
        if isinstance(sample := self._received("wrench", data), WrenchSample):
            self.estimator.push_wrench(sample)
            self._publish_measurements()

    def _on_twist(self, data: bytes) -> None:
        if isinstance(sample := self._received("twist", data), TwistSample):
            self.estimator.push_twist(sample)

    def _on_pose(self, data: bytes) -> None:
        start = perf_counter()
        sample = self._received("pose", data)
        if not isinstance(sample, PoseSample):
            return
        # What came before the pose must be pushed before it; in which order rclpy serves them is a matter of luck.
        newest = self._diagnostics.newest
        for role, subscription, callback in self._before_pose:
            if newest.get(role, 0) < sample.stamp:
                while (taken := subscription.handle.take_message(subscription.msg_type, True)) is not None:
                    callback(taken[0])
        answer = self.estimator.push_pose(sample)
        if not isinstance(answer, Estimate):
            return
        stamp, serialise = answer.stamp, self._serialise
        self._predicted.publish(serialise(stamp, answer.predicted))
        self._last_estimate = answer
        self._diagnostics.tick(perf_counter() - start, answer)
        self._publish_measurements()

    def _publish_measurements(self) -> None:
        for measurement in self.estimator.measurements():
            if measurement.compensated is not None and measurement.residual is not None:
                self._compensated.publish(self._serialise(measurement.stamp, measurement.compensated))
                self._residual.publish(self._serialise(measurement.stamp, measurement.residual))
                self._last_measured = measurement.compensated

    # --- parameters and swaps

    def _validate(self, values: Mapping[str, Value]) -> None:
        if not (path := locate_mesh(str(values["mesh.file"]))).is_file():
            raise InputError(f"mesh.file '{path}' is not there")
        settings_of(values)
        if hasattr(self, "estimator") and not self._with_memory and values["medium.mobilization_length"]:
            raise InputError(
                "medium.mobilization_length was 0.0 at the start, so that the kernels for it are not compiled; "
                "start the node with it"
            )
        if values["alpha_y.model"] == "table":
            self._model(values, self.estimator.model.tool) if hasattr(self, "estimator") else model_of(values)

    def _model(self, values: Mapping[str, Value], tool: Tool) -> Model:
        return model_of(values, tool=tool, generation=self._generation)

    def _apply(self, values: Mapping[str, Value], changed: frozenset[str]) -> None:
        self.estimator.use(settings=settings_of(values))
        self._serialise = wrench_cdr(str(values["sensor_frame"]))
        if changed & _TOOL:
            self._cancel_preparation()
            request = tool_request(values)
            if request == self._tool_in_force:
                return
            self._preparation = self._preparer.prepare(request)
            self._diagnostics.preparing = request.file
            self._swap_timer.reset()
        if any(name.startswith(("medium.", "alpha_y.")) for name in changed):
            self._generation += 1
            self.estimator.use(model=self._model(values, self.estimator.model.tool))
            self.get_logger().info(f"generation {self._generation}: {self.describe()}")

    def _cancel_preparation(self) -> None:
        if self._preparation is not None:
            self._preparation.cancel()
            self._preparation = None
        self._diagnostics.preparing = ""

    def _on_swap_poll(self) -> None:
        if self._preparation is None:
            self._swap_timer.cancel()
            return
        answer = self._preparation.poll()
        if answer is None:
            return
        asked = self._preparation.request
        self._preparation = None
        self._diagnostics.preparing = ""
        self._swap_timer.cancel()
        if isinstance(answer, str):
            self._diagnostics.last_swap_failure = answer
            self.get_logger().error(f"mesh not swapped, {self.estimator.model.tool.name} stays: {answer}")
            in_force = self._tool_in_force._asdict()
            self._table.set_all({name: in_force[field] for field, name in TOOL_PARAMETERS.items()})
            return
        self._tool_in_force = asked
        self._diagnostics.last_swap_failure = ""
        self._generation += 1
        self.estimator.use(model=self._model(self._table.values, answer))
        self.get_logger().info(f"generation {self._generation}: {self.describe()}")
        for finding in answer.issues:
            self.get_logger().warning(f"mesh {answer.name}: {finding.message}")

    # --- services and reports

    def _on_tare(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            bias = self.estimator.tare(_TARE_WINDOW)
        except InputError as error:
            response.success, response.message = False, str(error)
            return response
        self._table.set_all({"sensor.bias": bias})
        response.success = True
        response.message = "sensor.bias set to [" + ", ".join(f"{b:.6g}" for b in bias) + "] N, N m"
        return response

    def _on_status(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = self._diagnostics.status(self.estimator)
        return response

    def _on_diagnostics(self) -> None:
        now = self.get_clock().now().nanoseconds
        message, sentences = self._diagnostics.report(now, self.estimator, _DIAGNOSTICS_PERIOD)
        self._diagnostics_publisher.publish(message)
        if sentences:  # as one, since a throttled line keeps back the others of its place in the code
            self.get_logger().warning("; ".join(sentences), throttle_duration_sec=10.0)

    def destroy_node(self) -> None:
        """End a preparation that still runs, then the node."""
        self._cancel_preparation()
        super().destroy_node()
