"""The memory of a replay does not grow with the bag."""

import subprocess
import sys

import pytest
from recordings import plunge, write_ros2
from rosbags.rosbag2 import StoragePlugin

SCRIPT = """
import resource, sys
from pathlib import Path
from rft_ros.bags.replay import replay
from rft_ros.estimator.parameters import defaults
replay(Path(sys.argv[1]), Path(sys.argv[2]), defaults(), report=sys.argv[3] == "report")
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
"""


def peak(bag, out, report):
    """Peak resident memory [MiB] of a process that replays the bag."""
    command = [sys.executable, "-c", SCRIPT, str(bag), str(out), report]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return float(done.stdout)


@pytest.mark.parametrize(
    ("plugin", "report", "bound"),
    [(StoragePlugin.MCAP, "none", 25.0), (StoragePlugin.SQLITE3, "none", 25.0), (StoragePlugin.MCAP, "report", 40.0)],
)
def test_a_bag_of_ten_times_the_length_takes_no_more_memory(tmp_path, plugin, report, bound):
    """20 s and 200 s at 100 Hz; `bound` [MiB] is over twice what was measured: the largest block of rows, once."""
    peaks = []
    for times in (1, 10):
        bag = write_ros2(tmp_path / f"times{times}", plunge(3 * times), plugin=plugin)
        peaks.append(peak(bag, tmp_path / f"out{times}", report))
    assert peaks[1] - peaks[0] < bound, peaks
