"""A node `rft` over real DDS, in this process or its own, and a peer that feeds it and collects its answers."""

import ctypes
import itertools
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from unittest import mock

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rcl_interfaces.msg import Log, ParameterValue, SetParametersResult
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.executors import Executor, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from recordings import cdr
from std_srvs.srv import Trigger

from rft_ros.node import rft_node
from rft_ros.parameters import MeshConfig, Part, load_parts
from rft_ros.rft import MEDIA, alpha_y_model, checked_states, law_named, wrenches
from rft_ros.tool import Tool

OUTPUTS = ("wrench_predicted", "wrench_sigma", "wrench_compensated", "wrench_residual")
WITHOUT_MEMORY = ("-p", "medium.mobilization_length:=0.0", "-p", "alpha_y.model:=constant")
"""Before a test's own arguments, which override them: an answer is then that of `predicted_by_the_core`."""
NODE = (sys.executable, "-m", "rft_ros.node.main", "--ros-args")
WAIT = 600.0  # s: other work may keep every core busy, and a first start compiles
_NUMBERS = itertools.count()


class InlineWorker:
    """Loads a model's files in this process, which has the mesh library in memory; the node asks it as its own."""

    def load(self, files: Mapping[str, Part], _given_up: object = None) -> dict[str, object]:
        tool = files.get("tool")
        is_shipped = isinstance(tool, MeshConfig) and tool.file.isidentifier()
        loaded = {"tool": _loaded(tool)} if is_shipped else {}
        return loaded | load_parts({n: part for n, part in files.items() if n not in loaded})

    def end(self) -> None:
        pass


