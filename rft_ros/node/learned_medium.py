"""How the node reports what it learned of the medium: a topic, log lines, and a parameter file."""

import os
from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path

from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from rft_ros.errors import InputError, file_errors
from rft_ros.estimator import Estimate, Estimator
from rft_ros.estimator.learning import BeliefIssue, Learning, Surprise
from rft_ros.parameters import Values, write_parameter_file

_PERIOD = 20_000_000  # ns, of the topic
_NAMES = ["vertical_strength", "horizontal_strength", "turn", "surface", "surprise"]
_OFF = "learning.mode is off"
_MOST_FILES = 100


def saved(response: Trigger.Response, name: str, write: Callable[[Path], None]) -> Trigger.Response:
    """Answer a service that writes a file to $ROS_HOME or ~/.ros; {} in `name` becomes the time.

    Anyone on the network may call it, so that the folder takes a hundred files of a name.
    """
    # Not ROS time: simulated time begins at 1970 each time and would repeat names.
    moment = datetime.now(timezone.utc).strftime("%Y%m%dT%H%M%S.%f")
    folder = Path(os.environ.get("ROS_HOME") or Path.home() / ".ros")
    file = folder / name.format(moment)
    try:
        with file_errors(f"folder '{folder}'", "written"):
            folder.mkdir(parents=True, exist_ok=True)
            if len([*folder.glob(name.format("*"))]) >= _MOST_FILES:
                raise InputError(f"not saved: folder '{folder}' has {_MOST_FILES} such files; move them away")
        write(file)
    except InputError as error:
        response.message = str(error)
        return response
    response.success, response.message = True, str(file)
    return response


class LearnedMedium:
    """Publishes ``~/medium_learned`` beside the estimates, and logs surprises and signs of a wrong model.

    JointState: `name` as `_NAMES`, `position` the value (turn [rad], surface [m]), `effort` its standard error. The
    surprise is in standard deviations, so its `effort` is 1.
    """

    def __init__(self, node: Node, estimator: Estimator, qos: QoSProfile) -> None:
        self._logger = node.get_logger()
        self._estimator = estimator
        self._publisher = node.create_publisher(JointState, "~/medium_learned", qos)
        self._published = 0
        self._surprise = Surprise.NONE
        self._issues: list[BeliefIssue] = []

    def publish(self, estimate: Estimate) -> None:
        """Publish what is believed at an estimate, at most every 20 ms of its stamps, and log what is new."""
        learning = self._estimator.learning
        if learning is None or 0 <= estimate.stamp - self._published < _PERIOD:
            return
        self._published = estimate.stamp
        self._log(learning)
        b = learning.belief()
        message = JointState(name=_NAMES)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(estimate.stamp, 1_000_000_000)
        message.position = [getattr(b, name) for name in _NAMES]
        message.effort = [*(getattr(b, f"{name}_error") for name in _NAMES[:4]), 1.0]
        self._publisher.publish(message)

    def _log(self, learning: Learning) -> None:
        if learning.surprise is not self._surprise:
            self._surprise = learning.surprise
            if self._surprise is Surprise.NONE:
                self._logger.info("grains as learned again")
            else:
                self._logger.warning(learning.surprise_sentence())
        issues = learning.issues()
        for issue in issues:
            if issue not in self._issues:
                self._logger.error(str(issue))
        self._issues = issues

    def forget(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Answer the service: go back to the calibration."""
        response.success = self._estimator.learning is not None
        response.message = "back to the calibration" if response.success else f"nothing to forget: {_OFF}"
        if self._estimator.learning is not None:
            self._estimator.learning.forget()
        return response

    def save(self, values: Values, response: Trigger.Response) -> Trigger.Response:
        """Answer the service: write a parameter file with the learned ζ and its error; the message has its path."""
        learning = self._estimator.learning
        learned = learning.strength() if learning is not None else None
        if learning is None or learned is None:
            response.message = f"not saved: {_OFF if learning is None else 'nothing was learned yet'}"
            return response
        strength, error = learned
        zeta = float(values["medium.zeta"]) * strength  # type: ignore[arg-type]
        new = {**values, "medium.zeta": zeta, "medium.zeta_error": min(error / strength, 2.0)}
        comment = "; ".join(["rft_node: medium.zeta learned from the load cell", *map(str, learning.doubts())])
        saved(response, "rft_medium_{}.yaml", lambda file: write_parameter_file(file, new, comment=comment))
        if response.success and learning.doubts():
            doubts = "; ".join(map(str, learning.doubts()))
            response.message += f" (doubtful, it was learned while {doubts}; then call ~/forget and learn again)"
        return response
