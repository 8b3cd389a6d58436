"""Kalman filter of four correction factors θ = (s_v, s_h, ρ, δ) of the model's force.

s_v and s_h scale the vertical and the horizontal part of the model's force F (any law, rule or memory; world axes, z
up), ρ turns the horizontal part about the vertical, and δ [m] moves the surface:

    F' = [ s_h (Fx, Fy) + ρ (-Fy, Fx);  s_v Fz ] + δ dF/dh  =  H θ                                  (L1)

F' is linear in θ, so the torque follows from the same θ and the sums Σ r_j f_l over the plates. The path of the tool's
fastest point takes the place of time. Equation numbers are those of docs/learning.md, which has the data behind the
constants: lengths are path [m], deviations are standard deviations.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.sigma import LEVER_SHARE, SIGMA
from rft_ros.rft.frames import BY_HEIGHT, FORCE, MOMENTS, TORQUE, WRENCH
from rft_ros.rft.kernel.compilation import inlined

VERTICAL, HORIZONTAL, TURN, SURFACE = range(4)  # places in θ: s_v, s_h, ρ, δ
X, Y, Z = range(3)

_X_MOMENTS, _Y_MOMENTS, _Z_MOMENTS = (
    slice(MOMENTS.start + 3 * r, MOMENTS.start + 3 * r + 3) for r in (X, Y, Z)
)

_PRIOR_STRENGTH_SHARE = (
    0.3  # deviation of s_v, s_h and ρ, in addition to the error that s_v and s_h share
)
_PRIOR_SURFACE_M = 0.003  # deviation of δ
_NOISE_SHARE = 0.093  # deviation over the predicted force
_NOISE_FLOOR_N = 0.025  # deviation
_NOISE_PATH_M = 0.003  # errors of samples closer than this are correlated
# a larger innovation, over the root of the trace of its covariance, is reduced to this
_GATE_FACTOR = 2.2
_MIN_STRENGTH_RATIO = 0.1
_MAX_STRENGTH_RATIO = 10.0
_HORIZONTAL_RISE_PATH_M = 0.0015  # path of the mean of the squared errors while it grows
_HORIZONTAL_FALL_PATH_M = 0.0026  # the same while it falls
_VERTICAL_RISE_PATH_M = 0.0025
_VERTICAL_FALL_PATH_M = 0.004
_MIN_SCALE_FACTOR = 1e-6  # keeps σ over 0
_BIAS_PATH_M = 0.0025  # path of the mean of the vertical errors
_BIAS_GROWTH_PER_M = 150.0  # weight of its square over the lag
_MAX_BIAS_LAG_M = 0.01  # lag up to which it grows
_MAX_ERROR_FACTOR = 3.0  # a larger error, in standard deviations, counts as this


def _covariance(common: float, each: float, surface: float) -> NDArray[np.float64]:
    p = np.diag([each**2, each**2, each**2, surface**2])
    p[:2, :2] += common**2
    return p


_GROWTH = _covariance(0.153, 0.23, 0.00126) / 0.01  # of P over a metre of path: G of (L2)

_GAUSSIAN = np.dtype(
    (np.record, np.dtype([("theta", float, 4), ("p", float, (4, 4))], align=True))
)

FILTER_FIELDS = [
    ("latest", _GAUSSIAN),  # mean and covariance of θ after the last record taken
    ("of_push", _GAUSSIAN),  # the same, without the updates in withdrawals and in fast motion
    ("prior", _GAUSSIAN),
    ("now", _GAUSSIAN),  # at the pose that is predicted
    ("path_learned", float),  # path of the last record that updated the filter
    ("scale", float, 3),  # m of (L5): mean of the squared errors of each component
    ("bias", float),  # b of (L5): mean of the vertical errors
]
"""Fields of a state that the functions below use."""


def start(state: Any, strength_error: float) -> None:
    """Set a state to the calibration, whose ζ has this relative standard error."""
    prior = state.prior
    prior.theta[:] = 1.0, 1.0, 0.0, 0.0
    prior.p[:] = _covariance(strength_error, _PRIOR_STRENGTH_SHARE, _PRIOR_SURFACE_M)
    copy(state.latest, prior)
    copy(state.of_push, prior)
    state.scale[:] = 1.0
    state.bias = 0.0


@inlined
def dot(a, b):
    """Σ a_i b_i."""
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@inlined
def _form(a, m, b):
    """aᵀ M b."""
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * dot(m[i], b)
    return total


@inlined
def copy(target, source):
    """Copy mean and covariance."""
    # number by number: an assignment of arrays also compiles an error message, which takes 4 s
    for i in range(4):
        target.theta[i] = source.theta[i]
        for j in range(4):
            target.p[i, j] = source.p[i, j]


@inlined
def copy_place(target, source):
    """Copy mean and covariance of turn and surface, which belong to a place, and those with the strengths."""
    for i in (TURN, SURFACE):
        target.theta[i] = source.theta[i]
        for j in range(4):
            target.p[i, j] = target.p[j, i] = source.p[i, j]


@inlined
def _bound(theta):
    """Bound θ to values that the model can have."""
    for i in (VERTICAL, HORIZONTAL):
        theta[i] = min(max(theta[i], _MIN_STRENGTH_RATIO), _MAX_STRENGTH_RATIO)
    theta[TURN] = min(max(theta[TURN], -theta[HORIZONTAL]), theta[HORIZONTAL])


@inlined
def grow(belief, path):
    """Add the growth of (L2) over a path [m] to P."""
    for i in range(4):
        for j in range(4):
            belief.p[i, j] += path * _GROWTH[i, j]


@inlined
def _set_row(row, vertical, horizontal, turn):
    """Set a row of H, but for the surface."""
    row[VERTICAL] = vertical
    row[HORIZONTAL] = horizontal
    row[TURN] = turn


@inlined
def _design(h, row):
    """H of (L1): three rows for the force, three for the torque Σ r × f. The force of δ acts where the model's does."""
    force = row[FORCE]
    height_derivative = row[BY_HEIGHT]
    x_f, y_f, z_f = row[_X_MOMENTS], row[_Y_MOMENTS], row[_Z_MOMENTS]  # Σ x f, Σ y f, Σ z f
    fx, fy, fz = force[X], force[Y], force[Z]
    square = dot(force, force)
    # smaller squares lose digits
    per_force = dot(force, height_derivative) / square if square > 1e-200 else 0.0
    force_rows = h[FORCE]
    torque_rows = h[TORQUE]
    _set_row(force_rows[X], 0.0, fx, -fy)
    _set_row(force_rows[Y], 0.0, fy, fx)
    _set_row(force_rows[Z], fz, 0.0, 0.0)
    _set_row(torque_rows[X], y_f[Z], -z_f[Y], -z_f[X])
    _set_row(torque_rows[Y], -x_f[Z], z_f[X], -z_f[Y])
    _set_row(torque_rows[Z], 0.0, x_f[Y] - y_f[X], x_f[X] + y_f[Y])
    for i in range(3):
        force_rows[i, SURFACE] = height_derivative[i]
        torque_rows[i, SURFACE] = per_force * (
            torque_rows[i, VERTICAL] + torque_rows[i, HORIZONTAL]
        )


