"""Tests of each reading: whether the force is as expected, and whether load cell and model are plausible."""

import math

from rft_ros.estimator.learning.filter import dot
from rft_ros.rft.kernel.compilation import inlined

__all__ = [
    "AIR_SAMPLES",
    "ISSUES",
    "JUDGE",
    "OFFSET",
    "OFFSET_LEAST",
    "OFFSET_SHARE",
    "OPPOSED",
    "STRONG",
    "STUCK",
    "TURNED",
    "WEAK",
    "average_in_air",
    "judge",
]

_ENTRY = 0.008  # path [m] after entering without a judgement, since the estimate of δ has not settled
_SURPRISE_LENGTH = 0.0005  # path [m] of the mean of the normalised error
_SURPRISE_ON, _SURPRISE_OFF = 1.93, 1.0  # mean normalised error
_SCORE_MOST = 4.0  # a larger normalised error counts as this
_SHARE_MOST = 0.34  # most weight of one sample in that mean, so that two spikes in a row are no surprise
_SUM_LENGTH = 0.005  # path [m] of the means that compare measurement and model
_OPPOSING = 0.05  # [N]; the direction of a smaller force is random
_WEAK, _STRONG = 0.2, 5.0  # a measured force below or above this many times the model's is an issue
_UNEXPLAINED = 0.1  # a measured force below this many times the model's is explained by no θ
_SIDEWAYS = 0.05  # least share of the horizontal part in the square of the force; the direction of a smaller is random
_RATIO_MOST = 10.0  # a larger ratio of measured to model force counts as this
_STUCK_LENGTH = 0.005  # path [m]; a cell that repeats one reading over more is stuck
_STUCK_STEP = 0.002  # path [m]; most that one sample adds to that

AIR_SAMPLES = 64
"""Readings in the mean force in the air; half of them are enough to judge it."""

OFFSET_LEAST, OFFSET_SHARE = 0.2, 0.1
"""A tared cell reads less in the air: a force [N], or a share of the model's force in the grains if that is more."""

JUDGE = [
    ("entered", float),  # path at which the tool last entered
    ("feeble", float),  # path of the last record with too small a force to compare
    ("judged", float),  # path of the last record that was judged
    ("score", float),  # means over _SURPRISE_LENGTH: normalised error, error [N], force [N]
    ("excess", float),
    ("size", float),
    ("surprise", int),  # 1: harder than believed, -1: softer
    ("along", float),  # means over _SUM_LENGTH: y·F, F·F, and dot, cross product and square of horizontal parts
    ("square", float),
    ("flat_along", float),
    ("flat_cross", float),
    ("flat_square", float),
    ("repeated", float),  # path of the reading that repeats
    ("air", float, 3),  # mean reading in the air [N]
    ("air_samples", float),
    ("issues", int),  # a bitwise or of keys of `ISSUES`
    ("doubts", int),  # issues under which the filter was updated
]
"""Fields of a state that the functions below use."""

STUCK, OPPOSED, WEAK, STRONG, TURNED, OFFSET = 1, 2, 4, 8, 16, 32
ISSUES = {
    STUCK: "the load cell repeats the same reading while the tool moves: check its driver",
    OPPOSED: "the measured force points against the model's: check sensor.sign, sensor.quaternion and the mesh",
    WEAK: "the measured force is below a fifth of the model's: check medium.zeta, surface_height and the mesh",
    STRONG: "the measured force is over five times the model's: check medium.zeta, mesh.scale and surface_height",
    TURNED: "the measured force is turned by over 45 degrees from the model's: check sensor.quaternion and the frames",
    OFFSET: "the load cell reads a force in the air: call ~/tare there, or check sensor.bias and sensor.mass",
}
"""Issues that no grains can explain: the load cell or the model is wrong. A sentence for each."""


@inlined
def average_in_air(state, y):
    """Add a reading in the air to their mean, which is zero for a tared cell."""
    state.air_samples = min(state.air_samples + 1.0, float(AIR_SAMPLES))
    for i in range(3):
        state.air[i] += (y[i] - state.air[i]) / state.air_samples
    state.issues = state.issues & ~OFFSET | _offset_issue(state)


