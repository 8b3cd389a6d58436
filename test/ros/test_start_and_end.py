"""Starting and ending: signals at any time, arguments that cannot be used, executors, compiling ahead."""

import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from harness import NODE, WAIT, numbers, predicted_by_the_core
from rclpy.executors import SingleThreadedExecutor
from refusals import refusal

import rft_ros
from rft_ros.cli import main
from rft_ros.estimator.warm_up import prepare
from rft_ros.node.node_parameters import given_sections
from rft_ros.node.rft_node import executor_of
from rft_ros.parameters import read_parameter_file
from rft_ros.tool import locate_mesh

PLATE = locate_mesh("plate")


def descendants(pid: int) -> set[int]:
    children: set[int] = set()
    for threads in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(FileNotFoundError):  # a thread that has ended since
            children |= {int(child) for child in threads.read_text().split()}
    return children.union(*(descendants(child) for child in children))


def wait_until(condition, what: str):
    end = time.monotonic() + WAIT
    while not condition():
        assert time.monotonic() < end, f"waited in vain: {what}"
        time.sleep(0.02)


def alive(pids: set[int]) -> set[int]:
    """Of these processes, those that run, and are no zombies that init has not yet reaped."""
    stats = {pid: Path(f"/proc/{pid}/stat") for pid in pids}
    return {pid for pid, stat in stats.items() if stat.exists() and ") Z" not in stat.read_text()}


@pytest.fixture
def not_compiled(tmp_path: Path) -> Path:
    """A folder with a copy of the package, whose cache of machine code is empty."""
    package = Path(rft_ros.__file__).parent
    shutil.copytree(package, tmp_path / "rft_ros")
    for name in ("package.xml", "meshes", "config"):  # which make the folder a checkout
        (tmp_path / name).symlink_to(package.parent / name)
    return tmp_path


def test_a_signal_during_compilation_ends_with_status_0_and_leaves_no_child(
    start_process, not_compiled
):
    rft = start_process("-p", f"mesh.file:={PLATE}", folder=not_compiled)
    wait_until(lambda: "rft_node: loading ROS, the tool" in rft.said(), "the node says so")
    wait_until(lambda: "compiling: " in rft.said(), "the node compiles")
    wait_until(lambda: len(descendants(rft.process.pid)) >= 2, "compilers and tool worker run")
    children = descendants(rft.process.pid)
    assert rft.stop(signal.SIGTERM) == 0
    wait_until(lambda: not alive(children), "the children end")
    assert "Traceback" not in rft.said()


def test_a_node_is_ready_before_code_that_it_does_not_use_is_compiled_and_refuses_to_use_it_until_then(
    start_process, not_compiled
):
    prepare()
    cache = not_compiled / "__pycache__"
    module = "rft_ros.estimator.pose_difference"
    unused = shutil.ignore_patterns(f"{module}.*")
    shutil.copytree(Path(rft_ros.__file__).parents[1] / "__pycache__", cache, ignore=unused)
    rft = start_process("-p", f"mesh.file:={PLATE}", folder=not_compiled)
    (compiler,) = found(lambda: compilers(rft.process.pid))
    os.kill(compiler, signal.SIGSTOP)
    rft.wait_ready()
    made, why = rft.set(twist_source="pose_difference")
    assert not made
    assert "velocity still compiles" in why
    os.kill(compiler, signal.SIGCONT)
    while not rft.set(twist_source="pose_difference")[0]:
        rft.spin(0.1)
    assert list(cache.glob(f"{module}.*"))
    assert "compiling: " not in rft.said()


def compilers(pid: int) -> set[int]:
    """The processes that compile code for later."""
    return {
        child
        for child in descendants(pid)
        if b"warm_up import load;" in Path(f"/proc/{child}/cmdline").read_bytes()
    }


def found(processes):
    """The processes, once there are some."""
    wait_until(processes, "a process starts")
    return processes()


@pytest.mark.parametrize(
    "action", [signal.SIG_DFL, signal.SIG_IGN], ids=["foreground", "background job"]
)
def test_a_signal_right_after_the_first_process_starts_ends_with_status_0(start_process, action):
    ours = signal.signal(signal.SIGINT, action)  # which the node inherits
    rft = start_process("-p", "mesh.file:=plate")
    signal.signal(signal.SIGINT, ours)
    wait_until(lambda: descendants(rft.process.pid), "the tool worker starts")
    assert rft.stop() == 0
    expected = "ready: tool plate", "loading ROS"  # the node may be ready by then, or take long
    said = rft.said().splitlines()
    assert [line for line in said if not any(word in line for word in expected)] == []


