"""The node's services, all of type std_srvs/Trigger, and the files that some of them write."""

import os
from collections.abc import Callable
from datetime import datetime, timezone
from functools import partial
from pathlib import Path

import numpy as np
from rclpy.node import Node
from std_srvs.srv import Trigger

from rft_ros.errors import InputError
from rft_ros.estimator import Estimator
from rft_ros.estimator.learning import Learning
from rft_ros.estimator.tare import silent
from rft_ros.ground import write_height_map
from rft_ros.node.node_parameters import NodeParameters
from rft_ros.parameters import write_parameter_file

_TARE_WINDOW = 1.0  # s
_NO_GROUND = "the ground is a level plane; set ground.cell"


class Services:
    """Answers each service with a sentence. An InputError becomes an answer without success."""

    def __init__(
        self,
        node: Node,
        estimator: Estimator,
        parameters: NodeParameters,
        *,
        status: Callable[[], str],
        silence: Callable[[str], float],
    ) -> None:
        """`silence`: the time since the last message of a role [s]."""
        self._estimator = estimator
        self._silence = silence
        self._parameters = parameters
        answers = {
            "tare": self._tare,
            "status": status,
            "forget": self._forget,
            "save_medium": self._save_medium,
            "level_ground": self._level_ground,
            "save_ground": self._save_ground,
        }
        for name, answer in answers.items():
            node.create_service(Trigger, f"~/{name}", partial(_respond, answer))

    def _tare(self) -> str:
        for role, what in {"pose": "poses", "wrench": "load-cell samples"}.items():
            if self._silence(role) > _TARE_WINDOW:
                raise InputError(silent(what, self._silence(role)))
        bias = self._estimator.tare(_TARE_WINDOW)
        self._parameters.set_all({"sensor.bias": bias}, why="tare")
        return "sensor.bias set to [" + ", ".join(f"{b:.6g}" for b in bias) + "] N, N m"

    def _learning(self) -> Learning:
        if self._estimator.learning is None:
            raise InputError("learning is not active; set learning.mode to observe or apply")
        return self._estimator.learning

    def _forget(self) -> str:
        self._learning()
        self._estimator.forget()
        return "back to the calibration"

    def _save_medium(self) -> str:
        """Save all parameters, with the learned ζ and its standard error."""
        learning = self._learning()
        learned = learning.strength()
        if learned is None:
            raise InputError("not saved: nothing was learned yet")
        strength, error = learned
        config = self._parameters.config
        learned_values = {
            "medium.zeta": strength * config.medium.zeta,
            "medium.zeta_error": min(error / strength, 2.0),
        }
        doubts = [f"doubtful, since {issue}" for issue in self._estimator.issues()]
        comment = "; ".join(["rft_node: medium.zeta learned from the load cell", *doubts])
        file = _new_file("rft_medium_{}.yaml")
        write_parameter_file(file, config.changed(learned_values), comment=comment)
        return "; ".join([str(file), *doubts])

    def _level_ground(self) -> str:
        if not self._estimator.level_ground():
            raise InputError(_NO_GROUND)
        return "ground as at the start"

    def _save_ground(self) -> str:
        ground = self._estimator.ground
        if ground is None:
            raise InputError(f"not saved: {_NO_GROUND}")
        if np.isnan(ground.heights).all():
            raise InputError("not saved: no height is known yet")
        # Not in a thread, so that the answer says whether it succeeded. The largest map takes 10 ms.
        file = _new_file("rft_ground_{}.npz")
        write_height_map(file, ground)
        return str(file)


def _respond(
    answer: Callable[[], str], _request: Trigger.Request, response: Trigger.Response
) -> Trigger.Response:
    try:
        response.message = answer()
        response.success = True
    except InputError as error:
        response.message = str(error)
    return response


def _new_file(name: str) -> Path:
    """A new file in $ROS_HOME or ~/.ros; {} in `name` becomes the time."""
    # Not ROS time: simulated time begins at zero in every run, and names would repeat.
    moment = datetime.now(timezone.utc).strftime("%Y%m%dT%H%M%S.%f")
    return Path(os.environ.get("ROS_HOME") or Path.home() / ".ros") / name.format(moment)
