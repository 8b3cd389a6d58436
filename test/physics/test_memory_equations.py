"""One plate along any path: the memory against its equations, written plate by plate from the text of rft/memory.py."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from scenes import LINEAR, seeds, unit
from scipy.spatial.transform import Rotation
from single_plate import traction_per_depth

from rft_ros.rft import Memory, Plates, rotation_matrix, wrenches_in_time
from rft_ros.rft.memory import BLOCK_STATE, EMPTY, PlateState, advance, follow_gap, load, store

LENGTH, AREA = 0.003, 2e-4
NORMAL = np.array([0.6, 0.0, -0.8])


class Plate:
    """Traction per depth τ, yield radius y, gap g, and the worn share u."""

    def __init__(self):
        self.tau = np.zeros(3)
        self.y = 0.0
        self.gap = 0.0
        self.worn = 0.0

    def wear(self, n, moved, share, length):
        """u∞, and the plastic path over which u comes near to it by a factor of e, Eq. (10d)."""
        way = np.linalg.norm(moved)
        lead = moved @ n / way
        dive = max(-moved[2], 0.0) / way
        fresh = max(0.75 * (1.0 - dive), 0.3)
        steady = 0.9 * max(-n[2], 0.0) * np.clip(1.0 - lead / fresh, 0.0, 1.0)
        over = max(0.013, 1.5 * length) if steady > self.worn else 1.5 * length
        return steady, over / min(2.0 * share, 1.0) if share > 0.0 else np.inf

    def step(self, n, moved, law, depth, share):
        """The force after a displacement [m] to a depth [m]; `law`: `share` times its traction [N/m³]."""
        if depth <= 0.0:
            self.__init__()
            return np.zeros(3)
        length = LENGTH * np.clip(((depth + 0.5 * moved[2]) / 0.03) ** 2, 0.1, 2.25)  # half-way
        k = 12.0 * 1e6 / length  # at zeta 1
        carried = np.linalg.norm(self.tau)
        closed = min(max(moved @ n, 0.0), self.gap)
        beyond = max(-moved @ n - max(-self.tau @ n, 0.0) / k, 0.0)
        if not moved.any():
            return self.tau * depth * AREA
        of_spring = (1.0 - closed / np.linalg.norm(moved)) * moved + beyond * n
        way = np.linalg.norm(of_spring)
        u = of_spring / way if way > 0.0 else np.zeros(3)
        elastic = (2.0 * max(self.tau @ u, 0.0) + self.y - carried) / k
        path = max(way - elastic, 0.0)
        tau = self.tau - k * min(elastic, way) * u
        steady, over = self.wear(n, moved, share, length)
        before, sliding = self.worn, path / over
        self.worn = steady + (before - steady) * np.exp(-sliding)
        change = tau - (1.0 - self.worn) * law
        size = np.linalg.norm(tau)
        sizes = np.linalg.norm(change) * max(size, np.linalg.norm(change))
        faster = max(tau @ change, 0.0) / sizes if sizes > 0.0 else 0.0
        yielding = (1.0 + faster) * path / length
        left = np.exp(-yielding)
        weight = 1.0
        if yielding > 1e-6:
            weight = yielding / (yielding - sliding) * (np.exp(-sliding) - left) / (1.0 - left)
        target = (1.0 - steady - (before - steady) * weight) * law
        tau = target + (tau - target) * left
        self.y = np.linalg.norm(tau) + (self.y - size) * left
        size = np.linalg.norm(tau)
        self.tau = tau * (max(size - k * beyond, 0.0) / size if size > 0.0 else 0.0)
        self.y = max(self.y * (1.0 - beyond / (3.0 * length)), np.linalg.norm(self.tau))
        self.gap += 0.2 * beyond - closed
        return self.tau * depth * AREA


def wandering(seed, steps=60):
    """A path in the grains, now and then out of them: attitudes, strokes to and fro along few directions, pauses."""
    rng = np.random.default_rng(seed)
    states = np.zeros((steps, 13))
    states[:, 3:7] = unit(rng.normal(size=4))
    if rng.random() < 0.5:  # it turns about its centre
        states[:, 3:7] = unit(
            states[:, 3:7] + np.cumsum(rng.normal(scale=0.05, size=(steps, 4)), axis=0)
        )
    ways = unit(rng.normal(size=(4, 3)))
    ways[0] = rotation_matrix(states[0, 3:7]) @ NORMAL
    chosen = rng.choice(4, steps, p=[0.55, 0.15, 0.15, 0.15])
    moved = (
        ways[chosen]
        * (rng.choice([1.0, -1.0], steps) * 10.0 ** rng.uniform(-5.5, -2.3, steps))[:, None]
    )
    moved[rng.random(steps) < 0.1] = 0.0
    states[:, :3] = np.cumsum(moved, axis=0)
    states[:, 2] += rng.uniform(-0.08, -0.01)
    states[:, 7:10] = moved / 0.01
    return states


@given(seed=seeds)
@settings(max_examples=100)
def test_one_plate_follows_the_equations_along_any_path(seed):
    states = wandering(seed)
    plates = Plates.from_arrays([[0.0, 0.0, 0.0]], [NORMAL], [AREA])
    grains = replace(LINEAR, mobilization_length=LENGTH)
    found = wrenches_in_time(plates, grains, states, Memory(plates))[:, :3]
    plate, twist, expected = Plate(), np.zeros(3), []
    for k, state in enumerate(states):
        turned = Rotation.from_quat([states[max(k - 1, 0), 3:7], state[3:7]])
        n = turned.mean().as_matrix() @ NORMAL  # half-way
        twist = state[7:10] if state[7:10].any() else twist
        share = float(twist @ n > 0.0)
        target = share * np.array(traction_per_depth(LINEAR, *n, *twist))
        moved = state[:3] - states[max(k - 1, 0), :3]
        expected.append(plate.step(n, moved, target, -state[2], share))
    assume(np.abs(expected).max() > 0.0)  # a path that never loads the plate shows nothing
    np.testing.assert_allclose(
        found, expected, rtol=0.0, atol=1e-7 * max(np.abs(expected).max(), 1e-3)
    )


@given(seed=seeds)
def test_the_gap_of_a_skipped_block_is_that_of_plates_that_are_evaluated(seed):
    """Else the gap would depend on which plates share a block."""
    rng = np.random.default_rng(seed)
    n = unit(rng.normal(size=3))
    gap = rng.choice([0.0, 1e-5, 1e-3])
    moved = unit(rng.normal(size=3)) * 10.0 ** rng.uniform(-6.0, -2.0)
    block = np.zeros(1, BLOCK_STATE)[0]
    before = EMPTY._replace(gap=gap)
    store(block, 0, before)
    follow_gap(block, 0, n, moved)
    followed, _ = advance(before, n, moved, 0.0, np.zeros(3), LENGTH, 1e6)
    assert load(block, 0).gap == pytest.approx(followed.gap, rel=1e-15)


def test_a_plate_is_stored_and_loaded_number_by_number():
    block = np.zeros(1, BLOCK_STATE)[0]
    state = PlateState(*np.arange(1.0, 1.0 + len(PlateState._fields)))
    store(block, 3, state)
    assert load(block, 3) == state
    assert load(block, 2) == EMPTY
