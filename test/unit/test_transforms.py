"""Where one frame is in another at a stamp: chains, gaps, jumps, two parents, loops, and what is not known."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_plate import MS, SECOND, START, estimator, pose, push, twist, use, wrench
from scipy.spatial.transform import Rotation

from rft_ros.estimator import Estimate, Reason, TransformSample
from rft_ros.estimator.transforms import Transforms
from rft_ros.parameters import LoadCell
from rft_ros.rft.frames import Placement

AGE = 100 * MS
numbers = st.floats(-2.0, 2.0)
places = st.tuples(numbers, numbers, numbers)
turns = st.tuples(numbers, numbers, numbers).map(
    lambda v: tuple(Rotation.from_rotvec(v).as_quat().tolist())
)
STILL = (0.0, 0.0, 0.0, 1.0)


def fixed(parent, child, position=(0.0, 0.0, 0.0), quaternion=STILL):
    return TransformSample(0, parent, child, position, quaternion, True)


def moving(stamp, parent, child, position=(0.0, 0.0, 0.0), quaternion=STILL):
    return TransformSample(stamp, parent, child, position, quaternion)


def tree(*samples):
    transforms = Transforms()
    assert [transforms.push(s) for s in samples] == [None] * len(samples)
    return transforms


def matrix(placement):
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = (
        Rotation.from_quat(placement.quaternion).as_matrix(),
        placement.position,
    )
    return out


@given(p=st.tuples(places, places, places, places), q=st.tuples(turns, turns, turns, turns))
def test_a_chain_of_fixed_and_moving_frames_is_the_product_of_its_matrices(p, q):
    """world <- base <- flange -> tool, and from flange to sensor."""
    transforms = tree(
        fixed("world", "base", p[0], q[0]),
        moving(START, "base", "flange", p[1], q[1]),
        fixed("flange", "tool", p[2], q[2]),
        fixed("flange", "sensor", p[3], q[3]),
    )
    base, flange, tool, sensor = (matrix(Placement(*pq)) for pq in zip(p, q, strict=True))
    np.testing.assert_allclose(
        matrix(transforms.at("world", "tool", START, AGE)), base @ flange @ tool, atol=1e-12
    )
    between = np.linalg.inv(tool) @ sensor
    np.testing.assert_allclose(matrix(transforms.fixed("tool", "sensor")), between, atol=1e-12)
    np.testing.assert_allclose(
        matrix(transforms.at("sensor", "tool", START, AGE)), np.linalg.inv(between), atol=1e-12
    )
    assert transforms.at("tool", "tool", START, AGE) == Placement((0.0, 0.0, 0.0), STILL)


@given(share=st.floats(0.0, 1.0), spin=places, flip=st.booleans())
def test_between_two_stamps_a_frame_moves_and_turns_evenly(share, spin, flip):
    """Also where a driver flips the sign of a quaternion."""
    angle = np.linalg.norm(spin)
    end = Rotation.from_rotvec(np.array(spin) * min(1.0, 3.0 / max(angle, 1e-9)))
    q = tuple((-1 if flip else 1) * c for c in end.as_quat().tolist())
    transforms = tree(
        moving(START, "world", "tool"),
        moving(START + 10 * MS, "world", "tool", (0.1, -0.2, 0.3), q),
    )
    stamp = START + round(share * 10 * MS)
    found = transforms.at("world", "tool", stamp, AGE)
    exact = (stamp - START) / (10 * MS)
    assert found.position == pytest.approx((0.1 * exact, -0.2 * exact, 0.3 * exact), abs=1e-12)
    turned = Rotation.from_rotvec(end.as_rotvec() * exact)
    assert (Rotation.from_quat(found.quaternion) * turned.inv()).magnitude() < 1e-7


names = st.sampled_from(["world", "base", "flange", "tool", ""])
any_transform = st.builds(
    TransformSample,
    stamp=st.sampled_from(
        [0, START, START + MS, START + 20 * MS, START - 2 * SECOND, START + 3 * SECOND]
    ),
    parent=names,
    child=names,
    position=st.tuples(numbers, numbers, st.sampled_from([0.0, math.nan])),
    quaternion=st.sampled_from([STILL, (0.0, 0.0, 0.0, 0.0)]),
    fixed=st.booleans(),
)


@given(st.lists(any_transform, max_size=25), st.booleans())
def test_any_transforms_in_any_order_leave_a_tree_that_answers(samples, kept):
    transforms = Transforms()
    if kept:
        transforms.keep("world", "tool")
    for sample in samples:
        transforms.push(sample)
        for stamp in (START, START + 10 * MS):
            found = transforms.at("world", "tool", stamp, AGE)
            assert isinstance(found, Reason) or all(map(math.isfinite, found.position))
        known = transforms.newest("world", "tool")
        if known is not None and transforms.unlinked("tool_frame", "tool", "world") is None:
            assert transforms.at("world", "tool", known, AGE) is not Reason.TF_FRAME_UNKNOWN
        transforms.fixed("tool", "flange")
        assert "there are" in (transforms.unlinked("tool_frame", "tool", "world") or "there are")


REFUSED = {
    "NaN": (Reason.TF_INVALID, fixed("world", "tool", (math.nan, 0.0, 0.0))),
    "quaternion of zeros": (
        Reason.TF_INVALID,
        fixed("world", "tool", quaternion=(0.0, 0.0, 0.0, 0.0)),
    ),
    "no stamp": (Reason.TF_INVALID, moving(0, "world", "tool")),
    "no name": (Reason.TF_INVALID, fixed("", "tool")),
    "its own parent": (Reason.TF_LOOP, fixed("tool", "tool")),
    "a loop of three": (Reason.TF_LOOP, fixed("sensor", "world")),
    "another parent at the same stamp": (Reason.TF_TWO_PARENTS, moving(START, "camera", "flange")),
    "an older stamp": (Reason.TF_OUT_OF_ORDER, moving(START - 1, "world", "flange")),
    "the same stamp": (Reason.TF_OUT_OF_ORDER, moving(START, "world", "flange")),
}


@pytest.mark.parametrize("what", REFUSED)
def test_a_bad_transform_is_refused_with_its_reason_counted_and_named_and_changes_nothing(what):
    e = estimator()
    push(e, moving(START, "world", "flange"), fixed("flange", "sensor"))
    before = e.transforms.at("world", "sensor", START, AGE)
    reason, sample = REFUSED[what]
    assert push(e, sample) is reason
    assert e.counts == {reason: 1}
    assert e.transforms.at("world", "sensor", START, AGE) == before
    assert e.unknown_frames()[reason.value].startswith(f"{sample.child!r}")
    assert f" in {sample.parent!r}" in e.unknown_frames()[reason.value]


def test_another_parent_is_taken_with_a_warning_as_tf2_does_and_decides_from_its_stamp_on():
    e = estimator(tool_frame="flange")
    for stamp, parent, x in (
        (START, "world", 0.0),
        (START + 10 * MS, "camera", 1.0),
        (START + 20 * MS, "world", 2.0),
    ):
        push(e, moving(stamp, parent, "flange", (x, 0.0, 0.0)))
    push(e, fixed("world", "camera", (0.0, 5.0, 0.0)))
    assert e.counts == {"tf_two_parents": 2}
    assert e.unknown_frames()["tf_two_parents"].startswith(
        "'flange' in 'world': before in 'camera'; "
    )
    places = [
        e.transforms.at("world", "flange", START + k * 5 * MS, AGE).position for k in range(5)
    ]
    assert places == [
        (0.0, 0.0, 0.0),
        (0.0, 0.0, 0.0),
        (1.0, 5.0, 0.0),
        (1.0, 5.0, 0.0),
        (2.0, 0.0, 0.0),
    ]
    push(e, fixed("camera", "flange", (3.0, 0.0, 0.0)))  # the mount was measured anew
    assert e.transforms.fixed("world", "flange").position == (3.0, 5.0, 0.0)


def test_what_came_before_the_transform_that_links_tool_and_world_is_kept():
    transforms = Transforms()
    transforms.keep("world", "tool")
    for k in range(1000):
        transforms.push(moving(START + k * MS, "world", "joint"))
        if k == 100:
            transforms.push(fixed("joint", "tool"))
    assert isinstance(transforms.at("world", "tool", START, AGE), Placement)


def test_a_missing_frame_is_named_with_the_frames_that_there_are():
    """It counts once the load cell is a second ahead."""
    e, poses = fed(
        fixed("world", "base"),
        fixed("base", "flange"),
        *(wrench(START + k * SECOND) for k in range(4)),
    )
    assert (poses, e.counts) == ([], {"tf_frame_unknown": 2})
    there = "there are 'base' in 'world' (fixed), 'flange' in 'base' (fixed)"
    assert e.unknown_frames()["tf_frame_unknown"].startswith(
        f"no transform names tool_frame 'tool'; {there}; "
    )
    push(e, fixed("flange", "tool"))
    assert e.unknown_frames() == {}


def test_a_missing_frame_is_named_without_a_load_cell_too_and_poses_come_once_it_is_linked():
    others = [
        moving(START + k * 10 * MS, "world", "flange", (0.0, 0.0, -0.001 * k)) for k in range(400)
    ]
    e, poses = fed(*others[:300], tf_rate=50.0)
    assert (poses, set(e.counts)) == ([], {"tf_frame_unknown"})
    assert e.unknown_frames()["tf_frame_unknown"].startswith(
        "no transform names tool_frame 'tool'; there are "
    )
    push(e, fixed("flange", "tool"))
    late = [place.stamp for sample in others[300:] for place, _ in e.answers((sample,))]
    assert late[-40:] == [START + k * 20 * MS for k in range(160, 200)]
    assert e.unknown_frames() == {}


def test_streams_of_other_frames_neither_make_poses_nor_drop_frames_whatever_their_stamps():
    """An older clock of frames that lead nowhere; then with a tool that is fixed in the world."""
    robot = [moving(START + k * 10 * MS, "world", "flange") for k in range(300)]
    other = [moving(START - 3 * SECOND + k * 10 * MS, "map", "odom") for k in range(300)]
    mixed = [sample for pair in zip(robot, other, strict=True) for sample in pair]
    e, poses = fed(*mixed, tf_rate=50.0)
    assert (poses, set(e.counts)) == ([], {"tf_frame_unknown"})
    assert len(e.transforms.frames()) == 2
    e, poses = fed(fixed("world", "tool"), *mixed, tf_rate=50.0)
    assert (poses, dict(e.counts)) == ([], {})


def test_what_is_not_known_at_a_stamp_has_a_reason():
    transforms = tree(*(moving(START + k * MS, "world", "tool") for k in (0, 50, 1000)))
    for after, found in (
        (-1, Reason.TF_MISSING),
        (SECOND + 1, Reason.TF_STALE),
        (500 * MS, Reason.TF_GAP),
    ):
        assert transforms.at("world", "tool", START + after, AGE) is found
    assert transforms.at("world", "camera", START, AGE) is Reason.TF_FRAME_UNKNOWN
    assert isinstance(transforms.at("world", "tool", START + 50 * MS, AGE), Placement)
    assert transforms.fixed("world", "tool") is None


def fed(*samples, **values):
    """An estimator and the poses that follow from samples in this order. They have no twist, which is not counted."""
    e, poses = estimator(pose_source="tf", **values), []
    for sample in samples:
        sample = (sample,) if isinstance(sample, TransformSample) else sample
        for place, answer in e.answers(sample):
            poses.append(place)
            e.counts[answer.reason] -= 1
    for reason in [reason for reason, n in e.counts.items() if n == 0]:
        del e.counts[reason]
    return e, poses


def in_order(*streams):
    return sorted(
        (sample for stream in streams for sample in stream), key=lambda sample: sample.stamp
    )


def descent(*, step=10 * MS, count=20):
    return [
        moving(START + k * step, "world", "tool", (0.0, 0.0, -0.001 * k)) for k in range(count)
    ]


def test_poses_come_at_the_load_cells_stamps_once_transforms_lie_on_both_sides():
    cell = [wrench(START + k * 7 * MS) for k in range(20)]
    e, poses = fed(*in_order(descent(), cell))
    assert [p.stamp for p in poses] == [w.stamp for w in cell]
    assert [p.position[2] for p in poses] == pytest.approx([-0.0007 * k for k in range(20)])
    assert not e.counts
    late = moving(START + 1250 * MS, "world", "tool")
    _, poses = fed(
        *descent(), wrench(START + 200 * MS), twist(START + 1300 * MS), late, max_input_age=2.0
    )
    assert len(poses) == 1, (
        "a twist says nothing about transforms that are late, and the node does not ask after one"
    )


@given(st.permutations(range(3)), st.integers(0, 400))
def test_the_order_of_arrival_does_not_change_the_poses(order, late):
    """The load cell, the arm and the tool changer, each in its own order, and late by up to 0.4 s."""
    arm = [
        moving(START + k * 10 * MS, "world", "flange", (0.0, 0.0, -0.001 * k)) for k in range(40)
    ]
    changer = [
        moving(START + k * 10 * MS + 3, "flange", "tool", (0.001 * k, 0.0, 0.0)) for k in range(40)
    ]
    cell = [wrench(START + k * 7 * MS + 5) for k in range(40)]
    streams = [arm, changer, cell]
    arrivals = [
        (s.stamp + order[k] * late * MS, k, s) for k, stream in enumerate(streams) for s in stream
    ]
    _, poses = fed(*(s for _, _, s in sorted(arrivals, key=lambda a: a[:2])))
    _, prompt = fed(*in_order(*streams))
    assert poses == prompt
    assert len(poses) == 40


def test_after_a_reset_the_tool_is_not_where_it_was_in_the_run_before():
    reset = [wrench(START + k * 10 * MS + 1) for k in range(5)]
    again = [moving(START + k * 10 * MS, "world", "tool", (0.5, 0.0, 0.0)) for k in range(20)]
    _, poses = fed(*descent(count=200), wrench(START + 1900 * MS), *reset, *again)
    assert {p.position[0] for p in poses if p.stamp < START + SECOND} == {0.5}


def test_at_tf_rate_poses_come_without_a_load_cell_and_a_reset_by_just_a_time_jump_loses_none():
    back = [
        moving(START + 1990 * MS - 1004 * MS + k * 10 * MS, "world", "tool", (0.5, 0.0, 0.0))
        for k in range(50)
    ]
    _, poses = fed(*descent(count=200), *back, tf_rate=50.0)
    first, again = ([p.stamp for p in poses if p.position[0] == x] for x in (0.0, 0.5))
    assert first == [START + k * 20 * MS for k in range(100)]
    assert again == [START + k * 20 * MS for k in range(50, 74)]
    assert fed(*descent(), tf_rate=1e-300)[1] == []


def test_a_gap_and_an_end_of_the_transforms_are_counted_and_lose_no_other_pose():
    samples = descent()
    samples = [s for s in samples if not START + 20 * MS < s.stamp < START + 150 * MS]
    cell = [wrench(START + k * 10 * MS + 1) for k in range(140)]
    e, poses = fed(*in_order(samples, cell))
    assert e.counts == {"tf_gap": 6, "tf_stale": 20}
    assert [p.stamp for p in poses] == [w.stamp for w in (*cell[:2], *cell[5:12], *cell[15:19])]


def test_samples_in_frames_with_fixed_links_are_transformed_and_in_a_moving_frame_refused():
    """As if each had come in the frame that the node expects."""
    q = tuple(Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_quat().tolist())
    base, cell, flange = (
        Placement((0.3, 0.2, 0.1), q),
        Placement((0.0, 0.01, 0.02), q),
        Placement((0.0, 0.0, 0.1), q),
    )
    plain, linked = estimator(), estimator()
    for parent, child, p in (
        ("world", "base", base),
        ("ft_sensor", "cell", cell),
        ("tool", "flange", flange),
    ):
        push(linked, fixed(parent, child, *p))
    inner = Placement((0.01, -0.02, -0.01), STILL)
    load = (1.0, 2.0, 3.0, 0.1, 0.2, 0.3)
    placed = base.of(inner)
    for stamp in (START, START + MS):
        load_there, motion_there = (
            wrench(stamp, cell.wrench(load)),
            flange.rotate((0.0, 0.01, -0.02)),
        )
        a = push(plain, load_there, twist(stamp, motion_there, frame="tool"), pose(stamp, *placed))
        in_links = (
            twist(stamp, (0.0, 0.01, -0.02), frame="flange"),
            pose(stamp, *inner, frame="base"),
        )
        b = push(linked, wrench(stamp, load, frame="cell"), *in_links)
        assert isinstance(b, Estimate)
        assert b.predicted == pytest.approx(a.predicted, rel=1e-12, abs=1e-12)
    assert np.array(linked.measurements()[0].residual) == pytest.approx(
        plain.measurements()[0].residual, abs=1e-12
    )
    push(linked, moving(START, "world", "moving"))
    assert push(linked, pose(START + 2 * MS, frame="moving")).reason is Reason.POSE_FRAME_UNKNOWN


def test_the_sensors_place_comes_from_fixed_transforms_and_until_then_there_is_no_estimate():
    place = Placement(
        (0.01, 0.02, -0.1), tuple(Rotation.from_euler("x", 30, degrees=True).as_quat().tolist())
    )
    known = estimator(sensor=LoadCell(position=place.position, quaternion=place.quaternion))
    e = estimator(sensor_frame_source="tf")
    push(known, twist())
    assert push(e, twist(), pose()).reason is Reason.SENSOR_FRAME_UNKNOWN
    assert "sensor_frame_unknown" in e.unknown_frames()
    e.use(config=known.config)
    assert e.unknown_frames() == {}  # this config does not need it
    use(e, sensor_frame_source="tf")
    answer = push(e, fixed("tool", "ft_sensor", *place), pose(START + MS))
    assert answer.predicted == push(known, pose(START + MS)).predicted
    # poses before the transform are part of the window of velocities all the same
    e = estimator(sensor_frame_source="tf", twist_source="pose_difference")
    push(e, *(pose(START + k * MS) for k in range(2)), fixed("tool", "ft_sensor", *place))
    assert push(e, pose(START + 2 * MS, (0.0, 0.0, -0.011))).speed_bound > 0.0
