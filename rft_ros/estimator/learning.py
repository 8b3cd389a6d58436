"""Learning the medium: a Kalman filter with four states over the path of the tool.

The model's force F (any law, rule or memory; world axes, z up) is corrected by θ = (s_v, s_h, ρ, δ):

    F' = [ s_h (Fx, Fy) + ρ (-Fy, Fx);  s_v Fz ] + δ dF/dh  =  H θ                                  (L1)

s_v and s_h scale the vertical and the horizontal part, ρ turns the horizontal part about the vertical, and δ [m] moves
the surface. F' is linear in θ, so the torque follows from the same θ and the sums Σ r_j f_l over the plates. The path
of the tool's fastest point takes the place of time: at rest nothing changes, and speed does not matter. Equation
numbers are those of docs/learning.md, which also has the data that the constants were chosen on.
"""

import math
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.compilation import compiled, inlined, machine_code

__all__ = ["Belief", "BeliefIssue", "Learning", "Surprise"]

Array = NDArray[np.float64]


class _Constants(NamedTuple):
    """All constants of the filter; lengths are path [m], deviations are standard deviations."""

    # prior and growth of P
    prior_each: float = 0.3  # deviation of s_v, s_h and ρ, beside what s_v and s_h share
    prior_surface: float = 0.003  # deviation of δ [m]
    growth_length: float = 0.01  # the variances of growth are added over this path
    growth_common: float = 0.28  # deviation that s_v and s_h share
    growth_each: float = 0.42  # deviation of s_v, s_h and ρ
    growth_surface: float = 0.0023  # deviation of δ [m]
    # measurement
    noise: float = 0.093  # deviation over the predicted force
    noise_floor: float = 0.025  # deviation [N]
    noise_length: float = 0.003  # errors of samples closer than this are correlated
    gate: float = 3.0  # a larger innovation, in deviations, is reduced to this
    lever: float = 0.07  # deviation of the point where the force acts, over the tool's reach
    # adaptation to the errors of past predictions
    tempo_length: float = 0.01  # of the mean of the squared errors
    tempo_power: float = 1.6
    tempo_least: float = 0.14
    tempo_most: float = 10.0
    scale_rise: float = 0.0025  # of the mean of the squared errors by component, while it grows
    scale_fall: float = 0.005  # and while it falls
    square_most: float = 9.0  # a larger squared error, in variances, counts as this
    # bounds of θ and P
    strength_least: float = 0.1
    strength_most: float = 10.0
    surface_most: float = 0.03  # of |δ| [m]
    variance_most: float = 1.0  # of s_v, s_h and ρ
    surface_variance_most: float = 1e-4  # of δ [m²]
    # path through air
    air_local: float = 0.005  # δ and ρ return to the prior over this length
    air_strength: float = 0.5  # s_v and s_h return to the prior over this length
    # surprise and checks of the model
    entry: float = 0.008  # not judged over this path after entering, while δ is being learned
    surprise_length: float = 0.0003  # of the mean of the normalised error
    surprise_on: float = 2.4  # mean normalised error
    surprise_off: float = 1.2
    score_most: float = 6.0  # a larger normalised error counts as this
    drift_length: float = 0.05  # the reference of the drift follows the strength over this length
    drift_on: float = 3.0  # in deviations of the prior
    drift_off: float = 1.5
    sum_length: float = 0.005  # of the means that compare measurement and model
    opposing: float = 0.05  # [N]; below this the direction of a force is chance
    ratio_most: float = 10.0  # a larger ratio of measured to model force counts as this
    stuck_length: float = 0.0005  # repeated readings over more than this path are a fault
    stuck_samples: int = 3
    # limits of the records
    step_most: float = 1.0  # path between two poses
    records: int = 2048
    records_per_lag: int = 1024


C = _Constants()
_FORCE_MOST = 1e100  # [N]; squares of larger forces overflow

