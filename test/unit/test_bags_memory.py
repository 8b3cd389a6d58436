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
for bag in sys.argv[2:]:
    replay(Path(bag), Path(bag + "_replayed"), defaults(), report=sys.argv[1] == "report")
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
"""


@pytest.mark.parametrize(
    ("plugin", "report", "bound"),
    [(StoragePlugin.MCAP, "none", 25.0), (StoragePlugin.SQLITE3, "none", 25.0), (StoragePlugin.MCAP, "report", 40.0)],
)
def test_a_bag_of_ten_times_the_length_takes_no_more_memory(tmp_path, plugin, report, bound):
    """20 s and 200 s at 100 Hz; `bound` on the growth of a process's peak memory [MiB]: the largest block of rows."""
    bags = [str(write_ros2(tmp_path / f"times{n}", plunge(3 * n), plugin=plugin)) for n in (1, 10)]
    command = [sys.executable, "-c", SCRIPT, report, *bags]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    of_the_short, of_both = map(float, done.stdout.split())
    assert of_both - of_the_short < bound
