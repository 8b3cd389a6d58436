"""A step of bodies in grains: the wrenches to hold over it, such that they are the grains' own at its end.

The wrench at the end of a step depends on where the step ends, and that on the wrench. With B the stiffness of the
grains, A the inverse inertia of the bodies as their joints and constraints show it, and v_free their twists at the end
of the step without the grains, it is to first order (backward Euler)

    w = (1 + h² B A)^-1 (w_0 - h B v_free)

Where bodies move further than the grains stay linear, Newton's method follows the grains' own wrench to where the step
ends. Twists and wrenches of n bodies are stacked: linear then angular, force then torque, 6 numbers a body, at the body
frames' origins, world axes.
"""

from math import sqrt

import numpy as np

from rft_ros.rft.kernel.compilation import compiled, inlined
from rft_ros.simulation.algebra import dot, multiply, solve
from rft_ros.simulation.beds import evaluate, stiffness_matrix

__all__ = ["COUPLED", "advance", "forces_on_plates", "hold", "hold_each"]

_STRIDE, _STILL = 1.0 / 30.0, 1e-7
"""Longest path of a point in a step, in mobilization lengths, over which the grains are taken as linear. `_STRIDE`: if
the wrench changes little. `_STILL`: however much it changes."""

_CHANGE, _TURN = 0.02, 0.002
"""Greatest relative change of the wrench over which the grains are taken as linear, and the same for a body that is
pushed back. Grains that yielded are more than ten times as stiff when the motion reverses."""

_MOST, _WHOLE, _CLOSE = 32, 12, 0.02
"""Most evaluations of Newton's method, those with whole steps, and the relative change of the wrench at which it ends.
The steps after them are halved: where plates turn, whole steps may go round in a circle."""

_ROUNDED = 1e-9
"""Wrench of a body, as a share of the greatest of all bodies, below which it is rounding: of a foot in the air, beside
one on the ground."""

_SLIGHT = 0.1
"""Change of a body's motion by its wrench in the step, as a share of the motion. Below it the body ploughs on as it
did: the wrench at the end is first guessed to change as in the last step, whose wrench is the mean over it."""

_OVERSHOT, _LEVEL = 0.5, 0.1
"""Residual along a step of Newton's method at its end, over that at its beginning. The step is too long if the sign has
changed and the ratio is over the first number. It is short enough if the ratio is below the second."""

_SLOW, _SUDDEN, _QUICK = 0.002, 0.01, 0.1
"""Limits of the speed [m/s] to which the grains push back a body that nothing holds. `_SLOW`: under a constant load. A
decrease of the load adds at most `_PER_RELEASE` times `_SUDDEN` if the load is removed within one step, or `_QUICK` if
it decreases more slowly."""

_AT_ONCE = 0.5
"""Share of the push: a larger decrease of the load in one step counts as a sudden release."""

_PER_RELEASE = 2.0
"""Factor of the release speed in the limit of the push-back."""

_KEPT, _FADES = 0.9, 0.02
"""Share of the release speed kept from step to step at most; time [s] in which it falls to 1/e if steps exceed 2 ms."""

_LIMITED = 0.99
"""A body's push-back counts as limited if it keeps a smaller share of its wrench."""

COUPLED = np.dtype(
    [(name, np.float64, 6) for name in ("wrench", "free", "last_free")]
    + [(name, np.float64) for name in ("release_speed", "last_release_speed", "energy", "strength", "height")]
    + [(name, np.bool_) for name in ("held", "limited")]
)
"""State of a body.

`wrench`: of the last step. `free`, `last_free`: its acceleration without the grains in this step and in the last one.
`release_speed`, `last_release_speed`: the speed to which the decrease of the load on it lets the grains push it back
[m/s], in the same steps. `energy`: that the grains have taken [J]. `strength`: factor of its law's stresses. `height`:
of its surface [m]. `held`: whether something else takes up the elastic energy of the grains, so that its push-back is
not limited. `limited`: whether the push-back in this step was.
"""

_TURNS, _SETTLED = 50, 1e-3
"""Most rounds in which bodies' shares of their wrenches are found, and the change of a share at which they end."""

_TINY = 1e-290  # avoids 0 / 0


