"""One plate along any path: the memory against its equations, written plate by plate from the text of rft/memory.py."""

from dataclasses import replace

import numpy as np
from hypothesis import assume, given, settings
from scenes import LINEAR, seeds, unit

from rft_ros.rft import Memory, Plates, rotation_matrix, traction_per_depth, wrenches_in_time

LENGTH, AREA = 0.003, 2e-4
NORMAL = np.array([0.6, 0.0, -0.8])
SLIGHT = np.sin(np.radians(2.0))


WEAKEST = 0.01e6  # N/m³, at zeta 1


class Plate:
    """Traction per depth τ, elastic radius y, strength s, the demand at the last state, and the gap g."""

    def __init__(self):
        self.tau, self.demand, self.y, self.s, self.gap = np.zeros(3), np.zeros(3), 0.0, 0.0, 0.0

    def step(self, n, moved, law, depth):
        """Over a displacement [m] to a depth [m]; `law`: traction per depth there, None where the plate trails."""
        if depth <= 0.0:
            self.__init__()
            return np.zeros(3)
        forward, way = moved @ n, np.linalg.norm(moved)
        square = ((depth + 0.5 * moved[2]) / 0.03) ** 2  # half-way
        ratio = np.clip(square, 1 / 6, 2.25)
        length, elastic = LENGTH * ratio, LENGTH * ratio * max(0.08, 1 / 30 / max(ratio, 5 / 12 - square))
        gap, counts = self.gap, 1.0
        self.gap = max(gap - max(forward, 0.0), 0.0)
        if gap > 0.0:  # it closes first, and what is left of the displacement counts
            counts = max(1.0 - gap / forward, 0.0) if forward > 0.0 else 0.0
        k = counts * max(self.y, self.s, WEAKEST) / elastic
        limit = k * max(-forward, SLIGHT * way)
        pressed = min(max(-self.tau @ n, 0.0) / limit, 1.0) if limit > 0.0 else float(self.tau @ n < 0.0)
        onward = min(max(forward, 0.0) / (SLIGHT * way), 1.0) if way > 0.0 else 0.0
        released = (1.0 - pressed) * (1.0 - onward)
        if law is None:
            self.trail(k * moved, k * way, released, way / length, forward)
        else:
            self.lead(law, k * moved, released, counts * way / length)
        self.demand = np.zeros(3) if law is None else np.array(law)
        return self.tau * depth * AREA

    def lead(self, law, fall, released, path):
        """A release if τ pushes; elastic to abs(τ) = y, which τ - share fall meets; then τ approaches the mean of t."""
        tau, share = self.tau, 1.0 - released
        size, full = np.linalg.norm(tau), np.linalg.norm(fall)
        if fall @ tau > 0.0:
            pushes = min(10.0 * (fall @ tau) / (full * size), 1.0)
            tau = tau * max(size - full * released * pushes, 0.0) / size
        if full > 0.0:
            a, b, c = fall @ fall, fall @ tau, self.y**2 - tau @ tau
            share = min((b + np.sqrt(b * b + a * max(c, 0.0))) / a, share)
        tau = tau - share * fall
        path *= 1.0 - share
        if path <= 0.0:
            self.tau = tau
            return
        sizes = sorted((law @ law, self.demand @ self.demand))
        change = law + 0.5 * min(4.0 * sizes[0] / sizes[1], 1.0) * (self.demand - law) - tau
        turn = np.sqrt(change @ change * (change @ change + tau @ tau))
        rate = 1.0 + np.clip(-10.0 * (change @ tau) / max(turn, WEAKEST**2), 0.0, 1.0)
        left = np.exp(-path * rate)
        self.tau = tau + (1.0 - left) * change
        swift = path * max(8.0 * self.y, self.s, WEAKEST)
        self.s += swift / (self.y + swift) * (np.linalg.norm(law) - self.s)
        self.y = np.sqrt(self.tau @ self.tau + left**2 * max(self.y**2 - tau @ tau, 0.0))

    def trail(self, fall, full, released, path, forward):
        """A spring that slips at y, and a release; y fades where it slips or is not half used, and in the release."""
        tau = self.tau - (1.0 - released) * fall
        tried = np.linalg.norm(tau)
        size = min(tried, self.y)
        left = max(size - full * released, 0.0)
        self.tau = tau * (left / tried) if tried > 0.0 else tau
        unused = max(released - (size / full if full > 0.0 else 0.0), 0.0)
        self.gap = min(self.gap + 0.2 * max(-forward, 0.0) * max(unused - 0.05, 0.0) / 0.95, 5e-3)
        loose = np.clip(5.0 - 20.0 * (tried / self.y) ** 2, 0.0, 1.0) if self.y > 0.0 else 0.0
        slips = (tried - size) / full if full > 0.0 else 0.0
        fades = released + (1.0 - released) * min(max(loose, slips), 1.0)
        floor = 1e-6 * self.s**2
        self.y = np.sqrt(max((self.y**2 + floor) * np.exp(-path * fades / 1.5) - floor, 0.0))


def wandering(seed, steps=60):
    """A path in the grains, now and then out of them: attitudes, strokes to and fro along few directions, pauses."""
    rng = np.random.default_rng(seed)
    states = np.zeros((steps, 13))
    states[:, 3:7] = unit(rng.normal(size=4))
    if rng.random() < 0.5:  # it turns about its centre
        states[:, 3:7] = unit(states[:, 3:7] + np.cumsum(rng.normal(scale=0.05, size=(steps, 4)), axis=0))
    ways = unit(rng.normal(size=(4, 3)))
    ways[0] = rotation_matrix(states[0, 3:7]) @ NORMAL
    chosen = rng.choice(4, steps, p=[0.55, 0.15, 0.15, 0.15])
    moved = ways[chosen] * (rng.choice([1.0, -1.0], steps) * 10.0 ** rng.uniform(-5.5, -2.3, steps))[:, None]
    moved[rng.random(steps) < 0.1] = 0.0
    states[:, :3] = np.cumsum(moved, axis=0)
    states[:, 2] += rng.uniform(-0.08, -0.01)
    states[:, 7:10] = moved / 0.01
    return states


@given(seed=seeds)
@settings(max_examples=200)
def test_one_plate_follows_the_equations_along_any_path(seed):
    states = wandering(seed)
    plates = Plates.from_arrays([[0.0, 0.0, 0.0]], [NORMAL], [AREA])
    durations = np.full(len(states), 0.01)
    grains = replace(LINEAR, mobilization_length=LENGTH)
    found = wrenches_in_time(plates, grains, states, durations, Memory(plates))[:, :3]
    plate, twist, expected = Plate(), np.zeros(3), []
    for k, state in enumerate(states):
        n = rotation_matrix(state[3:7]) @ NORMAL
        twist = state[7:10] if state[7:10].any() else twist
        leads = twist @ n > 0.0
        moved = state[:3] - states[max(k - 1, 0), :3]
        expected.append(
            plate.step(n, moved, np.array(traction_per_depth(LINEAR, *n, *twist)) if leads else None, -state[2])
        )
    assume(np.abs(expected).max() > 0.0)  # a path that never loads the plate shows nothing
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * max(np.abs(expected).max(), 1e-3))
