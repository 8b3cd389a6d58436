"""Samples of any kind into an estimator, and the tool's poses from transforms, for `pose_source` tf."""

from collections import deque

from rft_ros.estimator.estimator import Estimator
from rft_ros.estimator.messages import Sample, Stamped
from rft_ros.estimator.samples import TIME_JUMP, Estimate, NoEstimate, PoseSample, Reason, TwistSample, WrenchSample
from rft_ros.ground import Cloud

__all__ = ["ToolPoses", "push"]

_PATIENCE = 1_000_000_000  # ns of other inputs' stamps to wait for a transform: a process may stall by less
_MOST_WANTED = 4096


def push(estimator: Estimator, sample: Sample) -> Estimate | NoEstimate | None:
    """Push a sample of any kind; the answer if it is a pose."""
    if isinstance(sample, PoseSample):
        return estimator.push_pose(sample)
    if isinstance(sample, TwistSample):
        estimator.push_twist(sample)
    elif isinstance(sample, WrenchSample):
        estimator.push_wrench(sample)
    elif isinstance(sample, Cloud):
        estimator.push_surface(sample)
    else:
        for transform in sample:
            estimator.push_transform(transform)
    return None


class ToolPoses:
    """Poses of `tool_frame` in `world_frame`, from an estimator's transforms.

    Their stamps are the load cell's or, with `tf_rate`, multiples of its period. A pose is ready once the transforms on
    both sides of its stamp have come, so it depends on stamps only. A stamp for which they do not come within 1 s of
    the other inputs' stamps has no pose; the estimator's `counts` get the reason.
    """

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._wanted: deque[int] = deque()
        self._last = 0  # stamp that was wanted last
        self._newest = 0  # stamp of the last transforms whose poses were taken at `tf_rate`

    def after(self, sample: Sample) -> list[PoseSample]:
        """The poses that are ready after a sample that the estimator was given."""
        rate = self._estimator.settings.tf_rate
        if isinstance(sample, WrenchSample) and rate == 0.0 and sample.stamp > 0:
            self._want(sample.stamp)
        if isinstance(sample, Stamped):
            return self._ready(sample.stamp)
        if rate > 0.0:
            self._want_at(rate)
        return self._ready(max((transform.stamp for transform in sample), default=0))

    def _want_at(self, rate: float) -> None:
        settings = self._estimator.settings
        newest = self._estimator.transforms.newest(settings.world_frame, settings.tool_frame)
        if newest is None:
            return
        period = round(min(1e9 / rate, 1e18))
        if not -TIME_JUMP < newest - self._newest < _PATIENCE:  # a new run, or nothing came for long
            if newest < self._newest:
                self._wanted.clear()
            self._newest = newest - 1
            self._last = min(self._last, self._newest)
        for stamp in range((self._newest // period + 1) * period, newest + 1, period):
            self._want(stamp)
        self._newest = max(newest, self._newest)

    def _want(self, stamp: int) -> None:
        if self._last - stamp >= TIME_JUMP:
            self._wanted.clear()
            self._estimator.transforms.begin_again(stamp)
        elif stamp <= self._last:
            return
        self._last = stamp
        self._wanted.append(stamp)

    def _ready(self, now: int) -> list[PoseSample]:
        settings, transforms = self._estimator.settings, self._estimator.transforms
        max_age = round(1e9 * settings.max_input_age)
        found = []
        while self._wanted:
            stamp = self._wanted[0]
            placement = transforms.at(settings.world_frame, settings.tool_frame, stamp, max_age)
            if isinstance(placement, Reason):
                may_pass = placement in (Reason.TF_STALE, Reason.TF_FRAME_UNKNOWN)
                if may_pass and now <= stamp + _PATIENCE and len(self._wanted) < _MOST_WANTED:
                    break
                self._estimator.counts[placement.value] += 1
            else:
                found.append(PoseSample(stamp, settings.world_frame, *placement))
            self._wanted.popleft()
        return found
