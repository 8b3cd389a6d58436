"""A CSV table replays and calibrates as the bag with the same samples."""

import csv
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recordings import START, moments, plunge, rows_of, values, write_ros2
from refusals import assert_says, refusal

from rft_ros.bags.reading import opened_recording
from rft_ros.bags.replay import replay
from rft_ros.calibration.track import read_track
from rft_ros.cli import main
from rft_ros.rft import AXES, STATE, TWIST
from rft_ros.states_file import read_states
from rft_ros.sweeps.motions import circumnutation, sample

COLUMNS = ("t", *STATE, *AXES)
GROUPS = {"pose": COLUMNS[1:8], "twist": COLUMNS[8:14], "wrench": COLUMNS[14:]}


def write_table(
    file, rows, *, begin=0.0, roles=("pose", "twist", "wrench"), order=None, beside=()
):
    """The samples of a recording as a table whose first row is at t = `begin` [s]."""
    table = {}
    for role, _, stamp, numbers in rows:
        table.setdefault(stamp, {"t": repr(begin + (stamp - START) * 1e-9)}).update(
            zip(GROUPS[role], numbers, strict=True)
        )
    names = ["t", *(name for role in roles for name in GROUPS[role]), *beside]
    names = names if order is None else [names[k] for k in order(len(names))]
    with file.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, names, restval=7, extrasaction="ignore")
        writer.writeheader()
        writer.writerows(table.values())
    return file


@pytest.mark.parametrize("begin", [0.0, -3.5, 12.25])
@pytest.mark.parametrize("twists", [True, False])
def test_a_table_replays_as_the_bag_with_the_same_samples(tmp_path, begin, twists):
    roles = ("pose", "twist", "wrench") if twists else ("pose", "wrench")
    table = write_table(tmp_path / "trial.csv", plunge(), begin=begin, roles=roles)
    bag = write_ros2(tmp_path / "bag", plunge())
    same = {"twist_source": "topic" if twists else "pose_difference"}
    frames = {"world_frame": "lab", "sensor_frame": "cell"}  # a table names no frames
    of_table = replay(table, tmp_path / "a", values(**frames))
    of_bag = replay(bag, tmp_path / "b", values(**same))
    assert of_table.damage is None
    assert of_table.estimates == of_bag.estimates > 500
    assert of_table.wrench["force"] == of_bag.wrench["force"]
    for one, other in zip(rows_of(tmp_path / "a"), rows_of(tmp_path / "b"), strict=True):
        assert float(one["t"]) - begin == pytest.approx(float(other["t"]) - START * 1e-9, abs=1e-6)
        assert {**one, "t": ""} == {**other, "t": ""}


def test_a_table_calibrates_as_the_bag_with_the_same_samples(tmp_path):
    table = write_table(tmp_path / "trial.csv", plunge(), roles=("pose", "wrench"))
    bag = write_ros2(tmp_path / "bag", plunge())
    one, other = (
        read_track(table, values()),
        read_track(bag, values(twist_source="pose_difference")),
    )
    np.testing.assert_allclose(one.time, other.time, atol=1e-9)
    for name in ("states", "readings"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@settings(max_examples=25, deadline=None)
@given(st.randoms(use_true_random=False), st.sampled_from([(), ("note", "temperature")]))
def test_columns_may_have_any_order_and_others_beside_them(tmp_path_factory, random, beside):
    folder = tmp_path_factory.mktemp("tables")
    rows = list(plunge())[:90]
    tables = [
        write_table(folder / "a.csv", rows),
        write_table(
            folder / "b.csv", rows, order=lambda n: random.sample(range(n), n), beside=beside
        ),
    ]
    samples = []
    for table in tables:
        with opened_recording(table, values()) as recording:
            samples.append(list(recording))
    assert samples[0] == samples[1]
    assert len(samples[0]) == 90


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("t,px", "px"), "has no column t"),
        ((",vz", ""), "has no column vz; its first line must name vx,vy,vz,wx,wy,wz"),
        ((",fx,fy", ""), "has no column fx; its first line must name fx,fy,fz,tx,ty,tz"),
        ((",qw", ""), "has no column qw; its first line must name t,px"),
        (
            ("\n0.02,", "\n0.005,"),
            "line 4: t is 0.005; it must be a time [s] that does not go back",
        ),
        (("\n0.02,", "\nnan,"), "line 4: t is nan; it must be a time"),
        (("\n0.02,", "\n1e12,"), "line 4: t is 1e+12; it must be a time"),
        (("\n0.02,", "\nsoon,"), "line 4 is not 20 numbers"),
    ],
)
def test_what_is_wrong_in_a_table_is_named(tmp_path, change, words):
    table = write_table(tmp_path / "trial.csv", list(plunge())[:30])
    table.write_text(table.read_text().replace("\r\n", "\n").replace(*change))
    with_lines = [line.split(",") for line in table.read_text().splitlines()]
    if len(with_lines[0]) < 20:  # a column goes with its cells
        kept = [k for k, name in enumerate(COLUMNS) if name in with_lines[0]]
        text = "\n".join(",".join(line[k] for k in kept) for line in with_lines[1:])
        table.write_text(f"{','.join(with_lines[0])}\n{text}\n")
    said = refusal(opened, table)
    assert f"table '{table}'" in said
    assert words in said