@compiled
def advance(beds, first, coupled, before, given, states, rows):
    """Bring the memory of bodies from `first` on to `given` states, shape [n, 13]; write their rows, shape [n, 19].

    `before`: duration of the last step [s], in which the last wrenches took energy. `states`: takes a copy of `given`.
    """
    for b in range(len(given)):
        states[b] = given[b]
        coupled[b].energy -= before * dot(coupled[b].wrench, given[b, 7:])
        coupled[b].last_free[:], coupled[b].last_release_speed = coupled[b].free, coupled[b].release_speed
        evaluate(beds, first + b, beds.memory[first + b : first + b + 1], states[b : b + 1], rows[b : b + 1])


@compiled
def forces_on_plates(beds, body, states, forces):
    """Write the force on each plate of a body at its last state, shape [1, 13]: shape [plates, 3], kernel's order."""
    forces[:] = 0.0
    evaluate(beds, body, beds.memory[body : body + 1].copy(), states, forces)


@inlined
def _move(state, twist, h):
    """Move a state, shape [13], in place: it takes this twist for h [s], in which it turns little."""
    state[:3] += h * twist[:3]
    state[7:] = twist
    a, b, c = 0.5 * h * twist[3], 0.5 * h * twist[4], 0.5 * h * twist[5]
    x, y, z, w = state[3], state[4], state[5], state[6]
    state[3] += a * w + b * z - c * y
    state[4] += b * w + c * x - a * z
    state[5] += c * w + a * y - b * x
    state[6] -= a * x + b * y + c * z
    state[3:7] /= sqrt(dot(state[3:7], state[3:7]))


@inlined
def _settle(residual, springs, inverse, h, change):
    """Write the change of the wrenches that takes away their residual to first order: (1 + h² B A)^-1 of it."""
    matrix = np.empty((len(residual), len(residual)))
    for b in range(len(springs)):
        multiply(springs[b], inverse[_part(b)], matrix[_part(b)])
    matrix *= h * h
    for i in range(len(residual)):
        matrix[i, i] += 1.0
    change[:] = residual
    solve(matrix, change.reshape(-1, 1))


@inlined
def _follow(ahead, inverse, h, wrench, after):
    """Write the twists at the end of the step under the wrenches."""
    for i in range(len(ahead)):
        after[i] = ahead[i] + h * dot(inverse[i], wrench)


@inlined
def _path(twist, reach):
    """Path per second of the fastest point within `reach` [m/s], at most."""
    return sqrt(dot(twist[:3], twist[:3])) + reach * sqrt(dot(twist[3:], twist[3:]))


@inlined
def _size(wrench, reach):
    return sqrt(dot(wrench[:3], wrench[:3])) + sqrt(dot(wrench[3:], wrench[3:])) / reach


