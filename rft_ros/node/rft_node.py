"""The node `rft`: converts messages, calls the estimator once per pose, publishes."""

from collections.abc import Callable
from contextlib import suppress
from copy import copy
from functools import partial
from time import perf_counter

from geometry_msgs.msg import WrenchStamped
from rclpy.clock import Clock, ClockType
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.time import Time
from sensor_msgs.msg import JointState

from rft_ros.errors import InputError
from rft_ros.estimator import Estimate, Estimator, Sample, Stamped
from rft_ros.estimator.timeline import patience
from rft_ros.messages import TOPICS, TYPES, UNREADABLE, Role, decoder, stamped_cdr
from rft_ros.node.arrivals import POLL_PERIOD, Arrivals
from rft_ros.node.diagnostics import DIAGNOSTICS_PERIOD, Diagnostics
from rft_ros.node.feedforward import FeedForward
from rft_ros.node.markers import Markers
from rft_ros.node.node_parameters import NodeParameters
from rft_ros.node.services import Services
from rft_ros.node.swap import Failed, Prepared, Swap
from rft_ros.node.tool_worker import ToolWorker
from rft_ros.node.topics import INPUTS, OUTPUTS, has_tf2_msgs, message_class, type_on, waiting
from rft_ros.parameters import Config

_SWAP_POLL_PERIOD = 0.05  # s
_MARKER_PERIOD = 0.1  # s
_LEARNED_PERIOD = 20_000_000  # ns
_LEARNED = ["vertical_strength", "horizontal_strength", "turn", "surface", "surprise"]


