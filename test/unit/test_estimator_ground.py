"""Points of the ground in the estimator: when they count, what they change, and what refuses them."""

from dataclasses import replace

import numpy as np
import pytest
from one_plate import MS, SECOND, START, estimator, plate_model, pose, push, twist
from scipy.spatial.transform import Rotation

from rft_ros.estimator import Estimate, Reason, TransformSample
from rft_ros.ground import CLOUD_DELAY_NS, Cloud, HeightMap

CELL = 0.004
AXIS = CELL * (np.arange(-30, 30) + 0.5)
X, Y = (v.ravel() for v in np.meshgrid(AXIS, AXIS, indexing="ij"))


def cloud(stamp, height=0.0, frame="world"):
    return Cloud(
        stamp, frame, X, Y, np.broadcast_to(np.asarray(height, dtype=np.float64), X.shape)
    )


def on_map():
    return estimator(model=replace(plate_model(), ground=HeightMap.unknown(CELL)))


def forces(e, clouds=(), *, until=120, late=0):
    """fz at 10 ms steps of a plate that is pushed down 1 cm deep; each cloud arrives `late` steps after its stamp."""
    waiting = sorted(clouds)
    found = []
    for k in range(until):
        stamp = START + 10 * k * MS
        while waiting and waiting[0].stamp + 10 * late * MS <= stamp:
            assert push(e, waiting.pop(0)) is None
        answer = push(e, twist(stamp), pose(stamp))
        assert isinstance(answer, Estimate)
        found.append(answer.predicted[2])
    return found


def test_a_map_that_knows_nothing_gives_the_bytes_of_the_level_plane():
    assert forces(on_map()) == forces(estimator())


def test_a_cloud_counts_from_half_a_second_after_its_stamp_until_the_ground_is_levelled():
    e = on_map()
    found = forces(e, [cloud(START + 100 * MS, 0.005)])
    changed = (100 * MS + CLOUD_DELAY_NS) // (10 * MS)
    assert found[:changed] == [found[0]] * changed
    assert found[changed] == pytest.approx(1.5 * found[0], rel=1e-5)
    assert (e.depth(), e.surface.depth) == pytest.approx((0.015, 0.015), abs=1e-6)
    assert e.level_ground()
    assert push(e, twist(START + 2 * SECOND), pose(START + 2 * SECOND)).predicted[2] == found[0]


def test_a_doubt_about_the_file_of_the_map_is_an_issue_until_a_cloud_changes_the_map():
    doubtful = HeightMap(cell=CELL, corner=(0, 0), heights=[[0.0]], issue="sparse")
    e = estimator(model=replace(plate_model(), ground=doubtful))
    assert e.issues() == ["sparse"]
    forces(e, [cloud(START)])
    assert e.issues() == []


def test_when_a_cloud_arrives_changes_no_byte():
    clouds = [cloud(START + 200 * k * MS, 0.001 * k) for k in range(1, 4)]
    assert forces(on_map(), clouds, late=37) == forces(on_map(), clouds)


def test_a_cloud_in_the_frame_of_a_fixed_camera_is_as_one_in_the_world():
    turn = Rotation.from_euler("xyz", [3.0, 0.1, -0.5])
    place = np.array([0.3, -0.2, 0.8])
    bed = np.column_stack([X, Y, 0.005 + 0.1 * X])
    seen = [*turn.inv().apply(bed - place).T]
    seen[2][7], seen[0][9] = np.inf, np.nan  # a depth camera sends such points, too
    e = on_map()
    push(e, TransformSample(0, "world", "optical", (*place,), (*turn.as_quat(),), fixed=True))
    found = forces(e, [Cloud(START, "optical", *seen)])
    assert found == pytest.approx(forces(on_map(), [cloud(START, bed[:, 2])]), rel=1e-6)


@pytest.mark.parametrize(
    ("sent", "reason"),
    [
        (cloud(0), Reason.SURFACE_STAMP_ZERO),
        (cloud(START, frame="camera"), Reason.SURFACE_FRAME_UNKNOWN),
        (cloud(START, frame="moving"), Reason.SURFACE_FRAME_UNKNOWN),
        (cloud(START - CLOUD_DELAY_NS), Reason.SURFACE_LATE),
    ],
)
def test_a_cloud_that_cannot_be_used_is_counted_and_changes_nothing(sent, reason):
    e = on_map()
    push(e, TransformSample(START, "world", "moving", (0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 0.0)))
    before = forces(e, until=1), e.ground
    assert push(e, sent) is reason
    assert e.counts[reason] == 1
    later = push(e, twist(START + SECOND), pose(START + SECOND))
    assert ([later.predicted[2]], e.ground) == before


def test_clouds_out_of_order_too_often_or_without_a_map_are_counted():
    e, without = on_map(), estimator()
    for after, reason in (
        (100, None),
        (110, Reason.SURFACE_RATE_LIMITED),
        (90, Reason.SURFACE_OUT_OF_ORDER),
    ):
        assert push(e, cloud(START + after * MS)) is reason
    assert push(without, cloud(START)) is Reason.SURFACE_OFF
    assert not without.level_ground()


def test_a_cloud_with_a_stamp_in_the_future_does_not_hold_up_later_ones():
    e = on_map()
    assert push(e, cloud(START + 1000 * SECOND, 0.02)) is None
    assert forces(e, [cloud(START + 100 * MS, 0.005)])[-1] == pytest.approx(6.0, rel=0.01)
    assert isinstance(push(e, twist(START - 10 * SECOND), pose(START - 10 * SECOND)), Estimate)
    assert push(e, cloud(START - 10 * SECOND + MS)) is None
