"""Write a rosbag2 folder with one MCAP file."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import yaml
from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from rft_ros.errors import InputError, reason_of
from rft_ros.files import read_text

_MARK = {
    "written_by": "rft_ros"
}  # custom data that marks bags which rft_ros wrote and may replace


def read_metadata(folder: Path) -> dict[str, Any]:
    """What the metadata.yaml of a rosbag2 folder says of it. Raises InputError."""
    text = read_text(folder / "metadata.yaml", "metadata")
    try:
        return {**yaml.safe_load(text)["rosbag2_bagfile_information"]}
    except (yaml.YAMLError, LookupError, TypeError) as error:
        raise InputError(reason_of(error)) from None


def check_replaceable(path: Path) -> None:
    """Raise InputError if there is a file or folder at `path` that a BagWriter did not write."""
    if not path.exists():
        return
    with suppress(InputError):
        if read_metadata(path).get("custom_data") == _MARK:
            return
    raise InputError(
        f"'{path}' already exists and was not written by rft_ros; give another folder"
    )


class BagWriter(Writer):
    """Writes a rosbag2 folder, for use in a `with` block; the same messages give the same bytes.

    `path` must not exist yet. After an exception in the block, the bag has the messages that were written before it.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, version=9, storage_plugin=StoragePlugin.MCAP)
        self.custom_data |= _MARK
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._of_topic: dict[str, Connection] = {}

    def write_raw(self, topic: str, msgtype: str, stamp: int, cdr: bytes) -> None:
        """Write a serialised message (CDR) of any type of ROS 2 Jazzy's common interfaces at log time `stamp` [ns]."""
        if topic not in self._of_topic:
            self._of_topic[topic] = self.add_connection(topic, msgtype, typestore=self._types)
        self.write(self._of_topic[topic], stamp, cdr)