@inlined
def correct(state, record, row, out, apply, lag, reach):
    """Correct a row of the model by (L1), (L3) and (L4), with `state.now`.

    Writes F, H, F', S and r to the record, and wrench and standard deviations to `out`, shape [12]. `lag` of the
    readings and `reach` of the tool [m].
    """
    h = record.h
    now = state.now
    force = row[FORCE]
    wrench = out[WRENCH]
    sigma = out[SIGMA]
    _design(h, row)
    for i in range(3):
        record.force[i] = force[i]
        record.predicted[i] = dot(h[i], now.theta)
    square = dot(record.predicted, record.predicted)
    record.r = _NOISE_SHARE**2 * square + _NOISE_FLOOR_N**2
    for i in range(3):
        for j in range(3):
            record.s[i, j] = _form(h[i], now.p, h[j]) + (record.r if i == j else 0.0)
    growth = _BIAS_GROWTH_PER_M * min(lag, _MAX_BIAS_LAG_M)
    vertical = state.scale[Z] + growth * state.bias**2
    greatest = max(state.scale[X], state.scale[Y], vertical)
    for i in range(6):
        model = h[i, VERTICAL] + h[i, HORIZONTAL]
        corrected = dot(h[i], now.theta)
        if i < 3:
            variance = (vertical if i == Z else state.scale[i]) * record.s[i, i]
        else:
            variance = greatest * (_form(h[i], now.p, h[i]) + (_NOISE_SHARE * corrected) ** 2)
            variance += (LEVER_SHARE * reach) ** 2 * square
        wrench[i] = corrected if apply else model
        # a correction not applied is an error, too
        sigma[i] = math.sqrt(variance + (corrected - wrench[i]) ** 2)


