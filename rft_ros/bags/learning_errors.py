"""The error of a replay's predictions without and with learning, from estimators that run beside the replay."""

from collections import deque
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from rft_ros.bags.estimates import Trace
from rft_ros.bags.statistics import statistics
from rft_ros.estimator import Estimate, Estimator, Model, Settings
from rft_ros.estimator.messages import Sample
from rft_ros.estimator.tool_poses import push

__all__ = ["LearningErrors"]

_SECOND_LAG = 0.005
_METRICS = ("rms_over_peak", "median_relative_error", "within_sigma", "within_two_sigma")


class LearningErrors:
    """Runs beside a replay, by name: without learning, with learning at `learning_lag`, and with a lag of 5 mm.

    No runs if `learning_mode` is off. `traces` closes their scratch files, which are in `folder`.
    """

    def __init__(self, settings: Settings, model: Model, traces: ExitStack, folder: Path) -> None:
        runs = {"off": replace(settings, learning_mode="off")}
        for lag in (settings.learning_lag, _SECOND_LAG):
            runs[f"{1e3 * lag:g} mm"] = replace(settings, learning_mode="apply", learning_lag=lag)
        self._runs = {
            name: (Estimator(own, model), traces.enter_context(Trace(folder)), deque[Estimate]())
            for name, own in (runs.items() if settings.learning_mode != "off" else ())
        }

    def push(self, sample: Sample) -> None:
        """Push a sample of the replay into every run."""
        for estimator, trace, waiting in self._runs.values():
            answer = push(estimator, sample)
            if isinstance(answer, Estimate):
                waiting.append(answer)
            self._collect(estimator, trace, waiting)

    def _collect(self, estimator: Estimator, trace: Trace, waiting: deque[Estimate]) -> None:
        for measurement in estimator.measurements():
            # depth and state are those of a later pose; `finish` uses neither
            trace.add(estimator.depth(), waiting.popleft(), measurement, None, estimator.state.tobytes())

    def finish(self) -> dict[str, dict[str, float | None]]:
        """Metrics of `Group` over all estimates of each run, after the last sample; by name of the run and the metric.

        No prediction uses its own load-cell sample.
        """
        found = {}
        for name, (estimator, trace, waiting) in self._runs.items():
            estimator.finish()
            self._collect(estimator, trace, waiting)
            group, _ = statistics(trace.rows())
            found[name] = {metric: getattr(group, metric) for metric in _METRICS}
        return found
