"""What the load cell reports, less bias and weight, is what the grains do; prediction in its frame, by stamps alone."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from one_plate import (
    LEVEL,
    MS,
    SECOND,
    START,
    about,
    config,
    estimator,
    measurement,
    plate_model,
    pose,
    push,
    twist,
    use,
    wrench,
)
from scipy.spatial.transform import Rotation

from rft_ros.estimator import Estimate, QualityFlag, Reason, TransformSample
from rft_ros.parameters import LoadCell
from rft_ros.rft import checked_states, wrenches
from rft_ros.rft.frames import Placement
from rft_ros.tool import load_tool

AGE = 100 * MS  # the default max_input_age
GRAVITY = 9.80665
ORIENTATIONS = [tuple(q) for q in Rotation.random(20, random_state=3).as_quat().tolist()]
MOUNT = tuple((Rotation.from_euler("zyx", [30.0, -50.0, 170.0], degrees=True)).as_quat().tolist())
IN_AIR = (0.1, -0.2, 0.5)


def weight_in_sensor(cell, orientation):
    """Force and torque of the hanging mass in sensor axes, by scipy's rotations."""
    to_sensor = (Rotation.from_quat(orientation) * Rotation.from_quat(cell.quaternion)).inv()
    force = to_sensor.apply([0.0, 0.0, -cell.mass * GRAVITY])
    return np.concatenate([force, np.cross(cell.center_of_mass, force)])


def answer(cell, reading, *, position=IN_AIR, quaternion=LEVEL):
    """What the load cell measures in a tool that is pushed down, and what is predicted [N, N m]."""
    e = estimator(sensor=cell)
    predicted = push(
        e, twist(), wrench(numbers=reading), pose(START, position, quaternion)
    ).predicted
    return measurement(e), predicted


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
    measured, _ = answer(cell, reading, quaternion=orientation)
    assert measured.compensated == pytest.approx([0.0] * 6, abs=1e-9)
    assert measured.residual == pytest.approx([0.0] * 6, abs=1e-9)
    assert np.abs(reading - cell.bias).max() > 1.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_push_of_the_grains_is_positive_upwards_as_in_a_reading(sign):
    """1 cm deep, 4 cm², pushed straight down: 4 N up. The residual is what a driver, of either sign, reports beyond."""
    exact, predicted = answer(
        LoadCell(sign=sign), [0, 0, sign * 4.0, 0, 0, 0], position=(0, 0, -0.01)
    )
    assert predicted[2] == pytest.approx(4.0, rel=1e-6)
    assert exact.compensated[2] == 4.0
    # the published nudge tilts the velocity by 1e-5
    assert exact.residual == pytest.approx([0.0] * 6, abs=1e-4)
    more, predicted = answer(LoadCell(), [1, 2, 7, 0.1, 0.2, 0.3], position=(0, 0, -0.01))
    assert more.residual == pytest.approx(np.subtract(more.compensated, predicted), abs=1e-15)
    assert more.residual[2] == pytest.approx(3.0, rel=1e-5)


@pytest.fixture(scope="module")
def body(tmp_path_factory):
    """A closed tetrahedron, metres, with no face level: a body with a wrench of six components."""
    file = tmp_path_factory.mktemp("mesh") / "tetrahedron.obj"
    file.write_text(
        "v 0.03 0.001 -0.02\nv -0.02 0.03 -0.018\nv -0.019 -0.028 -0.023\nv 0.002 0.004 0.035\n"
        "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n"
    )
    return plate_model(zeta=0.7, tool=load_tool(str(file), scale=1.0))


@pytest.mark.parametrize("frame", ["world", "tool"])
@pytest.mark.parametrize("orientation", [*ORIENTATIONS[:8], about((0, 0, 1), 90.0)], ids=range(9))
def test_the_prediction_is_the_world_wrench_moved_to_the_sensors_axes_and_origin(
    orientation, frame, body
):
    """Against numpy and scipy: force R' f, torque R' (t - p x f); the twist is told in world or in tool axes."""
    position, tool_to_world = (0.0, 0.0, -0.1), Rotation.from_quat(orientation)
    v = np.array([[0.01, -0.02, -0.03], [0.4, -0.2, 0.1]])
    linear, angular = (tool_to_world.inv().apply(v) if frame == "tool" else v).tolist()
    cell = LoadCell(position=(0.03, -0.05, 0.12), quaternion=MOUNT)
    motion = twist(START, tuple(linear), tuple(angular), frame)
    estimate = push(estimator(sensor=cell, model=body), motion, pose(START, position, orientation))
    world = wrenches(
        body.tool.plates, body.law, checked_states([*position, *orientation, *v.ravel()])
    )[0]
    to_sensor = (tool_to_world * Rotation.from_quat(MOUNT)).inv()
    arm = tool_to_world.apply(cell.position)
    expected = [
        *to_sensor.apply(world[:3]),
        *to_sensor.apply(world[3:6] - np.cross(arm, world[:3])),
    ]
    assert np.abs(world[:3]).min() > 1e-3
    assert estimate.predicted == pytest.approx(expected, abs=1e-9)


