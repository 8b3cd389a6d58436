"""Bags that would fill the memory or take for ever are refused, or used up to where they would."""

import os
import re
import resource
import struct
import subprocess
import sys

import pytest
import zstandard
from packed_bags import chunk_bomb
from recordings import POSE, ROS2, START, STEP, cdr, moments, write_ros2
from refusals import refusal
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from rft_ros.bags.limits import MOST_BYTES, LimitedPath, unpacked
from rft_ros.bags.reading import Recording
from rft_ros.parameters import defaults

TOPICS = {"pose": "/rft/pose", "wrench": "/rft/wrench_measured"}
READ = """
import resource, sys
from pathlib import Path
from rft_ros.bags.reading import Recording
from rft_ros.parameters import defaults
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    with Recording(Path(sys.argv[1]), defaults(), topics={"pose": "/rft/pose"}) as recording:
        print(sum(1 for _ in recording), recording.damage)
except ValueError as error:
    print(error)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)
"""


def read(bag):
    """What a process of its own says of a bag, and how much memory it took for it [MiB]."""
    done = subprocess.run([sys.executable, "-c", READ, bag], capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    said, memory = done.stdout.splitlines()
    return said, int(memory)


@pytest.mark.parametrize("suffix", [".bag", ".mcap", ".db3"])
@pytest.mark.parametrize("size", [2**30, 10 * 2**30])
@pytest.mark.parametrize(
    "begin", [b"", b"#ROSBAG V2.0\n", b"#ROSBAG V2.0\n\0\0\0\x40", b"\x89MCAP0\r\n", b"SQLite format 3\0"]
)
def test_a_file_of_zeros_is_called_damaged_without_being_read_into_memory(tmp_path, suffix, size, begin):
    file = tmp_path / f"zeros{suffix}"
    with file.open("wb") as stream:
        stream.write(begin)
        stream.truncate(size)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ValueError, match="zeros"), Recording(file, defaults(), topics=TOPICS):
        pass
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 2 * MOST_BYTES / 1024


@pytest.mark.parametrize("options", [{}, {"says": 2**20}, {"streamed": True}, {"says": 2**20, "streamed": True}])
def test_a_chunk_that_unpacks_to_gigabytes_is_refused_before_it_is_unpacked(tmp_path, options):
    chunk_bomb(tmp_path / "bomb.mcap", **options)
    assert (tmp_path / "bomb.mcap").stat().st_size < 2**17
    said, memory = read(tmp_path / "bomb.mcap")
    assert "bomb.mcap" in said
    assert re.search("a chunk unpacks to|a chunk does not have", said)
    assert memory < 2 * MOST_BYTES / 2**20


def packed_bag(folder, mode, *, mib):
    """A bag with compression_mode file or message, one message or its file of many zeros; and its size on disk."""
    bag = Writer(folder, version=8, storage_plugin=StoragePlugin.SQLITE3)
    bag.set_compression(CompressionMode[mode.upper()], CompressionFormat.ZSTD)
    with bag as writer:
        pose = writer.add_connection(TOPICS["pose"], POSE, typestore=ROS2)
        for k in range(30):
            writer.write(pose, START + k * STEP, cdr("pose", START + k * STEP, (0, 0, 0, 0, 0, 0, 1)))
        if mode == "message" and mib:
            writer.write(pose, START + 30 * STEP, bytes(mib * 2**20))
    if mode == "file" and mib:
        (file,) = folder.glob("*.zstd")
        compressor = zstandard.ZstdCompressor(level=1).compressobj()
        zeros = b"".join(compressor.compress(bytes(2**20)) for _ in range(mib)) + compressor.flush()
        file.write_bytes(file.read_bytes() + zeros)
    return sum(file.stat().st_size for file in folder.iterdir())


@pytest.mark.parametrize("mode", ["file", "message"])
def test_a_bag_that_is_compressed_by_file_or_message_is_read(tmp_path, mode):
    packed_bag(tmp_path / "bag", mode, mib=0)
    with Recording(tmp_path / "bag", defaults(), topics=TOPICS) as recording:
        assert sum(1 for _ in recording) == 30
    assert recording.damage is None


@pytest.mark.parametrize("mode", ["file", "message"])
def test_what_unpacks_to_gigabytes_is_refused_before_it_is_unpacked(tmp_path, mode):
    assert packed_bag(tmp_path / "bag", mode, mib=900) < 2**18
    said, memory = read(tmp_path / "bag")
    assert re.search("a (compressed file|message) unpacks to", said)
    assert memory < 2 * MOST_BYTES / 2**20


def test_what_comes_before_a_chunk_that_is_too_large_is_used(tmp_path):
    write_ros2(tmp_path / "good", moments(40))
    (good,) = (tmp_path / "good").glob("*.mcap")
    chunk_bomb(tmp_path / "bomb.mcap")
    content, bad = good.read_bytes(), (tmp_path / "bomb.mcap").read_bytes()
    end = content.index(struct.pack("<BQ", 15, 4))  # the end of the data
    both = tmp_path / "both.mcap"
    both.write_bytes(content[:end] + bad[8 + 9 + 8 :])
    with Recording(both, defaults(), topics=TOPICS) as recording:
        assert sum(1 for _ in recording) > 30
    assert "both.mcap is damaged" in recording.damage


@pytest.mark.parametrize("compression", ["lz4", "bz2", "zstd", ""])
def test_a_chunk_unpacks_to_its_content_or_is_refused(compression):
    import bz2

    import lz4.frame

    packed = {"lz4": lz4.frame.compress, "bz2": bz2.compress, "zstd": zstandard.compress, "": bytes}[compression]
    assert unpacked(packed(b"abc" * 1000), compression, 3000) == b"abc" * 1000
    assert unpacked(packed(b"abc" * 1000), compression) == b"abc" * 1000
    for size in (2999, 3001, MOST_BYTES + 1):
        with pytest.raises(ValueError, match="a chunk"):
            unpacked(packed(b"abc" * 1000), compression, size)


def test_a_limited_file_reads_as_any_other_up_to_the_limit(tmp_path):
    file = tmp_path / "file"
    with file.open("wb") as stream:
        stream.write(b"first\nsecond")
        stream.truncate(2**40)
    with LimitedPath(file).open("rb") as stream:
        assert stream.readline() == b"first\n"
        assert stream.read(6) == b"second"
        for size in (2**30, -1, None):
            with pytest.raises(ValueError, match="the limit of 256 MiB"):
                stream.read(size)
    assert LimitedPath(tmp_path / "file").name == "file"


@pytest.mark.parametrize("name", ["metadata.yaml", "part.mcap"])
def test_a_pipe_in_a_bag_is_refused_and_not_waited_for(tmp_path, name):
    write_ros2(tmp_path / "bag", moments(4))
    (tmp_path / "bag" / name).unlink(missing_ok=True)
    os.mkfifo(tmp_path / "bag" / name)
    assert "is a pipe" in refusal(Recording(tmp_path / "bag", defaults(), topics=TOPICS).__enter__)