_GAUSSIAN = np.dtype([("theta", float, 4), ("p", float, (4, 4))], align=True)  # mean and covariance of θ
_RECORD = np.dtype(
    [
        ("stamp", np.int64),
        ("travel", float),  # path in air and grains
        ("path", float),  # path in the grains
        ("air", float),  # path through the air before this record, if it enters
        ("enters", np.bool_),
        ("passing", np.bool_),
        ("teaches", np.bool_),
        ("measured", np.bool_),  # y holds a measurement that teaches
        ("force", float, 3),  # of the model, F
        ("h", float, (6, 4)),  # H of force and torque
        ("predicted", float, 3),  # F' as it was predicted, and its covariance S
        ("s", float, (3, 3)),
        ("r", float),  # variance of the noise
        ("y", float, 3),  # measured force
    ],
    align=True,
)
"""A pose in the grains that waits for its measurement, or until the tool is `lag` further."""

_STATE = np.dtype(
    [
        ("latest", _GAUSSIAN),  # after the last record taken
        ("push", _GAUSSIAN),  # the same, without what withdrawals and fast motion taught
        ("now", _GAUSSIAN),  # at the pose that is predicted
        ("prior", _GAUSSIAN),
        ("growth", float, (4, 4)),  # G of (L2)
        ("first", np.int64),  # records are numbered without end; number n is at n modulo their count
        ("open", np.int64),  # the first record whose measurement is not final
        ("end", np.int64),
        ("entries", np.int64),  # records kept that enter
        ("travel", float),
        ("path", float),
        ("learned", float),  # path of the last record that taught
        ("judged", float),  # path of the last record that was judged
        ("entered", float),  # path at which the tool last entered
        ("felt", float),  # path of the last record with too small a force to compare
        ("speed", float),
        ("pushing", np.bool_),  # in the grains, neither withdrawn nor fast
        ("air", float),  # path through the air since the last push
        ("entry_air", float),  # the same at the last entry
        ("mean_square", float),
        ("tempo", float),  # m of (L5)
        ("scale", float, 3),  # c of (L6) by component; x and y are equal
        ("score", float),  # means over surprise_length: normalised error, error [N], force [N]
        ("excess", float),
        ("size", float),
        ("reference", float),  # mean of the logarithm of the strength
        ("drift", float),
        ("surprise", np.int64),
        ("along", float),  # means over sum_length: y·F, F·F, and dot, cross product and square of horizontal parts
        ("square", float),
        ("flat_along", float),
        ("flat_cross", float),
        ("flat_square", float),
        ("stuck_path", float),
        ("repeats", np.int64),
        ("fitted", float, 3),  # work space of the update
        ("s", float, (3, 3)),
        ("gain", float, 4),
        ("a", float, (4, 4)),
    ],
    align=True,
)


_SUMS = ("along", "square", "flat_along", "flat_cross", "flat_square")


class Surprise(IntEnum):
    """Whether the grains are as believed."""

    SOFTER = -1
    NONE = 0
    HARDER = 1


class BeliefIssue(str, Enum):
    """Why the load cell or the model cannot be right, whatever the grains; the value is a sentence."""

    STUCK = "the load cell repeats the same reading while the tool moves: check its driver"
    OPPOSED = "the measured force points against the model's: check sensor.sign, sensor.quaternion and the mesh"
    WEAK = "the measured force is below a fifth of the model's: check medium.zeta, surface_height and the mesh"
    STRONG = "the measured force is over five times the model's: check medium.zeta, mesh.scale and surface_height"
    TURNED = "the measured force is turned by over 45 degrees from the model's: check sensor.quaternion and the frames"

    __str__ = str.__str__


