"""A feed-forward wrench for controllers: gain times the prediction, limited in size and rate.

It is ramped to zero when estimates stop.
"""

import math
import threading
import time
from collections.abc import Sequence
from dataclasses import replace

from geometry_msgs.msg import WrenchStamped
from rclpy.duration import Duration
from rclpy.node import Node

from rft_ros.estimator import Estimate, Estimator, Trust, trust
from rft_ros.messages import stamped_cdr
from rft_ros.node.topics import OUTPUTS
from rft_ros.parameters import FeedforwardConfig
from rft_ros.rft import FORCE, QUATERNION, TORQUE
from rft_ros.rft.frames import Placement, Wrench

_PERIOD = 0.01  # s, between two outputs while there are no estimates
_ZERO: Wrench = (0.0,) * 6
_LONGEST_STEP = 2.0 * _PERIOD  # longest time of one step of the ramp, also after a pause
_LEAST = 1e-9  # N, N m: so that the ramp to zero ends also with a limit of 0
_END = 0.25  # s: the longest ramp when the node ends


class Ramp:
    """Follows a wrench, limited in size and rate."""

    def __init__(self) -> None:
        self.wrench: tuple[float, ...] = _ZERO  # [N], [N m]
        self._largest = [_LEAST, _LEAST]
        """Greatest force and torque since the wrench was zero. The ramp to zero is timed by these, so that a lowered
        limit does not slow it.
        """

    def follow(
        self,
        target: tuple[float, ...],
        duration: float,
        *,
        limits: tuple[float, float],
        rise_time: float,
    ) -> tuple[float, ...]:
        """Move towards `target` ([N], [N m], finite) for `duration` [s]; returns the wrench.

        `limits`: largest force and torque [N, N m]. `rise_time`: from zero to them [s].
        """
        made: list[float] = []
        for k, part in enumerate((FORCE, TORQUE)):
            now = self.wrench[part]
            goal = _scaled(target[part], limits[k])
            way = [g - n for g, n in zip(goal, now, strict=True)]
            longest = max(limits[k], self._largest[k]) * duration / rise_time
            new = [n + step for n, step in zip(now, _scaled(way, longest), strict=True)]
            size = math.hypot(*new)
            self._largest[k] = max(self._largest[k], size) if size > 0.0 else _LEAST
            made += new
        self.wrench = tuple(made)
        return self.wrench


def _scaled(vector: Sequence[float], longest: float) -> Sequence[float]:
    length = math.hypot(*vector)
    return [v * longest / length for v in vector] if length > longest else vector


class FeedForward:
    """Publishes ``~/wrench_feedforward`` at each estimate. Without estimates it publishes a ramp to zero.

    Controllers apply the last wrench that they received, without a time limit. So the target is zero for an estimate
    without trust, when no estimate has come for ``feedforward.timeout``, with a gain of 0, and when the node ends. A
    thread of its own watches for this, so that nothing that blocks the node's callbacks holds a force. While there is
    no wrench it sleeps: each time that it woke, ticks on a busy machine would wait for it.
    """

    def __init__(self, node: Node, estimator: Estimator, config: FeedforwardConfig) -> None:
        self.config = config
        self._publisher = node.create_publisher(WrenchStamped, "~/wrench_feedforward", OUTPUTS)
        self._clock = node.get_clock()
        self._context = node.context
        self._estimator = estimator
        self._ramp = Ramp()
        self._moved = -math.inf  # times of `time.monotonic` [s]
        self._estimated = -math.inf
        self._active = False
        self._changed = threading.Condition()  # of what is active, and whether it has ended
        self._has_ended = False
        self._watchdog = threading.Thread(target=self._watch, daemon=True)
        self._watchdog.start()

    def estimated(self, estimate: Estimate) -> None:
        """Publish the wrench for an estimate, with its stamp."""
        if self.config.gain == 0.0:
            return
        target = self._target(estimate)
        with self._changed:
            if not self._active:
                self._active = True
                self._changed.notify()
            self._estimated = time.monotonic()
            self._publish(target, estimate.stamp)

    def _watch(self) -> None:
        with self._changed:
            while self._context.ok() and not self._has_ended:
                self._without_estimate()
                self._changed.wait(_PERIOD if self._active else None)

    def _without_estimate(self) -> None:
        """Move towards zero if no estimate has come for ``feedforward.timeout``. Call it with `_changed` held."""
        is_off = self.config.gain == 0.0
        age = time.monotonic() - self._estimated
        if self._active and (is_off or age > self.config.timeout):
            self._publish(_ZERO, self._clock.now().nanoseconds)
            self._active = not is_off or self._ramp.wrench != _ZERO

    def end(self) -> None:
        """Ramp to zero in at most 0.25 s, and wait until the subscribers have received it.

        On a machine so busy that the ramp takes twice as long, the last wrench is zero all the same. Once ROS is shut
        down, nothing can be published any more.
        """
        with self._changed:
            self._has_ended = True
            self._changed.notify()
        self._watchdog.join()
        if not self._context.ok():
            return
        rise_time = min(self.config.rise_time, _END)
        self.config = replace(self.config, gain=0.0, rise_time=rise_time)
        latest = time.monotonic() + 2.0 * _END
        while self._active and time.monotonic() < latest:
            with self._changed:
                self._without_estimate()
            time.sleep(_PERIOD)
        if self._active:
            self._ramp = Ramp()
            self._publish(_ZERO, self._clock.now().nanoseconds)
        self._publisher.wait_for_all_acked(Duration(seconds=0.1))

    def _target(self, estimate: Estimate) -> Wrench:
        if trust(estimate.quality_flags) is Trust.NO:
            return _ZERO
        frame = self.config.frame
        wrench = estimate.predicted
        if frame != "sensor_frame":
            wrench = self._estimator.load_cell.place.wrench(wrench)
        if frame == "world_frame":
            quaternion = self._estimator.state[QUATERNION].tolist()
            wrench = Placement((0.0, 0.0, 0.0), quaternion).wrench(wrench)
        gain = self.config.gain
        fx, fy, fz, tx, ty, tz = wrench
        return gain * fx, gain * fy, gain * fz, gain * tx, gain * ty, gain * tz

    def _publish(self, target: Wrench, stamp: int) -> None:
        before = self._moved
        self._moved = time.monotonic()
        wrench = self._ramp.follow(
            target,
            duration=min(self._moved - before, _LONGEST_STEP),
            limits=self.config.limit,
            rise_time=self.config.rise_time,
        )
        frame = self.config.frame
        axes = self._estimator.wrench_frame
        if frame == "tool_frame":
            axes = self._estimator.config.frames.tool
        elif frame == "world_frame":
            axes = self._estimator.config.frames.world
        self._publisher.publish(stamped_cdr(axes)(stamp, wrench))
