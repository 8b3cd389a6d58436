"""The medium, learned from the load cell: a Kalman filter on four numbers, along the tool's path.

The model's force F (any law, rule or memory; world axes, z up) is corrected by θ = (s_v, s_h, ρ, δ):

    F' = [ s_h (Fx, Fy) + ρ (-Fy, Fx);  s_v Fz ] + δ dF/dh                                      Eq. (L1)

s_v and s_h scale the vertical and the horizontal part, ρ turns the horizontal part about the vertical, and δ [m] moves
the surface. θ is linear in F', so that the torque follows from the same numbers and the sums Σ r_j f_l. Path of the
tool's fastest point stands in for time: rest teaches nothing and speed does not matter. docs/learning.md has the
derivation, the data that the constants were chosen on, and what was tried and discarded.
"""

import math
from dataclasses import dataclass
from enum import Enum, IntEnum
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["Belief", "BeliefIssue", "Learning", "LearningSettings", "Lesson", "Surprise"]

Array = NDArray[np.float64]

# Chosen on the data of docs/learning.md. Lengths are of path [m].
_PRIOR_EACH = 0.3  # standard deviation of s_v, s_h and ρ each, beside what s_v and s_h share
_PRIOR_SURFACE = 0.003  # [m]
_GROWTH = 0.01  # path over which the variances below are added
_GROWTH_COMMON, _GROWTH_EACH, _GROWTH_SURFACE = 0.28, 0.42, 0.0023
_NOISE, _NOISE_FLOOR = 0.093, 0.025  # share of the predicted force; [N]
_NOISE_LENGTH = 0.003  # samples closer than this say the same
_TEMPO_LENGTH, _TEMPO_POWER, _TEMPO_LEAST, _TEMPO_MOST = 0.01, 1.6, 0.14, 10.0
_SCALE_LENGTH = 0.005
_LARGEST_SQUARE = 9.0  # of a normalised error: one sample must not decide a mean
_CLIP = 3.0  # standard deviations that a sample may pull
_LEAST_STRENGTH, _MOST_STRENGTH = 0.1, 10.0
_MOST_VARIANCE = (1.0, 1.0, 1.0, 1e-4)
_AIR_LOCAL, _AIR_STRENGTH = 0.005, 0.5  # path in the air over which the surface and the turn, and the strength, fade
_ENTRY = 0.008  # after entering, the surface is being learned: nothing surprises
_SURPRISE_LENGTH, _SURPRISING, _SETTLED = 0.0003, 2.4, 1.2
_DRIFT_LENGTH, _DRIFTED = 0.05, 3.0  # the reference of the drift follows over this path; prior standard deviations
_SUM_LENGTH = 0.005
_LEVER = 0.07  # standard deviation of the point where the force acts, over the tool's reach
_STUCK, _STUCK_SAMPLES = 0.0005, 3
_OPPOSING = 0.05  # [N]: smaller forces oppose by chance
_LARGEST_SHARE = 10.0  # of the model's force, in the means that judge the model
_MOST_SURFACE = 0.03  # [m]
_LONGEST_STEP = 1.0
_ABSURD = 1e100  # [N]: squares of larger forces overflow
_RECORDS = 2048
_PER_LAG = 1024  # records kept over one lag of path

# columns of a record
_PATH, _WET, _EVENT, _AIR, _PASSING, _STATE, _F, _G, _PRED, _S, _Y, _NOISE_VARIANCE, _WIDTH = (
    0, 1, 2, 3, 4, 5, 6, 9, 12, 15, 21, 24, 25,
)  # fmt: skip
_PENDING, _MEASURED, _VOID = 0.0, 1.0, 2.0

# places of single numbers beside θ and its covariance
(
    _TOTAL, _GRAINS, _LEARNED, _TEMPO, _MEAN_SQUARE, _SCALE_H, _SCALE_V, _SPEED, _AWAY,
    _AIR_PENDING, _ENTERED, _SCORE, _SCORED, _EXCESS, _FORCE, _ALONG, _SQUARE, _STUCK_PATH,
    _REPEATS, _DRIFT, _REFERENCE, _DOT, _CROSS, _FLAT, _SURPRISE, _BED,
) = range(26)  # fmt: skip

