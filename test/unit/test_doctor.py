"""`rft doctor` names what is wrong with a recorded cell, says what to do, and finds nothing wrong with a good one."""

import re
import shutil
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from cells import (
    MOUNT,
    PARAMETERS,
    SURFACE,
    cell_of,
    loads,
    motion,
    record,
    record_of_a_newcomer,
    wrong,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st
from recordings import START, STEP
from scipy.spatial.transform import Rotation

from rft_ros import progress
from rft_ros.bags.reading import opened_recording
from rft_ros.cli import main
from rft_ros.doctor.checkup import Checkup
from rft_ros.doctor.seen_motion import SeenMotion
from rft_ros.estimator import PoseSample, TransformSample, TwistSample, WrenchSample
from rft_ros.installation import start_of_node
from rft_ros.parameters import Config
from rft_ros.rft import QUATERNION
from rft_ros.rft.frames import Placement

TURNED = (
    (Rotation.from_quat(MOUNT.quaternion) * Rotation.from_euler("x", 180, degrees=True))
    .as_quat()
    .tolist()
)
FAULTS = {
    "wrong frame": ("frames", "poses and twists have frame_id 'world'", {"world_frame": "map"}),
    "wrong type": (
        "wrench",
        "/rft/pose is geometry_msgs/msg/PoseStamped",
        {},
        "~/wrench_measured:=/rft/pose",
    ),
    "no twist": ("twist", "set twist_source: pose_difference", {}, "~/twist:=/none"),
    "no stamps": (
        "wrench",
        "1050 messages on /unstamped have no stamp",
        {},
        "~/wrench_measured:=/unstamped",
    ),
    "no load cell": (
        "wrench",
        "nothing on /none; use --remap ~/wrench_measured:=/rft/wrench_measured; it has ",
        {},
        "~/wrench_measured:=/none",
    ),
    "surface not set": ("surface_height", "set surface_height: 0.1", {"surface_height": None}),
    "not tared": ("load cell", "tare it there", {"sensor.bias": [0.0, 0.0, 2.0, 0.0, 0.0, 0.0]}),
    "untouched": (  # as if the cell hung in the air: no force but noise, and no grains in reach
        "sign",
        "push the tool down into the grains and run again",
        {"surface_height": -1.0},
        "~/wrench_measured:=/still",
    ),
    "another mount": (
        "sensor",
        "0 degrees and 100 mm; set sensor.frame_source: tf",
        {"sensor.position": [0.0, 0.0, 0.15]},
    ),
}
ALONE = ("untouched", "another mount")


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return record(tmp_path_factory.mktemp("cell") / "bag")


@pytest.fixture
def examined(bag, tmp_path, capsys):
    """The findings on the cell, or on another recording of it, with these parameters and remaps."""
    usual = bag

    def of(parameters, *remaps, node="/**", replayed=None, arguments=(), bag=usual):
        named = {k: v for k, v in (PARAMETERS | parameters).items() if v is not None}
        tree = {node: {"ros__parameters": named}} | (
            {"rft_replay": {"ros__parameters": replayed}} if replayed else {}
        )
        (tmp_path / "my_cell.yaml").write_text(yaml.safe_dump(tree))
        remapped = [f"--remap={remap}" for remap in remaps]
        status = main(
            ["doctor", str(tmp_path / "my_cell.yaml"), "--bag", str(bag), *remapped, *arguments]
        )
        said = capsys.readouterr()
        lines = [line for line in said.out.splitlines() if not line.startswith("-> ")] or [
            said.err.strip()
        ]
        assert all(line.startswith(("OK  ", "FIX ", "NOTE ")) for line in lines)
        assert status == (1 if any(line.startswith("FIX") for line in lines) else 0)
        return lines

    return of


def faults(lines):
    return [line for line in lines if line.startswith("FIX")]


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"pose_source": "tf", "sensor.frame_source": "tf"},
        {"ground.cell": 0.004},
        {"learning.mode": "apply"},
    ],
    ids=["topics", "TF", "map without a camera", "learning"],
)
def test_a_good_cell_needs_nothing(examined, more):
    lines = examined(more)
    assert faults(lines) == []
    said = "\n".join(lines)
    assert "OK  surface_height: 0.12 m; by the force the grains begin" in said
    assert "OK  sign: measured and predicted force agree" in said
    assert "OK  strength: measured over predicted force 1.1" in said


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_found_and_says_what_to_do(examined, fault):
    name, sentence, *cell = FAULTS[fault]
    lines = examined(*cell)
    assert any(line.startswith(f"FIX {name}: ") and sentence in line for line in lines), lines
    assert fault not in ALONE or len(faults(lines)) == 1
    assert fault != "no stamps" or not any(line.startswith("OK  wrench") for line in lines)


