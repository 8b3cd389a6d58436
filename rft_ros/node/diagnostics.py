"""/diagnostics at 1 Hz: inputs, estimates and model, each OK, WARN or ERROR (REP 107)."""

import math
from collections import Counter
from dataclasses import asdict, dataclass
from statistics import median

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from rft_ros.estimator import Estimate, Estimator, Reason
from rft_ros.estimator.learning import Learning
from rft_ros.estimator.quality import QualityFlag, Trust, flag_names, sentences, trust
from rft_ros.node.learned_medium import surprise_sentence
from rft_ros.node.swap import ToolSwap

__all__ = ["Diagnostics", "LogLine"]

_LATENCIES = 1000
_KINDS = ("pose", "twist", "wrench")
_QUIET_REPORTS = 3
_NORMAL = {Reason.AT_REST.value, Reason.POSE_RATE_LIMITED.value}
"""Reasons that are part of normal operation: neither a warning in the log nor in the status."""


@dataclass(frozen=True, slots=True)
class LogLine:
    """A reason that began or ended, in a sentence."""

    text: str
    warning: bool


class Diagnostics:
    """Adds up what happens between two reports."""

    def __init__(self, name: str, estimator: Estimator, swap: ToolSwap) -> None:
        self._name = name
        self._estimator = estimator
        self._swap = swap
        self._latencies: list[float] = []
        self._reported: Counter[str] = Counter()
        self._received: Counter[str] = Counter()
        self.newest: dict[str, int] = {}
        """By kind of input: stamp [ns] of the last message."""
        self._newest_estimate: Estimate | None = None
        self._fastest = 0.0
        self._quality_flags = 0
        self._ongoing: dict[str, tuple[int, int]] = {}  # by reason: how often so far, reports since the last time

    def received_one(self, kind: str, stamp: int) -> None:
        """Note that a pose, twist or wrench with this stamp [ns] arrived."""
        self._received[kind] += 1
        self.newest[kind] = stamp

    def tick(self, seconds: float, answer: Estimate) -> None:
        """Note one answered pose and the time from its callback's start to the last publication [s]."""
        if len(self._latencies) < _LATENCIES:
            self._latencies.append(seconds)
        self._newest_estimate = answer
        self._quality_flags |= answer.quality_flags
        if answer.speed > self._fastest:
            self._fastest = answer.speed

    def status(self) -> tuple[bool, str]:
        """Whether the last swap succeeded, and which tool is in force, being prepared or has failed, in a sentence."""
        model = self._estimator.model
        force = f"generation {model.generation}: tool {model.tool.name} in force"
        preparing = f"; preparing {self._swap.preparing}" if self._swap.preparing else ""
        if self._swap.last_failure:
            return False, f"{force}{preparing}; the last swap failed: {self._swap.last_failure}"
        return True, force + preparing

    def report(self, now: int, period: float) -> tuple[DiagnosticArray, list[LogLine]]:
        """The message at time `now` [ns], and a log line for each reason that began or ended since the last report."""
        new = Counter(self._estimator.counts)
        new.subtract(self._reported)
        self._reported = Counter(self._estimator.counts)
        reasons = {k: n for k, n in new.items() if n and k != "estimates"}
        frames = self._estimator.unknown_frames()
        named = {r: f"{r} ({frames[r]})" if r in frames else r for r in reasons}
        array = DiagnosticArray()
        array.header.stamp.sec, array.header.stamp.nanosec = divmod(now, 1_000_000_000)
        array.status = [self._inputs(now, period, named), self._estimates(new, reasons), self._model()]
        if self._estimator.learning is not None:
            array.status.append(self._medium(self._estimator.learning))
        self._received.clear()
        self._latencies.clear()
        self._fastest = 0.0
        self._quality_flags = 0
        return array, self._began_and_ended(reasons, named, period)

    def _began_and_ended(self, reasons: dict[str, int], named: dict[str, str], period: float) -> list[LogLine]:
        lines = []
        for reason, n in sorted(reasons.items()):
            if reason not in self._ongoing:
                text = f"{named[reason]}: began, {n} in the last {period:.0f} s"
                lines.append(LogLine(text, warning=reason not in _NORMAL))
            self._ongoing[reason] = self._ongoing.get(reason, (0, 0))[0] + n, 0
        for reason, (total, quiet) in list(self._ongoing.items()):
            if reason in reasons:
                continue
            self._ongoing[reason] = total, quiet + 1
            if quiet + 1 >= _QUIET_REPORTS:
                del self._ongoing[reason]
                lines.append(LogLine(f"{reason}: ended, {total} in all", warning=False))
        return lines

    def _status(self, component: str, level: bytes, message: str, values: dict[str, object]) -> DiagnosticStatus:
        pairs = [KeyValue(key=k, value=f"{v:.6g}" if isinstance(v, float) else str(v)) for k, v in values.items()]
        return DiagnosticStatus(level=level, name=f"{self._name}: {component}", message=message, values=pairs)

    def _inputs(self, now: int, period: float, named: dict[str, str]) -> DiagnosticStatus:
        values: dict[str, object] = {f"{k}_rate_hz": self._received[k] / period for k in _KINDS}
        values.update({f"{k}_age_s": (now - stamp) * 1e-9 for k, stamp in self.newest.items()})
        values.update({f"count.{k}": n for k, n in self._estimator.counts.items() if k != "estimates"})
        if not self._received["pose"]:
            return self._status("inputs", DiagnosticStatus.ERROR, "no poses", values)
        if bad := sorted(text for reason, text in named.items() if reason not in _NORMAL):
            return self._status("inputs", DiagnosticStatus.WARN, ", ".join(bad), values)
        return self._status("inputs", DiagnosticStatus.OK, "inputs arrive", values)

    def _estimates(self, new: Counter[str], reasons: dict[str, int]) -> DiagnosticStatus:
        flags = self._quality_flags
        values: dict[str, object] = {
            "estimates": self._estimator.counts["estimates"],
            "last_reason": max(reasons, key=lambda r: reasons[r]) if reasons else "",
            "fastest_m_s": self._fastest,
            "depth_m": self._estimator.depth(),
            "trust": (trust(flags) if new["estimates"] else Trust.NO).value,
            "quality_flags": ", ".join(flag_names(flags)),
        }
        if (newest := self._newest_estimate) is not None:
            values["speed_m_s"] = newest.speed
            values["force_sigma_n"] = math.hypot(*newest.sigma[:3])
            values["torque_sigma_nm"] = math.hypot(*newest.sigma[3:])
        if self._latencies:
            ordered = sorted(self._latencies)
            values["latency_median_us"] = 1e6 * median(ordered)
            values["latency_p99_us"] = 1e6 * ordered[int(0.99 * (len(ordered) - 1))]
        if not new["estimates"]:
            return self._status("estimates", DiagnosticStatus.WARN, "no estimates", values)
        if flags:
            speed = f"{self._fastest:.3f} m/s is " if flags & QualityFlag.FAST else ""  # "faster" is the first sentence
            return self._status("estimates", DiagnosticStatus.WARN, speed + sentences(flags), values)
        return self._status("estimates", DiagnosticStatus.OK, f"{new['estimates']} estimates", values)

    def _model(self) -> DiagnosticStatus:
        model = self._estimator.model
        failure = self._swap.last_failure
        values: dict[str, object] = {
            "tool": model.tool.name,
            "facets": len(model.tool.facets),
            "plates": len(model.tool.plates),
            "medium": model.medium,
            "zeta": model.zeta,
            "alpha_y": model.alpha_y,
            "generation": model.generation,
            "preparing": self._swap.preparing,
            "last_swap_failure": failure,
        }
        problems = failure or "; ".join(issue.message for issue in model.tool.issues)
        level = DiagnosticStatus.WARN if problems else DiagnosticStatus.OK
        return self._status("model", level, problems or "in force", values)

    def _medium(self, learning: Learning) -> DiagnosticStatus:
        issues = [str(issue) for issue in learning.issues()]
        values: dict[str, object] = {**asdict(learning.belief()), "issues": "; ".join(issues)}
        if issues:
            return self._status("medium", DiagnosticStatus.WARN, "; ".join(issues), values)
        if learning.surprise:
            return self._status("medium", DiagnosticStatus.WARN, surprise_sentence(learning), values)
        return self._status("medium", DiagnosticStatus.OK, "as learned", values)