@dataclass(frozen=True, slots=True, kw_only=True)
class Belief:
    """What is believed of the grains after every sample that lies `lag` behind.

    `vertical`, `horizontal`: strengths, no unit. `turn` [rad] of the horizontal force about the vertical. `surface`
    [m] above `surface_height`. Then their standard errors. `path` [m] in the grains. `surprise`: measured minus
    predicted force along the predicted one, in standard deviations, mean over 0.3 mm of path. `excess`: the same over
    the predicted force. `drift`: the logarithm of the strength minus its mean over 50 mm of path, in standard
    deviations of the prior.
    """

    vertical: float
    horizontal: float
    turn: float
    surface: float
    vertical_error: float
    horizontal_error: float
    turn_error: float
    surface_error: float
    path: float
    surprise: float
    excess: float
    drift: float


def _covariance(common: float, each: float, surface: float) -> Array:
    p = np.diag([each**2, each**2, each**2, surface**2])
    p[:2, :2] += common**2
    return p


@inlined
def _dot(a, b):  # type: ignore[no-untyped-def]
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * b[i]
    return total


@inlined
def _form(a, m, b):  # type: ignore[no-untyped-def]
    """aᵀ M b."""
    total = 0.0
    for i in range(a.shape[0]):
        total += a[i] * _dot(m[i], b)
    return total


@inlined
def _toward(mean, value, step, length):  # type: ignore[no-untyped-def]
    """Exponential mean over `length` of path."""
    return mean + (1.0 - math.exp(-step / length)) * (value - mean)


@inlined
def _mahalanobis(s, y, predicted):  # type: ignore[no-untyped-def]
    """eᵀ S⁻¹ e of e = y - predicted, by the Cholesky factor of S, shape [3, 3]; finite if S is nearly singular."""
    l00 = math.sqrt(s[0, 0])
    l10, l20 = s[1, 0] / l00, s[2, 0] / l00
    l11 = math.sqrt(max(s[1, 1] - l10 * l10, 1e-12 * s[1, 1]))
    l21 = (s[2, 1] - l20 * l10) / l11
    l22 = math.sqrt(max(s[2, 2] - l20 * l20 - l21 * l21, 1e-12 * s[2, 2]))
    u = (y[0] - predicted[0]) / l00
    v = (y[1] - predicted[1] - l10 * u) / l11
    w = (y[2] - predicted[2] - l20 * u - l21 * v) / l22
    return u * u + v * v + w * w


@inlined
def _copy(target, source):  # type: ignore[no-untyped-def]
    for i in range(4):  # assigning arrays compiles numba's error for shapes that differ: 4 s each
        target.theta[i] = source.theta[i]
        for j in range(4):
            target.p[i, j] = source.p[i, j]


@inlined
def _design(h, row):  # type: ignore[no-untyped-def]
    """H of (L1): three rows for the force, three for the torque Σ r × f. δ's force acts where the model's does."""
    f, g, m = row[0:3], row[7:10], row[10:19]  # F, dF/dh, and Σ r_j f_l row by row
    square = _dot(f, f)
    per_force = _dot(f, g) / square if square > 0.0 else 0.0
    h[0, 0], h[0, 1], h[0, 2], h[0, 3] = 0.0, f[0], -f[1], g[0]
    h[1, 0], h[1, 1], h[1, 2], h[1, 3] = 0.0, f[1], f[0], g[1]
    h[2, 0], h[2, 1], h[2, 2], h[2, 3] = f[2], 0.0, 0.0, g[2]
    h[3, 0], h[3, 1], h[3, 2] = m[5], -m[7], -m[6]
    h[4, 0], h[4, 1], h[4, 2] = -m[2], m[6], -m[7]
    h[5, 0], h[5, 1], h[5, 2] = 0.0, m[1] - m[3], m[0] + m[4]
    for i in range(3, 6):
        h[i, 3] = per_force * (h[i, 0] + h[i, 1])


@inlined
def _grow(belief, growth, amount):  # type: ignore[no-untyped-def]
    """P of (L2)."""
    for i in range(4):
        for j in range(4):
            belief.p[i, j] += amount * growth[i, j]