def test_of_several_remedies_that_fit_alike_none_is_written(examined, tmp_path):
    """A press alone tells a wrong sign from half a turn of the load cell no better, nor a surface from a TCP."""
    mended = tmp_path / "mended.yaml"
    wrong = {"sensor.sign": -1.0, "surface_height": SURFACE + 0.05}
    (of_sign, _) = faults(
        examined(wrong, arguments=("--write", str(mended)), replayed={"end": 4.2})
    )
    assert "sensor.sign: 1, or set sensor.quaternion" in of_sign
    written = yaml.safe_load(mended.read_text())["/**"]["ros__parameters"]
    assert written["sensor.sign"] == -1.0
    assert written["sensor.quaternion"] == PARAMETERS["sensor.quaternion"]
    assert written["surface_height"] == pytest.approx(SURFACE + 0.05)


def test_the_remedies_are_written_to_a_parameter_file_with_which_the_cell_is_right(
    examined, bag, tmp_path, capsys
):
    """Beside what the file says of other nodes, and with paths that begin at its own folder."""
    mended = tmp_path / "folder" / "mended.yaml"
    mended.parent.mkdir()
    wrong = {"sensor.sign": -1.0, "surface_height": SURFACE + 0.05}
    examined(wrong, arguments=("--write", str(mended)), replayed={"end": 10.0})
    written = yaml.safe_load(mended.read_text())
    assert written["rft_replay"]["ros__parameters"] == {"end": 10.0}
    of_node = written["/**"]["ros__parameters"]
    assert of_node["sensor.sign"] == 1.0
    assert of_node["surface_height"] == pytest.approx(SURFACE, abs=0.004)
    status = main(["doctor", str(mended), "--bag", str(bag)])
    assert faults(capsys.readouterr().out.splitlines()) == [], status


def test_a_cell_is_judged_with_the_only_topic_that_fits_whose_remap_is_written(examined, tmp_path):
    """As with the broadcaster's ~/wrench in the parameters, and ~/wrench_filtered in the recording."""
    mended = tmp_path / "mended.yaml"
    missing, not_tared, *_ = faults(
        examined(
            {"world_frame": "base", "twist_source": "pose_difference"},
            "~/pose:=/tcp",
            replayed={"remap": ["~/wrench_measured:=/other"]},
            arguments=("--write", str(mended)),
            bag=record_of_a_newcomer(tmp_path / "bag", offset=(0.0, 0.0, 2.0, 0.0, 0.0, 0.0)),
        )
    )
    assert "nothing on /other; use --remap ~/wrench_measured:=/ft" in missing
    assert "tare it there" in not_tared
    written = yaml.safe_load(mended.read_text())
    rules = written["rft_replay"]["ros__parameters"]["remap"]
    assert rules == ["~/pose:=/tcp", "~/wrench_measured:=/ft"]


def test_an_input_without_messages_or_in_an_unknown_frame_is_named_once(examined):
    """And not again by the poses that have no reading or no twist."""
    found = faults(examined({}, "~/twist:=/none"))
    assert [line.split(":")[0] for line in found] == ["FIX twist", "FIX estimates"]
    assert len(faults(examined({}, "~/wrench_measured:=/none"))) == 1
    assert len(faults(examined({"sensor_frame": "ati"}))) == 1


@pytest.mark.parametrize(
    "parameters",
    [{"pose_source": "tf", "sensor.frame_source": "tf"}, {"world_frame": "base"}],
    ids=["TF", "base"],
)
@pytest.mark.parametrize("before", [75, 750], ids=["0.2 s", "2 s"])
def test_what_comes_shortly_before_the_first_fixed_transforms_is_no_fault(bag, parameters, before):
    """Publishers are found one after the other: poses before the transforms that their frames need."""
    values = {**Config().values, **PARAMETERS, **parameters}
    checkup = Checkup(cell_of(values))
    with opened_recording(Path(bag), values) as recording:
        fixed, *others = ((sample, recording.time) for sample in recording)
        for sample, time in [*others[:before], (fixed[0], others[before][1]), *others[before:]]:
            checkup.push(sample, time)
    found = [finding.text for finding in checkup.findings() if not finding.ok]
    assert bool(found) == (before > 75), found


def test_a_tool_that_pitches_on_its_way_down_shows_the_surface():
    states, time = motion(100.0), 0.01 * np.arange(1050)
    states[:, QUATERNION] = Rotation.from_rotvec(
        np.outer(0.4 * np.sin(3.0 * time), (0, 1, 0))
    ).as_quat()
    states[:, 11] = 1.2 * np.cos(3.0 * time)
    (found,) = wrong(states, loads(states), surface_height=SURFACE + 0.03)
    assert found.remedy["surface_height"] == pytest.approx(SURFACE, abs=0.008)


