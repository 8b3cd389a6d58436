"""A feed-forward wrench for controllers: gain times the prediction, limited in size and rate.

It is ramped to zero when estimates stop.
"""

import math
import threading
import time

from geometry_msgs.msg import WrenchStamped
from rclpy.duration import Duration
from rclpy.node import Node

from rft_ros.estimator import Estimate, Estimator, Trust, trust
from rft_ros.messages import stamped_cdr
from rft_ros.node.topics import OUTPUTS
from rft_ros.parameters import Values
from rft_ros.rft import FORCE, TORQUE
from rft_ros.rft.frames import Placement, Wrench

_PERIOD = 0.01  # s, between two outputs while there are no estimates
_ZERO: Wrench = (0.0,) * 6
_LONGEST_STEP = 2.0 * _PERIOD  # longest time of one step of the ramp, also after a pause
# N, N m: least rate times rise time; with a limit of 0 the ramp to zero would not end
_LEAST = 1e-9
_END = 0.25  # s: the longest ramp when the node ends


class Ramp:
    """Follows a wrench with limits. `limit`: largest force and torque [N, N m]. `rise_time`: from zero to it [s]."""

    def __init__(self) -> None:
        self.limit = (0.0, 0.0)
        self.rise_time = 1.0
        self.wrench: Wrench = _ZERO
        self._largest = [0.0, 0.0]
        """Greatest force and torque since the wrench was zero. The ramp to zero is timed by these, so that a lowered
        limit does not slow it.
        """

    def follow(self, target: Wrench, duration: float) -> Wrench:
        """Move towards `target` ([N], [N m], finite) for `duration` [s]; returns the wrench."""
        made: list[float] = []
        before: tuple[float, ...] = self.wrench
        wanted: tuple[float, ...] = target
        for k, (part, limit) in enumerate(zip((FORCE, TORQUE), self.limit, strict=True)):
            now = before[part]
            goal = _scaled(wanted[part], limit)
            most = max(limit, self._largest[k], _LEAST) * duration / self.rise_time
            if math.dist(now, goal) > most:
                step = _scaled(tuple(b - a for a, b in zip(now, goal, strict=True)), most)
                goal = tuple(a + s for a, s in zip(now, step, strict=True))
            size = math.hypot(*goal)
            self._largest[k] = max(self._largest[k], size) if size > 0.0 else 0.0
            made += goal
        self.wrench = tuple(made)  # type: ignore[assignment]
        return self.wrench


def _scaled(vector: tuple[float, ...], longest: float) -> tuple[float, ...]:
    length = math.hypot(*vector)
    return tuple(v * longest / length for v in vector) if length > longest else vector


class FeedForward:
    """Publishes ``~/wrench_feedforward`` at each estimate. Without estimates it publishes a ramp to zero.

    Controllers apply the last wrench that they received, without a time limit. So the target is zero for an estimate
    without trust, when no estimate has come for ``feedforward.timeout``, with a gain of 0, and when the node ends. A
    thread of its own watches for this, so that nothing that blocks the node's callbacks holds a force.
    """

    def __init__(self, node: Node, estimator: Estimator, values: Values) -> None:
        self._publisher = node.create_publisher(WrenchStamped, "~/wrench_feedforward", OUTPUTS)
        self._clock = node.get_clock()
        self._estimator = estimator
        self._ramp = Ramp()
        self._moved = self._estimated = -math.inf
        self._active = False
        self._lock = threading.Lock()
        self._ended = threading.Event()
        self.use_parameters(values)
        self._watchdog = threading.Thread(target=self._watch, daemon=True)
        self._watchdog.start()

    def use_parameters(self, values: Values) -> None:
        """Apply new values of the parameters."""
        with self._lock:
            self._gain = values["feedforward.gain"]
            self._timeout = values["feedforward.timeout"]
            self._ramp.limit = values["feedforward.limit"]
            self._ramp.rise_time = values["feedforward.rise_time"]
            self._frame = values["feedforward.frame"]
            self._axes = values[values["feedforward.frame"]]

    def estimated(self, estimate: Estimate) -> None:
        """Publish the wrench for an estimate, with its stamp."""
        if self._gain == 0.0:
            return
        target = (
            _ZERO
            if trust(estimate.quality_flags) is Trust.NO
            else self._target(estimate.predicted)
        )
        with self._lock:
            self._active = True
            self._estimated = time.monotonic()
            self._publish(target, estimate.stamp)

    def _watch(self) -> None:
        while not self._ended.wait(_PERIOD):
            self._without_estimate()

    def _without_estimate(self) -> None:
        """Move towards zero if no estimate has come for ``feedforward.timeout``."""
        with self._lock:
            late = time.monotonic() - self._estimated > self._timeout
            if self._active and (late or self._gain == 0.0):
                self._publish(_ZERO, self._clock.now().nanoseconds)
                self._active = self._gain != 0.0 or self._ramp.wrench != _ZERO

    def end(self) -> None:
        """Ramp to zero in at most 0.25 s, and wait until the subscribers have received it.

        On a machine so busy that the ramp takes twice as long, the last wrench is zero all the same.
        """
        self._ended.set()
        self._watchdog.join()
        self._ramp.rise_time = min(self._ramp.rise_time, _END)
        self._gain = 0.0
        latest = time.monotonic() + 2.0 * _END
        while self._active and time.monotonic() < latest:
            self._without_estimate()
            time.sleep(_PERIOD)
        if self._active:
            self._active = False
            self._ramp = Ramp()
            self._publish(_ZERO, self._clock.now().nanoseconds)
        self._publisher.wait_for_all_acked(Duration(seconds=0.1))

    def _target(self, wrench: Wrench) -> Wrench:
        if self._frame != "sensor_frame":
            cell = self._estimator.load_cell
            wrench = Placement(cell.position, cell.quaternion).wrench(wrench)
        if self._frame == "world_frame":
            _, _, _, qx, qy, qz, qw, *_ = self._estimator.state.tolist()
            wrench = Placement((0.0, 0.0, 0.0), (qx, qy, qz, qw)).wrench(wrench)
        return tuple(self._gain * c for c in wrench)

    def _publish(self, target: Wrench, stamp: int) -> None:
        before = self._moved
        self._moved = time.monotonic()
        wrench = self._ramp.follow(target, min(self._moved - before, _LONGEST_STEP))
        axes = self._estimator.wrench_frame if self._frame == "sensor_frame" else self._axes
        self._publisher.publish(stamped_cdr(axes)(stamp, wrench))