_NUMBERS = _BED + 20  # the belief of the last push: θ and its covariance
_SINGLE, _PRIOR = 20, 20 + _NUMBERS  # parts of the work array, after θ and its covariance
_ADDED, _NOW, _H, _K, _WORK = _PRIOR + 16, _PRIOR + 32, _PRIOR + 52, _PRIOR + 64, _PRIOR + 124

_HEAD, _COUNT, _NEXT = 0, 1, 2  # of the ring: oldest record, records, records whose measurement is final


class Lesson(IntEnum):
    """What became of a load-cell sample."""

    NONE = 0
    """No pose in the grains that moved has this stamp, or the sample is missing or not finite."""
    TAKEN = 1
    """It will teach once the tool is `lag` further."""
    STUCK = 2
    """The load cell repeats the same numbers while the tool moves on."""
    OPPOSED = 3
    """The measured force points against the model's."""


class Surprise(IntEnum):
    """Whether the grains are as believed."""

    SOFTER = -1
    NONE = 0
    HARDER = 1


class BeliefIssue(str, Enum):
    """Why the model cannot be right, whatever the grains; the value is a sentence."""

    OPPOSED = "the measured force points against the model's: check sensor.sign, sensor.quaternion and the mesh"
    WEAK = "the measured force is below a fifth of the model's: check medium.zeta, surface_height and the mesh"
    STRONG = "the measured force is over five times the model's: check medium.zeta, mesh.scale and surface_height"
    TURNED = "the measured force is turned by over 45 degrees from the model's: check sensor.quaternion and the frames"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, slots=True, kw_only=True)
class LearningSettings:
    """`lag`: path [m] between a sample and the first prediction that it may change, over 0.

    `strength_error`: relative standard error of ζ, as calibrated; without a calibration the default. Raises ValueError
    on values out of range.
    """

    lag: float = 0.002
    strength_error: float = 0.15

    def __post_init__(self) -> None:
        if not 1e-5 <= self.lag <= 1.0:
            raise ValueError(f"lag is {self.lag} m; it must lie in 0.00001 to 1")
        if not 0.0 <= self.strength_error <= 2.0:
            raise ValueError(f"strength_error is {self.strength_error}; it must lie in 0 to 2")


@dataclass(frozen=True, slots=True, kw_only=True)
class Belief:
    """What is believed of the grains after every sample that lies `lag` behind.

    Strengths, no unit; `turn` [rad] of the horizontal force about the vertical; `surface` [m] above `surface_height`;
    their standard errors. `path` [m] in the grains. `surprise`: measured less predicted force along the predicted one,
    in standard deviations, mean over 0.3 mm of path; `excess`: the same over the predicted force. `drift`: how far
    the logarithm of the strength has left its mean over 50 mm of path, in standard deviations of the prior.
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
    p = np.diag([each * each, each * each, each * each, surface * surface])
    p[:2, :2] += common * common
    return p


@numba.njit(cache=True, error_model="numpy")
def _parts(work):  # type: ignore[no-untyped-def]
    """θ, its covariance, the single numbers, the prior's covariance and what is added to it over `_GROWTH`."""
    return (
        work[:4],
        work[4:20].reshape((4, 4)),
        work[_SINGLE : _SINGLE + _NUMBERS],
        work[_PRIOR : _PRIOR + 16].reshape((4, 4)),
        work[_ADDED : _ADDED + 16].reshape((4, 4)),
    )


@numba.njit(cache=True, error_model="numpy")
def _design(f, g, h):  # type: ignore[no-untyped-def]
    """The rows of Eq. (L1): force over θ."""
    h[0, 0], h[0, 1], h[0, 2], h[0, 3] = 0.0, f[0], -f[1], g[0]
    h[1, 0], h[1, 1], h[1, 2], h[1, 3] = 0.0, f[1], f[0], g[1]
    h[2, 0], h[2, 1], h[2, 2], h[2, 3] = f[2], 0.0, 0.0, g[2]


