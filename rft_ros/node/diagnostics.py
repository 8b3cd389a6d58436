"""/diagnostics at 1 Hz: inputs, estimates and model, each OK, WARN or ERROR (REP 107)."""

from collections import Counter
from statistics import median

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from rft_ros.estimator import Estimate, Estimator, Reason
from rft_ros.estimator.quality import QualityFlag, deviation, flag_names, sentences, trust

__all__ = ["Diagnostics"]

_LATENCIES = 1000
_KINDS = ("pose", "twist", "wrench")


class Diagnostics:
    """Adds up what happens between two reports."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._latencies: list[float] = []
        self._last: Counter[str] = Counter()
        self.received: Counter[str] = Counter()
        self._received_last: Counter[str] = Counter()
        self.newest: dict[str, int] = {}
        self.last_swap_failure = ""
        self.preparing = ""
        self._newest_estimate: Estimate | None = None
        self._fastest = 0.0
        self._quality_flags = 0

    def received_one(self, kind: str, stamp: int) -> None:
        """Note that a pose, twist or wrench with this stamp [ns] arrived."""
        self.received[kind] += 1
        self.newest[kind] = stamp

    def tick(self, seconds: float, answer: Estimate) -> None:
        """Note one answered pose and the time from its callback's start to the last publication [s]."""
        if len(self._latencies) < _LATENCIES:
            self._latencies.append(seconds)
        self._newest_estimate = answer
        self._quality_flags |= answer.quality_flags
        if answer.speed > self._fastest:
            self._fastest = answer.speed

    def status(self, estimator: Estimator) -> tuple[bool, str]:
        """Whether the last swap went well, and what is in force, being prepared or went wrong, in a sentence."""
        model = estimator.model
        force = f"generation {model.generation}: tool {model.tool.name} in force"
        if self.last_swap_failure:
            return False, f"{force}; the last swap failed: {self.last_swap_failure}"
        return True, f"{force}; preparing {self.preparing}" if self.preparing else force

    def report(self, now: int, estimator: Estimator, period: float) -> tuple[DiagnosticArray, list[str]]:
        """The message at time `now` [ns], and the reasons that came up since the last one as sentences for the log."""
        new = Counter(estimator.counts)
        new.subtract(self._last)
        self._last = Counter(estimator.counts)
        rates = {k: (self.received[k] - self._received_last[k]) / period for k in _KINDS}
        self._received_last = Counter(self.received)
        reasons = {k: n for k, n in new.items() if n and k != "estimates"}
        frames = estimator.unknown_frames()
        named = {reason: f"{reason} ({frames[reason]})" if reason in frames else reason for reason in reasons}
        array = DiagnosticArray()
        array.header.stamp.sec, array.header.stamp.nanosec = divmod(now, 1_000_000_000)
        array.status = [
            self._inputs(now, rates, named, estimator),
            self._estimates(new, reasons, estimator),
            self._model(estimator),
        ]
        self._latencies.clear()
        self._fastest = 0.0
        self._quality_flags = 0
        return array, [f"{named[reason]}: {n} in the last {period:.0f} s" for reason, n in sorted(reasons.items())]

    def _status(self, component: str, level: bytes, message: str, values: dict[str, object]) -> DiagnosticStatus:
        pairs = [KeyValue(key=k, value=f"{v:.6g}" if isinstance(v, float) else str(v)) for k, v in values.items()]
        return DiagnosticStatus(level=level, name=f"{self._name}: {component}", message=message, values=pairs)

    def _inputs(
        self, now: int, rates: dict[str, float], named: dict[str, str], estimator: Estimator
    ) -> DiagnosticStatus:
        values: dict[str, object] = {f"{k}_rate_hz": r for k, r in rates.items()}
        values.update({f"{k}_age_s": (now - stamp) * 1e-9 for k, stamp in self.newest.items()})
        values.update({f"count.{k}": n for k, n in estimator.counts.items() if k != "estimates"})
        if rates["pose"] == 0.0:
            return self._status("inputs", DiagnosticStatus.ERROR, "no poses", values)
        bad = [text for r, text in named.items() if r not in (Reason.AT_REST.value, Reason.POSE_RATE_LIMITED.value)]
        if bad:
            return self._status("inputs", DiagnosticStatus.WARN, ", ".join(sorted(bad)), values)
        return self._status("inputs", DiagnosticStatus.OK, "inputs arrive", values)

    def _estimates(self, new: Counter[str], reasons: dict[str, int], estimator: Estimator) -> DiagnosticStatus:
        values: dict[str, object] = {
            "estimates": estimator.counts["estimates"],
            "last_reason": max(reasons, key=lambda r: reasons[r]) if reasons else "",
            "fastest_m_s": self._fastest,
            "depth_m": estimator.depth(),
            "trust": trust(self._quality_flags).value,
            "quality_flags": ", ".join(flag_names(self._quality_flags)),
        }
        if (newest := self._newest_estimate) is not None:
            values["speed_m_s"] = newest.speed
            values["force_deviation_n"], values["torque_deviation_nm"] = deviation(newest.predicted)
        if self._latencies:
            ordered = sorted(self._latencies)
            values["latency_median_us"] = 1e6 * median(ordered)
            values["latency_p99_us"] = 1e6 * ordered[int(0.99 * (len(ordered) - 1))]
        if not new["estimates"]:
            return self._status("estimates", DiagnosticStatus.WARN, "no estimates", values)
        if self._quality_flags:
            speed = (
                f"{self._fastest:.3f} m/s is " if self._quality_flags & QualityFlag.FAST else ""
            )  # the first of the sentences
            message = speed + sentences(self._quality_flags)
            return self._status("estimates", DiagnosticStatus.WARN, message, values)
        return self._status("estimates", DiagnosticStatus.OK, f"{new['estimates']} estimates", values)

    def _model(self, estimator: Estimator) -> DiagnosticStatus:
        model = estimator.model
        values: dict[str, object] = {
            "tool": model.tool.name,
            "facets": len(model.tool.facets),
            "plates": len(model.tool.plates),
            "medium": model.medium,
            "zeta": model.zeta,
            "alpha_y": model.alpha_y,
            "generation": model.generation,
            "preparing": self.preparing,
            "last_swap_failure": self.last_swap_failure,
        }
        if self.last_swap_failure:
            return self._status("model", DiagnosticStatus.WARN, self.last_swap_failure, values)
        issues = "; ".join(f.message for f in model.tool.issues)
        level = DiagnosticStatus.WARN if issues else DiagnosticStatus.OK
        return self._status("model", level, issues or "in force", values)
