"""Quality flags of estimates, and the trust that they leave in an estimate."""

import math
from collections.abc import Callable
from enum import Enum, IntFlag, unique

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.learning import Learning
from rft_ros.estimator.learning.surprise import AIR_SAMPLES, ISSUES, OFFSET, OFFSET_LEAST, OFFSET_SHARE
from rft_ros.estimator.motion import Motion
from rft_ros.estimator.plausible import HIGHEST, LARGEST_FORCE, deepest, is_plausible_tool
from rft_ros.estimator.samples import Vector
from rft_ros.ground import LocalSurface
from rft_ros.parameters import Settings
from rft_ros.rft import POSITION, QUATERNION, SpeedLimits, edge_share, rotation_matrix
from rft_ros.tool import Tool

Array = NDArray[np.float64]

__all__ = ["QualityFlag", "QualityMonitor", "ReadingInAir", "Trust", "flag_names", "sentences", "trust"]


@unique
class QualityFlag(IntFlag):
    """Known causes of error that apply to an estimate; `docs/where-it-fails.md` shows most of them."""

    sentence: str

    def __new__(cls, value: int, sentence: str = "") -> "QualityFlag":
        """A flag with a sentence on what it means for an estimate."""
        flag = int.__new__(cls, value)
        flag._value_, flag.sentence = value, sentence
        return flag

    @property
    def label(self) -> str:
        """The flag's name in outputs, such as ``fast``."""
        return str(self.name).lower()

    NONE = 0
    FAST = 1, "faster than the speed up to which the model was checked (0.025 m/s, or 1 m/s with medium.density)"
    INERTIAL = (
        2,
        "so fast that the grains' inertia matters (over 0.2 m/s), or with medium.density over 1 m/s, where the modelled"
        " inertia was not checked",
    )
    NEAR_REST = 4, "so slow that noise decides the direction of the motion"
    WAKE = 8, "in the wake of its own motion, where the grains are looser"
    CONCAVE = 16, "a hollow tool: the model computes each facet as if no other facet were near"
    WITHDRAWAL = 32, "the tool moves up: the force of real grains vanishes sooner than the predicted one"
    KNIFE_EDGE = 64, "faces move nearly along themselves: an error of one degree changes the force by a tenth or more"
    DEEP = 128, "deeper than medium.calibrated_depth"
    SURPRISE = 256, "the grains are harder or softer than the filter has estimated"
    STEEP = 512, "the ground is tilted by over 15 degrees"
    UNEVEN = 1024, "the ground departs from the plane under the tool by over a quarter of the depth (RMS)"
    DISAGREEMENT = (
        2048,
        "the load cell's readings are not plausible, or the model is wrong; /diagnostics or the report names the fault",
    )
    MESH = 4096, "the mesh has faults, such as repeated or inverted facets, that make the force wrong"
    IMPOSSIBLE = (
        8192,
        "not plausible: deeper than 0.3 m + 10 times the tool's size, over 50 m above the grains, a tool over 10 m or"
        " under 1 mm, or a force over 500 kN, as with poses in millimetres or a wrong mesh.scale",
    )


class Trust(str, Enum):
    """Trust in an estimate."""

    OK = "OK"
    CAUTION = "CAUTION"
    NO = "NO"


_NO_TRUST = QualityFlag.INERTIAL | QualityFlag.IMPOSSIBLE


def trust(quality_flags: int) -> Trust:
    """The trust in an estimate with these flags, a bitwise or of `QualityFlag`."""
    if quality_flags & _NO_TRUST:
        return Trust.NO
    return Trust.CAUTION if quality_flags else Trust.OK


def flag_names(quality_flags: int) -> list[str]:
    """The labels of the flags."""
    return [flag.label for flag in QualityFlag if quality_flags & flag]


def sentences(quality_flags: int) -> str:
    """A description of each flag, joined by semicolons."""
    return "; ".join(flag.sentence for flag in QualityFlag if quality_flags & flag)


