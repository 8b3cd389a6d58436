"""The comparison of each prediction with the load cell's reading at its stamp, which also updates the filter."""

from collections import Counter

from rft_ros.estimator.lifetimes import Lifetimes
from rft_ros.estimator.load_cell import Prediction
from rft_ros.estimator.samples import Measurement, Reason
from rft_ros.estimator.timeline import interpolated, patience
from rft_ros.rft.frames import Wrench

# estimates that wait for samples; if there are more, the oldest is compared early
_MAX_PENDING_COUNT = 4096


class Comparison:
    """Compares each prediction with the load cell, once the readings around its stamp have come.

    The reading is interpolated linearly between those on both sides of the stamp, each within `max_age`. If no reading
    follows within that, the last one before the stamp is used. A prediction waits for a later reading until another
    input has a stamp that is later by `patience`. Reasons for predictions without a measurement are counted in
    `counts`. Each compensated wrench updates the mean in the air and the filter, in the order of the estimates.
    """

    def __init__(self, counts: Counter[Reason]) -> None:
        self._counts = counts
        self._final: list[Measurement] = []

    def add(self, prediction: Prediction, lifetimes: Lifetimes) -> None:
        """Add a prediction."""
        if len(lifetimes.readings.pending) >= _MAX_PENDING_COUNT:
            self._compare_oldest(lifetimes)
        lifetimes.readings.pending.append(prediction)
        self.settle(prediction.pose.stamp, lifetimes)

    def settle(self, now: float, lifetimes: Lifetimes) -> None:
        """Compare the predictions that need not wait. `now` [ns]: the stamp of the sample that has just come."""
        while lifetimes.readings.pending:
            oldest = lifetimes.readings.pending[0]
            stamp = oldest.pose.stamp
            newest = (
                lifetimes.readings.samples.last.stamp if lifetimes.readings.samples.last else 0
            )
            if newest < stamp and now <= stamp + patience(oldest.max_age):
                break
            self._compare_oldest(lifetimes)

    def measurements(self) -> list[Measurement]:
        """The measurements that became final since the last call, in the order of the estimates."""
        final = self._final
        self._final = []
        return final

    def _compare_oldest(self, lifetimes: Lifetimes) -> None:
        self._final.append(self._measured(lifetimes.readings.pending.popleft(), lifetimes))

    def _measured(self, prediction: Prediction, lifetimes: Lifetimes) -> Measurement:
        pose = prediction.pose
        cell = prediction.cell
        reading_before, reading_after, share = lifetimes.readings.samples.around(pose.stamp)
        if reading_before is None or pose.stamp - reading_before.stamp > prediction.max_age:
            reason = Reason.WRENCH_MISSING if reading_before is None else Reason.WRENCH_STALE
            self._counts[reason] += 1
            return Measurement(pose.stamp, None, None, reason)
        raw = reading_before
        if (
            reading_after
            and reading_after.stamp - pose.stamp <= prediction.max_age
            and reading_after.frame == reading_before.frame
        ):
            fx, fy, fz, tx, ty, tz = interpolated(
                reading_before.wrench, reading_after.wrench, share
            )
            raw = reading_before._replace(wrench=(fx, fy, fz, tx, ty, tz))
        # a torque that is no number equals nothing, and the filter uses the force alone
        raw_force = raw.wrench[:3]
        is_repeated = raw_force == lifetimes.readings.last_raw_force
        lifetimes.readings.last_raw_force = raw_force
        wrench = _difference(cell.sign, cell.in_own_axes(raw, pose), prediction.offset)
        _learn(prediction, wrench, lifetimes, is_repeated=is_repeated)
        return Measurement(pose.stamp, wrench, _difference(1.0, wrench, prediction.wrench), None)


def _learn(
    prediction: Prediction, wrench: Wrench, lifetimes: Lifetimes, *, is_repeated: bool
) -> None:
    """Update the mean in the air and the filter. `is_repeated`: the raw force equals the one before, bit by bit."""
    lifetimes.air.add(prediction, wrench)
    if lifetimes.learning is not None:
        force = prediction.force_in_world(wrench)
        lifetimes.learning.learn(
            prediction.pose.stamp, force, is_repeated=is_repeated, air_load=lifetimes.air.load
        )


def _difference(factor: float, a: Wrench, b: Wrench) -> Wrench:
    """`factor` times one wrench, minus the other; written out, since a loop takes twice as long."""
    fx, fy, fz, tx, ty, tz = a
    gx, gy, gz, ux, uy, uz = b
    force = factor * fx - gx, factor * fy - gy, factor * fz - gz
    return *force, factor * tx - ux, factor * ty - uy, factor * tz - uz