@numba.njit(cache=True, error_model="numpy")
def _bounded(theta, p):  # type: ignore[no-untyped-def]
    """Keep θ where the model still means something, and the variances of what is not observed finite."""
    for i in range(2):
        theta[i] = min(max(theta[i], _LEAST_STRENGTH), _MOST_STRENGTH)
    theta[2] = min(max(theta[2], -theta[1]), theta[1])
    theta[3] = min(max(theta[3], -_MOST_SURFACE), _MOST_SURFACE)
    for i in range(4):
        if p[i, i] > _MOST_VARIANCE[i]:
            share = math.sqrt(_MOST_VARIANCE[i] / p[i, i])
            for j in range(4):
                p[i, j] *= share
                p[j, i] *= share
    for i in range(4):
        for j in range(i):
            mean = 0.5 * (p[i, j] + p[j, i])
            p[i, j], p[j, i] = mean, mean


@numba.njit(cache=True, error_model="numpy")
def _reenter(theta, p, bed, prior, air):  # type: ignore[no-untyped-def]
    """The belief with which the tool pushes again after it rose or left.

    It is that of the last push, not what it came to while the grains let go. The strength fades slowly with the path
    through the air, surface and turn fade fast.
    """
    for i in range(4):
        keep_i = math.exp(-air / (_AIR_STRENGTH if i < 2 else _AIR_LOCAL))
        mean = 1.0 if i < 2 else 0.0
        theta[i] = mean + keep_i * (bed[i] - mean)
        for j in range(4):
            keep = keep_i * math.exp(-air / (_AIR_STRENGTH if j < 2 else _AIR_LOCAL))
            p[i, j] = keep * bed[4 + 4 * i + j] + (1.0 - keep) * prior[i, j]


@numba.njit(cache=True, error_model="numpy")
def _solved(s, x):  # type: ignore[no-untyped-def]
    """x' S⁻¹ x of a symmetric positive definite S, given as xx, xy, xz, yy, yz, zz."""
    a, b, c, d, e, f = s[0], s[1], s[2], s[3], s[4], s[5]
    l0 = math.sqrt(a)
    l1, l2 = b / l0, c / l0
    m0 = math.sqrt(max(d - l1 * l1, 1e-12 * d))
    m1 = (e - l1 * l2) / m0
    n0 = math.sqrt(max(f - l2 * l2 - m1 * m1, 1e-12 * f))
    u = x[0] / l0
    v = (x[1] - l1 * u) / m0
    w = (x[2] - l2 * u - m1 * v) / n0
    return u * u + v * v + w * w


