"""`config/robots/`: a parameter file for each driver that zeroes or compensates; and a load cell without any grains."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from cells import MOUNT, PARAMETERS, loads, motion
from recordings import POSE, WRENCH, write_run
from scipy.spatial.transform import Rotation, Slerp

from rft_ros.bags.options import read_replay_options, topics_of
from rft_ros.bags.replay import replay
from rft_ros.cli import main
from rft_ros.parameters import read_parameter_file
from rft_ros.rft import QUATERNION, STATE

ROBOTS = Path(__file__).resolve().parents[2] / "config" / "robots"
OFFSET = (1.5, -0.8, 2.2, 0.01, 0.02, -0.03)


def recorded(path, states, readings, values, remap=()):
    """A bag at 100 Hz of what a cell with these parameters publishes, without twists."""
    topics = topics_of(values, remap)
    kinds = {"pose": (topics["pose"], POSE), "wrench": (topics["wrench"], WRENCH)}
    frames = {"pose": values["world_frame"], "wrench": values["sensor_frame"]}
    noise = np.random.default_rng(7).normal(
        scale=(0.02, 0.02, 0.02, 2e-4, 2e-4, 2e-4), size=readings.shape
    )
    return write_run(
        path, 0.01 * np.arange(len(states)), states, readings + noise, topics=kinds, frames=frames
    )


@pytest.mark.parametrize("file", sorted(ROBOTS.glob("*.yaml")), ids=lambda file: file.stem)
def test_the_file_of_a_robot_replays_what_its_driver_publishes(file, tmp_path):
    """Poses of the tool, and wrenches in its axes without the tool's weight, with an offset."""
    grains = {name: value for name, value in PARAMETERS.items() if not name.startswith("sensor.")}
    values = read_parameter_file(file).values | grains
    options = read_replay_options(file)
    states = motion(100.0)
    states = np.vstack([np.repeat(states[:1], 150, axis=0), states])
    on_tool = np.array([MOUNT.wrench(tuple(row)) for row in loads(states).tolist()])
    readings = values["sensor.sign"] * on_tool + OFFSET
    bag = recorded(tmp_path / "bag", states, readings, values, options.remap)
    replay(bag, tmp_path / "out", values, options)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["warnings"] == []
    assert summary["median_relative_error"] < 0.05


def test_without_grains_the_compensated_wrench_is_what_pushes_the_tool(tmp_path):
    """As docs/gravity.md says: seven attitudes in the air; then the same while a hand pushes with 5 N."""
    angles = [(0, 0), (40, 0), (0, 40), (-40, 0), (0, -40), (25, 25), (0, 0)]
    still = np.repeat(np.arange(13) // 2, 150)
    moving = np.tile(np.linspace(0.0, 1.0, 150), 13) * (np.repeat(np.arange(13), 150) % 2)
    attitudes = Slerp(np.arange(7), Rotation.from_euler("xy", angles, degrees=True))(
        still + moving
    )
    states = np.zeros((len(still), len(STATE)))
    states[:, 2] = 0.3
    states[:, QUATERNION] = attitudes.as_quat()
    weight = attitudes.inv().apply([0.0, 0.0, -0.8 * 9.80665])
    readings = np.hstack([weight, np.cross([0.0, 0.01, 0.06], weight)]) + OFFSET
    cell = tmp_path / "cell.yaml"
    cell.write_text(
        "/**:\n  ros__parameters:\n    surface_height: -1.0\n    twist_source: pose_difference\n"
    )
    values = read_parameter_file(cell).values
    bag = recorded(tmp_path / "bag", states, readings, values)
    weighed = tmp_path / "weighed.yaml"
    assert main(["calibrate", str(bag), "--params", str(cell), "-o", str(weighed)]) == 0
    assert read_parameter_file(weighed).values["sensor.mass"] == pytest.approx(0.8, rel=1e-3)
    push = np.zeros((len(still), 6))
    push[300:350, 2] = 5.0
    pushed = recorded(tmp_path / "pushed", states, readings + push, values)
    replay(pushed, tmp_path / "out", read_parameter_file(weighed).values)
    with (tmp_path / "out" / "estimates.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["compensated_fz"]]
    found = np.array(
        [[float(row[f"compensated_{name}"]) for name in ("fx", "fy", "fz", "tx")] for row in rows]
    )
    known = push[-len(found) :, [0, 1, 2, 3]]
    assert np.abs(found[:, :3] - known[:, :3]).max() < 0.2
    assert np.abs(found[:, 3] - known[:, 3]).max() < 0.01
