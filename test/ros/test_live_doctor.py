"""`rft doctor` beside a running node: a right cell is green, with topics and with TF; faults that only exist live."""

import os
import re
import subprocess
import sys
import threading
import time
from pathlib import Path
from unittest import mock

import pytest
import rclpy
import yaml
from cells import MOUNT, PARAMETERS, loads, motion
from geometry_msgs.msg import PoseStamped
from harness import WAIT, Harness
from rclpy.qos import QoSProfile, ReliabilityPolicy
from recordings import cdr, transforms_cdr
from test_live_transforms import transform_publishers

from rft_ros.doctor.running import _of_losses, _of_topic, _samples
from rft_ros.estimator import TransformSample
from rft_ros.node import listen
from rft_ros.node.listen import Listener, Message, Publisher, Topic
from rft_ros.rft import POSE, POSITION, QUATERNION, TWIST, VELOCITY

_RATE = 100.0
# the recorded motion takes 10 s; faster, a message that is late on a busy machine leaves a gap of centimetres
_HASTE = 2
_FINE = 5_000.0  # [Hz], of the states: each message carries the state at its own time, however late it is sent


def examined(rft: Harness, tmp_path: Path, send, parameters) -> list[str]:
    """What the doctor says of a node, while `send(state, load, time)` is called at 100 Hz."""
    remap = (
        f"--remap=~/pose:={rft.name}/pose"  # what it is anyway: rcl must not take it for its own
    )
    lines, _, _ = listening(rft, tmp_path, send, parameters, "--node", rft.name, remap)
    return lines


def listening(rft, tmp_path, send, parameters, *options) -> tuple[list[str], list[str], int]:
    """The doctor's lines on stdout and on stderr, and its exit status, while `send(state, load, time)` is called.

    The motion repeats from where it ended: back at its start, the pose would jump.
    """
    states = motion(_FINE / _HASTE)
    states[:, VELOCITY] *= _HASTE
    felt = loads(states).tolist()
    way = states[-1, POSITION] - states[0, POSITION]
    file = tmp_path / "doctor.yaml"
    file.write_text(yaml.safe_dump({"/**": {"ros__parameters": parameters}}))
    command = [
        sys.executable,
        "-m",
        "rft_ros.cli",
        "doctor",
        str(file),
        *options,
    ]
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(sys.path),
    }  # tf2_msgs or its stand-in
    doctor = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    try:
        begin = rft.node.get_clock().now().nanoseconds
        while doctor.poll() is None:
            now = rft.node.get_clock().now().nanoseconds
            repeats, k = divmod(round(1e-9 * (now - begin) * _FINE), len(states))
            state = states[k].copy()
            state[POSITION] += repeats * way
            send(state.tolist(), felt[k], now)
            rft.spin(1.0 / _RATE)
        said, errors = doctor.communicate(timeout=WAIT)
    finally:
        doctor.kill()
    assert "deprecat" not in errors.lower()
    assert said, errors
    return said.splitlines(), errors.splitlines(), doctor.returncode


def faults(lines):
    return [line for line in lines if line.startswith("FIX")]


TF = {"pose_source": "tf", "sensor.frame_source": "tf", "twist_source": "pose_difference"}


@pytest.mark.parametrize("sources", [{}, TF], ids=["topics", "tf"])
def test_a_right_cell_needs_nothing(start_node, tmp_path, sources):
    file, parameters = tmp_path / "my_cell.yaml", PARAMETERS | sources
    file.write_text(yaml.safe_dump({"/**": {"ros__parameters": parameters}}))
    rft = start_node("--params-file", str(file))
    rft.get("mesh.file")
    publishers = transform_publishers(rft.node)
    publishers["tf_static"].publish(
        transforms_cdr(TransformSample(1, "tool", "ft_sensor", *MOUNT))
    )

    def send(state, load, now):
        rft.wrench.publish(cdr("wrench", now, load))
        if sources:
            publishers["tf"].publish(
                transforms_cdr(
                    TransformSample(now, "world", "tool", state[POSITION], state[QUATERNION])
                )
            )
        else:
            rft.twist.publish(cdr("twist", now, state[TWIST]))
            rft.pose.publish(cdr("pose", now, state[POSE]))

    lines = examined(rft, tmp_path, send, parameters)
    assert faults(lines) == []
    assert lines[0].startswith(f"OK  node: {rft.name} runs with the parameters of ")
    assert "no section of" not in rft.said()


def test_it_says_what_to_do_listens_until_it_has_seen_a_trial_and_needs_no_node(
    start_node, tmp_path
):
    rft = start_node("-p", "mesh.file:=plate")
    rft.get("mesh.file")

    def send(state, load, now):
        rft.wrench.publish(cdr("wrench", now, load))
        rft.twist.publish(cdr("twist", now, state[TWIST]))
        rft.pose.publish(cdr("pose", now, state[POSE]))

    topics = {"pose": "pose", "twist": "twist", "wrench_measured": "wrench_measured"}
    remaps = [f"--remap=~/{name}:={rft.name}/{topic}" for name, topic in topics.items()]
    lines, said, status = listening(
        rft, tmp_path, send, PARAMETERS, *remaps, "--seconds", f"{WAIT:g}"
    )
    assert any(line.startswith("NOTE node: no node /rft was found") for line in lines)
    assert faults(lines) == []
    assert status == 0
    task = (
        "hold the tool still in the air, push it down into the grains, drag it along x and along y"
    )
    assert any(f"listening for at most {WAIT:g} s: {task}" in line for line in said)
    assert re.match(r"after \d+ s: still to see: nothing", said[-1])