_NEAR_REST_FACTOR = 5.0  # times rest_speed
_HARMLESS = {"concave", "size", "degenerate_facets"}  # kinds of issues that are no fault of the mesh
_EDGE_SHARE = 0.4  # of the submerged area; the narrow sides of a plate that moves straight down have less
_DEEPER = 1.02  # times the calibrated depth, so that the bag of the calibration is not flagged
_STEEP_SLOPE = math.tan(math.radians(15.0))
_UNEVEN_SHARE = 0.25  # of the depth
_EVERY = 8  # estimates between two evaluations of the slow flags


class ReadingInAir:
    """The mean compensated force in the air, where a tared cell reads nothing; for an estimator that does not learn."""

    def __init__(self) -> None:
        self._greatest = 0.0  # of the model's forces so far [N]
        self.forget()

    def forget(self) -> None:
        """Drop the readings so far: the load cell was tared, or has other settings."""
        self._mean, self._count = (0.0, 0.0, 0.0), 0

    def add_in_grains(self, predicted: Vector) -> None:
        """Add the model's force in the grains [N]."""
        self._greatest = max(self._greatest, math.hypot(*predicted))

    def add_in_air(self, measured: Vector) -> None:
        """Add a compensated force in the air [N], world axes."""
        self._count = n = min(self._count + 1, AIR_SAMPLES)
        (x, y, z), (a, b, c) = self._mean, measured
        self._mean = x + (a - x) / n, y + (b - y) / n, z + (c - z) / n

    def issues(self) -> list[str]:
        """The issue `OFFSET` if the load cell reads a force in the air; otherwise none."""
        if 2 * self._count < AIR_SAMPLES:
            return []
        has_offset = math.hypot(*self._mean) > max(OFFSET_LEAST, OFFSET_SHARE * self._greatest)
        return [ISSUES[OFFSET]] if has_offset else []


class QualityMonitor:
    """Sets the quality flags of one tool's successive estimates.

    They are joined as integers: an operation on two `QualityFlag`s takes a microsecond.
    """

    def __init__(self, tool: Tool) -> None:
        self._plates, self._path, self._deepest = tool.plates, _Path(tool), deepest(tool)
        self._of_tool = 0
        if "concave" in tool.issues:
            self._of_tool |= QualityFlag.CONCAVE.value
        if tool.issues.keys() - _HARMLESS:
            self._of_tool |= QualityFlag.MESH.value
        if not is_plausible_tool(tool):
            self._of_tool |= QualityFlag.IMPOSSIBLE.value
        self._countdown = self._slow = 0

    def flags(
        self,
        motion: Motion,
        surface: LocalSurface,
        settings: Settings,
        limits: SpeedLimits,
        *,
        force: Vector,
        in_grains: bool,
        depth: Callable[[], float],
        withdrawn: bool,
        learning: Learning | None,
    ) -> int:
        """Flags of the next estimate: bitwise or of `QualityFlag`.

        `force`: of the model [N]. `depth`: returns the depth of the lowest point [m]; called only if needed.
        `withdrawn`: `Withdrawal.active`.
        """
        f = QualityFlag
        flags = 0 if learning is None else _flags_of_learning(learning)
        x, y, z = motion.pose.position
        height = surface.height + surface.slope[0] * x + surface.slope[1] * y
        origin_depth = height - z  # of the tool frame's origin
        if not in_grains:
            self._path.clear()
            self._countdown = 0
            if origin_depth < -HIGHEST:
                flags |= f.IMPOSSIBLE.value
            return flags
        # the lowest point is at most `reach` below the origin; its exact depth takes longer to compute
        may_be_deep = origin_depth + self._plates.reach > self._deepest
        if math.hypot(*force) > LARGEST_FORCE or (may_be_deep and depth() > self._deepest):
            flags |= f.IMPOSSIBLE.value
        if withdrawn:
            flags |= f.WITHDRAWAL.value
        flags |= _flags_of_speed(motion.speed_bound, limits, settings.rest_speed) | _flags_of_ground(surface)
        if self._countdown == 0:
            self._countdown = _EVERY
            self._slow = self._slow_flags(motion.state[0], height, settings.calibrated_depth, depth)
        self._countdown -= 1
        return flags | self._slow

    def _slow_flags(
        self, state: Array, height: float, calibrated_depth: float | None, depth: Callable[[], float]
    ) -> int:
        """The flags that take long to find, and change slowly. `height` of the surface at the tool frame [m]."""
        f, flags = QualityFlag, self._of_tool
        self._path.extend(state)
        if self._path.crosses_itself:
            flags |= f.WAKE.value
        if calibrated_depth is not None and depth() > _DEEPER * calibrated_depth:
            flags |= f.DEEP.value
        if edge_share(self._plates, state, surface_height=float(height)) > _EDGE_SHARE:
            flags |= f.KNIFE_EDGE.value
        return flags


