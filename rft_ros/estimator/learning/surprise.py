"""Tests of each reading: whether the force is as expected, and whether load cell and model are plausible."""

import math

from rft_ros.estimator.learning.filter import dot
from rft_ros.estimator.tare import OFFSET_SENTENCE
from rft_ros.rft.kernel.compilation import inlined

_ENTRY = 0.008  # path [m] after the tool enters in which nothing is judged: the estimate of δ has not settled
_SURPRISE_LENGTH = 0.0005  # path [m] of the mean of the normalised error
_SURPRISE_ON = 1.93  # mean normalised error from which on there is a surprise
_SURPRISE_OFF = 1.0  # the same at which it ends
_NORMALISED_MOST = 4.0  # a larger normalised error counts as this
_SHARE_MOST = 0.34  # greatest weight of one sample in that mean: two successive outliers do not count as a surprise
_SUM_LENGTH = 0.005  # path [m] of the means that compare measurement and model
_OPPOSING = 0.05  # [N]; the direction of a smaller force is random
_WEAK = 0.2  # a measured force below this many times the model's is an issue
_STRONG = 5.0  # so is one above this many times
_UNEXPLAINED = 0.1  # a measured force below this many times the model's is explained by no θ
_TURN_MOST = 45.0  # degrees; a measured horizontal force that is turned by more is an issue
_TANGENT_MOST = math.tan(math.radians(_TURN_MOST))
_SIDEWAYS = 0.05  # least share of the horizontal part in the square of the force; the direction of a smaller is random
_RATIO_MOST = 10.0  # a larger ratio of measured to model force counts as this
_STUCK_LENGTH = 0.005  # path [m]; a cell that repeats one reading over more is stuck
_STUCK_STEP = 0.002  # path [m]; most that one sample adds to that

JUDGE_FIELDS = [
    ("path_entered", float),  # path at which the tool last entered
    ("path_feeble", float),  # path of the last record with too small a force to compare
    ("path_judged", float),  # path of the last record that was judged
    ("stuck_path", float),  # path over which the reading repeats
    ("surprise", float),  # mean over _SURPRISE_LENGTH: error along F' in standard deviations
    ("mean_error", float),  # the same means of this error and of F' [N]
    ("mean_force", float),
    ("change", int),  # 1: the grains are harder than believed, -1: softer
    ("along", float),  # mean over _SUM_LENGTH: y·F, with outliers reduced
    # the same mean of F·F; next: of the horizontal parts' dot product, cross product and square
    ("square", float),
    ("flat_along", float),
    ("flat_cross", float),
    ("flat_square", float),
    ("issues", int),  # a bitwise or of keys of `ISSUES`
]
"""Fields of a state that the functions below use."""

STUCK, OPPOSED, WEAK, STRONG, TURNED, OFFSET = (1 << bit for bit in range(6))
ISSUES = {
    STUCK: "the load cell repeats the same reading while the tool moves: check its driver",
    OPPOSED: "the measured force points against the model's: check sensor.sign, sensor.quaternion and the mesh",
    WEAK: f"the measured force is below {_WEAK:g} times the model's: check medium.zeta, surface_height and the mesh",
    STRONG: (
        f"the measured force is over {_STRONG:g} times the model's: check medium.zeta, mesh.scale and surface_height"
    ),
    TURNED: (
        f"the measured force is turned by over {_TURN_MOST:g} degrees from the model's: check sensor.quaternion and the"
        " frames"
    ),
    OFFSET: OFFSET_SENTENCE,
}
"""Issues that no grains can explain: the load cell or the model is wrong. A sentence for each."""


@inlined
def judge(state, record, y, step, repeated):
    """Judge a reading in the grains: find issues, measure the surprise, decide whether it will update the filter."""
    state.path_judged = record.path
    state.stuck_path = state.stuck_path + min(step, _STUCK_STEP) if repeated else 0.0
    if not record.passing:
        _compare(state, record, y, step)
    _find_issues(state)
    record.fault = _is_unexplained(state)
    record.measured = not (repeated or record.fault)  # a repeated reading is no new measurement
    if record.measured:
        _measure_surprise(state, record, y, step)


@inlined
def _compare(state, record, y, step):
    """Update the means that compare the measured force with the model's."""
    f = record.force
    square = dot(f, f)
    if square < _OPPOSING**2:
        state.path_feeble = record.path
    ratio = min(
        1.0, (_RATIO_MOST * math.sqrt(square) + _OPPOSING) / max(math.sqrt(dot(y, y)), 1e-300)
    )
    share = 1.0 - math.exp(-step / _SUM_LENGTH)
    state.along += share * (ratio * dot(y, f) - state.along)
    state.square += share * (square - state.square)
    state.flat_along += share * (ratio * (y[0] * f[0] + y[1] * f[1]) - state.flat_along)
    state.flat_cross += share * (ratio * (y[1] * f[0] - y[0] * f[1]) - state.flat_cross)
    state.flat_square += share * (f[0] * f[0] + f[1] * f[1] - state.flat_square)


@inlined
def _is_comparable(state):
    """Whether the means compare enough: a path of `_ENTRY` since the tool entered, with a large enough force."""
    return (
        state.square > 0.0
        and state.path_judged - max(state.path_entered, state.path_feeble) >= _ENTRY
    )


@inlined
def _find_issues(state):
    """Set the issues."""
    issues = 0
    if state.stuck_path > _STUCK_LENGTH:
        issues |= STUCK
    if _is_comparable(state):
        if state.along < 0.0:
            issues |= OPPOSED
        elif state.along < _WEAK * state.square:
            issues |= WEAK
        elif state.along > _STRONG * state.square:
            issues |= STRONG
        is_sideways = state.flat_square > _SIDEWAYS * state.square
        if (
            state.along >= 0.0
            and is_sideways
            and abs(state.flat_cross) > _TANGENT_MOST * state.flat_along
        ):
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
def _measure_surprise(state, record, y, step):
    """Update the mean error along the predicted force, in standard deviations of (L4), and with it the change."""
    predicted = record.predicted
    size = math.sqrt(dot(predicted, predicted))
    if record.passing or record.path - state.path_entered < _ENTRY or not size > 0.0:
        state.surprise = state.mean_error = state.mean_force = 0.0
    else:
        error = dot(predicted, y) / size - size
        variance = 0.0
        for i in range(3):
            variance += predicted[i] * dot(record.s[i], predicted)
        variance *= max(1.0, state.scale[0], state.scale[1], state.scale[2])
        normalised = min(
            max(error * size / math.sqrt(variance), -_NORMALISED_MOST), _NORMALISED_MOST
        )
        share = min(1.0 - math.exp(-step / _SURPRISE_LENGTH), _SHARE_MOST)
        state.surprise += share * (normalised - state.surprise)
        state.mean_error += share * (error - state.mean_error)
        state.mean_force += share * (size - state.mean_force)
    if abs(state.surprise) > _SURPRISE_ON:
        state.change = 1 if state.surprise > 0.0 else -1
    elif abs(state.surprise) < _SURPRISE_OFF:
        state.change = 0