@numba.njit(cache=True, error_model="numpy")
def _take(record, theta, p, numbers, prior, growth, h, k):  # type: ignore[no-untyped-def]
    """One record into the belief: growth over the path since the last, then its measurement."""
    if record[_EVENT] > 0.0:
        _reenter(theta, p, numbers[_BED : _BED + 20], prior, record[_AIR])
        numbers[_AIR_PENDING] = max(numbers[_AIR_PENDING] - 1.0, 0.0)
    if record[_STATE] != _MEASURED:
        return
    step = record[_WET] - numbers[_LEARNED]
    if not step > 0.0:
        return
    numbers[_LEARNED] = record[_WET]
    force, design = record[_F : _F + 3], record[_G : _G + 3]
    _design(force, design, h)
    noise = record[_NOISE_VARIANCE]
    y, predicted, s = record[_Y : _Y + 3], record[_PRED : _PRED + 3], record[_S : _S + 6]

    # The errors of predictions as they were made set how fast θ may change, and how wide the errors are told.
    e0, e1, e2 = y[0] - predicted[0], y[1] - predicted[1], y[2] - predicted[2]
    k[0, 0], k[0, 1], k[0, 2] = e0, e1, e2
    square = _solved(s, k[0, :3]) / 3.0
    w = 1.0 - math.exp(-step / _TEMPO_LENGTH)
    numbers[_MEAN_SQUARE] += w * (min(square, _LARGEST_SQUARE) - numbers[_MEAN_SQUARE])
    numbers[_TEMPO] = min(max(numbers[_MEAN_SQUARE] ** _TEMPO_POWER, _TEMPO_LEAST), _TEMPO_MOST)
    w = 1.0 - math.exp(-step / _SCALE_LENGTH)
    level = (e0 * e0 + e1 * e1) / (s[0] + s[3])
    numbers[_SCALE_H] += w * (min(level, _LARGEST_SQUARE) - numbers[_SCALE_H])
    numbers[_SCALE_V] += w * (min(e2 * e2 / s[5], _LARGEST_SQUARE) - numbers[_SCALE_V])

    grown = numbers[_TEMPO] * step / _GROWTH
    for i in range(4):
        for j in range(4):
            p[i, j] += grown * growth[i, j]

    # A sample pulls by at most _CLIP deviations.
    for i in range(3):
        k[0, i] = y[i]
        for j in range(4):
            k[0, i] -= h[i, j] * theta[j]
    n = 0
    for i in range(3):
        for m in range(i, 3):
            total = noise if i == m else 0.0
            for a in range(4):
                for b in range(4):
                    total += h[i, a] * p[a, b] * h[m, b]
            k[1, n] = total
            n += 1
    distance = math.sqrt(_solved(k[1, :6], k[0, :3]))
    share = min(1.0, _CLIP / max(distance, 1e-300))
    # what is left of the measurement, to be matched one component after another: R is a multiple of the identity
    for i in range(3):
        k[2, i] = share * k[0, i]
        for j in range(4):
            k[2, i] += h[i, j] * theta[j]
    variance = noise * max(1.0, _NOISE_LENGTH / step)
    for i in range(3):
        innovation = k[2, i]
        s_i = variance
        for a in range(4):
            innovation -= h[i, a] * theta[a]
            k[3, a] = 0.0
            for b in range(4):
                k[3, a] += p[a, b] * h[i, b]
        for a in range(4):
            s_i += h[i, a] * k[3, a]
        for a in range(4):
            k[4, a] = k[3, a] / s_i
            theta[a] += k[4, a] * innovation
        # Joseph: (I - K H) P (I - K H)' + K R K'
        for a in range(4):
            for b in range(4):
                k[5 + a, b] = p[a, b] - k[4, a] * k[3, b]
        for a in range(4):
            k[9, a] = 0.0
            for b in range(4):
                k[9, a] += k[5 + a, b] * h[i, b]
        for a in range(4):
            for b in range(4):
                p[a, b] = k[5 + a, b] - k[9, a] * k[4, b] + variance * k[4, a] * k[4, b]
    _bounded(theta, p)
    if record[_PASSING] == 0.0:
        for i in range(4):
            numbers[_BED + i] = theta[i]
            for j in range(4):
                numbers[_BED + 4 + 4 * i + j] = p[i, j]
        full = force[0] ** 2 + force[1] ** 2 + force[2] ** 2
        since = record[_WET] - numbers[_ENTERED] - _ENTRY
        if full > 0.0 and since >= 0.0:
            strength = (theta[1] * (force[0] ** 2 + force[1] ** 2) + theta[0] * force[2] ** 2) / full
            # a mean of all that was since the entry, then of the last _DRIFT_LENGTH
            w = 1.0 if since <= step else max(step / (since + _SUM_LENGTH), step / _DRIFT_LENGTH)
            numbers[_REFERENCE] += min(w, 1.0) * (math.log(strength) - numbers[_REFERENCE])
            numbers[_DRIFT] = (math.log(strength) - numbers[_REFERENCE]) / math.sqrt(prior[0, 0])


