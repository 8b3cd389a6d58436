"""Records of poses in the grains. Each waits for its reading, and updates the filter when the tool is `lag` further.

The path of the tool's fastest point takes the place of time: at rest nothing changes, and speed does not matter.
"""

import numpy as np

from rft_ros.estimator.learning.filter import FILTER, absorb, copy, correct, grow, resume
from rft_ros.estimator.learning.surprise import JUDGE, average_in_air, judge
from rft_ros.rft import SUBMERGED_AREA
from rft_ros.rft.kernel.compilation import compiled, inlined

__all__ = ["FILTER_STATE", "RECORD", "RECORDS", "STEP_MOST", "add_reading", "predict"]

RECORDS, _RECORDS_PER_LAG = 2048, 1024
STEP_MOST = 1.0  # path [m] between two poses

RECORD = np.dtype(
    [
        ("stamp", np.int64),
        ("travel", float),  # path in air and grains
        ("path", float),  # path in the grains
        ("passing", np.bool_),
        ("measured", np.bool_),  # y holds a force that will update the filter
        ("fault", np.bool_),
        ("force", float, 3),  # of the model, F
        ("h", float, (6, 4)),  # H of force and torque
        ("predicted", float, 3),  # F' as it was predicted, and its covariance S
        ("s", float, (3, 3)),
        ("r", float),  # variance of the noise
        ("y", float, 3),  # measured force
    ],
    align=True,
)

FILTER_STATE = np.dtype(
    [
        *FILTER,
        *JUDGE,
        ("first", int),  # number of the first record that waits; record n is at index n modulo `RECORDS`
        ("open", int),  # number of the first record whose measurement may still come
        ("end", int),  # number of the next record
        ("travel", float),
        ("path", float),
        ("pushing", np.bool_),  # in the grains, neither withdrawn nor fast
        ("aired", np.bool_),  # in the air since the last push
    ],
    align=True,
)


@inlined
def _move(state, step, wet, passing):
    """Advance the path. When the tool begins to push, the filter resumes with its state at the last push."""
    state.travel += step
    if not wet:
        state.pushing, state.aired = False, True
        return
    state.path += step
    if passing:
        state.pushing = False
    elif not state.pushing and step > 0.0:
        resume(state.latest, state.push, state.prior, state.aired)
        state.pushing, state.aired, state.entered = True, False, state.path


@compiled
def predict(states, records, row, out, stamp, step, passing, apply, lag, reach):
    """Advance, update the filter with the records `lag` behind, predict with (L4), and add a record of this pose."""
    state = states[0]
    wet = row[SUBMERGED_AREA] > 0.0
    _move(state, step, wet, passing)
    while state.first < state.open and records[state.first % RECORDS].travel <= state.travel - lag:
        oldest = records[state.first % RECORDS]
        if oldest.fault:  # earlier updates may have been wrong as well
            copy(state.latest, state.prior)
            copy(state.push, state.prior)
        elif oldest.measured and oldest.path > max(state.learned, state.entered if oldest.passing else 0.0):
            absorb(state, oldest)
        state.first += 1
    if state.end - state.first == RECORDS:  # no reading came for the oldest record: drop it
        state.first += 1
        state.open = max(state.open, state.first)
    copy(state.now, state.latest)
    grow(state.now, max(state.path - state.learned, 0.0))

    record = records[state.end % RECORDS]
    correct(state.now, state, record, row, out, reach, lag, apply)
    last = records[(state.end - 1) % RECORDS].travel
    close = state.end > state.first and state.travel - last < lag / _RECORDS_PER_LAG
    if wet and step > 0.0 and not close:
        record.stamp, record.travel, record.path = stamp, state.travel, state.path
        record.passing, record.measured, record.fault = passing, False, False
        state.end += 1


@compiled
def add_reading(states, records, y, stamp, repeated, in_air):
    """Add the measurement at a stamp to the record of that stamp, and judge it."""
    state = states[0]
    if in_air:
        average_in_air(state, y)
    while state.open < state.end and records[state.open % RECORDS].stamp < stamp:
        state.open += 1
    record = records[state.open % RECORDS]
    if state.open < state.end and record.stamp == stamp:
        state.open += 1
        judge(state, record, y, min(record.path - state.judged, STEP_MOST), repeated)
        for i in range(3):
            record.y[i] = y[i]