@inlined
def _followed_scale(scale, square, rise, fall, step):
    """m of (L5) after a squared error. `rise`, `fall`: path of the mean while it grows, and while it falls."""
    square = min(square, _MAX_ERROR_FACTOR**2)
    length = rise if square > scale else fall
    return max(scale + (1.0 - math.exp(-step / length)) * (square - scale), _MIN_SCALE_FACTOR)


@inlined
def _adapt(state, record, step):
    """Update m and b of (L5) with the error of the prediction that was made at the record's pose."""
    y = record.y
    prediction = record.predicted
    s = record.s
    scale = state.scale
    for i in (X, Y):
        square = (y[i] - prediction[i]) ** 2 / s[i, i]
        scale[i] = _followed_scale(
            scale[i], square, _HORIZONTAL_RISE_PATH_M, _HORIZONTAL_FALL_PATH_M, step
        )
    vertical = (y[Z] - prediction[Z]) / math.sqrt(s[Z, Z])
    scale[Z] = _followed_scale(
        scale[Z], vertical**2, _VERTICAL_RISE_PATH_M, _VERTICAL_FALL_PATH_M, step
    )
    error = min(max(vertical, -_MAX_ERROR_FACTOR), _MAX_ERROR_FACTOR)
    state.bias += (1.0 - math.exp(-step / _BIAS_PATH_M)) * (error - state.bias)


@inlined
def _update_with_component(belief, h, y, variance):
    """Update with a component y of the force, whose row of H is h."""
    theta = belief.theta
    p = belief.p
    gain = dot(p[0], h), dot(p[1], h), dot(p[2], h), dot(p[3], h)
    s = dot(h, gain) + variance
    innovation = y - dot(h, theta)
    for i in range(4):
        theta[i] += gain[i] / s * innovation
        for j in range(4):
            p[i, j] -= gain[i] * gain[j] / s


@inlined
def update(state, record):
    """Update with a measured force: adapt the scale (L5), grow P (L2), gate the innovation, use the noise of (L3)."""
    belief = state.latest
    h = record.h
    y = record.y
    step = record.path - state.path_learned
    state.path_learned = record.path
    _adapt(state, record, step)
    grow(belief, step)
    force = dot(h[X], belief.theta), dot(h[Y], belief.theta), dot(h[Z], belief.theta)
    square = trace = 0.0
    for i in range(3):
        square += (y[i] - force[i]) ** 2
        trace += _form(h[i], belief.p, h[i]) + record.r
    share = min(1.0, _GATE_FACTOR * math.sqrt(trace / max(square, 1e-300)))
    variance = record.r * max(1.0, _NOISE_PATH_M / step)
    for i in range(3):
        _update_with_component(belief, h[i], force[i] + share * (y[i] - force[i]), variance)
    _bound(belief.theta)
    if not record.passing:
        copy(state.of_push, belief)