@numba.njit(cache=True, error_model="numpy")
def _tick(stamp, duration, speed, passing, teaches, apply, lag, reach, row, work, ring, stamps, places, out):  # type: ignore[no-untyped-def]
    """Advance the path, take what lies `lag` behind, predict, and keep a record for the measurement to come."""
    theta, p, numbers, prior, growth = _parts(work)
    now, p_now = work[_NOW : _NOW + 4], work[_NOW + 4 : _NOW + 20].reshape((4, 4))
    h, k = work[_H : _H + 12].reshape((3, 4)), work[_K : _K + 60].reshape((10, 6))
    force, wet, per_height, moments = row[0:3], row[6] > 0.0, row[7:10], row[10:19]
    step = min(0.5 * (speed + numbers[_SPEED]) * duration, _LONGEST_STEP)
    numbers[_SPEED] = speed
    numbers[_TOTAL] += step
    size_f = math.sqrt(force[0] * force[0] + force[1] * force[1] + force[2] * force[2])
    # a law that pulls the tool down speaks of a withdrawal
    passing = passing or force[2] < -0.5 * size_f
    event = air = 0.0
    if wet:
        numbers[_GRAINS] += step
        if numbers[_AWAY] != 0.0 and not passing and step > 0.0:
            event, air = 1.0, max(numbers[_AWAY], 0.0)
            numbers[_AWAY] = 0.0
            numbers[_ENTERED] = numbers[_GRAINS]
        elif passing and numbers[_AWAY] == 0.0:
            numbers[_AWAY] = -1.0  # rose, did not leave
    else:
        numbers[_AWAY] = max(numbers[_AWAY], 0.0) + step
        if numbers[_AWAY] == 0.0:
            numbers[_AWAY] = -1.0

    size = ring.shape[0]
    while places[_COUNT] > 0:
        i = places[_HEAD]
        if ring[i, _STATE] == _PENDING or ring[i, _PATH] > numbers[_TOTAL] - lag:
            break
        _take(ring[i], theta, p, numbers, prior, growth, h, k)
        places[_HEAD] = (i + 1) % size
        places[_COUNT] -= 1
        places[_NEXT] -= 1

    for i in range(4):
        now[i] = theta[i]
        for j in range(4):
            p_now[i, j] = p[i, j]
    if event > 0.0:
        _reenter(now, p_now, numbers[_BED : _BED + 20], prior, air)
    elif numbers[_AIR_PENDING] > 0.0:  # entered less than a lag ago
        for n in range(places[_COUNT]):
            i = (places[_HEAD] + n) % size
            if ring[i, _EVENT] > 0.0:
                _reenter(now, p_now, numbers[_BED : _BED + 20], prior, ring[i, _AIR])
    grown = numbers[_TEMPO] * max(numbers[_GRAINS] - numbers[_LEARNED], 0.0) / _GROWTH
    for i in range(4):
        for j in range(4):
            p_now[i, j] += grown * growth[i, j]
    _bounded(now, p_now)

    _design(force, per_height, h)
    squares = 0.0
    for i in range(3):
        k[0, i] = 0.0
        for a in range(4):
            k[0, i] += h[i, a] * now[a]
        squares += k[0, i] * k[0, i]
    noise = _NOISE * _NOISE * squares + _NOISE_FLOOR * _NOISE_FLOOR
    n = 0
    for i in range(3):
        for m in range(i, 3):
            total = noise if i == m else 0.0
            for a in range(4):
                for b in range(4):
                    total += h[i, a] * p_now[a, b] * h[m, b]
            k[1, n] = total
            n += 1
    scale_h, scale_v = numbers[_SCALE_H], numbers[_SCALE_V]
    # without the correction its size is an error too
    for i in range(3):
        left = 0.0 if apply else k[0, i] - force[i]
        n = 0 if i == 0 else (3 if i == 1 else 5)
        out[i] = k[0, i] if apply else force[i]
        out[6 + i] = math.sqrt((scale_v if i == 2 else scale_h) * k[1, n] + left * left)

    # torque = Σ r × f' over θ; moments: Σ r_j f_l, row by row
    k[2, 0], k[2, 1], k[2, 2] = moments[5], -moments[7], -moments[6]
    k[3, 0], k[3, 1], k[3, 2] = -moments[2], moments[6], -moments[7]
    k[4, 0], k[4, 1], k[4, 2] = 0.0, moments[1] - moments[3], moments[0] + moments[4]
    # what the surface adds acts where the force does
    along = force[0] * per_height[0] + force[1] * per_height[1] + force[2] * per_height[2]
    per_force = along / (size_f * size_f) if size_f > 0.0 else 0.0
    for i in range(3):
        k[2 + i, 3] = per_force * (k[2 + i, 0] + k[2 + i, 1])
    lever = _LEVER * reach * math.sqrt(squares)
    for i in range(3):
        torque = variance = 0.0
        for a in range(4):
            torque += k[2 + i, a] * now[a]
            for b in range(4):
                variance += k[2 + i, a] * p_now[a, b] * k[2 + i, b]
        plain = k[2 + i, 0] + k[2 + i, 1]
        left = 0.0 if apply else torque - plain
        variance = max(scale_h, scale_v) * (variance + _NOISE * _NOISE * torque * torque)
        out[3 + i] = torque if apply else plain
        out[9 + i] = math.sqrt(variance + lever * lever + left * left)

    if not wet or not step > 0.0:
        return
    if places[_COUNT] > 0:
        last = (places[_HEAD] + places[_COUNT] - 1) % size
        if event == 0.0 and numbers[_TOTAL] - ring[last, _PATH] < lag / _PER_LAG:
            return
    if places[_COUNT] == size:  # measurements never came: the oldest will not teach
        if ring[places[_HEAD], _EVENT] > 0.0:
            ring[(places[_HEAD] + 1) % size, _EVENT] = 1.0
            ring[(places[_HEAD] + 1) % size, _AIR] = ring[places[_HEAD], _AIR]
        places[_HEAD] = (places[_HEAD] + 1) % size
        places[_COUNT] -= 1
        places[_NEXT] = max(places[_NEXT] - 1, 0)
    i = (places[_HEAD] + places[_COUNT]) % size
    places[_COUNT] += 1
    stamps[i] = stamp
    r = ring[i]
    r[_PATH], r[_WET], r[_EVENT], r[_AIR] = numbers[_TOTAL], numbers[_GRAINS], event, air
    r[_PASSING] = 1.0 if passing else 0.0
    numbers[_AIR_PENDING] += event
    r[_STATE] = _PENDING
    r[_NOISE_VARIANCE] = noise if teaches else -1.0
    for a in range(3):
        r[_F + a], r[_G + a] = force[a], per_height[a]
        r[_PRED + a] = 0.0
        for b in range(4):
            r[_PRED + a] += h[a, b] * now[b]
    for a in range(6):
        r[_S + a] = k[1, a]