@inlined
def _innovate(s, h, belief, r):  # type: ignore[no-untyped-def]
    """S = H P Hᵀ + r I of the force."""
    for i in range(3):
        for j in range(3):
            s[i, j] = _form(h[i], belief.p, h[j]) + (r if i == j else 0.0)


@inlined
def _update(state, belief, h, y, variance):  # type: ignore[no-untyped-def]
    """One component of the force into the belief, in Joseph's form: P = (I - K H) P (I - K H)ᵀ + K R Kᵀ."""
    gain, a = state.gain, state.a
    for i in range(4):
        gain[i] = _dot(belief.p[i], h)
    s = _dot(h, gain) + variance
    innovation = y - _dot(h, belief.theta)
    for i in range(4):
        for j in range(4):
            a[i, j] = belief.p[i, j] - gain[i] * gain[j] / s
    for i in range(4):
        gain[i] /= s
        belief.theta[i] += gain[i] * innovation
    for i in range(4):
        ah = _dot(a[i], h)
        for j in range(4):
            belief.p[i, j] = a[i, j] - ah * gain[j] + variance * gain[i] * gain[j]


@inlined
def _bound(belief):  # type: ignore[no-untyped-def]
    """Keep θ where the model has a meaning, P symmetric, and the variances of what is not observed finite."""
    theta, p = belief.theta, belief.p
    for i in range(2):
        theta[i] = min(max(theta[i], C.strength_least), C.strength_most)
    theta[2] = min(max(theta[2], -theta[1]), theta[1])
    theta[3] = min(max(theta[3], -C.surface_most), C.surface_most)
    for i in range(4):
        most = C.variance_most if i < 3 else C.surface_variance_most
        if p[i, i] > most:
            share = math.sqrt(most / p[i, i])
            for j in range(4):
                p[i, j] *= share
                p[j, i] *= share
    for i in range(4):
        for j in range(i):
            p[i, j] = p[j, i] = 0.5 * (p[i, j] + p[j, i])


@inlined
def _reenter(belief, push, prior, air):  # type: ignore[no-untyped-def]
    """The belief of the last push, faded towards the prior by the path through the air."""
    local, strength = math.exp(-air / C.air_local), math.exp(-air / C.air_strength)
    for i in range(4):
        keep = strength if i < 2 else local
        belief.theta[i] = prior.theta[i] + keep * (push.theta[i] - prior.theta[i])
        for j in range(4):
            both = keep * (strength if j < 2 else local)
            belief.p[i, j] = both * push.p[i, j] + (1.0 - both) * prior.p[i, j]


@inlined
def _adapt(state, record, step):  # type: ignore[no-untyped-def]
    """m of (L5) and c of (L6) from the error of a prediction as it was made."""
    y, predicted, s = record.y, record.predicted, record.s
    square = min(_mahalanobis(s, y, predicted) / 3.0, C.square_most)
    state.mean_square = _toward(state.mean_square, square, step, C.tempo_length)
    state.tempo = min(max(state.mean_square**C.tempo_power, C.tempo_least), C.tempo_most)
    flat = ((y[0] - predicted[0]) ** 2 + (y[1] - predicted[1]) ** 2) / (s[0, 0] + s[1, 1])
    vertical = (y[2] - predicted[2]) ** 2 / s[2, 2]
    for i in range(3):
        square = min(vertical if i == 2 else flat, C.square_most)
        length = C.scale_rise if square > state.scale[i] else C.scale_fall
        state.scale[i] = max(_toward(state.scale[i], square, step, length), 1e-6)  # else σ could vanish


