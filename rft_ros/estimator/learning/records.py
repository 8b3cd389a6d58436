"""Records: each pose in the grains leaves one, which waits for its reading and then until the tool is `lag` further.

At rest nothing changes, and speed does not matter: the path of the tool's fastest point takes the place of time.
"""

import numpy as np

from rft_ros.estimator.learning.filter import FILTER, absorb, copy, correct, grow, resume
from rft_ros.estimator.learning.surprise import JUDGE, average_in_air, judge
from rft_ros.rft.compilation import compiled, inlined

__all__ = ["RECORD", "RECORDS", "STATE", "STEP_MOST", "add_reading", "predict"]

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

STATE = np.dtype(
    [
        *FILTER,
        *JUDGE,
        ("first", int),  # the first record that was not taken; number n, without end, is at n modulo their count
        ("open", int),  # the first record whose measurement may still come
        ("end", int),
        ("travel", float),
        ("path", float),
        ("pushing", np.bool_),  # in the grains, neither withdrawn nor fast
        ("aired", np.bool_),  # in the air since the last push
    ],
    align=True,
)


@inlined
def _move(state, step, wet, passing):
    """Advance the path. Where the tool begins to push, the filter starts from the belief of the last push."""
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
    """Move, take the records that lie `lag` behind, predict with (L4), and keep a record for the measurement."""
    state = states[0]
    wet = row[6] > 0.0
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
    """Give the record of a stamp its measurement, and judge it."""
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