BASE = Placement((0.3, -0.2, 0.1), about((0, 0, 1), 180.0))
IN_WORLD = {
    "the frame_id is the world": ("world", {}),
    "the frame_id is fixed in the world": ("base", {}),
    "sensor_frame is the world": ("world", {"sensor_frame": "world"}),
    "sensor_frame is fixed in the world": ("base", {"sensor_frame": "base"}),
    "the frame_id names the sensor wrongly": ("ft_sensor", {"sensor_frame_source": "world"}),
}


@pytest.mark.parametrize("way", IN_WORLD)
@given(
    attitude=st.sampled_from(ORIENTATIONS),
    reading=st.tuples(*[st.floats(-50.0, 50.0)] * 6),
    sign=st.sampled_from([1.0, -1.0]),
)
@settings(max_examples=10, deadline=None)
def test_a_reading_in_world_axes_gives_what_the_same_reading_in_sensor_axes_gives(
    way, attitude, reading, sign
):
    """The torque is about the sensor's origin, in whichever axes the driver gives it."""
    frame, choice = IN_WORLD[way]
    cell = LoadCell(
        quaternion=MOUNT, position=(0.01, 0.02, 0.1), sign=sign, bias=(1.0,) * 6, mass=0.5
    )
    axes = Rotation.from_quat(attitude) * Rotation.from_quat(MOUNT)
    if frame == "base":
        axes = Rotation.from_quat(BASE.quaternion).inv() * axes
    turned = [*axes.apply(reading[:3]), *axes.apply(reading[3:])]
    plain, turning = estimator(sensor=cell), estimator(sensor=cell, **choice)
    push(turning, TransformSample(0, "world", "base", *BASE, True))
    for e, sample in (
        (plain, wrench(numbers=reading)),
        (turning, wrench(numbers=turned, frame=frame)),
    ):
        push(e, sample, twist(), pose(START, IN_AIR, attitude))
    assert measurement(turning).compensated == pytest.approx(
        measurement(plain).compensated, abs=1e-9
    )
    assert turning.wrench_frame == ("tool" if "sensor_frame" in choice else "ft_sensor")


@given(delay=st.integers(-2 * SECOND, 2 * SECOND), seed=st.integers(0, 99))
@settings(max_examples=20, deadline=None)
def test_readings_whose_stamps_are_late_give_with_the_delay_what_prompt_ones_give(delay, seed):
    poses, readings = streams(seed, 2 * MS, 0.1)
    late = [w._replace(stamp=w.stamp + delay) for w in readings]
    assert replayed([*late, *poses], delay=delay * 1e-9)[:2] == replayed([*readings, *poses])[:2]


def ramp(stamp):
    """A load cell whose reading grows by 1 N a millisecond."""
    return wrench(stamp, (0.0, 0.0, (stamp - START) / MS, 0.0, 0.0, 0.0))


def waiting(*before, sensor=None):
    """An estimator with these samples and an estimate at START."""
    e = estimator(sensor=sensor)
    push(e, twist(), *before, pose())
    return e


def test_the_reading_is_interpolated_between_the_samples_on_both_sides_of_the_stamp():
    e = waiting(ramp(START - 3 * MS))
    assert e.measurements() == []
    push(e, wrench(START + MS, (4.0, 0.0, 1.0, 0.0, 0.0, 8.0)))
    (measured,) = e.measurements()
    assert measured.compensated == pytest.approx((3.0, 0.0, 0.0, 0.0, 0.0, 6.0))
    assert measured.residual[2] == pytest.approx(-4.0, rel=1e-6)
    assert e.measurements() == []


def test_the_first_sample_at_the_stamp_is_the_reading_before_the_pose_or_after():
    exact, again = wrench(START, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)), wrench(START)
    early, late = waiting(ramp(START - MS), exact, again), waiting(ramp(START - MS))
    push(late, exact, again)
    for e in (early, late):
        assert [m.compensated for m in e.measurements()] == [exact.wrench]


@pytest.mark.parametrize(
    "last", [pose(START + SECOND + 1), twist(START + SECOND + 1), ramp(START + AGE + 1), None]
)
def test_without_a_sample_soon_after_the_stamp_or_at_the_end_the_last_one_before_counts(last):
    e = waiting(ramp(START - 2 * MS))
    push(e, twist(START + SECOND))
    assert e.measurements() == []
    push(e, last) if last else e.finish()
    assert e.measurements()[0].compensated[2] == -2.0


@pytest.mark.parametrize(
    ("before", "reason"),
    [((), Reason.WRENCH_MISSING), ((ramp(START - AGE - 1),), Reason.WRENCH_STALE)],
)
def test_without_a_usable_sample_before_the_stamp_there_is_a_prediction_alone_and_the_reason(
    before, reason
):
    e = waiting(*before)
    assert e.counts[reason] == 0
    push(e, ramp(START + MS))
    assert e.measurements() == [(START, None, None, reason)]
    assert (e.estimates, e.counts) == (1, {reason: 1})


