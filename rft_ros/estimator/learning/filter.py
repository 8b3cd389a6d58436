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

from rft_ros.rft import COLUMNS
from rft_ros.rft.kernel.compilation import inlined

__all__ = ["FILTER", "absorb", "begin", "copy", "correct", "dot", "grow", "resume"]

_PRIOR_EACH = 0.3  # deviation of s_v, s_h and ρ, beside what s_v and s_h share
_PRIOR_SURFACE = 0.003  # deviation of δ [m]
_NOISE = 0.093  # deviation over the predicted force
_NOISE_FLOOR = 0.025  # deviation [N]
_NOISE_LENGTH = 0.003  # errors of samples closer than this are correlated
_GATE = 2.2  # a larger innovation, over the root of the trace of its covariance, is reduced to this
_LEVER = 0.07  # deviation of the point where the force acts, over the tool's reach
_BY_HEIGHT, _MOMENTS = len(COLUMNS), len(COLUMNS) + 3  # where dF/dh and Σ r_j f_l begin in a row of the model
_STRENGTH_LEAST, _STRENGTH_MOST = 0.1, 10.0
_SCALE_RISE = 0.0025  # path of the mean of the squared errors while it grows
_SCALE_FALL, _SCALE_FALL_VERTICAL = 0.0026, 0.004  # the same while it falls, for x and y, and for z
_BIAS_LENGTH = 0.0025  # path of the mean of the vertical errors
_BIAS_GROWTH, _BIAS_LAG_MOST = 150.0, 0.01  # weight of its square over the lag [1/m], up to this lag [m]
_ERROR_MOST = 3.0  # a larger error, in standard deviations, counts as this
_SQUARE_MOST = 9.0  # a larger squared error, in variances, counts as this


def _covariance(common: float, each: float, surface: float) -> NDArray[np.float64]:
    p = np.diag([each**2, each**2, each**2, surface**2])
    p[:2, :2] += common**2
    return p


_GROWTH = _covariance(0.153, 0.23, 0.00126) / 0.01  # of P over a metre of path: G of (L2)

_GAUSSIAN = np.dtype([("theta", float, 4), ("p", float, (4, 4))], align=True)

FILTER = [
    ("latest", _GAUSSIAN),  # mean and covariance of θ after the last record taken
    ("push", _GAUSSIAN),  # the same, without the updates in withdrawals and in fast motion
    ("prior", _GAUSSIAN),
    ("now", _GAUSSIAN),  # at the pose that is predicted
    ("learned", float),  # path of the last record that updated the filter
    ("scale", float, 3),  # mean of the squared errors of (L5) by component; x and y are equal
    ("bias", float),  # mean of the vertical errors of (L5)
    ("fitted", float, 3),  # work space
    ("gain", float, 4),
    ("a", float, (4, 4)),
]
"""Fields of a state that the functions below use."""


def begin(state: Any, strength_error: float) -> None:
    """Set a state to the calibration, whose ζ has this relative standard error."""
    state["prior"]["theta"] = 1.0, 1.0, 0.0, 0.0
    state["prior"]["p"] = _covariance(strength_error, _PRIOR_EACH, _PRIOR_SURFACE)
    state["latest"] = state["push"] = state["prior"]
    state["scale"], state["bias"] = 1.0, 0.0


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
    for i in range(4):  # number by number: an assignment of arrays also compiles an error message, which takes 4 s
        target.theta[i] = source.theta[i]
        for j in range(4):
            target.p[i, j] = source.p[i, j]


@inlined
def resume(belief, push, prior, elsewhere):
    """Set mean and covariance to those of the last push; `elsewhere`: surface and turn to those of the prior."""
    copy(belief, push)
    for i in range(2 if elsewhere else 4, 4):
        belief.theta[i] = prior.theta[i]
        for j in range(4):
            belief.p[i, j] = belief.p[j, i] = prior.p[i, j]


@inlined
def _bound(belief):
    """Bound θ to values that the model can have, and make P symmetric."""
    theta, p = belief.theta, belief.p
    for i in range(2):
        theta[i] = min(max(theta[i], _STRENGTH_LEAST), _STRENGTH_MOST)
    theta[2] = min(max(theta[2], -theta[1]), theta[1])
    for i in range(4):
        for j in range(i):
            p[i, j] = p[j, i] = 0.5 * (p[i, j] + p[j, i])


@inlined
def grow(belief, path):
    """Add the growth of (L2) over a path [m] to P."""
    for i in range(4):
        for j in range(4):
            belief.p[i, j] += path * _GROWTH[i, j]
    _bound(belief)


