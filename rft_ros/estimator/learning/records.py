"""Records of poses in the grains. Each waits for its reading, and updates the filter once the tool moved on by `lag`.

The path of the tool's fastest point takes the place of time: at rest nothing changes, and speed does not matter.
"""

import numpy as np

from rft_ros.estimator.learning.filter import FILTER_FIELDS, copy, copy_place, correct, grow, update
from rft_ros.estimator.learning.surprise import JUDGE_FIELDS, OFFSET, judge
from rft_ros.rft import SUBMERGED_AREA
from rft_ros.rft.kernel.compilation import compiled, inlined

__all__ = ["AWAY", "CAPACITY", "FILTER_STATE", "RECORD", "STEP_LEAST", "STEP_MOST", "add_reading", "predict"]

CAPACITY, _RECORDS_PER_LAG = 2048, 1024
STEP_LEAST, STEP_MOST = 1e-15, 1.0
"""Limits of a path between two poses [m]. A shorter one counts as rest: the noise of (L3) over it would be infinite."""

RECORD = np.dtype(
    [
        ("stamp", np.int64),
        ("travel", float),  # path in air and grains
        ("path", float),  # path in the grains
        ("passing", np.bool_),
        ("measured", np.bool_),  # y holds a force that will update the filter
        ("fault", np.bool_),  # no θ explains the measured force
        ("force", float, 3),  # of the model, F
        ("h", float, (6, 4)),  # H: rows for force and torque
        ("predicted", float, 3),  # F' as it was predicted, and its covariance S
        ("s", float, (3, 3)),
        ("r", float),  # variance of the noise
        ("y", float, 3),  # measured force
    ],
    align=True,
)

PUSHING, INTERRUPTED, AWAY = range(3)
"""Stages of a push. The tool moves through the grains; it was withdrawn or fast since; it was in the air since."""

FILTER_STATE = np.dtype(
    [
        *FILTER_FIELDS,
        *JUDGE_FIELDS,
        ("lag", float),  # path [m] that the tool moves on before a reading updates the filter
        ("reach", float),  # of the tool [m]
        ("first", int),  # number of the first record that waits; record n is at index n modulo `CAPACITY`
        ("open", int),  # number of the first record whose measurement may still come
        ("end", int),  # number of the next record
        ("travel", float),
        ("path", float),
        ("stage", int),  # `PUSHING`, `INTERRUPTED` or `AWAY`
    ],
    align=True,
)


@inlined
def _move(state, step, wet, passing):
    """Advance the path. When the tool pushes again, the filter resumes with its state at the last push.

    After a time in the air, turn and surface begin with the prior.
    """
    state.travel += step
    if not wet:
        state.stage = AWAY
        return
    state.path += step
    if passing:
        if state.stage == PUSHING:
            state.stage = INTERRUPTED
    elif state.stage != PUSHING and step > 0.0:
        copy(state.latest, state.of_push)
        if state.stage == AWAY:
            copy_place(state.latest, state.prior)
        state.stage, state.path_entered = PUSHING, state.path


@inlined
def _update_with_due(state, records):
    """Update the filter with the records that the tool has passed by the lag."""
    while state.first < state.open and records[state.first % CAPACITY].travel <= state.travel - state.lag:
        oldest = records[state.first % CAPACITY]
        if oldest.fault:  # earlier updates may have been wrong as well
            copy(state.latest, state.prior)
            copy(state.of_push, state.prior)
        elif oldest.measured and oldest.path > max(state.path_learned, state.path_entered if oldest.passing else 0.0):
            update(state, oldest)
        state.first += 1
    if state.end - state.first == CAPACITY:  # no reading came for the oldest record: drop it
        state.first += 1
        state.open = max(state.open, state.first)


@compiled
def predict(states, records, row, out, stamp, step, passing, apply):
    """Advance, update the filter with the records `lag` behind, predict with (L4), and add a record of this pose."""
    state = states[0]
    wet = row[SUBMERGED_AREA] > 0.0
    _move(state, step, wet, passing)
    _update_with_due(state, records)
    copy(state.now, state.latest)
    grow(state.now, max(state.path - state.path_learned, 0.0))

    record = records[state.end % CAPACITY]
    correct(state, record, row, out, apply)
    last = records[(state.end - 1) % CAPACITY].travel
    close = state.end > state.first and state.travel - last < state.lag / _RECORDS_PER_LAG
    if wet and step > 0.0 and not close:
        record.stamp, record.travel, record.path = stamp, state.travel, state.path
        record.passing, record.measured, record.fault = passing, False, False
        state.end += 1


@compiled
def add_reading(states, records, y, stamp, repeated, air_load, has_offset):
    """Add the measurement at a stamp to the record of that stamp, and judge it.

    `air_load`: mean force that the load cell reads in the air [N]. `has_offset`: whether it is an offset, an issue.
    """
    state = states[0]
    while state.open < state.end and records[state.open % CAPACITY].stamp < stamp:
        state.open += 1
    record = records[state.open % CAPACITY]
    if state.open < state.end and record.stamp == stamp:
        state.open += 1
        record.r += air_load**2
        judge(state, record, y, min(record.path - state.path_judged, STEP_MOST), repeated)
        if has_offset:
            state.doubts |= OFFSET
        for i in range(3):
            record.y[i] = y[i]