class Harness:
    """A node, and a peer that feeds it and collects its answers: here both in this process.

    The node's diagnostics come ten times a second, so that no test waits for them. `reliable`: its inputs' QoS is, as a
    user may set it. No two nodes of a process have one name, the peers neither: when one ends, /rosout loses the log of
    the other, and the graph its publishers' node.
    """

    def __init__(self, *arguments: str, reliable: bool = False, as_shipped: bool = False) -> None:
        """`as_shipped`: with the default model in place of `WITHOUT_MEMORY`."""
        arguments = self._named(
            arguments if as_shipped else (*WITHOUT_MEMORY, *arguments), reliable
        )
        with mock.patch.object(rft_node, "DIAGNOSTICS_PERIOD", 0.1):
            self._rft = rft_node.RftNode(InlineWorker(), arguments=["--ros-args", *arguments])
        self._open(rft_node.executor_of(self._rft))
        self.executor.add_node(self._rft)
        self._log: list[str] = []
        latched = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.node.create_subscription(Log, "/rosout", self._on_log, latched)

    def _named(self, arguments: tuple[str, ...], reliable: bool) -> list[str]:
        """Chooses the node's name; the arguments that give it, before those of the test."""
        namespace = f"/node{next(_NUMBERS)}"
        self.name = f"{namespace}/rft"
        topics = (
            f"{self.name}/{topic}" for topic in ("pose", "twist", "wrench_measured") if reliable
        )
        qos = [
            w
            for t in topics
            for w in ("-p", f"qos_overrides.{t}.subscription.reliability:=reliable")
        ]
        return ["-r", f"__ns:={namespace}", *qos, *arguments]

    def _open(self, executor: Executor) -> None:
        """The peer, its inputs and the outputs that it receives."""
        self._stamp = 0
        self.node = rclpy.create_node("peer", namespace=self.name.rpartition("/")[0])
        self.executor = executor
        self.executor.add_node(self.node)
        qos = QoSProfile(depth=1000)
        self.open_inputs()
        self.received: dict[str, list[WrenchStamped]] = {topic: [] for topic in OUTPUTS}
        for topic in OUTPUTS:
            self.node.create_subscription(
                WrenchStamped, f"{self.name}/{topic}", self.received[topic].append, qos
            )
        self.diagnostics: list[DiagnosticArray] = []
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, qos)
        self._clients: dict[str, object] = {}

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        if message.status[0].name.startswith(
            f"{self.name}:"
        ):  # other nodes report on the same topic
            self.diagnostics.append(message)

    def _on_log(self, message: Log) -> None:
        if f"/{message.name.replace('.', '/')}" == self.name:
            self._log.append(message.msg)

    # --- life

    def open_inputs(self, qos: QoSProfile | None = None) -> None:
        qos = qos or QoSProfile(depth=1000)
        self.pose = self.node.create_publisher(PoseStamped, f"{self.name}/pose", qos)
        self.twist = self.node.create_publisher(TwistStamped, f"{self.name}/twist", qos)
        self.wrench = self.node.create_publisher(
            WrenchStamped, f"{self.name}/wrench_measured", qos
        )

    def close_inputs(self) -> None:
        for publisher in (self.pose, self.twist, self.wrench):
            self.node.destroy_publisher(publisher)

    def wait_ready(self) -> "Harness":
        """Until its services answer and every topic is matched."""
        self.get("mesh.file")
        publishers = (self.pose, self.twist, self.wrench)
        self.until(
            lambda: (
                all(p.get_subscription_count() > 0 for p in publishers)
                and all(self.node.count_publishers(f"{self.name}/{t}") > 0 for t in OUTPUTS)
            )
        )
        return self

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self._rft.destroy_node()

    def refuse(self, is_refused: Callable[[Parameter], bool], *, why: str) -> None:
        """Refuse parameters of the node from now on, as a callback of someone else's may."""

        def answer(changed: list[Parameter]) -> SetParametersResult:
            return SetParametersResult(successful=not any(map(is_refused, changed)), reason=why)

        self._rft.add_on_set_parameters_callback(answer)

    def said(self) -> str:
        """The node's log so far."""
        self.spin()
        return "\n".join(self._log)

    def check(self) -> None:
        """Fails if the node ended."""

    # --- waiting

    def spin(self, seconds: float = 0.0) -> None:
        end = time.monotonic() + seconds
        while True:
            self.executor.spin_once(timeout_sec=0.01)
            if time.monotonic() >= end:
                return

    def until(self, condition: Callable[[], object]) -> None:
        end = time.monotonic() + WAIT
        while not condition():
            self.check()
            assert time.monotonic() < end, "waited in vain"
            self.executor.spin_once(timeout_sec=0.05)
            for _ in range(20):  # one call takes one message; a condition may send several
                self.executor.spin_once(timeout_sec=0.0)

    # --- services

    def call(self, service: type, name: str, request: object) -> object:
        """The answer; after a minute without one a new client asks again, since a match can stay one-sided for good."""
        for _ in range(10):
            client = self._clients.get(name)
            if client is None:
                client = self._clients[name] = self.node.create_client(
                    service, f"{self.name}/{name}"
                )
            self.until(lambda client=client: client.wait_for_service(timeout_sec=0.5))
            future, end = client.call_async(request), time.monotonic() + 60.0
            self.until(lambda future=future, end=end: future.done() or time.monotonic() > end)
            if future.done():
                return future.result()
            self.node.destroy_client(self._clients.pop(name))
        raise AssertionError(f"no answer of {name} to ten clients")

    def get(self, name: str) -> ParameterValue:
        return self.call(
            GetParameters, "get_parameters", GetParameters.Request(names=[name])
        ).values[0]

    def set(self, **values: object) -> tuple[bool, str]:
        """Set parameters together (dots as double underscores); (successful, reason)."""
        request = SetParametersAtomically.Request(parameters=parameters(values))
        result = self.call(SetParametersAtomically, "set_parameters_atomically", request).result
        return result.successful, result.reason

    def trigger(self, service: str) -> tuple[bool, str]:
        answer = self.call(Trigger, service, Trigger.Request())
        return answer.success, answer.message

    # --- inputs

    def moment(self) -> int:
        """A stamp [ns] ten seconds after the last one."""
        self._stamp += 10 * 1_000_000_000
        return self._stamp

    def send(
        self,
        stamp: int,
        *,
        z: float = -0.01,
        quaternion: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0),
        frame: str = "world",
        linear: tuple[float, float, float] | None = (0.0, 0.0, -0.01),
        force: tuple[float, float, float] | None = (0.0, 0.0, 0.0),
        twist_stamp: int | None = None,
    ) -> None:
        """Send wrench and twist, then the pose that asks; None leaves an input out."""
        still = (0.0, 0.0, 0.0)
        if force is not None:
            self.wrench.publish(cdr("wrench", stamp, (*force, *still)))
        if linear is not None:
            when = stamp if twist_stamp is None else twist_stamp
            self.twist.publish(cdr("twist", when, (*linear, *still)))
        self.pose.publish(cdr("pose", stamp, (0.0, 0.0, z, *quaternion), frame))

    def ask(self, stamp: int, **inputs: object) -> WrenchStamped:
        """Send a moment and wait for its prediction.

        It is sent again every few seconds: the first may be lost, since a publisher can find its match before the match
        finds the publisher. The node does not answer a stamp twice.
        """
        again = 0.0

        def answer() -> WrenchStamped | None:
            nonlocal again
            if time.monotonic() > again:
                again = time.monotonic() + 3.0
                self.send(stamp, **inputs)
            return next(
                (m for m in self.received["wrench_predicted"] if stamp_of(m) == stamp), None
            )

        self.until(answer)
        return answer()

    def diagnostic(self, component: str) -> tuple[bytes, str, dict[str, str]]:
        """The next report of a component: level, message, values."""
        idle = 0
        while (
            idle < 20
        ):  # reports made before this call may be queued, among answers on other topics
            seen = len(self.diagnostics)
            self.executor.spin_once(timeout_sec=0.0)
            idle = 0 if len(self.diagnostics) > seen else idle + 1
        seen = len(self.diagnostics)
        self.until(lambda: len(self.diagnostics) > seen)
        return self.last_status(component)

    def last_status(self, component: str) -> tuple[bytes, str, dict[str, str]]:
        status = next(
            s for s in self.diagnostics[-1].status if s.name == f"{self.name}: {component}"
        )
        return status.level, status.message, {v.key: v.value for v in status.values}


