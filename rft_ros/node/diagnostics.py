"""/diagnostics at 1 Hz: inputs, estimates, model and what was learned, each OK, WARN or ERROR (REP 107)."""

from collections import Counter

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from rft_ros.errors import InputError
from rft_ros.estimator import (
    TOUCH_DEPTH_M,
    Estimate,
    Estimator,
    QualityFlag,
    Reason,
    Trust,
    begins_in_grains,
    flag_names,
    sentences,
    trust,
)
from rft_ros.estimator.learning import Learning
from rft_ros.estimator.pose_noise import NOISY_SENTENCE
from rft_ros.estimator.samples import DOCTOR_ON_FRAMES
from rft_ros.messages import TOPICS, Role
from rft_ros.node.swap import Swap

DIAGNOSTICS_PERIOD = 1.0  # s, between two reports
_QUIET_REPORTS = 3  # a problem that is missing in this many successive reports has ended
_WITH_ONE_PUBLISHER: tuple[Role, ...] = ("pose", "twist", "wrench")
_NORMAL = {Reason.AT_REST, Reason.POSE_RATE_LIMITED, Reason.SURFACE_RATE_LIMITED}  # no problems
_NORMAL_AT_START = _NORMAL | {Reason.POSE_HISTORY_SHORT}


class Diagnostics:
    """Counts messages and estimates, and publishes and logs what happened since the last report."""

    def __init__(self, node: Node, estimator: Estimator, swap: Swap) -> None:
        self._node = node
        self._estimator = estimator
        self._swap = swap
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._reported = Counter[Reason]()  # until the last report
        self._newest: dict[str, int] = {}  # by role, stamp [ns] of the last message
        self._ongoing: dict[str, int] = {}  # reports without a problem after which it has ended
        self._idle = True  # no pose came in the second before the last report
        self._start_period()

    def _start_period(self) -> None:
        self._received = Counter[str]()
        self._latencies: list[float] = []
        self._fastest = 0.0
        self._quality_flags = 0

    def received(self, role: str, stamp: int) -> None:
        """Count a message with this stamp [ns]."""
        self._received[role] += 1
        self._newest[role] = stamp

    def answered(self, estimate: Estimate, latency: float) -> None:
        """Record an estimate, and the time from its pose's callback to its publication [s]."""
        self._latencies.append(latency)
        self._quality_flags |= estimate.quality_flags
        self._fastest = max(self._fastest, estimate.speed_bound)
        if self._estimator.estimates == 1:
            depth = self._estimator.depth()
            # with integration centroid a corner may be below the surface, and no plate
            if depth > TOUCH_DEPTH_M and estimate.submerged_area > 0.0:
                self._node.get_logger().warning(begins_in_grains(depth))

    def summary(self) -> str:
        """A sentence on the current tool and a swap in progress. Raises InputError, which adds the problems, if any."""
        model = self._estimator.model
        message = f"generation {model.generation}: tool {model.tool.name} in force"
        if self._swap.preparing:
            message += f"; preparing {self._swap.preparing}"
        problems = [self._sentence(problem) for problem in sorted(self._ongoing)]
        if self._idle:
            problems.insert(0, "no poses come")
        if self._swap.last_failure:
            problems.insert(0, f"the last swap failed: {self._swap.last_failure}")
        if problems:
            raise InputError("; ".join([message, *problems]))
        return message

    def publish(self) -> None:
        """Publish the statuses, and log each problem that began or ended since the last report."""
        now = self._node.get_clock().now()
        counts = Counter(self._estimator.counts)
        # poses came in the second before, too, and still no estimate
        is_start_over = not self._latencies and not self._idle
        normal = _NORMAL if is_start_over else _NORMAL_AT_START
        bad: list[str] = [*sorted((counts - self._reported).keys() - normal)]
        crowded = self._crowded_topics()
        issues = self._estimator.issues()
        if crowded:  # mixed poses look like noise
            issues = [issue for issue in issues if issue != NOISY_SENTENCE]
        issues += crowded
        if self._quality_flags & QualityFlag.IMPOSSIBLE:  # as with poses in millimetres
            issues.append(QualityFlag.IMPOSSIBLE.sentence)
        learning = self._estimator.learning
        self._reported = counts
        self._idle = not self._received["pose"]
        # with learning, the status of the medium has the issues
        of_inputs = bad + issues if learning is None else bad
        statuses = [self._inputs(now.nanoseconds, of_inputs), self._estimates(), self._model()]
        if learning is not None:
            statuses.append(self._medium(learning, issues))
            if learning.change:
                issues.append(f"grains {learning.change} than learned")
        array = DiagnosticArray(status=statuses)
        array.header.stamp = now.to_msg()
        self._publisher.publish(array)
        self._log_changes(bad + issues)
        self._start_period()

    def _crowded_topics(self) -> list[str]:
        """A sentence on each input that has several publishers, whose messages the node cannot tell apart."""
        found = []
        for role in _WITH_ONE_PUBLISHER:
            topic = self._node.resolve_topic_name(TOPICS[role])
            if self._node.count_publishers(topic) < 2:
                continue
            publishers = self._node.get_publishers_info_by_topic(topic)
            names = ", ".join(sorted(publisher.node_name for publisher in publishers))
            found.append(f"{len(publishers)} publishers on {topic} ({names}): stop all but one")
        return found

    def _sentence(self, problem: str) -> str:
        """The problem; for an unknown frame, with a sentence that names it."""
        sentences = {
            str(reason): sentence for reason, sentence in self._estimator.unknown_frames().items()
        }
        if problem not in sentences:
            return problem
        return f"{problem} ({sentences[problem]}; {DOCTOR_ON_FRAMES})"

    def _log_changes(self, problems: list[str]) -> None:
        logger = self._node.get_logger()
        for problem in problems:
            if problem not in self._ongoing:
                logger.warning(f"began: {self._sentence(problem)}")
            self._ongoing[problem] = _QUIET_REPORTS + 1
        for problem in [*self._ongoing]:
            self._ongoing[problem] -= 1
            if not self._ongoing[problem]:
                del self._ongoing[problem]
                logger.info(f"ended: {problem}")

    def _status(
        self, component: str, values: dict[str, object], *, problem: str, fine: str
    ) -> DiagnosticStatus:
        """A warning of the `problem`; if there is none, OK with the message `fine`."""
        pairs = [
            KeyValue(key=k, value=f"{v:.6g}" if isinstance(v, float) else str(v))
            for k, v in values.items()
        ]
        return DiagnosticStatus(
            level=DiagnosticStatus.WARN if problem else DiagnosticStatus.OK,
            name=f"{self._node.get_fully_qualified_name()}: {component}",
            message=problem or fine,
            values=pairs,
        )

    def _inputs(self, now: int, bad: list[str]) -> DiagnosticStatus:
        values: dict[str, object] = {
            f"{role}_rate_hz": self._received[role] / DIAGNOSTICS_PERIOD
            for role in ("pose", "twist", "wrench")
        }
        values |= {f"{role}_age_s": (now - stamp) * 1e-9 for role, stamp in self._newest.items()}
        values |= {f"count.{k}": n for k, n in self._estimator.counts.items()}
        problems = ["no poses"] if self._idle else []
        problems += map(self._sentence, bad)
        status = self._status("inputs", values, problem=", ".join(problems), fine="inputs arrive")
        if self._idle:
            status.level = DiagnosticStatus.ERROR
        return status

    def _estimates(self) -> DiagnosticStatus:
        new = len(self._latencies)
        flags = self._quality_flags
        values: dict[str, object] = {
            "estimates": self._estimator.estimates,
            "fastest_m_s": self._fastest,
            "depth_m": self._estimator.depth(),
            "trust": (trust(flags) if new else Trust.NO).value,
            "quality_flags": ", ".join(flag_names(flags)),
        }
        problem = sentences(flags)
        if flags & QualityFlag.FAST:  # whose sentence this completes
            problem = f"{self._fastest:.3f} m/s is {problem}"
        if new:
            values["latency_median_us"] = 1e6 * np.median(self._latencies)
            values["latency_p99_us"] = 1e6 * np.percentile(self._latencies, 99)
        else:
            problem = "no estimates"
        return self._status("estimates", values, problem=problem, fine=f"{new} estimates")

    def _model(self) -> DiagnosticStatus:
        model = self._estimator.model
        tool = model.tool
        law = model.law
        failure = self._swap.last_failure
        values: dict[str, object] = {
            "tool": tool.name,
            "facets": len(tool.facets),
            "plates": len(tool.plates),
            "law": law.name,
            **law.stresses,
            "zeta": law.zeta,
            "mobilization_length": law.mobilization_length,
            "generation": model.generation,
            "preparing": self._swap.preparing,
            "last_swap_failure": failure,
        }
        problem = failure or "; ".join(tool.issues.values())
        return self._status("model", values, problem=problem, fine="in force")

    def _medium(self, learning: Learning, issues: list[str]) -> DiagnosticStatus:
        return self._status(
            "medium",
            learning.belief()._asdict(),
            problem="; ".join(issues) or learning.surprise_sentence(),
            fine="as learned",
        )
