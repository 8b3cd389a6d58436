"""Watches for kinds of motion in the grains that the calibration of the medium did not have."""

from rft_ros.estimator.motion import Motion
from rft_ros.rft.frames import Placement
from rft_ros.rft.motion_kinds import LEAST_PATH, MOTIONS, kind_between
from rft_ros.tool import Tool

_JUDGED_PATH_M = 0.001  # path over which a kind of motion is judged: noise of poses is far smaller


class UnseenMotion:
    """Follows one tool: how far it has gone in the grains by each kind of motion."""

    def __init__(self, tool: Tool) -> None:
        self._middle = Placement(tool.middle)
        self._radius = 0.5 * tool.size
        self._paths = dict.fromkeys(MOTIONS, 0.0)
        self._path = 0.0  # since the last place
        self._last: Placement | None = None  # of the tool's middle; None in the air

    def follow(self, motion: Motion, *, in_grains: bool) -> None:
        """Add the motion to the next pose."""
        if not in_grains:
            self._last = None
            return
        self._path += motion.path
        if self._last is not None and self._path < _JUDGED_PATH_M:
            return
        place = motion.pose.place.of(self._middle)
        if self._last is not None:
            kind = kind_between(self._last, place, radius=self._radius)
            self._paths[kind] += self._path
        self._path = 0.0
        self._last = place

    def sentences(self, calibrated_motions: str) -> list[str]:
        """A sentence for each kind of motion that is not among the calibrated ones; none if these are not known."""
        if not calibrated_motions:
            return []
        known_kinds = {kind.strip() for kind in calibrated_motions.split(",")}
        return [
            f"this {kind} is a kind of motion that the calibration did not have (medium.calibrated_motions:"
            f" {calibrated_motions}): medium.zeta may be wrong for it, calibrate with a recording that has it"
            for kind, path in self._paths.items()
            if path > LEAST_PATH and kind not in known_kinds
        ]