def rewritten(table, change):
    """The table with `change` applied to the columns, each a list of numbers, and to their headings."""
    header, *lines = [line.split(",") for line in table.read_text().splitlines()]
    columns = dict(zip(header, np.array(lines, dtype=float).T, strict=True))
    changed = change(columns)
    np.savetxt(
        table,
        np.column_stack([*changed.values()]),
        delimiter=",",
        header=",".join(changed),
        comments="",
        fmt="%.17g",
    )
    return table


def in_millimetres(columns):
    return columns | {name: 1e3 * columns[name] for name in STATE[:3]}


READERS = {"table": lambda table: opened(table), "states": read_states}


@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("roles", [("pose",), ("pose", "twist")])
@pytest.mark.parametrize(
    ("hertz", "unit", "factor"),
    [(100, "ms", 1e3), (4000, "ms", 1e3), (100, "us", 1e6), (100, "ns", 1e9), (1, "s", 1.0)],
)
def test_times_in_another_unit_are_named_by_the_speed_of_the_poses(
    tmp_path, reader, roles, hertz, unit, factor
):
    """Slow logs in seconds are taken; a heading that says the unit is believed."""
    table = write_table(tmp_path / "trial.csv", list(plunge())[:600], roles=roles)

    slower = 100 / hertz
    finer = min(slower, 1.0)  # the same speed at a high rate, a slower tool at a low one

    def change(columns):
        places = {name: finer * columns[name] for name in STATE[:3]}
        moved = columns | places | {"t": factor * slower * columns["t"]}
        return moved | {n: finer / slower * columns[n] for n in ("vx", "vy", "vz") if n in columns}

    rewritten(table, change)
    if unit == "s":
        READERS[reader](table)
        return
    said = refusal(READERS[reader], table)
    assert_says(said, str(table), f"t looks like {unit} ", "mm/s", f"t [{unit}]", "t [s]")
    table.write_text(table.read_text().replace("t,", f"t [{unit}],", 1))
    READERS[reader](table)


@pytest.mark.parametrize("reader", READERS)
def test_positions_in_millimetres_are_named(tmp_path, reader):
    table = rewritten(write_table(tmp_path / "trial.csv", list(plunge())[:300]), in_millimetres)
    said = refusal(READERS[reader], table)
    assert_says(said, str(table), "look like mm", "m/s", "px [mm]", "px [m]")
    header, rest = table.read_text().split("\n", 1)
    for name in STATE[:3]:
        header = header.replace(name, f"{name} [mm]")
    table.write_text(f"{header}\n{rest}")
    READERS[reader](table)


