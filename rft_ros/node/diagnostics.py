"""/diagnostics at 1 Hz: inputs, estimates, model and what was learned, each OK, WARN or ERROR (REP 107)."""

from collections import Counter

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from rft_ros.errors import InputError
from rft_ros.estimator import (
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
from rft_ros.messages import Role
from rft_ros.node.swap import Swap

DIAGNOSTICS_PERIOD = 1.0  # s, between two reports
_QUIET_REPORTS = 3  # a problem that is missing in this many successive reports has ended
_NORMAL = {Reason.AT_REST, Reason.POSE_RATE_LIMITED, Reason.SURFACE_RATE_LIMITED}  # no problems


class Diagnostics:
    """Counts messages and estimates, and publishes and logs what happened since the last report."""

    def __init__(self, node: Node, estimator: Estimator, swap: Swap) -> None:
        self._node = node
        self._estimator = estimator
        self._swap = swap
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._reported = Counter[Reason]()  # until the last report, as the next
        self._reported_estimates = 0
        self._newest: dict[Role, int] = {}  # stamp [ns] of the last message
        self._ongoing: dict[
            str, int
        ] = {}  # for each problem, the number of reports since it was last present
        self._idle = True  # no pose came in the second before the last report
        self._answered = False  # whether an estimate has come
        # of a first estimate that is in the grains [m], until it is logged
        self._first_depth: float | None = None
        self._start_period()

    def _start_period(self) -> None:
        self._received: Counter[Role] = Counter()
        self._latencies: list[float] = []
        self._fastest = 0.0
        self._quality_flags = 0

    def received(self, role: Role, stamp: int) -> None:
        """Count a message with this stamp [ns]."""
        self._received[role] += 1
        self._newest[role] = stamp

    def answered(self, estimate: Estimate, latency: float) -> None:
        """Record an estimate, and the time from its pose's callback to its publication [s]."""
        self._latencies.append(latency)
        self._quality_flags |= estimate.quality_flags
        self._fastest = max(self._fastest, estimate.speed_bound)
        if not self._answered and estimate.submerged_area > 0.0:
            depth = self._estimator.depth()
            self._first_depth = depth if depth > 0.0 else None
        self._answered = True

    def summary(self) -> str:
        """A sentence on the current tool and a swap in progress. Raises InputError, which adds the problems, if any."""
        model = self._estimator.model
        message = f"generation {model.generation}: tool {model.tool.name} in force"
        if self._swap.preparing:
            message += f"; preparing {self._swap.preparing}"
        problems = (
            [f"the last swap failed: {self._swap.last_failure}"] if self._swap.last_failure else []
        )
        problems += ["no poses come"] if self._idle else []
        problems += map(self._sentence, sorted(self._ongoing))
        if problems:
            raise InputError("; ".join([message, *problems]))
        return message

    def publish(self) -> None:
        """Publish the statuses, and log each problem that began or ended since the last report."""
        now = self._node.get_clock().now()
        counts = Counter(self._estimator.counts)
        new = counts - self._reported
        self._reported = counts
        estimates = self._estimator.estimates
        new_estimates = estimates - self._reported_estimates
        self._reported_estimates = estimates
        bad: list[str] = [*sorted(new.keys() - _NORMAL)]
        array = DiagnosticArray()
        learning = self._estimator.learning
        issues = self._estimator.issues()
        array.header.stamp = now.to_msg()
        # with learning, the status of the medium has them
        of_inputs = bad if learning is not None else bad + issues
        array.status = [
            self._inputs(now.nanoseconds, of_inputs),
            self._estimates(new_estimates),
            self._model(),
        ]
        bad += issues
        if learning is not None:
            if learning.change:
                bad.append(f"grains {learning.change} than learned")
            array.status.append(self._medium(learning, issues))
        self._publisher.publish(array)
        self._log_changes(bad)
        if self._first_depth is not None:
            self._node.get_logger().warning(begins_in_grains(self._first_depth))
            self._first_depth = None
        self._idle = not self._received["pose"]
        self._start_period()

    def _sentence(self, problem: str) -> str:
        """The problem; for an unknown frame, with a sentence that names it."""
        sentences = {
            str(reason): sentence for reason, sentence in self._estimator.unknown_frames().items()
        }
        return f"{problem} ({sentences[problem]})" if problem in sentences else problem

    def _log_changes(self, problems: list[str]) -> None:
        logger = self._node.get_logger()
        for problem in problems:
            if problem not in self._ongoing:
                logger.warning(f"began: {self._sentence(problem)}")
        self._ongoing = {problem: n + 1 for problem, n in self._ongoing.items()} | dict.fromkeys(
            problems, 0
        )
        for problem in [problem for problem, n in self._ongoing.items() if n >= _QUIET_REPORTS]:
            del self._ongoing[problem]
            logger.info(f"ended: {problem}")

    def _status(
        self,
        component: str,
        values: dict[str, object],
        *,
        problem: str,
        fine: str,
        level: bytes = DiagnosticStatus.WARN,
    ) -> DiagnosticStatus:
        """A status of this `level` with the `problem`; if there is none, OK with the message `fine`."""
        pairs = [
            KeyValue(key=k, value=f"{v:.6g}" if isinstance(v, float) else str(v))
            for k, v in values.items()
        ]
        if not problem:
            level = DiagnosticStatus.OK
        name = f"{self._node.get_fully_qualified_name()}: {component}"
        return DiagnosticStatus(level=level, name=name, message=problem or fine, values=pairs)

    def _inputs(self, now: int, bad: list[str]) -> DiagnosticStatus:
        roles: tuple[Role, ...] = ("pose", "twist", "wrench")
        values: dict[str, object] = {
            f"{role}_rate_hz": self._received[role] / DIAGNOSTICS_PERIOD for role in roles
        }
        values |= {f"{role}_age_s": (now - stamp) * 1e-9 for role, stamp in self._newest.items()}
        values |= {f"count.{k}": n for k, n in self._estimator.counts.items()}
        problems = list(map(self._sentence, bad))
        level = DiagnosticStatus.WARN
        if not self._received["pose"]:
            problems = ["no poses", *problems]
            level = DiagnosticStatus.ERROR
        return self._status(
            "inputs", values, problem=", ".join(problems), fine="inputs arrive", level=level
        )

    def _estimates(self, new: int) -> DiagnosticStatus:
        flags = self._quality_flags
        values: dict[str, object] = {
            "estimates": self._estimator.estimates,
            "fastest_m_s": self._fastest,
            "depth_m": self._estimator.depth(),
            "trust": (trust(flags) if new else Trust.NO).value,
            "quality_flags": ", ".join(flag_names(flags)),
        }
        if self._latencies:
            values["latency_median_us"], values["latency_p99_us"] = 1e6 * np.percentile(
                self._latencies, (50, 99)
            )
        # completes the sentence of FAST
        speed = f"{self._fastest:.3f} m/s is " if flags & QualityFlag.FAST else ""
        problem = speed + sentences(flags) if new else "no estimates"
        return self._status("estimates", values, problem=problem, fine=f"{new} estimates")

    def _model(self) -> DiagnosticStatus:
        model = self._estimator.model
        swap = self._swap
        tool = model.tool
        values: dict[str, object] = {
            "tool": tool.name,
            "facets": len(tool.facets),
            "plates": len(tool.plates),
        }
        values |= {"law": model.law.name, **model.law.stresses, "zeta": model.law.zeta}
        values |= {"mobilization_length": model.law.mobilization_length}
        values |= {
            "generation": model.generation,
            "preparing": swap.preparing,
            "last_swap_failure": swap.last_failure,
        }
        problems = swap.last_failure or "; ".join(tool.issues.values())
        return self._status("model", values, problem=problems, fine="in force")

    def _medium(self, learning: Learning, issues: list[str]) -> DiagnosticStatus:
        problem = "; ".join(issues) or learning.surprise_sentence()
        return self._status(
            "medium", learning.belief()._asdict(), problem=problem, fine="as learned"
        )