@inlined
def _design(h, row):
    """H of (L1): three rows for the force, three for the torque Σ r × f. The force of δ acts where the model's does."""
    force, by_height = row[0:3], row[_BY_HEIGHT : _BY_HEIGHT + 3]
    fx, fy, fz = force[0], force[1], force[2]
    sums = row[_MOMENTS:]  # Σ r_j f_l, row by row; z_fz makes no torque
    x_fx, x_fy, x_fz, y_fx, y_fy, y_fz = sums[0], sums[1], sums[2], sums[3], sums[4], sums[5]
    z_fx, z_fy = sums[6], sums[7]
    square = dot(force, force)
    per_force = dot(force, by_height) / square if square > 1e-200 else 0.0  # smaller squares lose digits
    h[0, 0], h[0, 1], h[0, 2] = 0.0, fx, -fy
    h[1, 0], h[1, 1], h[1, 2] = 0.0, fy, fx
    h[2, 0], h[2, 1], h[2, 2] = fz, 0.0, 0.0
    h[3, 0], h[3, 1], h[3, 2] = y_fz, -z_fy, -z_fx
    h[4, 0], h[4, 1], h[4, 2] = -x_fz, z_fx, -z_fy
    h[5, 0], h[5, 1], h[5, 2] = 0.0, x_fy - y_fx, x_fx + y_fy
    for i in range(3):
        h[i, 3] = by_height[i]
        h[3 + i, 3] = per_force * (h[3 + i, 0] + h[3 + i, 1])


@inlined
def correct(now, state, record, row, out, reach, lag, apply):
    """Correct a prediction by (L1), (L3) and (L4): write F, H, F', S and r to the record, the answer to `out`.

    The answer: wrench and standard deviations.
    """
    h = record.h
    _design(h, row)
    for i in range(3):
        record.force[i] = row[i]
        record.predicted[i] = dot(h[i], now.theta)
    square = dot(record.predicted, record.predicted)
    record.r = _NOISE**2 * square + _NOISE_FLOOR**2
    for i in range(3):
        for j in range(3):
            record.s[i, j] = _form(h[i], now.p, h[j]) + (record.r if i == j else 0.0)
    growth = _BIAS_GROWTH * min(lag, _BIAS_LAG_MOST)
    horizontal, vertical = state.scale[0], state.scale[2] + growth * state.bias**2
    for i in range(6):
        model, learned = h[i, 0] + h[i, 1], dot(h[i], now.theta)
        if i < 3:
            variance = (vertical if i == 2 else horizontal) * record.s[i, i]
        else:
            variance = max(horizontal, vertical) * (_form(h[i], now.p, h[i]) + (_NOISE * learned) ** 2)
            variance += (_LEVER * reach) ** 2 * square
        out[i] = learned if apply else model
        out[6 + i] = math.sqrt(variance + (learned - out[i]) ** 2)  # a correction that is not applied is an error, too


@inlined
def _adapt(state, record, step):
    """Update m and b of (L5) with the error of the prediction that was made at the record's pose."""
    y, predicted, s, scale = record.y, record.predicted, record.s, state.scale
    flat = ((y[0] - predicted[0]) ** 2 + (y[1] - predicted[1]) ** 2) / (s[0, 0] + s[1, 1])
    vertical = (y[2] - predicted[2]) / math.sqrt(s[2, 2])
    for i in range(3):
        square = min(vertical**2 if i == 2 else flat, _SQUARE_MOST)
        fall = _SCALE_FALL_VERTICAL if i == 2 else _SCALE_FALL
        length = _SCALE_RISE if square > scale[i] else fall
        scale[i] = max(scale[i] + (1.0 - math.exp(-step / length)) * (square - scale[i]), 1e-6)  # keeps σ over 0
    error = min(max(vertical, -_ERROR_MOST), _ERROR_MOST)
    state.bias += (1.0 - math.exp(-step / _BIAS_LENGTH)) * (error - state.bias)


@inlined
def _update(state, belief, h, y, variance):
    """Update with one component of the force, in Joseph's form: P = (I - K H) P (I - K H)ᵀ + K R Kᵀ."""
    gain, a = state.gain, state.a
    for i in range(4):
        gain[i] = dot(belief.p[i], h)
    s = dot(h, gain) + variance
    innovation = y - dot(h, belief.theta)
    for i in range(4):
        for j in range(4):
            a[i, j] = belief.p[i, j] - gain[i] * gain[j] / s
    for i in range(4):
        gain[i] /= s
        belief.theta[i] += gain[i] * innovation
    for i in range(4):
        ah = dot(a[i], h)
        for j in range(4):
            belief.p[i, j] = a[i, j] - ah * gain[j] + variance * gain[i] * gain[j]


@inlined
def absorb(state, record):
    """Update with a measured force: first c, then the growth (L2), then the gated innovation with the noise of (L3)."""
    belief, h, step = state.latest, record.h, record.path - state.learned
    state.learned = record.path
    _adapt(state, record, step)
    grow(belief, step)
    square = trace = 0.0
    for i in range(3):
        state.fitted[i] = dot(h[i], belief.theta)
        square += (record.y[i] - state.fitted[i]) ** 2
        trace += _form(h[i], belief.p, h[i]) + record.r
    share = min(1.0, _GATE * math.sqrt(trace / max(square, 1e-300)))
    variance = record.r * max(1.0, _NOISE_LENGTH / step)
    for i in range(3):
        _update(state, belief, h[i], state.fitted[i] + share * (record.y[i] - state.fitted[i]), variance)
    _bound(belief)
    if not record.passing:
        copy(state.push, belief)