def test_the_dump_of_a_namespaced_nodes_parameters_is_read(examined):
    assert faults(examined({}, node="/left/rft")) == []
    right = [f"~/{name}:=/rft/{name}" for name in ("pose", "twist", "wrench_measured")]
    assert faults(examined({}, *right, node="/left/rft", arguments=("--node", "/left/rft"))) == []


def test_a_tare_that_only_a_replay_does_is_asked_of_the_node(examined):
    lines = examined({"sensor.bias": [0.0, 0.0, 2.0, 0.0, 0.0, 0.0]}, replayed={"tare": 1.0})
    (line,) = [line for line in lines if line.startswith("OK  load cell")]
    assert "after the tare of the first 1 s; for the node call ~/tare" in line


def test_a_wrong_frame_of_poses_and_twists_is_the_first_cause_and_asks_for_one_parameter(examined):
    first, *others = faults(examined({"world_frame": "map"}))
    assert "set world_frame: world" in first
    assert not any("tool_frame" in line for line in (first, *others))


def test_a_topic_of_another_type_does_not_hide_the_other_checks(examined):
    lines = examined({"surface_height": SURFACE + 0.1}, "~/wrench_measured:=/rft/pose")
    assert any(line.startswith("OK  pose: 100 Hz") for line in lines)
    assert any(line.startswith("OK  twist: 100 Hz") for line in lines)
    assert any(line.startswith("OK  mesh: ellipsoid") for line in lines)


TF = {"pose_source": "tf", "sensor.frame_source": "tf"}


def test_a_wrong_fixed_transform_of_the_sensor_is_named_and_not_a_parameter_that_is_not_used(
    examined, tmp_path
):
    told = record(tmp_path / "told", told=Placement(MOUNT.position, tuple(TURNED)))
    for parameters in (TF, {"sensor.frame_source": "tf"}):
        (found,) = faults(examined(parameters, bag=told))
        assert found.startswith("FIX turn: ")
        assert "'ft_sensor' in 'tool' (fixed)" in found
        assert "/tf_static" in found
        assert "sensor.quaternion" not in found
        right = re.search(r"to the quaternion \[(.*?)\]", found)[1].split(", ")
        off = Rotation.from_quat([float(number) for number in right]).inv() * Rotation.from_quat(
            MOUNT.quaternion
        )
        assert off.magnitude() < 1e-3


def test_the_sensors_place_by_the_transforms_is_given_as_parameters(examined):
    """For a node that reads no transforms, such as with the wheels of PyPI, which have no tf2_msgs."""
    (line,) = [line for line in examined(TF) if line.startswith("OK  frames")]
    lists = [[float(n) for n in found.split(", ")] for found in re.findall(r"\[(.*?)\]", line)]
    assert lists[0] == pytest.approx(MOUNT.position, abs=1e-6)
    assert lists[1] == pytest.approx(MOUNT.quaternion, abs=1e-6)
    assert "sensor.position: [" in line and "sensor.quaternion: [" in line


@pytest.mark.parametrize(
    ("found", "words"), [("/opt/ros2", "ros2 launch"), (None, "rft_node --ros-args")]
)
def test_the_start_of_the_node_that_is_proposed_can_be_typed_here(monkeypatch, found, words):
    monkeypatch.setattr(shutil, "which", lambda _: found)
    assert start_of_node(Path("my cell.yaml")).startswith(words)
    assert "'my cell.yaml'" in start_of_node(Path("my cell.yaml"))


def test_frames_that_the_transforms_name_are_proposed_and_with_them_the_cell_is_right(
    examined, tmp_path
):
    """The names of the defaults are those of no driver; /tf_static places the load cell."""
    mended = tmp_path / "mended.yaml"
    unnamed = {"sensor.position": None, "sensor.quaternion": None}
    names = {"sensor_frame": "cell", "tool_frame": "flange"}
    found = faults(examined(unnamed | names, arguments=("--write", str(mended))))
    assert found[0].startswith("FIX frames: the load cell's readings are in the frame 'ft_sensor'")
    proposed = "set sensor_frame: ft_sensor and tool_frame: tool and sensor.frame_source: tf"
    assert proposed in found[0]
    assert not any("not sensor_frame" in line for line in found[1:])
    assert "'ft_sensor' in 'tool' (fixed)" in found[0]
    of_node = yaml.safe_load(mended.read_text())["/**"]["ros__parameters"]
    assert faults(examined(unnamed | {key: of_node[key] for key in of_node})) == []