@pytest.mark.parametrize(
    ("executor", "number", "status"),
    [("single", signal.SIGINT, 0), ("events", signal.SIGKILL, -signal.SIGKILL)],
)
def test_each_executor_answers_and_no_child_outlives_it_whatever_ends_it(
    start_process, executor, number, status
):
    rft = start_process("-p", "mesh.file:=plate", "-p", f"executor:={executor}").wait_ready()
    np.testing.assert_array_equal(numbers(rft.ask(rft.moment())), predicted_by_the_core())
    assert rft.set(medium__zeta=2.0) == (True, "")
    assert "tool plate in force" in rft.trigger("status")[1]
    rft.diagnostic("model")
    np.testing.assert_allclose(
        numbers(rft.ask(rft.moment())), predicted_by_the_core(zeta=2.0), rtol=1e-15
    )
    children = descendants(rft.process.pid)
    assert children
    assert rft.stop(number) == status
    wait_until(lambda: not alive(children), "the children end")
    assert "ready: tool plate" in rft.said()
    assert "Traceback" not in rft.said()


def test_where_rclpy_has_no_events_executor_the_node_says_so_and_takes_the_single_one(
    rft, monkeypatch
):
    monkeypatch.setitem(sys.modules, "rclpy.experimental", None)
    single = executor_of(rft._rft)
    assert isinstance(single, SingleThreadedExecutor)
    single.shutdown()
    rft.until(lambda: "no events executor" in rft.said())


POSES_IN_THE_GRAINS = """
import sys
from dataclasses import replace
from numba.core import event
from rft_ros.estimator import Estimator, PoseSample
from rft_ros.parameters import Config
from rft_ros.estimator.warm_up import prepare

prepare(on_cold_cache=lambda: sys.exit("the cache is cold after rft warm-up"))
if "trimesh" in sys.modules:
    sys.exit("warming up imports trimesh, which the node does not need")
for rule in ("centroid", "refined"):
    config = Config.of({"mesh.file": "plate", "integration": rule, "twist_source": "pose_difference"})
    model = config.model()
    for length in (0.0, 0.001):
        grains = replace(model.law, mobilization_length=length)
        with event.install_recorder("numba:compile") as compiled:
            estimator = Estimator(config, replace(model, law=grains))
        with event.install_recorder("numba:compiler_lock") as compiled_or_loaded:
            for k in range(1, 40):  # from the air into the grains
                pose = (0.0, 0.0, 0.1 - 0.005 * k), (0.0, 0.0, 0.0, 1.0)
                estimator.push_pose(PoseSample(k * 10_000_000, "world", *pose))
        if compiled.buffer or compiled_or_loaded.buffer or estimator.depth() < 0.05:
            sys.exit(f"{rule}, {length}: a pose compiles, loads or looks up")
"""


def test_after_compiling_ahead_nothing_is_left_to_compile():
    assert main(["warm-up"]) == 0
    done = subprocess.run(
        [sys.executable, "-c", POSES_IN_THE_GRAINS], capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_arguments_and_parameters_that_cannot_be_used_are_one_line_and_exit_status_2(tmp_path):
    file, pipe = tmp_path / "cell.yaml", tmp_path / "pipe.yaml"
    file.write_text("/**:\n  ros__parameters:\n    sensor.position: [0, 0, 0.5]\n")
    os.mkfifo(pipe)
    advice = "ROS arguments, such as --params-file, come after --ros-args"
    refused = {
        f"--params-file {file}": f"cannot use '--params-file {file}'; {advice}",
        "--ros-args -p mesh.file:=plate -- plate": f"cannot use 'plate'; {advice}",
        f"--ros-args --params-file {pipe}": f"parameter file '{pipe}' is a pipe",
        # in the words of a replay
        f"--ros-args --params-file {file}": refusal(read_parameter_file, file),
    }
    for arguments, sentence in refused.items():
        said = refusal(lambda given: list(given_sections(given)), arguments.split())
        assert said.startswith(sentence)
    bool_expected = (
        "Trying to set parameter 'use_sim_time' to '3' of type 'INTEGER', expecting type 'BOOL'"
    )
    of_the_node = {
        "--foo": f"cannot use '--foo'; {advice}",
        "--ros-args --log-lvel debug": "unknown ROS argument '--log-lvel', 'debug'",
        "--ros-args -p use_sim_time:=3": bool_expected,
    }
    for arguments, sentence in of_the_node.items():
        done = subprocess.run(
            [*NODE[:-1], *arguments.split()], capture_output=True, text=True, timeout=WAIT
        )
        assert done.returncode == 2
        # a slow start says first that it loads
        (said,) = (line for line in done.stderr.splitlines() if not line.endswith(" ..."))
        assert said.startswith(f"rft_node: {sentence}")


def test_a_home_in_which_ros_cannot_write_its_log_is_a_sentence_that_names_ros_log_dir():
    environment = {**os.environ, "HOME": "/proc/nowhere"}
    for name in ("ROS_LOG_DIR", "ROS_HOME"):
        environment.pop(name, None)
    done = subprocess.run(NODE, env=environment, capture_output=True, text=True)
    assert done.returncode == 2
    assert (
        "set ROS_LOG_DIR to a folder in which this user may write" in done.stderr.splitlines()[-1]
    )
    assert "Traceback" not in done.stderr


def test_help_is_printed_without_starting_the_node(start_process):
    rft = start_process("--help")
    assert rft.process.wait(WAIT) == 0
    assert rft.said().startswith("usage: rft_node")