@pytest.mark.parametrize("number", [np.nan, np.inf])
@pytest.mark.parametrize("rows", [slice(3, 4), slice(None)], ids=["one row", "every row"])
def test_a_velocity_that_is_no_number_is_named_by_predict_and_counted_by_replay(
    tmp_path, number, rows
):
    table = write_table(tmp_path / "trial.csv", list(plunge())[:300])

    def change(columns):
        columns["vz"][rows] = number
        return columns

    rewritten(table, change)
    assert_says(refusal(read_states, table), f"line {2 + (rows.start or 0)}:", "vz")
    counted = replay(table, tmp_path / "out", values()).reasons["twist_not_finite"]
    assert counted == len(range(100)[rows])


@pytest.mark.parametrize("reader", READERS)
def test_the_unit_of_time_is_named_beside_a_velocity_that_is_no_number(tmp_path, reader):
    table = write_table(tmp_path / "trial.csv", list(plunge())[:300])

    def change(columns):
        columns["vz"][3] = np.nan
        return columns | {"t": 1e3 * columns["t"]}

    said = refusal(READERS[reader], rewritten(table, change))
    assert_says(said, "t looks like ms ", "t [ms]")


def opened(table):
    with opened_recording(table, values()):
        pass


def test_the_command_takes_tables_with_a_tare_and_an_end(tmp_path):
    table = write_table(tmp_path / "trial.csv", moments(), roles=("pose", "wrench"))
    (tmp_path / "cell.yaml").write_text(
        "rft: {ros__parameters: {mesh.file: plate, pose_source: tf}}"
    )
    given = [
        "--params",
        tmp_path / "cell.yaml",
        "--tare",
        0.15,
        "--end",
        0.4,
        "-o",
        tmp_path / "out",
        "--no-report",
    ]
    assert main(["replay", str(table), *map(str, given)]) == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["messages"]["pose"] == 41
    assert summary["bias"][:3] == pytest.approx([1.0, 2.0, 3.0])


@pytest.mark.parametrize("twists", [True, False])
def test_the_doctor_examines_a_table_as_a_recording(tmp_path, capsys, twists):
    """The parameters name transforms and twists, and the table has poses, and velocities or none."""
    roles = ("pose", "twist", "wrench") if twists else ("pose", "wrench")
    table = write_table(tmp_path / "trial.csv", plunge(), roles=roles)
    (tmp_path / "cell.yaml").write_text(
        "rft: {ros__parameters: {mesh.file: plate, pose_source: tf}}"
    )
    main(["doctor", str(tmp_path / "cell.yaml"), "--bag", str(table)])
    said = capsys.readouterr().out
    assert "OK  pose: 100 Hz" in said
    assert "measured and predicted force" in said
    assert "missing" not in said and "nothing on" not in said


@settings(max_examples=20, deadline=None)
@given(st.floats(3.0, 40.0), st.floats(-60.0, 60.0), st.integers(100, 400), st.floats(-1e3, 1e3))
def test_states_without_velocities_have_those_of_their_poses(
    tmp_path_factory, tilt, rate, count, begin
):
    file = tmp_path_factory.mktemp("states") / "poses.csv"
    times, states = sample(
        circumnutation(tilt_deg=tilt, rate_deg_s=rate if abs(rate) > 1.0 else 1.0), count
    )
    times = 0.01 * np.arange(count)
    states = circumnutation(tilt_deg=tilt, rate_deg_s=rate if abs(rate) > 1.0 else 1.0).at(times)
    table = np.column_stack([times + begin, states[:, :7]])
    np.savetxt(
        file, table, delimiter=",", header=",".join(("t", *STATE[:7])), comments="", fmt="%.17g"
    )
    _, found = read_states(file)
    np.testing.assert_array_equal(found[:, :3], states[:, :3])
    np.testing.assert_allclose(found[3:, TWIST], states[3:, TWIST], atol=2e-4)


def test_states_without_velocities_need_three_poses_in_order(tmp_path):
    header, row = "t,px,py,pz,qx,qy,qz,qw", ",0,0,-0.01,0,0,0,1"
    for times, words in (
        ((0, 1), "line 2: velocities need 3 poses"),
        ((0, 2, 1), "line 4: t is 1 after 2"),
    ):
        (tmp_path / "poses.csv").write_text("\n".join([header, *(f"{t}{row}" for t in times)]))
        assert words in refusal(read_states, tmp_path / "poses.csv")