@pytest.mark.parametrize("twists", ["flange", "world"])
def test_of_the_frames_that_carry_a_load_cell_that_of_the_twists_is_the_tools(twists):
    """Or else tool0; the others are named."""
    checkup = Checkup(cell_of({**Config().values, **PARAMETERS}))
    still, level = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
    chain = ("wrist_3_link", "flange", "tool0", "adapter", "ati")
    fixed = [
        TransformSample(START, parent, child, still, level, fixed=True)
        for parent, child in pairwise(chain)
    ]
    arm = TransformSample(START, "base", "wrist_3_link", still, level)
    checkup.push((arm, *fixed), START)
    checkup.push(TwistSample(START, twists, still, still), START)
    checkup.push(WrenchSample(START, "ati", (0.0,) * 6), START)
    (proposal,) = [f for f in checkup.findings() if f.remedy.get("sensor_frame") == "ati"]
    assert proposal.remedy["tool_frame"] == ("flange" if twists == "flange" else "tool0")
    assert "wrist_3_link" in proposal.advice
    assert "sensor.frame_source" not in proposal.remedy  # the file gives the place itself


def test_transforms_without_stamps_are_the_only_cause_named(examined, tmp_path):
    first, *others = faults(examined(TF, bag=record(tmp_path / "unstamped", stamped=False)))
    assert first.startswith("FIX tf: 1050 messages on /tf have no stamp")
    assert all(line.startswith("FIX estimates: 0 at 0 poses") for line in others)


def test_a_frame_that_is_its_own_parent_is_named_with_what_is_wrong(examined, tmp_path):
    loop = TransformSample(START, "camera", "camera", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    (found,) = faults(examined(TF, bag=record(tmp_path / "loop", extra=(loop,))))
    assert "'camera' in 'camera' (fixed): a frame cannot be its own parent" in found


def of_cell_with_delays(delays):
    """The faults of a right cell whose messages arrive so late [s], shape [n]; none overtakes another."""
    states = motion(100.0)
    arrivals = [
        START + k * STEP + round(1e9 * delays[k % len(delays)]) for k in range(len(states))
    ]
    return wrong(states, loads(states), arrivals=np.maximum.accumulate(arrivals).tolist())


@given(st.lists(st.floats(0.0, 0.95), min_size=3, max_size=20))
# half of the messages are late by more than max_input_age, and some come in time
@example([0.8, 0.7, 0.9])
@settings(max_examples=4, deadline=None)
def test_messages_that_a_busy_machine_delays_are_no_fault_of_the_clocks_or_of_the_cell(stops):
    """It stands still for so long [s] once in a second, and then takes all that has come meanwhile."""
    delays = np.concatenate([np.maximum(stop - 0.01 * np.arange(100), 0.001) for stop in stops])
    said = of_cell_with_delays(delays)
    assert all(
        finding.name == "machine" and "too busy to judge" in finding.text for finding in said
    ), said


@pytest.mark.parametrize("off", [0.3, -0.3])
def test_clocks_that_differ_are_named_also_where_messages_are_delayed(off):
    random = np.random.default_rng(1)
    said = of_cell_with_delays(off + 0.05 * random.random(500))
    assert any(
        finding.name == "pose" and "stamps on /rft/pose are 0." in finding.text for finding in said
    ), said
    assert all("clocks" in finding.text for finding in said)


@pytest.mark.parametrize(("haste", "laps"), [(1, 1), (4, 3)])
def test_a_live_doctor_listens_until_a_fast_trial_was_in_the_grains_for_some_seconds(haste, laps):
    """It needs several stops, or it would not see a delay of the load cell."""
    states = motion(100.0 / haste)
    end = states[-1, :3] - states[0, :3]
    poses = np.vstack([states[:, :7] + [*(lap * end), 0, 0, 0, 0] for lap in range(4)])
    seen_motion = SeenMotion(cell_of({**PARAMETERS, "twist_source": "pose_difference"}))
    for k, (*place, qx, qy, qz, qw) in enumerate(poses.tolist()):
        if not seen_motion.missing:
            break
        seen_motion.add(PoseSample(START + k * STEP, "world", tuple(place), (qx, qy, qz, qw)))
    assert laps - 1 < k / len(states) < laps


def test_a_long_wait_of_the_doctor_is_not_silent(bag, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(progress, "MAX_SILENCE_S", 0.0)
    (tmp_path / "cell.yaml").write_text(yaml.safe_dump({"/**": {"ros__parameters": PARAMETERS}}))
    main(["doctor", str(tmp_path / "cell.yaml"), "--bag", str(bag)])
    lines = capsys.readouterr().err.splitlines()
    assert "loading Python packages ..." in lines
    assert f"examining {bag} ..." in lines
