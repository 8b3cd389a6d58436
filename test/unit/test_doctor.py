"""`rft doctor` finds what is wrong with a cell's set-up, and finds nothing wrong with a good one."""

import pytest
import trimesh
from recordings import TOPICS, plunge, write_ros2

from rft_ros.cli import main

GOOD = {"surface_height": 0.0, "medium.zeta": 0.5}
FAULTS = {
    "wrong frame": ({}, {"frame": "camera"}, "FIX frames: pose frame_id 'camera' is not world_frame 'world'"),
    "wrong sign": ({}, {"force": -1.0}, "FIX sign: pushed down, the tool is pulled down; set sensor.sign: -1"),
    "mesh in metres": ({"mesh.file": "metres"}, {}, "FIX mesh metres: 0.06 x 0.04 x 0.005 mm: "),
    "no twist": ({}, {"without": "twist"}, "FIX twist: nothing on /rft/twist; set twist_source: pose_difference"),
    "old stamps": ({}, {"age": 3_000_000_000}, "FIX pose: stamps on /rft/pose are 3 s old when they arrive"),
    "no surface height": ({"surface_height": None}, {}, "FIX surface_height is not set and counts as 0.0"),
    "not tared": ({}, {"bias": 2.0}, "FIX load cell: it reads 2.00 N in the air; call ~/tare"),
    "no load cell": ({}, {"without": "wrench"}, "FIX wrench: nothing on /rft/wrench_measured; start the load cell"),
}


def record(path, *, force=1.0, bias=0.0, age=0, without=None, frame=None):
    rows = []
    for role, time, stamp, numbers in plunge():
        if role == "wrench":
            numbers = (numbers[0], numbers[1], force * numbers[2] + bias, *numbers[3:])
        if role != without:
            rows.append((role, time, stamp - age, numbers))
    topics = {role: topic for role, topic in TOPICS.items() if role != without}
    return write_ros2(path, rows, frame=frame, topics=topics)


def examined(tmp_path, capsys, parameters, **faults):
    """The lines that say what to do, but for the compilation, which depends on what ran before."""
    named = {k: v for k, v in (GOOD | parameters).items() if v is not None}
    if named.get("mesh.file") == "metres":
        trimesh.creation.box((0.06, 0.04, 0.005)).export(tmp_path / "metres.stl")
        named["mesh.file"] = str(tmp_path / "metres.stl")
    file = tmp_path / "my_cell.yaml"
    file.write_text("/**:\n  ros__parameters:\n" + "".join(f"    {k}: {v}\n" for k, v in named.items()))
    status = main(["doctor", str(file), "--bag", str(record(tmp_path / "bag", **faults))])
    lines = capsys.readouterr().out.splitlines()
    assert all(line.startswith(("OK  ", "FIX ")) for line in lines)
    found = [line for line in lines if line.startswith("FIX") and "compiled" not in line]
    assert status == (1 if any(line.startswith("FIX") for line in lines) else 0)
    return found


@pytest.mark.parametrize("more", [{}, {"ground.cell": 0.004}], ids=["level", "map without a camera"])
def test_a_good_cell_needs_nothing(tmp_path, capsys, more):
    assert examined(tmp_path, capsys, more) == []


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found_and_says_what_to_do(tmp_path, capsys, fault):
    parameters, recorded, sentence = FAULTS[fault]
    found = examined(tmp_path, capsys, parameters, **recorded)
    assert any(line.startswith(sentence) for line in found), found


def test_a_tare_that_only_a_replay_does_is_asked_of_the_node(tmp_path, capsys):
    file = tmp_path / "my_cell.yaml"
    replayed = "rft_replay:\n  ros__parameters:\n    tare: 1.0\n"
    file.write_text("/**:\n  ros__parameters:\n    surface_height: 0.0\n" + replayed)
    main(["doctor", str(file), "--bag", str(record(tmp_path / "bag", bias=2.0))])
    assert "replay tares over its first 1 s; for the node call ~/tare in the air" in capsys.readouterr().out


def test_a_tool_that_touched_nothing_is_told_to_push(tmp_path, capsys):
    found = examined(tmp_path, capsys, {"surface_height": -1.0}, force=0.0)
    assert found == ["FIX sign: no push was seen; push the tool down into the grains and run again"]
