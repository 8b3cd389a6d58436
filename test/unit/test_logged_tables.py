"""Tables that other programs write give the samples of the bag that was recorded beside them."""

import csv

import numpy as np
import pytest
from recordings import START, plunge, rows_of, values, write_ros2
from refusals import assert_says, refusal
from scipy.spatial.transform import Rotation

from rft_ros.bags.options import ReplayOptions
from rft_ros.bags.reading import opened_recording
from rft_ros.cli import main
from rft_ros.errors import InputError
from rft_ros.rft import AXES, STATE
from rft_ros.states_file import read_states

POSE = STATE[:7]
FIELDS = {
    "pose": [f"pose/position/{axis}" for axis in "xyz"]
    + [f"pose/orientation/{axis}" for axis in "xyzw"],
    "wrench": [f"wrench/force/{axis}" for axis in "xyz"]
    + [f"wrench/torque/{axis}" for axis in "xyz"],
}


def samples(table, columns="", remap=()):
    options = ReplayOptions(columns=columns, remap=remap)
    with opened_recording(table, values(), options) as recording:
        return list(recording)


def of_bag(tmp_path, rows):
    with opened_recording(write_ros2(tmp_path / "bag", rows), values()) as recording:
        return [sample for sample in recording if type(sample).__name__ != "TwistSample"]


def numbers_of(sample):
    return [list(field) for field in sample[2:]]


def write_plotjuggler(file, rows, topics):
    """Each message on a line of its own, with blank cells for the other topics."""
    headings = [f"{topic}/{field}" for role, topic in topics for field in FIELDS[role]]
    with file.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, ["__time", *headings, "/rosout/level"], restval="")
        writer.writeheader()
        for role, _, stamp, numbers in rows:
            for other, topic in topics:
                if other == role:
                    fields = [f"{topic}/{field}" for field in FIELDS[role]]
                    writer.writerow(
                        {"__time": repr(stamp * 1e-9), **dict(zip(fields, numbers, strict=True))}
                    )
    return file


def write_columns(file, headings, numbers, separator=","):
    lines = [
        separator.join(headings),
        *(separator.join(map(repr, row)) for row in numbers.tolist()),
    ]
    file.write_text("\n".join(lines) + "\n")
    return file


def test_a_table_of_plotjuggler_gives_the_samples_of_its_bag(tmp_path):
    rows = [row for row in plunge() if row[0] != "twist"][:200]
    topics = [("pose", "/tcp/pose"), ("wrench", "/ft/wrench")]
    table = samples(write_plotjuggler(tmp_path / "plot.csv", rows, topics))
    bag = of_bag(tmp_path, rows)
    assert len(table) == len(bag) == 200
    for one, other in zip(table, bag, strict=True):
        assert type(one) is type(other)
        assert one.stamp == pytest.approx(
            other.stamp, abs=1000
        )  # float64 has 0.2 us left at 1.7e9 s
        assert numbers_of(one) == numbers_of(other)


def test_a_remap_chooses_among_topics_of_one_type_and_without_one_they_are_named(tmp_path):
    rows = [row for row in plunge() if row[0] != "twist"][:60]
    topics = [("pose", "/tcp"), ("wrench", "/ft/raw"), ("wrench", "/ft/filtered")]
    table = write_plotjuggler(tmp_path / "plot.csv", rows, topics)
    said = refusal(samples, table)
    assert_says(
        said,
        "several topics of a wrench: /ft/raw, /ft/filtered",
        "--remap ~/wrench_measured:=/ft/raw",
    )
    assert samples(table, remap=["~/wrench_measured:=/ft/filtered"])


def test_rows_without_a_pose_are_no_states(tmp_path):
    rows = [row for row in plunge() if row[0] != "twist"][:200]
    table = write_plotjuggler(tmp_path / "plot.csv", rows, [("pose", "/tcp"), ("wrench", "/ft")])
    times, states = read_states(table)
    poses = [row for row in rows if row[0] == "pose"]
    assert len(times) == len(poses)
    np.testing.assert_allclose(states[:, :7], [numbers for *_, numbers in poses])


@pytest.fixture
def motion():
    """Times [s], shape [n], and poses [n, 7] of a tool that sinks and turns."""
    t = np.linspace(0.0, 1.0, 101)
    turns = Rotation.from_rotvec(np.outer(t, (0.3, -0.2, 1.0)))
    places = np.column_stack([0.01 * t, 0.02 * t, -0.03 * t])
    return t, np.hstack([places, turns.as_quat()])