@inlined
def _offset(state):
    """Mean reading in the air [N]; 0 before there are enough readings."""
    return math.sqrt(dot(state.air, state.air)) if 2.0 * state.air_samples >= AIR_SAMPLES else 0.0


@inlined
def _offset_issue(state):
    return OFFSET if _offset(state) > max(OFFSET_LEAST, OFFSET_SHARE * math.sqrt(state.square)) else 0


@inlined
def judge(state, record, y, step, repeated):
    """Judge a reading in the grains: find issues, score the surprise, decide whether it will update the filter."""
    state.judged = record.path
    state.repeated = state.repeated + min(step, _STUCK_STEP) if repeated else 0.0
    if not record.passing:
        _compare(state, record, y, step)
    _find_issues(state)
    record.fault = _is_unexplained(state)
    record.measured = not (repeated or record.fault)  # a repeated reading is no new measurement
    record.r += _offset(state) ** 2
    if record.measured:
        _score(state, record, y, step)


@inlined
def _compare(state, record, y, step):
    """Update the means that compare the measured force with the model's."""
    f = record.force
    square = dot(f, f)
    if square < _OPPOSING**2:
        state.feeble = record.path
    ratio = min(1.0, (_RATIO_MOST * math.sqrt(square) + _OPPOSING) / max(math.sqrt(dot(y, y)), 1e-300))
    share = 1.0 - math.exp(-step / _SUM_LENGTH)
    state.along += share * (ratio * dot(y, f) - state.along)
    state.square += share * (square - state.square)
    state.flat_along += share * (ratio * (y[0] * f[0] + y[1] * f[1]) - state.flat_along)
    state.flat_cross += share * (ratio * (y[1] * f[0] - y[0] * f[1]) - state.flat_cross)
    state.flat_square += share * (f[0] * f[0] + f[1] * f[1] - state.flat_square)


@inlined
def _is_comparable(state):
    """Whether the means compare enough: a path of `_ENTRY` since the tool entered, with a large enough force."""
    return state.square > 0.0 and state.judged - max(state.entered, state.feeble) >= _ENTRY


@inlined
def _find_issues(state):
    """Set the issues."""
    issues = _offset_issue(state)
    if state.repeated > _STUCK_LENGTH:
        issues |= STUCK
    if _is_comparable(state):
        if state.along < 0.0:
            issues |= OPPOSED
        elif state.along < _WEAK * state.square:
            issues |= WEAK
        elif state.along > _STRONG * state.square:
            issues |= STRONG
        is_sideways = state.flat_square > _SIDEWAYS * state.square
        if state.along >= 0.0 and is_sideways and abs(state.flat_cross) > state.flat_along:
            issues |= TURNED
    state.issues = issues
    state.doubts |= issues


@inlined
def _is_unexplained(state):
    """Whether no θ explains the force: it opposes the model's, is turned from it or far too small.

    A force that clearly opposes the model's is excluded before it is comparable, and then no issue is named: while the
    tool enters, an offset of the cell can outweigh the force of the grains.
    """
    if state.along < -(_OPPOSING**2):
        return True
    is_small = state.along < _UNEXPLAINED * state.square
    return _is_comparable(state) and (is_small or state.issues & TURNED != 0)


@inlined
def _score(state, record, y, step):
    """Update the mean error along the predicted force, in standard deviations of (L4), and set the surprise."""
    predicted = record.predicted
    size = math.sqrt(dot(predicted, predicted))
    if record.passing or record.path - state.entered < _ENTRY or not size > 0.0:
        state.score = state.excess = state.size = 0.0
    else:
        error = dot(predicted, y) / size - size
        variance = 0.0
        for i in range(3):
            variance += predicted[i] * dot(record.s[i], predicted)
        variance *= max(1.0, state.scale[0], state.scale[2])
        normalised = min(max(error * size / math.sqrt(variance), -_SCORE_MOST), _SCORE_MOST)
        share = min(1.0 - math.exp(-step / _SURPRISE_LENGTH), _SHARE_MOST)
        state.score += share * (normalised - state.score)
        state.excess += share * (error - state.excess)
        state.size += share * (size - state.size)
    if abs(state.score) > _SURPRISE_ON:
        state.surprise = 1 if state.score > 0.0 else -1
    elif abs(state.score) < _SURPRISE_OFF:
        state.surprise = 0