class NodeProcess(Harness):
    """As `Harness`, with the node in a process of its own; `folder`: its working directory, whose package it runs.

    Its inputs' QoS is reliable, so that a busy machine loses no message.
    """

    def __init__(self, *arguments: str, log: Path, folder: Path | None = None) -> None:
        self.log = log
        with log.open("wb") as file:
            self.process = subprocess.Popen(
                [*NODE, *self._named((*WITHOUT_MEMORY, *arguments), reliable=True)],
                stderr=file,
                stdout=file,
                cwd=folder,
                preexec_fn=_end_with_tests,
            )
        # rclpy.spin_once would add and remove the node at each call
        self._open(SingleThreadedExecutor())

    def stop(self, number: int = signal.SIGINT) -> int:
        if self.process.poll() is None:
            self.process.send_signal(number)
        status = self.process.wait(WAIT)
        self.executor.shutdown()
        self.node.destroy_node()
        return status

    def close(self) -> None:
        if self.process.poll() is None:
            self.stop()

    def said(self) -> str:
        return self.log.read_text()

    def check(self) -> None:
        assert self.process.poll() is None, f"the node ended with status {self.process.returncode}"


def _end_with_tests() -> None:
    """In the child: be killed when the test process dies, so that no node of a broken run answers the next one."""
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


def predicted_by_the_core(
    *,
    law: str = "treers2021",
    zeta: float = 1.0,
    density: float = 0.0,
    alpha_y: str = "constant",
    mesh: str = "plate",
    quaternion=(0.0, 0.0, 0.0, 1.0),
    hull: bool = False,
    z: float = -0.01,
    linear=(0.0, 0.0, -0.01),
) -> np.ndarray:
    """What the node must answer to `Harness.send`'s defaults; the sensor's axes are the world's."""
    generic = MEDIA["generic"]
    model = alpha_y_model(alpha_y, generic)
    made = law_named(law, generic, model, zeta=zeta, density=density)
    state = checked_states([0.0, 0.0, z, 0.0, 0.0, 0.0, 1.0, *linear, 0.0, 0.0, 0.0])
    tool = _loaded(MeshConfig(file=mesh, quaternion=quaternion, hull=hull))
    return wrenches(tool.plates, made, state)[0, :6]


@cache
def _loaded(mesh: MeshConfig) -> Tool:
    return mesh.load()


def numbers(message: WrenchStamped) -> np.ndarray:
    f, t = message.wrench.force, message.wrench.torque
    return np.array([f.x, f.y, f.z, t.x, t.y, t.z])


def parameters(values: Mapping[str, object]) -> list[ParameterMessage]:
    return [
        Parameter(name.replace("__", "."), value=value).to_parameter_msg()
        for name, value in values.items()
    ]


def stamp_of(message: object) -> int:
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