class RftNode(Node):
    """Feeds messages to one estimator and publishes its results. `arguments`: ROS's, after the program's name."""

    def __init__(self, worker: ToolWorker, arguments: list[str]) -> None:
        super().__init__("rft", cli_args=arguments)
        self.table = NodeParameters(self, arguments, prepare=self._prepare, apply=self._apply)
        config = self.table.config
        logger = self.get_logger()
        compiling = "compiling: this takes ten seconds or more, at the first start only; services answer afterwards"
        self._swap = Swap(worker, config, on_cold_cache=lambda: logger.info(compiling))
        self.estimator = Estimator(config, self._swap.prepared.model)
        self._diagnostics = Diagnostics(self, self.estimator, self._swap)
        self._arrivals = Arrivals()
        self._decode: dict[Role, Callable[[bytes], Sample]] = {}

        publisher = partial(self.create_publisher, qos_profile=OUTPUTS)
        self._predicted = publisher(WrenchStamped, "~/wrench_predicted")
        self._compensated = publisher(WrenchStamped, "~/wrench_compensated")
        self._residual = publisher(WrenchStamped, "~/wrench_residual")
        self._sigma = publisher(WrenchStamped, "~/wrench_sigma")
        self._learned = publisher(JointState, "~/medium_learned")
        self._learned_at = 0
        self.feedforward = FeedForward(self, self.estimator, config.feedforward)
        self._markers = Markers(self, self.estimator)
        self._measured_frame = self.estimator.wrench_frame

        timer = partial(self.create_timer, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._subscribe("wrench")
        self._twists = self._subscribe("twist")
        if has_tf2_msgs() or "tf" in (config.inputs.pose_source, config.frames.sensor_source):
            self._subscribe("tf_static")
        if config.inputs.pose_source == "tf":
            self._subscribe("tf")
        else:
            self._pose_type = TYPES["pose"][0]
            self._poses: Subscription | None = self._subscribe("pose")
            timer(DIAGNOSTICS_PERIOD, self._follow_pose_type)
        self._clouds: Subscription | None = None
        self._subscribe_to_clouds()
        Services(
            self,
            self.estimator,
            self.table,
            status=self._diagnostics.summary,
            silence=self._arrivals.silence,
        )

        timer(DIAGNOSTICS_PERIOD, self._diagnostics.publish)
        timer(_MARKER_PERIOD, self._markers.publish)
        timer(_SWAP_POLL_PERIOD, self._on_swap_poll)
        timer(POLL_PERIOD, self._on_pause_poll)

    def _subscribe(self, role: Role, kind: str = "") -> Subscription:
        """Subscribe to the messages of a role. `kind`: which of `TYPES` they have; by default the first."""
        self._decode[role] = decoder(role, ros1=False, kind=kind)
        # Raw bytes: the estimator needs no message object, which rclpy takes 16 us to make.
        # A copy of the profile, since rclpy writes the node's qos_overrides into the one that it is given.
        qos = copy(INPUTS[role])
        options = QoSOverridingOptions.with_default_policies()
        message = message_class(kind or TYPES[role][0])
        callback = partial(self._on_message, role)
        return self.create_subscription(
            message, TOPICS[role], callback, qos, raw=True, qos_overriding_options=options
        )

    def _follow_pose_type(self) -> None:
        """Subscribe to the other type of poses once someone publishes that one, as motion capture does."""
        kind = type_on(self, "pose", TOPICS["pose"], usual=self._pose_type)
        if self._poses is None:
            # the first type is still in use; the next call tries again
            with suppress(RuntimeError):
                self._poses = self._subscribe("pose", kind)
        elif kind != self._pose_type:
            # The middleware takes one type of a topic at a time, and has this subscription until this callback ends.
            self.destroy_subscription(self._poses)
            self._poses = None
        self._pose_type = kind

    def _subscribe_to_clouds(self) -> None:
        """Subscribe to clouds while the ground is a map."""
        if self.estimator.ground is not None:
            self._clouds = self._clouds or self._subscribe("surface")
        elif self._clouds is not None:
            self.destroy_subscription(self._clouds)
            self._clouds = None

    def destroy_node(self) -> None:
        """Destroy the node, after the feed-forward has come to zero."""
        self.feedforward.end()
        super().destroy_node()

    def announce(self, event: str) -> None:
        """Log the current model, and the issues of its mesh and its law. `event`: the beginning of the sentence."""
        model = self.estimator.model
        tool = model.tool
        law = model.law
        logger = self.get_logger()
        logger.info(f"{event}: {model.in_words}")
        for issue in tool.issues.values():
            logger.warning(f"mesh {tool.name}: {issue}")
        for doubt in law.doubts:
            logger.warning(f"medium {law.stresses.get('medium', law.name)}: {doubt}")

    # --- the tick

    def _on_message(self, role: Role, data: bytes) -> None:
        """Push the sample of a message; publish the answers and measurements that it completes."""
        start = perf_counter()
        try:
            sample = self._decode[role](data)
        except UNREADABLE:
            self.estimator.count_unreadable()
            return
        if isinstance(sample, Stamped) and role != "pose":
            self._diagnostics.received(role, sample.stamp)
            self._arrivals.add(role)
        if role == "twist":
            self.estimator.push(sample)
            return
        if role == "pose" or self.estimator.config.inputs.pose_source == "tf":
            self._take_twists()
        for pose, answer in self.estimator.answers(sample):
            self._diagnostics.received("pose", pose.stamp)
            self._arrivals.add("pose")
            if isinstance(answer, Estimate):
                self._publish(answer, start)
            start = perf_counter()
        self._publish_measurements()

    def _take_twists(self) -> None:
        """Push the twists that arrived before a pose, since rclpy may call back in another order (4 us if none)."""
        for data, _ in waiting(self._twists):
            self._on_message("twist", data)

    def _publish(self, answer: Estimate, start: float) -> None:
        """Publish the estimate at a pose. `start`: when its callback began, a time of `perf_counter` [s]."""
        serialised = stamped_cdr(self.estimator.wrench_frame)
        self._predicted.publish(serialised(answer.stamp, answer.predicted))
        self.feedforward.estimated(answer)
        self._sigma.publish(serialised(answer.stamp, answer.sigma))
        self._publish_learned(answer.stamp)
        self._diagnostics.answered(answer, perf_counter() - start)
        self._markers.estimated(answer)

    def _publish_learned(self, stamp: int) -> None:
        """Publish what is learned: `position` has the values, `effort` their standard errors.

        Turn in rad, surface in m, surprise in standard deviations.
        """
        learning = self.estimator.learning
        if learning is None or 0 <= stamp - self._learned_at < _LEARNED_PERIOD:
            return
        self._learned_at = stamp
        belief = learning.belief()._asdict()
        message = JointState(name=_LEARNED)
        message.header.stamp = Time(nanoseconds=stamp).to_msg()
        message.position = [belief[name] for name in _LEARNED]
        message.effort = [belief.get(f"{name}_error", 1.0) for name in _LEARNED]
        self._learned.publish(message)

    def _publish_measurements(self) -> None:
        # in the old frame, if it has changed while comparisons waited
        serialised = stamped_cdr(self._measured_frame)
        for measurement in self.estimator.measurements():
            if measurement.compensated is not None and measurement.residual is not None:
                self._compensated.publish(serialised(measurement.stamp, measurement.compensated))
                self._residual.publish(serialised(measurement.stamp, measurement.residual))
            self._markers.measured = measurement.compensated
        self._measured_frame = self.estimator.wrench_frame

    def _on_pause_poll(self) -> None:
        """Publish the last measurements of a run once poses and readings have ended: no stamp will end their wait."""
        self._arrivals.count_quiet_time()
        longest_wait = 1e-9 * patience(self.estimator.config.inputs.max_age)
        if self._arrivals.quiet_time >= longest_wait:
            if self.estimator.waits_for_readings:
                self.estimator.finish()
            self._publish_measurements()

    # --- parameters and swaps

    def _prepare(self, config: Config) -> Prepared:
        if config.frames.sensor_source == "tf":
            message_class(*TYPES["tf"])
        return self._swap.prepare(config)

    def _apply(self, prepared: Prepared) -> None:
        doubts = self.estimator.model.law.doubts
        self._swap.want(prepared)
        self.feedforward.config = prepared.config.feedforward
        self._use(prepared)
        self._publish_measurements()  # those that waited when the parameters changed
        if prepared.model.law.doubts != doubts:
            self.announce("in force")

    def _use(self, prepared: Prepared) -> None:
        self.estimator.use(config=prepared.config, model=prepared.model)
        self._markers.forget()
        self._subscribe_to_clouds()

    def _on_swap_poll(self) -> None:
        swapped = self._swap.poll()
        if isinstance(swapped, Failed):
            self.get_logger().error(f"not swapped, the model in force stays: {swapped.reason}")
            self._undo(swapped)
        elif swapped is not None:
            self._use(swapped)
            self.announce("in force")

    def _undo(self, failed: Failed) -> None:
        """Set the parameters of a failed swap back. If that is refused the node goes on: a timer calls this."""
        try:
            self.table.set_all(failed.undo, why="the swap failed")
        except InputError as error:
            names = ", ".join(failed.undo)
            self.get_logger().error(f"{names} could not be set back: {error}")


def executor_of(node: RftNode) -> Executor:
    """The executor that the node's parameters name."""
    if node.table.config.executor == "events":
        try:
            from rclpy.experimental import EventsExecutor

            return EventsExecutor()
        except ImportError:
            node.get_logger().warning(
                "this rclpy has no events executor (new in 7.1.4); using the single-threaded one"
            )
    return SingleThreadedExecutor()
