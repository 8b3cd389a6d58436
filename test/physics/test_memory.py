"""Forces with memory: what must hold for any length, and what the grains were seen to do."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rft_ros.rft import MEDIA, Memory, Plates, alpha_y_model, checked_states, treers2021, wrenches, wrenches_in_time
from rft_ros.rft.memory import DEPTH, TRAILING
from rft_ros.tool import load_tool

GENERIC = MEDIA["generic"]
LAW = treers2021(GENERIC, alpha_y_model("constant", GENERIC), zeta=0.3)
PLATES = {i: load_tool("ellipsoid", integration=i).plates for i in ("centroid", "refined")}
INTEGRATIONS = tuple(PLATES)
ROOT_TIP = load_tool("root_tip", integration="refined").plates
LENGTH = 0.003


def along(path, velocity, *, start=(0.0, 0.0, -0.04), speed=1.0, angular=(0.0, 0.0, 0.0)):
    """States at these distances along a straight path, and the durations between them."""
    velocity = np.asarray(velocity, dtype=float)
    v = speed * velocity
    states = np.zeros((len(path), 13))
    states[:, :3] = np.asarray(start) + np.asarray(path)[:, None] * velocity / np.linalg.norm(velocity)
    states[:, 6] = 1.0
    states[:, 7:10] = v
    states[:, 10:13] = angular
    return checked_states(states), np.diff(path, prepend=path[0]) / np.linalg.norm(v)


def remembered(states, durations, *, length=LENGTH, plates=PLATES["centroid"], memory=None, law=LAW):
    memory = Memory(plates) if memory is None else memory
    return wrenches_in_time(plates, law, states, durations, memory, mobilization_length=length)


@pytest.mark.parametrize("integration", INTEGRATIONS)
def test_steady_motion_approaches_the_published_force_monotonically(integration):
    plates = PLATES[integration]
    states, durations = along(np.linspace(0.0, 0.08, 200), (0.01, 0.0, 0.0))  # level: the published force is constant
    result = remembered(states, durations, plates=plates)[:, 0]
    published = wrenches(plates, LAW, states)[0, 0]
    assert result[0] == pytest.approx(0.0, abs=1e-15)
    assert (np.diff(result) <= 1e-15).all()
    assert result[-1] == pytest.approx(published, rel=1e-3)


@pytest.mark.parametrize("integration", INTEGRATIONS)
def test_a_very_short_mobilization_length_gives_the_published_rule(integration):
    plates = PLATES[integration]
    states, durations = along(np.linspace(0.0, 0.05, 100), (0.005, 0.002, -0.01))
    result = remembered(states, durations, plates=plates, length=1e-12)[2:]
    published = wrenches(plates, LAW, states)
    # the mean of both ends of a step, over which the direction does not change
    np.testing.assert_allclose(result, published[2:], rtol=1e-9, atol=1e-12)


def test_a_plate_at_the_reference_depth_has_two_thirds_of_its_force_after_one_length():
    plate = Plates.from_arrays([[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]], [1e-4])
    for depth, after in ((DEPTH, LENGTH), (2.0 * DEPTH, 4.0 * LENGTH)):  # λ grows with the square of depth
        states, durations = along(np.array([0.0, after]), (0.01, 0.0, 0.0), start=(0.0, 0.0, -depth))
        ratio = remembered(states, durations, plates=plate)[1, 0] / wrenches(plate, LAW, states)[1, 0]
        assert ratio == pytest.approx(1.0 - np.exp(-1.0), rel=1e-9)


@given(speed=st.floats(1e-6, 1e3), integration=st.sampled_from(INTEGRATIONS))
@settings(max_examples=30)
def test_without_a_density_the_same_path_at_another_speed_gives_the_same_forces(speed, integration):
    path = np.linspace(0.0, 0.01, 20)
    turning = {"velocity": (0.01, 0.0, -0.01), "angular": (0.0, 0.3, 0.1)}
    slow = remembered(*along(path, **turning), plates=PLATES[integration])
    states, durations = along(path, speed=speed, **turning)
    states[:, 10:13] *= speed
    np.testing.assert_allclose(remembered(states, durations, plates=PLATES[integration]), slow, rtol=1e-9, atol=1e-12)


@given(yaw=st.floats(0.1, 3.1), speed=st.floats(1e-3, 1e3), shift=st.integers(1, 500))
@settings(max_examples=20)
def test_axes_speed_and_order_of_the_plates_do_not_decide_which_of_them_lead(yaw, speed, shift):
    """Down and up again: what the trailing plates keep decides the sign of the force."""
    down, pause = along(np.linspace(0.0, 0.04, 41), (0.0, 0.0, -0.02), start=(0.0, 0.0, 0.0))
    up, _ = along(np.linspace(0.0, 0.01, 11), (0.0, 0.0, 0.02), start=(0.0, 0.0, -0.04))
    states, durations = np.vstack([down, up[1:]]), np.append(pause, pause[1:11])
    expected = remembered(states, durations, plates=ROOT_TIP)
    assert expected[-1, 2] < 0.0 < expected[40, 2]
    states[:, 5:7] = np.sin(0.5 * yaw), np.cos(0.5 * yaw)
    states[:, 7:] *= speed
    found = remembered(states, durations / speed, plates=Plates(np.roll(ROOT_TIP.rows, shift, axis=1)))
    c, s = np.cos(yaw), np.sin(yaw)
    for column in (0, 3):
        x, y = expected[:, column].copy(), expected[:, column + 1].copy()
        expected[:, column], expected[:, column + 1] = c * x - s * y, s * x + c * y
        scale = np.abs(expected[:, column : column + 3]).max()
        # the released code's e2 of a horizontal plate prefers x by 1e-5
        np.testing.assert_allclose(found[:, column : column + 3], expected[:, column : column + 3], atol=1e-5 * scale)


@given(st.lists(st.floats(0.0, 0.02), min_size=1, max_size=8))
@settings(max_examples=30)
def test_dividing_a_steady_path_changes_nothing(cuts):
    """With level motion the law asks for the same at every point."""
    ends = np.array([0.0, 0.02])
    whole = remembered(*along(ends, (0.01, 0.003, 0.0)))[-1]
    divided = np.unique(np.concatenate([ends, cuts]))
    states, durations = along(divided, (0.01, 0.003, 0.0))
    memory = Memory(PLATES["centroid"])
    # the first step of a memory knows what the law asks for only at its end
    first = remembered(*along(np.array([0.0, 1e-30]), (0.01, 0.003, 0.0)), memory=memory)
    assert np.abs(first).max() < 1e-20 * np.abs(whole).max() + 1e-20 or first[0, 6] > 0.0
    parts = remembered(states, durations, memory=memory)[-1]
    memory = Memory(PLATES["centroid"])
    remembered(*along(np.array([0.0, 1e-30]), (0.01, 0.003, 0.0)), memory=memory)
    whole = remembered(*along(ends, (0.01, 0.003, 0.0)), memory=memory)[-1]
    np.testing.assert_allclose(parts, whole, rtol=1e-9, atol=1e-12)


def test_the_force_on_a_leading_plate_converges_at_second_order_in_the_step():
    """First order where plates begin or cease to lead, or to be loaded: that happens within a step."""
    plate = Plates.from_arrays([[0.0, 0.0, 0.0]], [[0.8, 0.0, -0.6]], [1e-4])

    def at_the_end(n):
        t = np.linspace(0.0, 1.0, n)
        states = np.zeros((n, 13))
        angle = 0.8 * (1.0 - t)  # turns towards the plate, whose load only grows
        states[:, 2] = -0.03 - 0.01 * t
        states[:, 6] = 1.0
        states[:, 7], states[:, 8], states[:, 9] = 0.012 * np.cos(angle), 0.012 * np.sin(angle), -0.01
        return remembered(checked_states(states), np.diff(t, prepend=0.0), plates=plate)[-1, :3]

    exact = at_the_end(12801)
    errors = [np.linalg.norm(at_the_end(n) - exact) for n in (51, 101, 201, 401)]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders.min() > 1.8, (errors, orders)


def test_the_forces_on_a_turning_body_depend_little_on_the_step():
    def at_the_end(n):
        t = np.linspace(0.0, 1.0, n)
        states = np.zeros((n, 13))
        angle = 4.0 * t
        states[:, 0], states[:, 2] = 0.003 * np.sin(angle), -0.04 - 0.01 * t
        states[:, 6] = 1.0
        states[:, 7], states[:, 9] = 0.012 * np.cos(angle), -0.01
        return remembered(checked_states(states), np.diff(t, prepend=0.0), plates=PLATES["refined"])[-1, :3]

    exact = at_the_end(3201)
    for n, share in ((126, 2e-3), (501, 5e-4), (1001, 2.5e-4)):
        assert np.linalg.norm(at_the_end(n) - exact) < share * np.linalg.norm(exact)


@pytest.mark.parametrize("integration", INTEGRATIONS)
def test_at_rest_the_force_holds(integration):
    plates, memory = PLATES[integration], Memory(PLATES[integration])
    states, durations = along(np.linspace(0.0, 0.02, 50), (0.004, 0.0, -0.01))
    last = remembered(states, durations, plates=plates, memory=memory)[-1]
    at_rest = np.repeat(states[-1:], 1000, axis=0)
    at_rest[:, 7:] = 0.0
    held = remembered(at_rest, np.full(1000, 0.01), plates=plates, memory=memory)
    np.testing.assert_allclose(held, np.repeat(last[None], 1000, axis=0), rtol=1e-12, atol=1e-15)


def test_after_a_reversal_the_force_falls_within_a_fraction_of_the_length():
    memory = Memory(PLATES["centroid"])
    down, durations = along(np.linspace(0.0, 0.04, 100), (0.0, 0.0, -0.01), start=(0.0, 0.0, 0.0))
    pressed = remembered(down, durations, memory=memory)[-1, 2]
    up, durations = along(np.linspace(0.0, LENGTH, 50), (0.0, 0.0, 0.01), start=(0.0, 0.0, -0.04))
    left = remembered(up, durations, memory=memory)[:, 2]
    assert left[0] == pytest.approx(pressed)
    assert (np.diff(left) < 0.0).all()
    scale = LENGTH * TRAILING * (0.05 / DEPTH) ** 2
    assert left[np.searchsorted(np.linspace(0.0, LENGTH, 50), 3.0 * scale)] < 0.1 * pressed


def test_plates_that_leave_the_grains_forget():
    memory = Memory(PLATES["refined"])
    down, durations = along(np.linspace(0.0, 0.03, 60), (0.0, 0.0, -0.01), start=(0.0, 0.0, 0.0))
    first = remembered(down, durations, plates=PLATES["refined"], memory=memory)
    above, pause = along(np.array([0.0]), (0.0, 0.0, 0.01), start=(0.0, 0.0, 0.1))
    remembered(above, pause, plates=PLATES["refined"], memory=memory)
    assert not memory.tractions.any()
    assert not memory.active.any()
    np.testing.assert_array_equal(remembered(down, durations, plates=PLATES["refined"], memory=memory), first)


@given(st.floats(1e-9, 1e3), st.integers(0, 2**32 - 1), st.sampled_from(INTEGRATIONS))
@settings(max_examples=40)
def test_forces_are_finite_and_bounded_by_the_law_for_any_length_and_motion(length, seed, integration):
    rng = np.random.default_rng(seed)
    states = np.zeros((12, 13))
    states[:, :3] = rng.normal(scale=0.03, size=(12, 3))
    q = rng.normal(size=(12, 4))
    states[:, 3:7] = q / np.linalg.norm(q, axis=1)[:, None]
    states[:, 7:] = rng.normal(size=(12, 6)) * 10.0 ** rng.integers(-12, 3, size=(12, 1)) * rng.integers(0, 2, (12, 6))
    durations = 10.0 ** rng.uniform(-6, 1, 12)
    result = remembered(checked_states(states), durations, length=length, plates=PLATES[integration])
    assert np.isfinite(result).all()
    depth = np.maximum(0.04 - states[:, 2], 0.0)
    strongest = 2.0 * LAW.stiffness * PLATES[integration].area * depth
    assert (np.linalg.norm(result[:, :3], axis=1) <= strongest).all()


def test_a_speed_near_the_largest_double_leaves_a_usable_memory():
    memory = Memory(PLATES["centroid"])
    states, durations = along(np.array([0.0]), (1.0, 0.0, 0.0))
    states[:, 7] = 1.7e308
    for _ in range(2):
        remembered(states, durations + 0.1, memory=memory)
    states, durations = along(np.linspace(0.0, 0.03, 60), (0.01, 0.0, -0.002))
    assert np.isfinite(remembered(states, durations, memory=memory)).all()


def test_memory_continues_with_another_alpha_y_model():
    """ζ and α_y are swapped while the tool is in the grains; what the plates remember is a traction, not a share."""
    memory = Memory(PLATES["centroid"])
    states, durations = along(np.linspace(0.0, 0.03, 60), (0.01, 0.0, -0.002))
    before = remembered(states, durations, memory=memory)[-1]
    stronger = treers2021(GENERIC, alpha_y_model("linear", GENERIC), zeta=0.6)
    rest = states[-1:].copy()
    rest[:, 7:] = 0.0
    after = remembered(rest, np.array([0.002]), memory=memory, law=stronger)[-1]
    np.testing.assert_allclose(after, before, rtol=1e-12)
