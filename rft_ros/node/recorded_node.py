"""A node in its own process, and a peer that publishes its inputs, calls its services and records all topics."""

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from numpy.typing import NDArray
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from rft_ros.bags.writing import BagWriter
from rft_ros.errors import InputError
from rft_ros.messages import decoder, stamped_cdr
from rft_ros.node.topics import message_class, start_ros
from rft_ros.rft import POSE, TWIST
from rft_ros.rft.frames import Wrench

_Array = NDArray[np.float64]

WRENCHES = ("predicted", "sigma", "compensated", "residual")
"""The wrenches that the node publishes at each pose."""

_QOS = QoSProfile(depth=500)
_WRENCH = "geometry_msgs/msg/WrenchStamped"
_INPUTS = {
    "wrench_measured": _WRENCH,
    "twist": "geometry_msgs/msg/TwistStamped",
    "pose": "geometry_msgs/msg/PoseStamped",
}
_OUTPUTS = {
    **{f"wrench_{name}": _WRENCH for name in WRENCHES},
    "medium_learned": "sensor_msgs/msg/JointState",
}


@contextmanager
def ros_outlives_signals() -> Iterator[None]:
    """Start ROS on this machine only, and without its signal handlers: the node's process has to be ended first."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    start_ros(signal_handler_options=SignalHandlerOptions.NO)
    try:
        rclpy.get_global_executor()  # created here, since a signal may interrupt `spin_once` while it creates it
        yield
    finally:
        rclpy.try_shutdown()


class RecordedNode:
    """A node in its own process, and the peer. Records their topics, and keeps the newest message of each output."""

    def __init__(self, parameters: Path, bag: BagWriter) -> None:
        self._bag = bag
        self._peer = rclpy.create_node("rft_demo")
        self._newest: dict[str, bytes] = {}
        self._decoded: Any = decoder("wrench", ros1=False)
        self._publishers = {
            name: self._peer.create_publisher(message_class(kind), f"/rft/{name}", _QOS)
            for name, kind in _INPUTS.items()
        }
        for name, kind in _OUTPUTS.items():
            callback = partial(self._on_answer, name)
            self._peer.create_subscription(
                message_class(kind), f"/rft/{name}", callback, _QOS, raw=True
            )
        self._begin = 0  # [ns]
        self._stamp = 0  # of the last state that was sent [ns]
        command = [sys.executable, "-m", "rft_ros.node.main"]
        command += ["--ros-args", "--params-file", str(parameters)]
        # in a session of its own, which Ctrl-C in the terminal does not reach
        self._process = subprocess.Popen(command, start_new_session=True)

    def _on_answer(self, name: str, data: bytes) -> None:
        self._newest[name] = data
        self._record(name, data)

    def _record(self, name: str, data: bytes) -> None:
        kind = (_INPUTS | _OUTPUTS)[name]
        self._bag.write_raw(f"/rft/{name}", kind, self._stamp, data)

    @property
    def time(self) -> float:
        """Time of the last state that was sent, from the start [s]."""
        return 1e-9 * (self._stamp - self._begin)

    def wrench(self, name: str) -> Wrench | None:
        """The newest wrench on an output [N], [N m]; None if none has come. `name`: one of `WRENCHES`."""
        data = self._newest.get(f"wrench_{name}")
        return self._decoded(data).wrench if data else None

    def wait(self) -> None:
        """Wait until the node answers and has subscribed to its inputs."""
        self.call("status")
        self._until(lambda: min(p.get_subscription_count() for p in self._publishers.values()) > 0)
        self._begin = self._stamp = self._peer.get_clock().now().nanoseconds

    def send(self, t: float, state: _Array, reading: Wrench) -> None:
        """Publish and record a state, shape [13], and a reading of the load cell at a time from the start [s]."""
        self._stamp = self._begin + round(t * 1e9)
        inputs = {
            "wrench_measured": reading,
            "twist": state[TWIST].tolist(),
            "pose": state[POSE].tolist(),
        }
        for name, numbers in inputs.items():
            frame = "ft_sensor" if name == "wrench_measured" else "world"
            data = stamped_cdr(frame, len(numbers))(self._stamp, numbers)
            self._publishers[name].publish(data)
            self._record(name, data)

    def spin(self, end: float) -> None:
        """Receive messages until a time of `time.monotonic` [s]. Raises InputError if the node has ended."""
        while (left := end - time.monotonic()) > 0.0:
            rclpy.spin_once(self._peer, timeout_sec=left)
        status = self._process.poll()
        if status is not None:
            raise InputError(
                f"the node ended with status {status} before the demo was over; see its messages above"
            )

    def _until(self, condition: Callable[[], bool]) -> None:
        while not condition():
            self.spin(time.monotonic() + 0.05)

    def call(self, service: str) -> tuple[bool, str]:
        """Call one of the node's services. Returns whether it succeeded, and its message."""
        client = self._peer.create_client(Trigger, f"/rft/{service}")
        self._until(client.service_is_ready)
        future = client.call_async(Trigger.Request())
        self._until(future.done)
        self._peer.destroy_client(client)
        answer = future.result()
        return answer.success, answer.message

    def end(self) -> None:
        """End the node, by SIGTERM or after 10 s by SIGKILL, and the peer."""
        self._process.terminate()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(10.0)
        self._process.kill()
        self._process.wait()
        self._peer.destroy_node()