@numba.njit(cache=True, error_model="numpy")
def _learn(stamp, y0, y1, y2, usable, repeated, work, ring, stamps, places):  # type: ignore[no-untyped-def]
    """Give the record of a stamp its measurement; what becomes of it, as `Lesson`."""
    numbers = work[_SINGLE : _SINGLE + _NUMBERS]
    size = ring.shape[0]
    while places[_NEXT] < places[_COUNT]:
        i = (places[_HEAD] + places[_NEXT]) % size
        if stamps[i] > stamp:
            return 0
        places[_NEXT] += 1
        r = ring[i]
        r[_STATE] = _VOID
        if stamps[i] < stamp:
            continue
        if not usable:
            return 0
        step = min(r[_WET] - numbers[_SCORED], _LONGEST_STEP)
        numbers[_SCORED] = r[_WET]
        numbers[_STUCK_PATH] = numbers[_STUCK_PATH] + step if repeated else 0.0
        numbers[_REPEATS] = numbers[_REPEATS] + 1.0 if repeated else 0.0
        if numbers[_STUCK_PATH] > _STUCK and numbers[_REPEATS] >= _STUCK_SAMPLES:
            return 2
        if r[_NOISE_VARIANCE] < 0.0:
            return 0
        f, p, s = r[_F : _F + 3], r[_PRED : _PRED + 3], r[_S : _S + 6]
        if r[_PASSING] == 0.0:
            square = f[0] * f[0] + f[1] * f[1] + f[2] * f[2]
            most = _LARGEST_SHARE * math.sqrt(square) + _OPPOSING
            share = min(1.0, most / max(math.sqrt(y0 * y0 + y1 * y1 + y2 * y2), 1e-300))
            w = 1.0 - math.exp(-step / _SUM_LENGTH)
            numbers[_ALONG] += w * (share * (y0 * f[0] + y1 * f[1] + y2 * f[2]) - numbers[_ALONG])
            numbers[_SQUARE] += w * (square - numbers[_SQUARE])
            numbers[_DOT] += w * (share * (y0 * f[0] + y1 * f[1]) - numbers[_DOT])
            numbers[_CROSS] += w * (share * (y1 * f[0] - y0 * f[1]) - numbers[_CROSS])
            numbers[_FLAT] += w * (f[0] * f[0] + f[1] * f[1] - numbers[_FLAT])
            if numbers[_ALONG] < -_OPPOSING * _OPPOSING:
                return 3
        r[_Y], r[_Y + 1], r[_Y + 2] = y0, y1, y2
        r[_STATE] = _MEASURED
        size_p = math.sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2])
        if r[_PASSING] == 0.0 and r[_WET] - numbers[_ENTERED] >= _ENTRY and size_p > 0.0:
            u0, u1, u2 = p[0] / size_p, p[1] / size_p, p[2] / size_p
            variance = (
                u0 * u0 * s[0] + u1 * u1 * s[3] + u2 * u2 * s[5]
                + 2.0 * (u0 * u1 * s[1] + u0 * u2 * s[2] + u1 * u2 * s[4])
            )  # fmt: skip
            error = u0 * (y0 - p[0]) + u1 * (y1 - p[1]) + u2 * (y2 - p[2])
            score = min(max(error / math.sqrt(variance), -6.0), 6.0)
            w = 1.0 - math.exp(-step / _SURPRISE_LENGTH)
            numbers[_SCORE] += w * (score - numbers[_SCORE])
            numbers[_EXCESS] += w * (error - numbers[_EXCESS])
            numbers[_FORCE] += w * (size_p - numbers[_FORCE])
        else:
            numbers[_SCORE] = numbers[_EXCESS] = numbers[_FORCE] = 0.0
        score, drift = numbers[_SCORE], numbers[_DRIFT]
        if abs(score) > _SURPRISING:
            numbers[_SURPRISE] = 1.0 if score > 0.0 else -1.0
        elif abs(drift) > _DRIFTED:
            numbers[_SURPRISE] = 1.0 if drift > 0.0 else -1.0
        elif abs(score) < _SETTLED and abs(drift) < 0.5 * _DRIFTED:
            numbers[_SURPRISE] = 0.0
        return 1
    return 0