def test_it_stops_early_where_no_load_cell_answers_and_says_what_it_has_not_seen(
    start_node, tmp_path
):
    rft = start_node("-p", "mesh.file:=plate")
    rft.get("mesh.file")

    def send(state, _, now):
        rft.twist.publish(cdr("twist", now, state[TWIST]))
        rft.pose.publish(cdr("pose", now, (*state[POSITION][:2], 0.5, *state[QUATERNION])))

    lines, _, _ = listening(
        rft, tmp_path, send, PARAMETERS, "--node", rft.name, "--seconds", f"{WAIT:g}"
    )
    assert any(line.startswith("FIX wrench: nothing on") for line in lines)
    assert any("NOTE motion: not seen" in line and "press" in line for line in lines)


@pytest.mark.parametrize(("option", "name"), [("--node", "a b"), ("--remap", "~/pose:=/a b")])
def test_a_name_that_ros_does_not_take_is_named(option, name):
    command = [
        sys.executable,
        "-m",
        "rft_ros.cli",
        "doctor",
        "config/demo.yaml",
        "--seconds",
        "1",
        option,
        name,
    ]
    done = subprocess.run(command, capture_output=True, text=True, cwd=Path(__file__).parents[2])
    assert (done.returncode, done.stdout) == (2, "")
    refusal = done.stderr.splitlines()[-1]
    assert "/a b" in refusal
    assert option in refusal


def test_what_is_wrong_only_in_a_running_cell_is_named(start_process, tmp_path):
    """A section for another name, poses that a node which asks for reliable ones cannot hear, no twist, a type."""
    file = tmp_path / "my_cell.yaml"
    file.write_text(yaml.safe_dump({"/rft": {"ros__parameters": PARAMETERS}}))
    rft = start_process("--params-file", str(file))
    rft.get("mesh.file")
    assert f"no section of {file} is for {rft.name}: ROS takes nothing from it" in rft.said()
    rft.close_inputs()
    arm = rft.node.create_publisher(
        PoseStamped,
        f"{rft.name}/pose",
        QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT),
    )
    cell = rft.node.create_publisher(PoseStamped, f"{rft.name}/wrench_measured", 10)

    def send(state, _, now):
        for publisher in (arm, cell):
            publisher.publish(cdr("pose", now, state[POSE]))

    found = faults(examined(rft, tmp_path, send, PARAMETERS))
    for sentence in (
        f"FIX node: {rft.name} runs with mesh.file plate (file: ellipsoid), medium.zeta 1.0 (file: 0.4), surface_he",
        f"FIX pose: peer publishes {rft.name}/pose so that rft cannot receive it",
        f"FIX twist: nothing on {rft.name}/twist; set twist_source: pose_difference",
        f"FIX wrench: {rft.name}/wrench_measured is geometry_msgs/msg/PoseStamped; it must be geometry_msgs/msg/Wren",
    ):
        assert any(line.startswith(sentence) for line in found), found
    assert any(
        line.startswith(f"FIX wrench: nothing on {rft.name}/wrench_measured") for line in found
    )


@pytest.mark.parametrize("stop", [0.05, 0.4, 1.2])
def test_a_message_arrives_when_the_middleware_receives_it_not_when_it_is_read(stop):
    """The doctor stands still for so long [s] between two readings, as on a busy machine."""
    topic, ended, sent = f"/doctor{round(1e3 * stop)}/pose", threading.Event(), {}
    arm, listener = rclpy.create_node("arm"), Listener("/rft")
    publisher = arm.create_publisher(PoseStamped, topic, 1000)
    transform_publishers(arm)  # the listener waits until each of its topics has a publisher

    def publish():
        while not ended.wait(0.01):
            stamp = time.time_ns()
            publisher.publish(cdr("pose", stamp, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)))
            # the middleware of this process has received it before `publish` returns
            sent[stamp] = time.time_ns()

    thread = threading.Thread(target=publish)
    try:
        thread.start()
        with mock.patch.object(listen, "_PERIOD", stop):
            listener.subscribe({"pose": topic})
            messages, _ = listener.listen(1.2)
    finally:
        ended.set()
        thread.join()
        arm.destroy_node()
        listener._node.destroy_node()
    arrived = [
        (sample.stamp, received)
        for sample, received in _samples(messages, {})
        if sample.stamp in sent
    ]
    assert arrived
    assert all(stamp <= received <= sent[stamp] for stamp, received in arrived)


def test_two_publishers_on_one_topic_are_named_but_not_those_of_transforms():
    publishers = (Publisher("new", "type", ()), Publisher("old", "type", ()))
    (found,) = _of_topic(Topic("wrench", "/ft", ("type",), publishers))
    assert not found.ok
    assert "2 publishers on /ft (new, old)" in found.text
    (found,) = _of_topic(Topic("tf", "/tf", ("type",), publishers))
    assert found.ok


@pytest.mark.parametrize(
    ("taken", "lost"), [(range(1, 1001), 0), (range(1, 1001, 2), 499), ([5], 0), ([], 0)]
)
def test_messages_that_were_lost_on_the_way_are_said(taken, lost):
    topic = Topic("pose", "/rft/pose", (), (Publisher("arm", "", ()),))
    found = [
        f.text
        for f in _of_losses(topic, [Message("pose", "", b"", 0, number) for number in taken])
    ]
    assert len(found) == (lost > 0)
    assert all(
        f"{lost} of 999 messages on /rft/pose were lost" in text and "too busy" in text
        for text in found
    )
