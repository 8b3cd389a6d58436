"""A replay of a bag with clouds of points: the ground that it ends with, and the same bytes twice."""

import numpy as np
import pytest
from recordings import (
    CLOUD,
    STEP,
    TF,
    TOPICS,
    cdr,
    cloud_cdr,
    plunge,
    rows_of,
    transforms_cdr,
    values,
    write_messages,
)

from rft_ros.bags.replay import replay
from rft_ros.errors import InputError
from rft_ros.estimator import TransformSample
from rft_ros.ground import read_height_map

CELL = 0.004
AXIS = CELL * (np.arange(-20, 20) + 0.5)
X, Y = (v.ravel() for v in np.meshgrid(AXIS, AXIS))


def bag_with_clouds(path, *, tf=False):
    points = np.column_stack([X, Y, np.full(len(X), 0.004)])
    messages = []
    for k, (role, time, stamp, numbers) in enumerate(plunge()):
        if k % 150 == 0:
            messages.append((time, "/rft/surface_points", CLOUD, cloud_cdr(points, stamp=stamp)))
        if tf and role == "pose":
            place = TransformSample(stamp, "world", "tool", numbers[:3], numbers[3:])
            messages.append((time, "/tf", TF, transforms_cdr(place)))
        else:
            messages.append((time, *TOPICS[role], cdr(role, stamp, numbers)))
    return write_messages(path, messages)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return bag_with_clouds(tmp_path_factory.mktemp("ground") / "bag")


@pytest.fixture(scope="module")
def mapped(bag, tmp_path_factory):
    """The folder of a replay with a map of the ground."""
    folder = tmp_path_factory.mktemp("mapped")
    summary = replay(bag, folder, values(ground__cell=CELL), report=True)
    assert summary.messages["surface"] == 13
    return folder


def predicted(folder):
    return np.array([float(row["predicted_fz"] or "nan") for row in rows_of(folder)])


def test_a_replay_uses_the_clouds_and_writes_the_ground(bag, mapped, tmp_path):
    (tmp_path / "notes.txt").touch()
    replay(bag, tmp_path, values(ground__cell=CELL))
    for file in ("estimates.csv", "ground.csv", "summary.json"):
        assert (tmp_path / file).read_bytes() == (mapped / file).read_bytes()
    replay(bag, tmp_path, values())
    left = [
        "estimates",
        "estimates.csv",
        "notes.txt",
        "summary.json",
    ]  # nothing of the earlier replay
    assert sorted(path.name for path in tmp_path.iterdir()) == left
    ground = read_height_map(mapped / "ground.csv", CELL)
    np.testing.assert_allclose(ground.points()[:, 2], 0.004, atol=1e-6)
    early = 500_000_000 // STEP
    np.testing.assert_array_equal(predicted(tmp_path)[:early], predicted(mapped)[:early])
    assert np.nanmax(predicted(mapped)) > 1.1 * np.nanmax(predicted(tmp_path))
    assert "figure-tool" in (mapped / "report.html").read_text()
    with pytest.raises(InputError, match="does not exist"):
        replay(tmp_path / "gone", tmp_path, values())
    # nothing was lost for a mistyped name
    assert sorted(path.name for path in tmp_path.iterdir()) == left


def test_clouds_count_as_much_beside_poses_from_transforms(mapped, tmp_path):
    # which predicts as without
    given = values(ground__cell=CELL, pose_source="tf", learning__mode="observe")
    replay(bag_with_clouds(tmp_path / "bag", tf=True), tmp_path / "tf", given)
    posed, transformed = (p[~np.isnan(p)] for p in (predicted(mapped), predicted(tmp_path / "tf")))
    assert transformed == pytest.approx(posed, rel=1e-6, abs=1e-9)


def test_the_ground_of_one_replay_begins_the_next_and_is_not_overwritten(bag, mapped, tmp_path):
    before = (mapped / "ground.csv").read_bytes()
    again = values(ground__cell=CELL, ground__file=str(mapped / "ground.csv"))
    replay(bag, tmp_path / "again", again)
    assert (tmp_path / "again" / "ground.csv").read_bytes() == before
    with pytest.raises(InputError, match="would overwrite the input"):
        replay(bag, mapped, again)
    assert (mapped / "ground.csv").read_bytes() == before
    with pytest.raises(InputError, match=r"needs ground\.cell"):
        replay(bag, tmp_path / "a", values(ground__file="bed.csv"))