@inlined
def _drift(state, record, step):  # type: ignore[no-untyped-def]
    """Strength, weighted as s_v and s_h make up the force, against its mean since the entry, then over 50 mm."""
    f, theta = record.force, state.latest.theta
    square, since = _dot(f, f), record.path - state.entered - C.entry
    if square > 0.0 and since >= 0.0:
        logarithm = math.log((theta[1] * (f[0] * f[0] + f[1] * f[1]) + theta[0] * f[2] * f[2]) / square)
        weight = 1.0 if since <= step else min(max(step / (since + C.sum_length), step / C.drift_length), 1.0)
        state.reference += weight * (logarithm - state.reference)
        state.drift = (logarithm - state.reference) / math.sqrt(state.prior.p[0, 0])


@inlined
def _take(state, record):  # type: ignore[no-untyped-def]
    """One record into the belief: entry, adaptation, growth (L2), and update with the noise of (L3)."""
    belief, h = state.latest, record.h
    if record.enters:
        _reenter(belief, state.push, state.prior, record.air)
        state.entries -= 1
    step = record.path - state.learned
    if not (record.measured and step > 0.0):
        return
    state.learned = record.path
    _adapt(state, record, step)
    _grow(belief, state.growth, state.tempo * step / C.growth_length)
    for i in range(3):
        state.fitted[i] = _dot(h[i], belief.theta)
    _innovate(state.s, h, belief, record.r)
    distance = math.sqrt(_mahalanobis(state.s, record.y, state.fitted))
    share = min(1.0, C.gate / max(distance, 1e-300))
    variance = record.r * max(1.0, C.noise_length / step)
    for i in range(3):
        _update(state, belief, h[i], state.fitted[i] + share * (record.y[i] - state.fitted[i]), variance)
    _bound(belief)
    if not record.passing:
        _copy(state.push, belief)
        _drift(state, record, step)


@inlined
def _move(state, step, wet, passing):  # type: ignore[no-untyped-def]
    """Advance the path; whether the tool begins to push here."""
    state.travel += step
    if not wet:
        state.pushing = False
        state.air += step
        return False
    state.path += step
    if passing:
        state.pushing = False
        return False
    if state.pushing or not step > 0.0:
        return False
    state.pushing = True
    state.entered = state.path
    return True


@compiled
def _predict(states, records, row, out, stamp, duration, speed, passing, teaches, apply, lag, reach):  # type: ignore[no-untyped-def]
    """Move, take the records that lie `lag` behind, predict with (L4), and keep a record for the measurement."""
    state, now = states[0], states[0].now
    force, wet = row[0:3], row[6] > 0.0
    step = min(0.5 * (speed + state.speed) * duration, C.step_most)
    state.speed = speed
    passing = passing or force[2] < -0.5 * math.sqrt(_dot(force, force))  # only a withdrawn tool is pulled down
    enters = _move(state, step, wet, passing)

    while state.first < state.open and records[state.first % C.records].travel <= state.travel - lag:
        _take(state, records[state.first % C.records])
        state.first += 1
    if state.end - state.first == C.records:  # measurements never came: the oldest will not teach
        records[state.first % C.records].measured = False
        _take(state, records[state.first % C.records])
        state.first += 1
        state.open = max(state.open, state.first)

    if enters:
        state.entries += 1
        state.entry_air, state.air = state.air, 0.0
    _copy(now, state.latest)
    if state.entries > 0:  # the record of the entry is not taken yet
        _reenter(now, state.push, state.prior, state.entry_air)
    _grow(now, state.growth, state.tempo * max(state.path - state.learned, 0.0) / C.growth_length)
    _bound(now)

    record = records[state.end % C.records]
    h, scale = record.h, state.scale
    _design(h, row)
    for i in range(3):
        record.force[i] = force[i]
        record.predicted[i] = _dot(h[i], now.theta)
    square = _dot(record.predicted, record.predicted)
    record.r = C.noise**2 * square + C.noise_floor**2
    _innovate(record.s, h, now, record.r)
    for i in range(6):
        model, learned = h[i, 0] + h[i, 1], _dot(h[i], now.theta)
        if i < 3:
            variance = scale[i] * record.s[i, i]
        else:
            variance = max(scale[0], scale[2]) * (_form(h[i], now.p, h[i]) + (C.noise * learned) ** 2)
            variance += (C.lever * reach) ** 2 * square
        out[i] = learned if apply else model
        out[6 + i] = math.sqrt(variance + (learned - out[i]) ** 2)  # without the correction its size is an error too

    last = records[(state.end - 1) % C.records].travel
    close = state.end > state.first and state.travel - last < lag / C.records_per_lag
    if wet and step > 0.0 and (enters or not close):
        record.stamp, record.travel, record.path = stamp, state.travel, state.path
        record.enters, record.air = enters, state.entry_air
        record.passing, record.measured = passing, False
        record.teaches = teaches and math.isfinite(record.s[0, 0] + record.s[1, 1] + record.s[2, 2])
        state.end += 1


