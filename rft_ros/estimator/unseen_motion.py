"""Watches for kinds of motion in the grains that the calibration of the medium did not have."""

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.motion import Motion
from rft_ros.rft import POSITION, QUATERNION, rotation_matrix
from rft_ros.rft.motion_kinds import LEAST_PATH, MOTIONS, kinds_of_motion
from rft_ros.tool import Tool

_STEP = 0.001  # path [m] over which a kind of motion is judged: noise of poses is far smaller


class UnseenMotion:
    """Follows one tool: how far it has gone in the grains by each kind of motion."""

    def __init__(self, tool: Tool) -> None:
        self._middle = tool.middle
        self._radius = 0.5 * tool.size
        self._paths = dict.fromkeys(MOTIONS, 0.0)
        self._leave()

    def _leave(self) -> None:
        self._path = 0.0
        self._place: NDArray[np.float64] | None = None
        self._rotation = np.eye(3)

    def follow(self, motion: Motion, *, in_grains: bool) -> None:
        """Add the motion to the next pose."""
        if not in_grains:
            self._leave()
            return
        self._path += motion.path
        if self._place is not None and self._path < _STEP:
            return
        rotation = rotation_matrix(motion.state[0, QUATERNION])
        place = motion.state[0, POSITION] + rotation @ self._middle
        if self._place is not None:
            cosine = 0.5 * (np.sum(rotation * self._rotation) - 1.0)
            angle = float(np.arccos(np.clip(cosine, -1.0, 1.0)))
            kind = str(
                kinds_of_motion((place - self._place)[None], np.array([self._radius * angle]))[0]
            )
            self._paths[kind] += self._path
        self._path = 0.0
        self._place = place
        self._rotation = rotation

    def sentences(self, calibrated: str) -> list[str]:
        """A sentence for each kind of motion that is not among the calibrated ones; none if these are not known."""
        if not calibrated:
            return []
        return [
            f"this {kind} is a kind of motion that the calibration did not have (medium.calibrated_motions:"
            f" {calibrated}): medium.zeta may be wrong for it, calibrate with a recording that has it"
            for kind, path in self._paths.items()
            if path > LEAST_PATH and kind not in calibrated
        ]
