"""Tests of each reading: whether any strength of the grains explains the force, and whether it is as expected."""

import math

import numpy as np

from rft_ros.estimator.learning.filter import dot
from rft_ros.rft.kernel.compilation import inlined

# path of a push in which there is no surprise, and only a force that opposes the model's is excluded: the estimate of
# δ has not settled
_ENTRY_PATH_M = 0.008
_SURPRISE_PATH_M = 0.0005  # path of the mean of the normalised error
_SURPRISE_BEGINS_FACTOR = 1.93  # mean normalised error from which on there is a surprise
_SURPRISE_ENDS_FACTOR = 1.0  # the same at which it ends
_MAX_ERROR_FACTOR = 4.0  # a larger normalised error counts as this
# greatest weight of one sample in that mean: two successive outliers do not count as a surprise
_MAX_SAMPLE_SHARE = 0.34
_COMPARED_PATH_M = 0.005  # path of the means that compare measurement and model
_MIN_FORCE_N = 0.05  # the direction of a smaller force is random
_MIN_FORCE_RATIO = 0.1  # a measured force below this many times the model's is explained by no θ
_MAX_TURN_DEG = 45.0  # a measured horizontal force that is turned by more is explained by no θ
_TANGENT_MOST = math.tan(math.radians(_MAX_TURN_DEG))
# least share of the horizontal part in the square of the force; the direction of a smaller one is random
_MIN_SIDEWAYS_SHARE = 0.05
_MAX_FORCE_RATIO = 10.0  # a larger ratio of measured to model force counts as this

JUDGE_FIELDS = [
    ("path_push_began", float),  # path at which the present push began
    ("path_feeble", float),  # path of the last record with too small a force to compare
    ("path_judged", float),  # path of the last record that was judged
    ("surprise", float),  # mean over _SURPRISE_PATH_M: error along F' in standard deviations
    ("mean_error", float),  # the same means of this error and of F' [N]
    ("mean_force", float),
    ("change", int),  # 1: the grains are harder than believed, -1: softer
    ("along", float),  # mean over _COMPARED_PATH_M: y·F, with outliers reduced
    # the same mean of F·F; next: of the horizontal parts' dot product, cross product and square
    ("square", float),
    ("flat_along", float),
    ("flat_cross", float),
    ("flat_square", float),
    ("unexplained", np.bool_),  # no θ explains the measured force
]
"""Fields of a state that the functions below use."""

UNEXPLAINED_SENTENCE = (
    "no strength of the grains explains the measured force, so it updates nothing: rft doctor names the fault of the"
    " load cell or the model"
)
"""What readings that are excluded from the update say to a user."""


@inlined
def judge(state, record, y, step, is_repeated):
    """Judge a reading in the grains: decide whether it will update the filter, and measure the surprise."""
    state.path_judged = record.path
    if not record.passing:
        _compare(state, record, y, step)
    state.unexplained = _is_unexplained(state)
    # a force that clearly opposes the model's is excluded at once: while the tool enters, an offset of the load cell
    # can outweigh the force of the grains
    record.fault = state.unexplained or state.along < -(_MIN_FORCE_N**2)
    record.measured = not (is_repeated or record.fault)  # a repeated reading is no new measurement
    if record.measured:
        _measure_surprise(state, record, y, step)


@inlined
def _compare(state, record, y, step):
    """Update the means that compare the measured force with the model's."""
    f = record.force
    square = dot(f, f)
    if square < _MIN_FORCE_N**2:
        state.path_feeble = record.path
    ratio = min(
        1.0,
        (_MAX_FORCE_RATIO * math.sqrt(square) + _MIN_FORCE_N) / max(math.sqrt(dot(y, y)), 1e-300),
    )
    share = 1.0 - math.exp(-step / _COMPARED_PATH_M)
    state.along += share * (ratio * dot(y, f) - state.along)
    state.square += share * (square - state.square)
    state.flat_along += share * (ratio * (y[0] * f[0] + y[1] * f[1]) - state.flat_along)
    state.flat_cross += share * (ratio * (y[1] * f[0] - y[0] * f[1]) - state.flat_cross)
    state.flat_square += share * (f[0] * f[0] + f[1] * f[1] - state.flat_square)


@inlined
def _is_comparable(state):
    """Whether the means compare enough: a path of `_ENTRY_PATH_M` since the push began, with a large enough force."""
    return (
        state.square > 0.0
        and state.path_judged - max(state.path_push_began, state.path_feeble) >= _ENTRY_PATH_M
    )


@inlined
def _is_unexplained(state):
    """Whether no θ explains the force: it opposes the model's, is turned from it or far too small."""
    is_sideways = state.flat_square > _MIN_SIDEWAYS_SHARE * state.square
    is_turned = is_sideways and abs(state.flat_cross) > _TANGENT_MOST * state.flat_along
    return _is_comparable(state) and (state.along < _MIN_FORCE_RATIO * state.square or is_turned)


@inlined
def _measure_surprise(state, record, y, step):
    """Update the mean error along the predicted force, in standard deviations of (L4), and with it the change."""
    force = record.predicted
    size = math.sqrt(dot(force, force))
    if record.passing or record.path - state.path_push_began < _ENTRY_PATH_M or not size > 0.0:
        state.surprise = state.mean_error = state.mean_force = 0.0
    else:
        error = dot(force, y) / size - size
        variance = 0.0
        for i in range(3):
            variance += force[i] * dot(record.s[i], force)
        variance *= max(1.0, state.scale[0], state.scale[1], state.scale[2])
        relative_error = min(
            max(error * size / math.sqrt(variance), -_MAX_ERROR_FACTOR), _MAX_ERROR_FACTOR
        )
        share = min(1.0 - math.exp(-step / _SURPRISE_PATH_M), _MAX_SAMPLE_SHARE)
        state.surprise += share * (relative_error - state.surprise)
        state.mean_error += share * (error - state.mean_error)
        state.mean_force += share * (size - state.mean_force)
    if abs(state.surprise) > _SURPRISE_BEGINS_FACTOR:
        state.change = 1 if state.surprise > 0.0 else -1
    elif abs(state.surprise) < _SURPRISE_ENDS_FACTOR:
        state.change = 0
