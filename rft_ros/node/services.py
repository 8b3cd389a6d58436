"""The node's services, all of type std_srvs/Trigger, and the files that some of them write."""

import os
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path

from rclpy.node import Node
from std_srvs.srv import Trigger

from rft_ros.errors import InputError, file_errors

_MOST_FILES = 100


def serve(node: Node, name: str, answer: Callable[[], str]) -> None:
    """Answer ``~/name`` with the sentence that `answer` returns or, without success, with that of its InputError."""

    def callback(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            response.success, response.message = True, answer()
        except InputError as error:
            response.message = str(error)
        return response

    node.create_service(Trigger, f"~/{name}", callback)


def save(name: str, write: Callable[[Path], None]) -> str:
    """Write a new file in $ROS_HOME or ~/.ros and return its path; {} in `name` becomes the time.

    Anyone on the network may ask for it, so that the folder takes a hundred files of a name. Raises InputError.
    """
    # Not ROS time: simulated time begins at 1970 each time and would repeat names.
    moment = datetime.now(timezone.utc).strftime("%Y%m%dT%H%M%S.%f")
    folder = Path(os.environ.get("ROS_HOME") or Path.home() / ".ros")
    with file_errors(f"folder '{folder}'", "written"):
        folder.mkdir(parents=True, exist_ok=True)
        if len([*folder.glob(name.format("*"))]) >= _MOST_FILES:
            raise InputError(f"not saved: folder '{folder}' has {_MOST_FILES} such files; move them away")
    file = folder / name.format(moment)
    write(file)
    return str(file)
