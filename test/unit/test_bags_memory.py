"""The memory of a replay does not grow with the bag."""

import subprocess
import sys

from recordings import plunge, write_ros2

SCRIPT = """
import resource, sys
from pathlib import Path
from rft_ros.bags.replay import replay
from rft_ros.parameters import defaults
for bag in map(Path, sys.argv[2:]):
    replay(bag, Path(sys.argv[1]) / bag.name, defaults(), report=True)
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)
"""


def test_a_bag_of_ten_times_the_length_takes_no_more_memory(tmp_path):
    """20 s and 200 s at 100 Hz; the bound on the growth of the peak [MiB] is the largest block of rows."""
    bags = [write_ros2(tmp_path / f"times{n}", plunge(3 * n)) for n in (1, 10)]
    done = subprocess.run([sys.executable, "-c", SCRIPT, tmp_path / "out", *bags], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    of_the_short, of_both = map(float, done.stdout.split())
    assert of_both - of_the_short < 40.0