def as_rotation_vectors(poses):
    return np.hstack([poses[:, :3], Rotation.from_quat(poses[:, 3:]).as_rotvec()])


def test_a_log_of_rtde_is_read_by_its_numbered_columns(tmp_path, motion):
    t, poses = motion
    headings = ["timestamp", *(f"actual_TCP_pose_{k}" for k in range(6))]
    numbers = np.column_stack([t, as_rotation_vectors(poses)])
    file = write_columns(tmp_path / "rtde.csv", headings, numbers, " ")
    times, states = read_states(file, {"t": "timestamp", "pose": "actual_TCP_pose"})
    np.testing.assert_array_equal(times, t)
    np.testing.assert_allclose(states[:, :7], poses, atol=1e-12)


def test_a_log_of_franka_is_read_by_its_matrices(tmp_path, motion):
    t, poses = motion
    matrices = np.tile(np.eye(4), (len(t), 1, 1))
    matrices[:, :3, :3] = Rotation.from_quat(poses[:, 3:]).as_matrix()
    matrices[:, :3, 3] = poses[:, :3]
    headings = ["time [ms]", *(f"O_T_EE[{k}]" for k in range(16))]
    by_columns = np.swapaxes(matrices, 1, 2).reshape(-1, 16)
    file = write_columns(tmp_path / "franka.csv", headings, np.column_stack([1e3 * t, by_columns]))
    times, states = read_states(file, {"t [ms]": "time [ms]", "matrix": "O_T_EE"})
    np.testing.assert_allclose(times, t)
    np.testing.assert_allclose(states[:, :7], poses, atol=1e-12)


@pytest.mark.parametrize(("command", "output"), [("predict", "out.csv"), ("view", "out.html")])
def test_single_columns_are_mapped_with_their_unit(tmp_path, motion, command, output):
    t, poses = motion
    headings = ["clock", "x_mm", "y_mm", "z_mm", *POSE[3:]]
    scaled = np.column_stack([t, 1e3 * poses[:, :3], poses[:, 3:]])
    file = write_columns(tmp_path / "log.csv", headings, scaled)
    out = tmp_path / output
    columns = "t=clock,px [mm]=x_mm,py [mm]=y_mm,pz [mm]=z_mm"
    arguments = [command, str(file), "--columns", columns, "--mesh", "sphere", "-o", str(out)]
    assert main(arguments) == 0
    if command == "predict":
        assert len(out.read_text().splitlines()) == len(t) + 1


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ("t", ("'t'", "NAME=HEADING")),
        ("time=t", ("time is none of t, px to qw",)),
        ("t=clock", ("no single column 'clock' for t", "its first line has")),
        ("pose=TCP", ("0 numbered columns 'TCP' for pose; it needs 6 or 7",)),
    ],
)
def test_a_mapping_that_cannot_be_used_is_named(tmp_path, motion, columns, words):
    t, poses = motion
    file = write_columns(tmp_path / "log.csv", ["t", *POSE], np.column_stack([t, poses]))
    assert_says(refusal(samples, file, columns), *words)


def test_times_with_too_few_digits_are_named(tmp_path):
    t = np.array([f"{1.7e9 + 0.01 * k:.5e}" for k in range(50)], dtype=float)
    poses = np.zeros((50, 7))
    poses[:, 2] = -1e-4 * np.arange(50)
    poses[:, 6] = 1.0
    file = write_columns(tmp_path / "six.csv", ["t", *POSE], np.column_stack([t, poses]))
    assert_says(
        refusal(samples, file), "t is 1700000000 again in line 3", "write t with more digits"
    )


def test_the_mapping_may_stand_in_the_parameter_file(tmp_path):
    with pytest.raises(InputError, match="columns"):
        ReplayOptions(columns="clock")
    rows = [row for row in plunge() if row[0] != "twist"]
    table = {}
    for role, _, stamp, numbers in rows:
        table.setdefault(stamp, {})[role] = numbers
    both = [
        (1e-9 * (s - START), *r["pose"], *r["wrench"]) for s, r in table.items() if len(r) == 2
    ]
    file = write_columns(tmp_path / "log.csv", ["stamp", *POSE, *AXES], np.array(both))
    cell = tmp_path / "cell.yaml"
    cell.write_text(
        "/**:\n  ros__parameters:\n    mesh.file: plate\nrft_replay:\n  ros__parameters:\n    columns: t=stamp\n"
    )
    assert main(["replay", str(file), "--params", str(cell), "-o", str(tmp_path / "out")]) == 0
    assert len(rows_of(tmp_path / "out")) == len(both)