@inlined
def _compare(state, record, y, step):  # type: ignore[no-untyped-def]
    """Means of the measured against the model's force, for `issues`."""
    f, length = record.force, C.sum_length
    flat, square = f[0] * f[0] + f[1] * f[1], _dot(f, f)
    if square < C.opposing**2:
        state.felt = record.path
    share = min(1.0, (C.ratio_most * math.sqrt(square) + C.opposing) / max(math.sqrt(_dot(y, y)), 1e-300))
    state.along = _toward(state.along, share * _dot(y, f), step, length)
    state.square = _toward(state.square, square, step, length)
    state.flat_along = _toward(state.flat_along, share * (y[0] * f[0] + y[1] * f[1]), step, length)
    state.flat_cross = _toward(state.flat_cross, share * (y[1] * f[0] - y[0] * f[1]), step, length)
    state.flat_square = _toward(state.flat_square, flat, step, length)


@inlined
def _score(state, record, step):  # type: ignore[no-untyped-def]
    """Mean error along the predicted force, in its standard deviations by S; 0 where it is not judged."""
    y, predicted = record.y, record.predicted
    size = math.sqrt(_dot(predicted, predicted))
    if record.passing or record.path - state.entered < C.entry or not size > 0.0:
        state.score = state.excess = state.size = 0.0
        return
    error = _dot(predicted, y) / size - size
    normalised = error * size / math.sqrt(_form(predicted, record.s, predicted))
    normalised = min(max(normalised, -C.score_most), C.score_most)
    state.score = _toward(state.score, normalised, step, C.surprise_length)
    state.excess = _toward(state.excess, error, step, C.surprise_length)
    state.size = _toward(state.size, size, step, C.surprise_length)


@inlined
def _judge(state):  # type: ignore[no-untyped-def]
    """Surprise at once or by drift, held until both have settled."""
    if abs(state.score) > C.surprise_on:
        state.surprise = 1 if state.score > 0.0 else -1
    elif abs(state.drift) > C.drift_on:
        state.surprise = 1 if state.drift > 0.0 else -1
    elif abs(state.score) < C.surprise_off and abs(state.drift) < C.drift_off:
        state.surprise = 0


@compiled
def _learn(states, records, y, stamp, usable, repeated):  # type: ignore[no-untyped-def]
    """Give the record of a stamp its measurement, unless it is missing, repeated or against the model's force."""
    state = states[0]
    while state.open < state.end and records[state.open % C.records].stamp < stamp:
        state.open += 1
    record = records[state.open % C.records]
    if state.open == state.end or record.stamp > stamp:
        return
    state.open += 1
    if not usable:
        return
    step = min(record.path - state.judged, C.step_most)
    state.judged = record.path
    state.stuck_path = state.stuck_path + step if repeated else 0.0
    state.repeats = state.repeats + 1 if repeated else 0
    if not record.teaches or (state.stuck_path > C.stuck_length and state.repeats >= C.stuck_samples):
        return
    if not record.passing:
        _compare(state, record, y, step)
        if state.along < -(C.opposing**2):
            return
    record.measured = True
    for i in range(3):
        record.y[i] = y[i]
    _score(state, record, step)
    _judge(state)