_LESSONS = tuple(Lesson)


class Learning:
    """What the load cell says of the grains, for one tool in one medium.

    At each pose call `predict`; once its compensated force is known, `learn` with the pose's stamp, in the order of
    stamps. A prediction uses θ after every measurement whose path is at least `lag` behind, so that no sample is part
    of its own prediction. Same calls, same bytes.
    """

    def __init__(self, settings: LearningSettings, *, reach: float = 0.0) -> None:
        self.settings = settings
        self.reach = reach
        self._work = np.zeros(_WORK)
        self._theta, self._covariance, self._numbers, self._prior, growth = _parts.py_func(self._work)
        self._prior[:] = _covariance(settings.strength_error, _PRIOR_EACH, _PRIOR_SURFACE)
        growth[:] = _covariance(_GROWTH_COMMON, _GROWTH_EACH, _GROWTH_SURFACE)
        self._ring = np.zeros((_RECORDS, _WIDTH))
        self._stamps = np.zeros(_RECORDS, dtype=np.int64)
        self._places = np.zeros(3, dtype=np.int64)
        self._out = np.zeros(12)
        self._last = 0
        self.forget()

    def forget(self) -> None:
        """Go back to the calibration."""
        self._theta[:] = 1.0, 1.0, 0.0, 0.0
        self._covariance[:] = self._prior
        self._numbers[:] = 0.0
        self._numbers[[_TEMPO, _MEAN_SQUARE, _SCALE_H, _SCALE_V]] = 1.0
        self._numbers[_BED : _BED + 4] = self._theta
        self._numbers[_BED + 4 : _BED + 20] = self._prior.ravel()
        self._places[:] = 0
        self._last = 0

    def leave(self) -> None:
        """The tool is elsewhere, is another one, or time has jumped: keep the bed's strength, forget place and turn."""
        self._places[:] = 0
        self._numbers[_AIR_PENDING] = 0.0
        self._numbers[_SPEED] = 0.0
        self._numbers[_LEARNED] = self._numbers[_SCORED] = self._numbers[_GRAINS]
        self._numbers[_AWAY] = 10.0 * _AIR_LOCAL
        self._last = 0

    def predict(
        self, stamp: int, row: Array, *, speed: float, passing: bool = False, teaches: bool = True, apply: bool = True
    ) -> Array:
        """Corrected wrench and its standard deviations at a pose, world axes; overwritten by the next call.

        `stamp` [ns], increasing (an earlier one calls `leave`). `row`, shape [19]: what the model has at the pose:
        force F [N], torque [N m], submerged area [m²], dF/dh [N/m], and Σ r_j f_l [N m] row by row; finite. `speed` of
        the tool's fastest point [m/s], 0 at rest. `passing`: the tool is withdrawn, or so fast that inertia matters;
        what it teaches here is dropped afterwards, and nothing surprises. `teaches` False: the estimate must not be
        learned from. `apply` False leaves the wrench as the model has it. Returns shape [12]: force [N], torque about
        the tool frame's origin [N m], then the standard deviations of each.
        """
        if stamp <= self._last:
            self.leave()
        duration = (stamp - self._last) * 1e-9 if self._last > 0 else 0.0
        self._last = stamp
        if not 0.0 <= speed < math.inf:
            speed, teaches = 0.0, False
        _tick(
            stamp, duration, speed, passing, teaches, apply, self.settings.lag, self.reach,
            row, self._work, self._ring, self._stamps, self._places, self._out,
        )  # fmt: skip
        return self._out

    def learn(self, stamp: int, force: Array | None, *, repeated: bool = False) -> Lesson:
        """Take the compensated force [N] at a pose, world axes, shape [3]; None if there is none.

        `repeated`: the load cell's raw reading equals the one before, bit by bit.
        """
        x, y, z = (math.nan,) * 3 if force is None else (float(force[0]), float(force[1]), float(force[2]))
        usable = math.hypot(x, y, z) < _ABSURD
        arrays = self._work, self._ring, self._stamps, self._places
        lesson: Lesson = _LESSONS[_learn(stamp, x, y, z, usable, repeated, *arrays)]
        return lesson

    @property
    def surprise(self) -> Surprise:
        """Whether the grains at the last measurement were harder or softer than believed."""
        return Surprise(int(self._numbers[_SURPRISE]))

    @property
    def theta(self) -> Array:
        """s_v, s_h, ρ, δ [m], shape [4]: a copy."""
        return np.array(self._theta)

    @property
    def covariance(self) -> Array:
        """Of `theta`, shape [4, 4]: a copy."""
        return np.array(self._covariance)

    def belief(self) -> Belief:
        """θ in the user's terms."""
        v, h, turn, surface = self._theta.tolist()
        dv, dh, dt, ds = np.sqrt(np.diag(self._covariance)).tolist()
        force = float(self._numbers[_FORCE])
        return Belief(
            vertical=v,
            horizontal=h,
            turn=math.atan2(turn, h),
            surface=surface,
            vertical_error=dv,
            horizontal_error=dh,
            turn_error=dt / h,
            surface_error=ds,
            path=float(self._numbers[_GRAINS]),
            surprise=float(self._numbers[_SCORE]),
            excess=float(self._numbers[_EXCESS]) / force if force > 0.0 else 0.0,
            drift=float(self._numbers[_DRIFT]),
        )

    def strength(self) -> tuple[float, float] | None:
        """Strength of the bed over the model's at the last push, and its standard error; None if nothing was learned.

        s_v and s_h by the inverse of their variances.
        """
        bed: Array = self._numbers[_BED : _BED + 20]
        covariance = bed[4:].reshape(4, 4)[:2, :2]
        if np.array_equal(bed[:4], (1.0, 1.0, 0.0, 0.0)):
            return None
        weights = 1.0 / np.diag(covariance)
        weights /= weights.sum()
        return float(weights @ bed[:2]), math.sqrt(float(weights @ covariance @ weights))

    def issues(self) -> list[BeliefIssue]:
        """Why the model cannot be right: judged over 5 mm of path, from 8 mm after the tool entered."""
        numbers: Any = self._numbers
        if not numbers[_SQUARE] > 0.0 or numbers[_SCORED] - numbers[_ENTERED] < _ENTRY:
            return []
        ratio = numbers[_ALONG] / numbers[_SQUARE]
        found = []
        if ratio < 0.0:
            found.append(BeliefIssue.OPPOSED)
        elif ratio < 0.2:
            found.append(BeliefIssue.WEAK)
        elif ratio > 5.0:
            found.append(BeliefIssue.STRONG)
        if ratio >= 0.0 and numbers[_FLAT] > 0.05 * numbers[_SQUARE] and abs(numbers[_CROSS]) > numbers[_DOT]:
            found.append(BeliefIssue.TURNED)
        return found
