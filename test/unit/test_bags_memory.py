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
from rft_ros.parameters import defaults
for bag in map(Path, sys.argv[3:]):
    replay(bag, Path(sys.argv[2]) / bag.name, defaults(), report=sys.argv[1] == "report")
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
"""


@pytest.fixture(scope="module")
def bags(request, tmp_path_factory):
    """20 s and 200 s at 100 Hz."""
    folder = tmp_path_factory.mktemp("bags")
    return [str(write_ros2(folder / f"times{n}", plunge(3 * n), plugin=request.param)) for n in (1, 10)]


@pytest.mark.parametrize(
    ("bags", "report", "bound"),
    [(StoragePlugin.MCAP, "report", 40.0), (StoragePlugin.SQLITE3, "none", 25.0)],
    indirect=["bags"],
)
def test_a_bag_of_ten_times_the_length_takes_no_more_memory(bags, tmp_path, report, bound):
    """`bound` on the growth of a process's peak memory [MiB]: the largest block of rows."""
    done = subprocess.run([sys.executable, "-c", SCRIPT, report, tmp_path, *bags], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    of_the_short, of_both = map(float, done.stdout.split())
    assert of_both - of_the_short < bound