@inlined
def _small(beds, first, change, most, most_back, begin, wrench, after):
    """Whether the wrenches of all bodies change by small shares: `most`, or `most_back` of a body that is pushed back.

    Shares of the wrench, at the beginning of the step or now.
    """
    greatest, small = 0.0, True
    for b in range(len(change) // 6):
        part, reach = _part(b), beds.bodies[first + b].reach
        greatest = max(greatest, _size(wrench[part], reach), _size(begin[part], reach))
    for b in range(len(change) // 6):
        part, reach = _part(b), beds.bodies[first + b].reach
        largest = max(_size(wrench[part], reach), _size(begin[part], reach), _ROUNDED * greatest)
        share = most_back if dot(begin[part], after[part]) > 0.0 else most
        small &= _size(change[part], reach) <= share * largest
    return small


@inlined
def _part(b):
    return slice(6 * b, 6 * b + 6)


@inlined
def _allowed_push_back(coupled, wrench, twist, ahead, inverse, spring, reach, h):
    """The greatest product of a body's wrench and its twist at the end of the step [W], so that no body is thrown.

    When the load on a pressed body decreases, the grains push it back elastically. A body that nothing holds would be
    thrown by the elastic energy, which real grains dissipate. So the speed to which they push it back is limited. The
    limit grows with the rate at which the load decreases. The push-back of a body that something holds has no limit.
    """
    square = stiff = fall = free = 0.0
    way = np.empty(6)
    for i in range(6):
        way[i] = dot(inverse[i], wrench)
        coupled.free[i] = (ahead[i] - twist[i]) / h
    for i in range(6):
        square += wrench[i] * way[i]
        stiff += way[i] * dot(spring[i], way)
        fall += wrench[i] * (coupled.free[i] - coupled.last_free[i])
        free += wrench[i] * ahead[i]
    speed = _path(way, reach)  # of the fastest point, per N s of impulse along the wrench
    most = _SUDDEN if fall > _AT_ONCE * square else _QUICK
    release = min(max(fall, 0.0) / max(h * stiff, _TINY) * speed, most)
    coupled.release_speed = max(min(_KEPT, np.exp(-h / _FADES)) * coupled.last_release_speed, release)
    if coupled.held:
        return np.inf
    return max((_SLOW + _PER_RELEASE * coupled.release_speed) * square / max(speed, _TINY), free, 0.0)


@inlined
def _limit_push_back(coupled, allowed, inverse, h, wrench, after):
    """Reduce the wrenches that push bodies back by more than is allowed, and write the twists that follow.

    Bodies of one mechanism move each other, so the share of its wrench that each keeps is found in turn (Gauss-Seidel).
    Returns how many bodies are limited.
    """
    n = len(allowed)
    share, push = np.ones(n), np.empty(6 * n)
    for _ in range(_TURNS):
        largest = 0.0
        for b in range(n):
            part = _part(b)
            back = own = 0.0
            for i in range(6 * n):
                push[i] = h * dot(inverse[i, part], wrench[part])
            for i in range(6 * b, 6 * b + 6):
                back += wrench[i] * after[i]
                own += wrench[i] * push[i]
            change = min(max(share[b] + (allowed[b] - back) / max(own, _TINY), 0.0), 1.0) - share[b]
            share[b] += change
            for i in range(6 * n):
                after[i] += change * push[i]
            largest = max(largest, abs(change))
        if largest < _SETTLED:
            break
    limited = 0
    for b in range(n):
        wrench[_part(b)] *= share[b]
        coupled[b].limited = share[b] < _LIMITED
        limited += coupled[b].limited
    return limited


@inlined
def _average(begin, inverse, h, wrench, after):
    """For a body that ploughs on, use the mean of the wrenches at both ends of the step, unless that reverses it."""
    work = 0.0
    for i in range(6):
        mean = 0.5 * (wrench[i] + begin[i])
        twist = after[i]
        for k in range(6):
            twist += 0.5 * h * inverse[i, k] * (begin[k] - wrench[k])
        work += mean * twist
    if work >= 0.0:
        return False
    for i in range(6):
        wrench[i] = 0.5 * (wrench[i] + begin[i])
    return True


@compiled
def hold(beds, first, coupled, states, rows, inverse, ahead, h, wrench, after):
    """Write the wrenches to hold over h [s] and the twists at its end, shape [6 n], of bodies from `first` on.

    `coupled`: of `COUPLED`, shape [n]. `states`, `rows`: of `advance`, shape [n, 13] and [n, 19]. `inverse`: A, shape
    [6 n, 6 n]; `ahead`: v_free, shape [6 n]. Returns whether Newton's method came to an end, the longest path of a
    point [m], and of how many bodies the push-back was limited.
    """
    n = len(states)
    springs, begin, residual, change = np.empty((n, 6, 6)), np.empty(6 * n), np.empty(6 * n), np.empty(6 * n)
    under_begin = np.empty(6 * n)  # the twists at the end of the step under the wrenches at its beginning
    for b in range(n):
        stiffness_matrix(beds.memory[first + b], springs[b])
        begin[_part(b)] = rows[b, :6]
    _follow(ahead, inverse, h, begin, under_begin)
    for i in range(6 * n):
        residual[i] = -h * dot(springs[i // 6, i % 6], under_begin[_part(i // 6)])
    _settle(residual, springs, inverse, h, change)
    wrench[:] = begin + change
    _follow(ahead, inverse, h, wrench, after)
    path = 0.0
    for b in range(n):
        path = max(path, h * _path(after[_part(b)], beds.bodies[first + b].reach))
    linear = path <= _STILL * beds.length or (
        path <= _STRIDE * beds.length and _small(beds, first, change, _CHANGE, _TURN, begin, wrench, after)
    )
    found = linear
    if not linear:
        for b in range(n):
            part, reach = _part(b), beds.bodies[first + b].reach
            twist, turn = states[b, 7:], under_begin[part] - ahead[part]
            if dot(begin[part], twist) < 0.0 and _path(turn, reach) < _SLIGHT * _path(twist, reach):
                wrench[part] = 3.0 * begin[part] - 2.0 * coupled[b].wrench
        _follow(ahead, inverse, h, wrench, after)
        found = _newton(beds, first, states, begin, springs, inverse, ahead, h, wrench, after)
    allowed = np.empty(n)
    for b in range(n):
        part, reach = _part(b), beds.bodies[first + b].reach
        allowed[b] = _allowed_push_back(
            coupled[b], wrench[part], states[b, 7:], ahead[part], inverse[part, part], springs[b], reach, h
        )
    limited = _limit_push_back(coupled, allowed, inverse, h, wrench, after)
    changed = False
    for b in range(n):
        part = _part(b)
        if not linear and dot(begin[part], states[b, 7:]) < 0.0 and dot(wrench[part], after[part]) < 0.0:
            changed |= _average(begin[part], inverse[part, part], h, wrench[part], after[part])
    if changed:
        _follow(ahead, inverse, h, wrench, after)
    return found, path, limited


@inlined
def _newton(beds, first, states, begin, springs, inverse, ahead, h, wrench, after):
    """Find the wrenches that are the grains' own where the step ends, from a guess; returns whether it was found.

    A step of Newton's method goes too far where the grains stiffen on the way. Its length is then found by the rule of
    false position (Illinois) for the residual along it.
    """
    n = len(states)
    trial, row = np.empty((1, 13)), np.empty((1, 19))
    residual, change, start = np.empty(6 * n), np.zeros(6 * n), wrench.copy()
    share, slope, within, low, high, at_low, at_high = 1.0, 0.0, False, 0.0, 1.0, 0.0, 0.0
    for turn in range(_MOST):
        for b in range(n):
            trial[0] = states[b]
            _move(trial[0], after[_part(b)], h)
            memory = beds.memory[first + b : first + b + 1].copy()
            evaluate(beds, first + b, memory, trial, row)
            stiffness_matrix(memory[0], springs[b])
            residual[_part(b)] = row[0, :6] - wrench[_part(b)]
        along = 0.0
        for i in range(6 * n):
            along += residual[i] * dot(inverse[i], change)
        length = 1.0 if turn < _WHOLE else 0.5
        if turn < _WHOLE and not within and along < -_OVERSHOT * slope < 0.0:
            within, low, high, at_low, at_high = True, 0.0, 1.0, slope, along
        elif within and along > 0.0:
            low, at_low, at_high = share, along, 0.5 * at_high
        elif within:
            high, at_high, at_low = share, along, 0.5 * at_low
        within = within and abs(along) > _LEVEL * slope
        if within:
            share = (low * at_high - high * at_low) / (at_high - at_low)
            wrench[:] = start + share * change
        else:
            start[:], share = wrench, 1.0
            _settle(residual, springs, inverse, h, change)
            slope = 0.0
            for i in range(6 * n):
                slope += residual[i] * dot(inverse[i], change)
            wrench[:] = start + length * change
            if _small(beds, first, change, _CLOSE, _CLOSE, begin, wrench, after):
                _follow(ahead, inverse, h, wrench, after)
                return True
        _follow(ahead, inverse, h, wrench, after)
    return False


@compiled
def hold_each(beds, first, coupled, states, rows, inverse, free, h, wrenches):
    """Write the wrenches of bodies that do not meet, shape [n, 6]; `inverse`: [n, 6, 6]; `free`: acceleration, [n, 6].

    Returns how many times Newton's method did not come to an end, the longest path of a point [m], and of how many
    bodies the push-back was limited.
    """
    after, ahead, failed, longest, limited = np.empty(6), np.empty(6), 0, 0.0, 0
    for b in range(len(states)):
        ahead[:] = states[b, 7:] + h * free[b]
        one = slice(b, b + 1)
        found, path, slowed = hold(
            beds, first + b, coupled[one], states[one], rows[one], inverse[b], ahead, h, wrenches[b], after
        )
        failed, longest, limited = failed + (0 if found else 1), max(longest, path), limited + slowed
    return failed, longest, limited
