"""How the node reports what it learned of the medium: a topic, log lines, and a parameter file."""

from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

from rft_ros.errors import InputError
from rft_ros.estimator import Estimate, Estimator
from rft_ros.estimator.learning import BeliefIssue, Learning, Surprise
from rft_ros.node.services import save
from rft_ros.parameters import Values, write_parameter_file

_PERIOD = 20_000_000  # ns, of the topic
_NAMES = ["vertical_strength", "horizontal_strength", "turn", "surface", "surprise"]


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
        belief = learning.belief()
        message = JointState(name=_NAMES)
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(estimate.stamp, 1_000_000_000)
        message.position = [getattr(belief, name) for name in _NAMES]
        message.effort = [*(getattr(belief, f"{name}_error") for name in _NAMES[:4]), 1.0]
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

    def forget(self) -> str:
        """Go back to the calibration. Raises InputError where nothing is learned."""
        self._learning("nothing to forget").forget()
        return "back to the calibration"

    def save(self, values: Values) -> str:
        """Write `values` with the learned ζ and its error to a parameter file and return its path, or InputError."""
        learning = self._learning("not saved")
        if (learned := learning.strength()) is None:
            raise InputError("not saved: nothing was learned yet")
        strength, error = learned
        zeta = float(values["medium.zeta"]) * strength  # type: ignore[arg-type]
        new = {**values, "medium.zeta": zeta, "medium.zeta_error": min(error / strength, 2.0)}
        doubts = "; ".join(map(str, learning.doubts()))
        comment = "; ".join(filter(None, ["rft_node: medium.zeta learned from the load cell", doubts]))
        path = save("rft_medium_{}.yaml", lambda file: write_parameter_file(file, new, comment=comment))
        advice = f" (doubtful, it was learned while {doubts}; then call ~/forget and learn again)"
        return path + (advice if doubts else "")

    def _learning(self, refusal: str) -> Learning:
        if self._estimator.learning is None:
            raise InputError(f"{refusal}: learning.mode is off")
        return self._estimator.learning