def _flags_of_learning(learning: Learning) -> int:
    flags = 0
    if learning.surprise:
        flags |= QualityFlag.SURPRISE.value
    if learning.disagrees:
        flags |= QualityFlag.DISAGREEMENT.value
    return flags


def _flags_of_speed(speed: float, limits: SpeedLimits, rest_speed: float) -> int:
    if speed > limits.inertial:
        return QualityFlag.FAST.value | QualityFlag.INERTIAL.value
    if speed > limits.checked:
        return QualityFlag.FAST.value
    return QualityFlag.NEAR_REST.value if speed < _NEAR_REST_FACTOR * rest_speed else 0


def _flags_of_ground(surface: LocalSurface) -> int:
    if math.isnan(surface.depth):  # the ground is a level plane
        return 0
    flags = 0
    if math.hypot(*surface.slope) > _STEEP_SLOPE:
        flags |= QualityFlag.STEEP.value
    if surface.roughness > _UNEVEN_SHARE * surface.depth:
        flags |= QualityFlag.UNEVEN.value
    return flags


class _Path:
    """The path of the tool's centre since it entered the grains, and whether the tool returns to it.

    On a straight path the distance from an earlier place equals the path length since. The tool passes the same grains
    again where, two or more widths of path later, the distance is below `_BENT` times that length and below two widths
    of the tool. This flags a root tip's helix of 20 mm pitch, where the measured forces deviate, but not one of 40 mm
    (Treers et al. 2021, V-B).
    """

    _KEPT = 512
    _BENT = 0.85

    def __init__(self, tool: Tool) -> None:
        columns = tool.corners.T  # one by one: numpy takes 6 ms for 170,000 rows of three
        low, high = np.array([c.min() for c in columns]), np.array([c.max() for c in columns])
        self._centre, self._width = 0.5 * (low + high), float(np.median(high - low))
        self._places, self._lengths = np.zeros((self._KEPT, 3)), np.zeros(self._KEPT)  # of the path until there
        self.clear()

    def clear(self) -> None:
        """Clear the path. The tool has left the grains, which fill its traces."""
        self._count, self._length = 0, 0.0
        self.crosses_itself = False
        """Whether the tool crosses its earlier path."""

    def extend(self, state: Array) -> None:
        """Add the next state, shape [13]."""
        place = state[POSITION] + rotation_matrix(state[QUATERNION]) @ self._centre
        if self._count:
            step = math.dist(place, self._places[(self._count - 1) % self._KEPT])
            if step < self._width / 8.0:
                return
            self._length += step
        self._places[self._count % self._KEPT] = place
        self._lengths[self._count % self._KEPT] = self._length
        self._count += 1
        since = self._length - self._lengths[: self._count]
        apart = np.linalg.norm(self._places[: self._count] - place, axis=1)
        near = (since >= 2.0 * self._width) & (apart < 2.0 * self._width) & (apart < self._BENT * since)
        self.crosses_itself = bool(near.any())
