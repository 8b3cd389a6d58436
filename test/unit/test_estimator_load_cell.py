"""What the load cell reports, less its bias and the tool's weight, is what the grains do; prediction in its frame."""

from collections import namedtuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_plate import LEVEL, START, about, estimator, measurement, plate_model, pose, push, twist, wrench
from scipy.spatial.transform import Rotation

from rft_ros.estimator import LoadCell
from rft_ros.rft import checked_states, wrenches
from rft_ros.tool import load_tool

GRAVITY = 9.80665
ORIENTATIONS = [tuple(q) for q in Rotation.random(20, random_state=3).as_quat().tolist()]
MOUNT = tuple((Rotation.from_euler("zyx", [30.0, -50.0, 170.0], degrees=True)).as_quat().tolist())
IN_AIR = (0.1, -0.2, 0.5)


def weight_in_sensor(cell, orientation):
    """Force and torque of the hanging mass in sensor axes, by scipy's rotations."""
    to_sensor = (Rotation.from_quat(orientation) * Rotation.from_quat(cell.quaternion)).inv()
    force = to_sensor.apply([0.0, 0.0, -cell.mass * GRAVITY])
    return np.concatenate([force, np.cross(cell.center_of_mass, force)])


Answer = namedtuple("Answer", "predicted compensated residual")


def answer(cell, reading, *, position=IN_AIR, quaternion=LEVEL, linear=(0, 0, -0.01), angular=(0, 0, 0), **model):
    e = estimator(load_cell=cell, model=plate_model(**model))
    estimate = push(
        e, twist(linear=linear, angular=angular), wrench(numbers=reading), pose(START, position, quaternion)
    )
    measured = measurement(e)
    assert measured.stamp == estimate.stamp
    return Answer(estimate.predicted, measured.compensated, measured.residual)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("orientation", ORIENTATIONS, ids=range(20))
def test_a_hanging_tool_turned_any_way_is_compensated_to_zero(orientation, sign):
    """Perfect readings: the driver's own sign, its bias, the weight on a rotated sensor."""
    cell = LoadCell(
        position=(0.01, -0.02, 0.15),
        quaternion=MOUNT,
        sign=sign,
        bias=(1.0, -2.0, 3.0, 0.1, -0.2, 0.3),
        mass=1.7,
        center_of_mass=(0.004, -0.006, 0.08),
    )
    reading = np.array(cell.bias) + sign * weight_in_sensor(cell, orientation)
    estimate = answer(cell, reading, quaternion=orientation)
    assert estimate.compensated == pytest.approx([0.0] * 6, abs=1e-9)
    assert estimate.residual == pytest.approx([0.0] * 6, abs=1e-9)
    assert np.abs(reading - cell.bias).max() > 1.0


def test_a_mass_of_1_kg_below_a_level_sensor_pulls_it_down_by_9_80665_newton():
    estimate = answer(LoadCell(mass=1.0, center_of_mass=(0.1, 0.0, -0.05)), [0.0] * 6)
    assert estimate.compensated == pytest.approx([0, 0, GRAVITY, 0, -0.1 * GRAVITY, 0], abs=1e-12)


@given(
    st.tuples(*[st.floats(-100.0, 100.0)] * 6), st.tuples(*[st.floats(-10.0, 10.0)] * 6), st.sampled_from([1.0, -1.0])
)
def test_bias_is_taken_off_in_the_drivers_sign_before_the_sign_is_turned(reading, bias, sign):
    estimate = answer(LoadCell(sign=sign, bias=bias), reading)
    assert estimate.compensated == pytest.approx(
        [sign * (m - b) for m, b in zip(reading, bias, strict=True)], abs=1e-12
    )


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_push_of_the_grains_is_positive_upwards_and_equals_a_drivers_reading_of_the_force_on_the_tool(sign):
    """1 cm deep, 4 cm², pushed straight down: 4 N up. The residual is what a driver, of either sign, reports beyond."""
    exact = answer(LoadCell(sign=sign), [0, 0, sign * 4.0, 0, 0, 0], position=(0, 0, -0.01))
    assert exact.predicted[2] == pytest.approx(4.0, rel=1e-6)
    assert exact.compensated[2] == 4.0
    assert exact.residual == pytest.approx([0.0] * 6, abs=1e-4)  # the published nudge tilts the velocity by 1e-5
    more = answer(LoadCell(), [1, 2, 7, 0.1, 0.2, 0.3], position=(0, 0, -0.01))
    assert more.residual == pytest.approx(np.array(more.compensated) - np.array(more.predicted), abs=1e-15)
    assert more.residual[2] == pytest.approx(3.0, rel=1e-5)


@pytest.mark.parametrize("orientation", ORIENTATIONS[:8], ids=range(8))
def test_the_prediction_is_the_world_wrench_moved_to_the_sensors_axes_and_origin(orientation, plate_file):
    """Against numpy and scipy: force R' f, torque R' (t - p x f), of a closed body with forces on several faces."""
    tool = load_tool(plate_file, scale=1.0)
    cell = LoadCell(position=(0.03, -0.05, 0.12), quaternion=MOUNT)
    linear, angular = (0.01, -0.02, -0.03), (0.4, -0.2, 0.1)
    where = {"position": (0, 0, -0.1), "quaternion": orientation, "linear": linear, "angular": angular}
    estimate = answer(cell, [0.0] * 6, **where, zeta=0.7, tool=tool)
    law = plate_model(zeta=0.7).law
    world = wrenches(tool.plates, law, checked_states([0, 0, -0.1, *orientation, *linear, *angular]))[0]
    tool_to_world = Rotation.from_quat(orientation)
    to_sensor = (tool_to_world * Rotation.from_quat(MOUNT)).inv()
    arm = tool_to_world.apply(cell.position)
    expected = [*to_sensor.apply(world[:3]), *to_sensor.apply(world[3:6] - np.cross(arm, world[:3]))]
    assert np.abs(world[:3]).min() > 1e-3
    assert estimate.predicted == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("orientation", [*ORIENTATIONS[:5], about((0, 0, 1), 90.0)])
def test_a_twist_in_tool_axes_gives_the_estimate_of_the_same_twist_in_world_axes(orientation, plate_file):
    tool = load_tool(plate_file, scale=1.0)
    turn = Rotation.from_quat(orientation)
    linear, angular = np.array([0.01, -0.02, -0.03]), np.array([0.4, -0.2, 0.1])
    predicted, place = [], pose(position=(0, 0, -0.1), quaternion=orientation)
    for frame, axes in (("world", Rotation.identity()), ("tool", turn.inv())):
        motion = twist(START, tuple(axes.apply(linear).tolist()), tuple(axes.apply(angular).tolist()), frame)
        predicted.append(push(estimator(model=plate_model(tool=tool)), motion, place).predicted)
    assert predicted[1] == pytest.approx(predicted[0], rel=1e-9, abs=1e-9)
    assert np.abs(predicted[0]).max() > 0.1


@pytest.fixture(scope="module")
def plate_file(tmp_path_factory):
    """A closed tetrahedron, metres, with no face level: a body with a wrench of six components."""
    file = tmp_path_factory.mktemp("mesh") / "tetrahedron.obj"
    file.write_text(
        "v 0.03 0.001 -0.02\nv -0.02 0.03 -0.018\nv -0.019 -0.028 -0.023\nv 0.002 0.004 0.035\n"
        "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    )
    return str(file)
