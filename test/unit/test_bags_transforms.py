"""A recording with /tf and /tf_static in place of poses: the same estimates as with poses."""

import numpy as np
import pytest
from recordings import (
    START,
    TF,
    TOPICS,
    cdr,
    plunge,
    rows_of,
    transforms_cdr,
    values,
    write_messages,
)
from scipy.spatial.transform import Rotation

from rft_ros.bags.options import ReplayOptions
from rft_ros.bags.replay import replay
from rft_ros.calibration.calibrate import calibrate
from rft_ros.calibration.track import read_track
from rft_ros.errors import InputError
from rft_ros.estimator import TransformSample
from rft_ros.rft.frames import Placement

TOOL = Placement(
    (0.01, -0.02, 0.15),
    tuple(Rotation.from_euler("xyz", [5, 10, 90], degrees=True).as_quat().tolist()),
)
"""The tool in the flange."""
CELL = Placement(
    (0.0, 0.0, -0.1), tuple(Rotation.from_euler("x", 180, degrees=True).as_quat().tolist())
)
"""The load cell in the tool."""
BASE = Placement(
    (0.5, 0.2, -0.3), tuple(Rotation.from_euler("z", 30, degrees=True).as_quat().tolist())
)
"""The arm's base in the sand's frame."""
FRAMES = {"world_frame": "sand", "tool_frame": "tool", "sensor_frame": "ft_sensor"}


def record(path, *, tf, late=0, fixed_at=START, unreadable=0, robot=""):
    """A plunge with poses, or with the transforms that say the same; these come `late` [ns]."""
    links = [("flange", "tool", TOOL), ("sand", "base", BASE), ("tool", "ft_sensor", CELL)]
    samples = [TransformSample(0, parent, child, *placement) for parent, child, placement in links]
    fixed = [
        (fixed_at + k, f"{robot}/tf_static", TF, transforms_cdr(one))
        for k, one in enumerate(samples)
    ]
    messages = (
        [(START, f"{robot}/tf_static", TF, b"\0\x09\0\0")] * unreadable + fixed if tf else []
    )
    for role, time, stamp, numbers in plunge():
        if role == "pose" and tf:
            flange = BASE.inverse().of(Placement(numbers[:3], numbers[3:])).of(TOOL.inverse())
            moving = TransformSample(stamp, "base", "flange", *flange)
            messages.append((time + late, f"{robot}/tf", TF, transforms_cdr(moving)))
        else:
            data = cdr(role, stamp, numbers, "ft_sensor" if role == "wrench" else "sand")
            messages.append((time, *TOPICS[role], data))
    return write_messages(path, messages)


def numbers_of(folder, *names):
    return np.array([[float(r[n]) for n in names] for r in rows_of(folder) if not r["reason"]])


@pytest.mark.parametrize(("late", "robot"), [(0, ""), (400_000_000, "/robot")])
@pytest.mark.parametrize("twist_source", ["topic", "pose_difference"])
def test_transforms_replay_as_the_poses_that_they_say(tmp_path, twist_source, late, robot):
    frames = FRAMES | {"twist_source": twist_source}
    told = values(**frames, sensor__position=CELL.position, sensor__quaternion=CELL.quaternion)
    posed = replay(record(tmp_path / "posed", tf=False), tmp_path / "a", told)
    bag = record(
        tmp_path / "tf", tf=True, late=late, fixed_at=START + 3 * 10**9, unreadable=1, robot=robot
    )
    from_tf = values(**frames, pose_source="tf", sensor__frame_source="tf")
    remap = [f"{topic}:={robot}{topic}" for topic in ("/tf", "/tf_static")]
    transformed = replay(bag, tmp_path / "b", from_tf, ReplayOptions(start=0.0, remap=remap))
    assert transformed.messages["pose"] == posed.messages["pose"] == 650
    assert transformed.reasons == posed.reasons | {"message_unreadable": 1}
    names = ("t", "depth", "predicted_fx", "predicted_fz", "predicted_ty", "residual_fz")
    assert numbers_of(tmp_path / "b", *names) == pytest.approx(
        numbers_of(tmp_path / "a", *names), rel=1e-5, abs=1e-6
    )


def test_a_part_of_a_recording_knows_the_fixed_transforms_of_all_of_it(tmp_path):
    bag, given = (
        record(tmp_path / "bag", tf=True, late=30_000_000),
        values(**FRAMES, pose_source="tf"),
    )
    for name in ("a", "b"):
        summary = replay(bag, tmp_path / name, given, ReplayOptions(start=2.0))
    assert summary.estimates > 300
    assert "tf_frame_unknown" not in summary.reasons
    assert (tmp_path / "a" / "estimates.csv").read_bytes() == (
        tmp_path / "b" / "estimates.csv"
    ).read_bytes()


def test_without_transforms_the_sentence_names_frames_and_topic(tmp_path):
    bag = record(tmp_path / "bag", tf=True)
    with pytest.raises(
        InputError,
        match=r"pose of tool_frame 'drill' in world_frame 'sand' .*'ft_sensor' in 'tool'",
    ):
        replay(bag, tmp_path / "out", values(**FRAMES | {"tool_frame": "drill"}, pose_source="tf"))
    with pytest.raises(
        InputError, match=r"no pose topic '/rft/pose' .use pose_source: tf, or --remap"
    ):
        replay(bag, tmp_path / "out", values(**FRAMES))
    with pytest.raises(InputError, match=r"no tf topic '/tf' .use --remap /tf:=TOPIC"):
        replay(
            record(tmp_path / "posed", tf=False),
            tmp_path / "out",
            values(**FRAMES, pose_source="tf"),
        )


def test_a_calibration_reads_the_same_motion_readings_and_mount_from_transforms(
    tmp_path, monkeypatch
):
    # the recorded forces are none of grains, and a refusal has no values
    monkeypatch.setattr("rft_ros.calibration.calibrate.judge_fitted", lambda *_: None)
    given = {**FRAMES, "twist_source": "pose_difference"}
    posed = read_track(record(tmp_path / "posed", tf=False), values(**given))
    transformed = read_track(record(tmp_path / "tf", tf=True), values(**given, pose_source="tf"))
    np.testing.assert_array_equal(transformed.time, posed.time)
    np.testing.assert_allclose(transformed.states, posed.states, atol=1e-9)
    np.testing.assert_array_equal(transformed.readings, posed.readings)
    given |= {"sensor__sign": -1.0}  # the plunge's cell is not turned as `CELL`
    told = values(**given, sensor__position=CELL.position, sensor__quaternion=CELL.quaternion)
    from_tf = values(**given, pose_source="tf", sensor__frame_source="tf")
    expected, found = (
        calibrate(*one, parts=("zeta",)) for one in (([posed], told), ([transformed], from_tf))
    )
    assert found.fitted_values[0].values == pytest.approx(
        expected.fitted_values[0].values, rel=1e-6
    )
    with pytest.raises(
        InputError,
        match="posed: no fixed transforms link tool_frame 'tool' and sensor_frame 'ft_sen",
    ):
        calibrate([posed], from_tf)