class Learning:
    """What the load cell tells about the grains, for one tool in one medium.

    At each pose call `predict`. When its compensated force is known, call `learn` with the pose's stamp, in the order
    of stamps. A prediction uses the measurements whose path is at least `lag` behind, so no sample is part of its own
    prediction. The same calls give the same bytes.

    `lag`: path [m] between a sample and the first prediction that it may change. `strength_error`: relative standard
    error of ζ from the calibration; without a calibration keep the default. `reach`: largest distance [m] of the tool's
    surface from the tool frame's origin. Raises ValueError for values out of range.
    """

    def __init__(self, *, lag: float = 0.002, strength_error: float = 0.15, reach: float = 0.0) -> None:
        if not 1e-5 <= lag <= 1.0:
            raise ValueError(f"lag is {lag} m; it must lie in 0.00001 to 1")
        if not 0.0 <= strength_error <= 2.0:
            raise ValueError(f"strength_error is {strength_error}; it must lie in 0 to 2")
        self.lag, self._strength_error = lag, strength_error
        self._states = np.zeros(1, _STATE)
        self._state: Any = self._states[0]
        self._records = np.zeros(C.records, _RECORD)
        self._row, self._y, self._out = np.zeros(19), np.zeros(3), np.zeros(12)
        self.reach = reach
        self._last = 0
        arrays = self._states, self._records
        pose = 0, 0.0, 0.0, False, True, True, 0.0, 0.0
        self._predict = machine_code(_predict, (*arrays, self._row, self._out, *pose))
        self._learn: Any = machine_code(_learn, (*arrays, self._y, 0, True, False))
        self.forget()

    def forget(self) -> None:
        """Go back to the calibration."""
        state = self._state
        self._states[:] = np.zeros(1, _STATE)
        state["prior"]["theta"] = 1.0, 1.0, 0.0, 0.0
        state["prior"]["p"] = _covariance(self._strength_error, C.prior_each, C.prior_surface)
        state["growth"] = _covariance(C.growth_common, C.growth_each, C.growth_surface)
        state["latest"] = state["push"] = state["prior"]
        state["mean_square"] = state["tempo"] = state["scale"] = 1.0
        state["pushing"] = True
        self._last = 0

    def leave(self) -> None:
        """Keep the strength, forget surface and turn: the tool is elsewhere or another one, or time has jumped."""
        state = self._state
        state["first"] = state["open"] = state["end"]
        state["entries"] = 0
        state["learned"] = state["judged"] = state["path"]
        state["speed"] = 0.0
        state["pushing"] = False
        latest, prior = state["latest"], state["prior"]
        state["latest"] = state["push"]
        latest["theta"][2:] = prior["theta"][2:]
        latest["p"][2:], latest["p"][:, 2:] = prior["p"][2:], prior["p"][:, 2:]
        for mean in ("surprise", "score", "excess", "size", "drift", *_SUMS):
            state[mean] = 0
        state["air"] = 10.0 * C.air_local  # at the next entry surface and turn have returned to the prior
        self._last = 0

    def predict(
        self, stamp: int, row: Array, *, speed: float, passing: bool = False, teaches: bool = True, apply: bool = True
    ) -> Array:
        """Corrected wrench and its standard deviations at a pose, world axes; overwritten by the next call.

        `stamp` [ns], increasing (an earlier one calls `leave`). `row`, shape [19]: the model at the pose: force F [N],
        torque [N m], submerged area [m²], dF/dh [N/m], and Σ r_j f_l [N m] row by row; finite. `speed` of the tool's
        fastest point [m/s], 0 at rest. `passing`: the tool is withdrawn, or so fast that inertia matters; what is
        learned here is dropped afterwards, and nothing surprises. `teaches` False: do not learn from this pose.
        `apply` False leaves the wrench as the model has it. Returns shape [12]: force [N], torque about the tool
        frame's origin [N m], then the standard deviation of each.
        """
        if stamp <= self._last:
            self.leave()
        duration = (stamp - self._last) * 1e-9 if self._last > 0 else 0.0
        self._last = stamp
        if not 0.0 <= speed < math.inf:
            speed, teaches = 0.0, False
        self._row[:] = row
        self._predict(
            self._states, self._records, self._row, self._out,
            int(stamp), duration, float(speed), bool(passing), bool(teaches), bool(apply),
            float(self.lag), float(self.reach),
        )  # fmt: skip
        return self._out

    def learn(self, stamp: int, force: Array | None, *, repeated: bool = False) -> None:
        """Take the compensated force [N] at a pose, world axes, shape [3]; None if there is none.

        `repeated`: the load cell's raw reading equals the one before, bit by bit.
        """
        self._y[:] = math.nan if force is None else force
        usable = math.hypot(*self._y.tolist()) < _FORCE_MOST
        self._learn(self._states, self._records, self._y, int(stamp), usable, bool(repeated))

    @property
    def surprise(self) -> Surprise:
        """Whether the grains at the last measurement were harder or softer than believed."""
        return Surprise(int(self._state["surprise"]))

    @property
    def theta(self) -> Array:
        """s_v, s_h, ρ, δ [m], shape [4]: a copy."""
        return np.array(self._state["latest"]["theta"])

    @property
    def covariance(self) -> Array:
        """Of `theta`, shape [4, 4], in its units: a copy."""
        return np.array(self._state["latest"]["p"])

    def belief(self) -> Belief:
        """θ in the user's terms."""
        state = self._state
        v, h, turn, surface = self.theta.tolist()
        dv, dh, dt, ds = np.sqrt(np.diag(self.covariance)).tolist()
        size = float(state["size"])
        return Belief(
            vertical=v,
            horizontal=h,
            turn=math.atan2(turn, h),
            surface=surface,
            vertical_error=dv,
            horizontal_error=dh,
            turn_error=dt / h,
            surface_error=ds,
            path=float(state["path"]),
            surprise=float(state["score"]),
            excess=float(state["excess"]) / size if size > 0.0 else 0.0,
            drift=float(state["drift"]),
        )

    def strength(self) -> tuple[float, float] | None:
        """Strength of the bed over the model's at the last push, and its standard error; None if nothing was learned.

        s_v and s_h by the inverse of their variances.
        """
        mean, covariance = self._state["push"]["theta"], self._state["push"]["p"][:2, :2]
        if np.array_equal(mean, (1.0, 1.0, 0.0, 0.0)):
            return None
        weights = 1.0 / np.diag(covariance)
        weights /= weights.sum()
        return float(weights @ mean[:2]), math.sqrt(float(weights @ covariance @ weights))

    def issues(self) -> list[BeliefIssue]:
        """Why the load cell or the model cannot be right.

        The model is judged over 5 mm of path, from 8 mm after the tool entered and after its force reached 0.05 N.
        """
        state = self._state
        stuck = state["stuck_path"] > C.stuck_length and state["repeats"] >= C.stuck_samples
        found = [BeliefIssue.STUCK] if stuck else []
        if not state["square"] > 0.0 or state["judged"] - max(state["entered"], state["felt"]) < C.entry:
            return found
        ratio = state["along"] / state["square"]
        if ratio < 0.0:
            found.append(BeliefIssue.OPPOSED)
        elif ratio < 0.2:
            found.append(BeliefIssue.WEAK)
        elif ratio > 5.0:
            found.append(BeliefIssue.STRONG)
        sideways = state["flat_square"] > 0.05 * state["square"]
        if ratio >= 0.0 and sideways and abs(state["flat_cross"]) > state["flat_along"]:
            found.append(BeliefIssue.TURNED)
        return found
