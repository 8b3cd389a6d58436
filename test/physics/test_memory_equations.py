"""One plate along any path: the memory against its equations, written plate by plate from the text of rft/memory.py."""

from dataclasses import replace

import numpy as np
from hypothesis import assume, given, settings
from scenes import LINEAR, seeds, unit

from rft_ros.rft import Memory, Plates, rotation_matrix, traction_per_depth, wrenches_in_time

LENGTH, AREA = 0.003, 2e-4
NORMAL = np.array([0.6, 0.0, -0.8])


class Plate:
    """Traction per depth τ, elastic radius y, the law's traction when it last yielded t, and the gap behind it g."""

    def __init__(self):
        self.tau, self.t, self.y, self.gap = np.zeros(3), np.zeros(3), 0.0, 0.0

    def step(self, n, moved, law, depth):
        """Over a displacement [m] to a depth [m]; `law`: traction per depth there, None where the plate trails."""
        if depth <= 0.0:
            self.__init__()
            return np.zeros(3)
        forward, way = moved @ n, np.linalg.norm(moved)
        square = ((depth + 0.5 * moved[2]) / 0.03) ** 2  # half-way
        ratio = np.clip(square, 1 / 6, 2.25)
        length, elastic = LENGTH * ratio, LENGTH * ratio * max(0.08, 1 / 30 / max(ratio, 5 / 12 - square))
        if law is None and not self.tau.any() and (forward < 0.0 or self.gap > 0.0):
            self.gap = min(max(self.gap - max(forward, 0.0), 0.0) + 0.2 * max(-forward, 0.0), 5e-3)
            self.fade(way, length)
            return np.zeros(3)
        if self.gap > 0.0:  # it closes first, and what is left of the displacement counts
            gap, self.gap = self.gap, max(self.gap - max(forward, 0.0), 0.0)
            if forward <= gap:
                return np.zeros(3)
            moved, way = moved * (1.0 - gap / forward), way * (1.0 - gap / forward)
        known = self.t.any()
        k = (max(np.linalg.norm(self.t), self.y) if known else 0.0 if law is None else np.linalg.norm(law)) / elastic
        trial = self.tau - k * moved
        if law is not None:
            self.lead(law, k * moved, way, length, known)
        elif trial @ n < 0.0 or forward >= 0.0:  # grains press: it slips beyond y
            size = np.linalg.norm(trial)
            self.tau = trial * min(1.0, self.y / size) if size > 0.0 else trial
            if not 0.5 * self.y <= size <= self.y:
                self.fade(way, length)
        else:  # it lets go
            size = np.linalg.norm(self.tau)
            self.tau = self.tau * max(1.0 - k * way / size, 0.0) if size > 0.0 else self.tau
            self.fade(way, length)
        return self.tau * depth * AREA

    def lead(self, law, fall, way, length, known):
        """Elastic up to abs(τ) = y, which τ - share fall meets; then τ approaches the mean of t over the step."""
        share = 1.0 if not fall.any() else 0.0
        if fall.any():
            a, b, c = fall @ fall, fall @ self.tau, self.y**2 - self.tau @ self.tau
            share = min((b + np.sqrt(b * b + a * max(c, 0.0))) / a, 1.0)
        self.tau = self.tau - share * fall
        path = way * (1.0 - share)
        if path > 0.0:
            to_go = (0.5 * (self.t + law) if known else law) - self.tau
            part = np.exp(-path / length)
            self.tau = self.tau + (1.0 - (part**2 if to_go @ self.tau < 0.0 else part)) * to_go
            self.t, self.y = np.array(law), np.linalg.norm(self.tau)

    def fade(self, way, length):
        self.y *= np.exp(-way / (3.0 * length))
        if self.y <= 1e-3 * np.linalg.norm(self.t):  # so little that it is forgotten
            self.y, self.tau = 0.0, np.zeros(3)


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