def test_bias_sign_and_weight_are_those_in_force_at_the_pose():
    e = waiting(ramp(START - MS), sensor=LoadCell(sign=-1.0, bias=(0.0, 0.0, 5.0, 0.0, 0.0, 0.0)))
    e.use(config=config())
    push(e, ramp(START + MS))
    assert e.measurements()[0].compensated[2] == pytest.approx(5.0)


def test_a_new_sensor_frame_does_not_mix_samples_of_two_frames():
    e = waiting(ramp(START - MS))
    use(e, sensor_frame="wrist")
    assert e.measurements()[0].compensated[2] == -1.0
    push(e, pose(START + MS))
    push(e, wrench(START + 2 * MS, frame="wrist"))
    assert e.measurements()[0].reason is Reason.WRENCH_MISSING


def test_an_estimate_before_a_jump_back_in_time_is_compared_with_the_samples_before_it():
    for jump in (pose(START - 5 * SECOND), wrench(START - 5 * SECOND)):
        e = waiting(ramp(START - MS))
        push(e, jump)
        assert e.measurements()[0].compensated[2] == -1.0


def streams(seed, period, gaps, *, seconds=1, start=-0.01):
    """Poses at 250 Hz and a noisy load cell, with stamps that jitter; `gaps`: shares left out; `start`: height [m]."""
    random, count = np.random.default_rng(seed), 250 * seconds
    heights = start - 4e-5 * np.arange(count)
    poses = [
        pose(START + k * 4 * MS + int(random.integers(0, MS)), (0.0, 0.0, z))
        for k, z in enumerate(heights)
    ]
    stamps = [
        START + k * period + int(random.integers(0, period))
        for k in range(seconds * SECOND // period)
    ]
    return poses, [
        wrench(t, random.normal(0.0, 5.0, 6).tolist()) for t in stamps if random.random() >= gaps
    ]


def replayed(samples, *, delay=0.0):
    e = estimator(
        twist_source="pose_difference", sensor=LoadCell(bias=(0.1,) * 6, mass=0.3, delay=delay)
    )
    answers = [answer for sample in samples if isinstance(answer := push(e, sample), Estimate)]
    e.finish()
    return answers, e.measurements(), e.counts


@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    wrench_period=st.sampled_from([2 * MS, 8 * MS]),
    gaps=st.sampled_from([0.0, 0.2]),
    delay=st.sampled_from([0.1, 5.0, 900.0]),
)
def test_arrival_shuffled_by_less_than_a_second_changes_no_estimate_flag_nor_measurement(
    seed, wrench_period, gaps, delay
):
    """The tool goes down for 3 s, from 100 mm above the grains; the cell is not tared, which sets a flag."""
    poses, readings = streams(seed, wrench_period, gaps, seconds=3, start=0.1)
    readings = [
        r._replace(wrench=(*r.wrench[:2], r.wrench[2] + 9.0, *r.wrench[3:])) for r in readings
    ]
    random = np.random.default_rng(seed + 1)

    def arrivals(samples):
        """Each topic keeps its own order, as a ROS publisher's messages do."""
        times = [s.stamp + random.uniform(0.0, delay * MS) for s in samples]
        return zip(np.maximum.accumulate(times), samples, strict=True)

    in_order = sorted([*readings, *poses], key=lambda s: s.stamp)
    shuffled = [
        s for _, s in sorted([*arrivals(poses), *arrivals(readings)], key=lambda row: row[0])
    ]
    expected, got = replayed(in_order), replayed(shuffled)
    assert got == expected
    answers, measurements, _ = got
    assert [m.stamp for m in measurements] == [a.stamp for a in answers]
    assert answers[-1].quality_flags & QualityFlag.DISAGREEMENT


def test_a_pose_within_max_input_age_finds_its_reading_among_any_number_of_later_samples():
    e = estimator(max_input_age=3.0)
    push(e, *(ramp(START + k * MS) for k in range(-1, 2000)), twist(), pose())
    assert e.measurements()[0].compensated[2] == 0.0


def test_a_force_in_the_air_is_an_issue_until_the_cell_is_tared_also_if_the_memory_is_switched_on():
    e, force = estimator(), (0.0, 0.0, 8.0, 0.0, 0.0, 0.0)
    for k in range(140):
        stamp = START + k * 10 * MS
        push(e, twist(stamp), wrench(stamp, force), pose(stamp, (0.0, 0.0, 0.5)))
    e.use(model=replace(e.model, law=replace(e.model.law, mobilization_length=0.003)))
    (issue,) = e.issues()
    for word in ("air", "~/tare", "sensor.bias", "sensor.mass"):
        assert word in issue
    use(e, sensor=replace(e.load_cell, bias=force))
    assert e.issues() == []
