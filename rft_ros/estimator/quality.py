"""Quality flags of estimates, the bounds by which they are set, and the trust that they leave."""

import math
from collections.abc import Callable
from enum import Enum, IntFlag, unique

from rft_ros.estimator.load_cell import GRAVITY
from rft_ros.estimator.motion import Motion
from rft_ros.estimator.pose_noise import NOISY
from rft_ros.ground import LocalSurface
from rft_ros.parameters import MediumConfig
from rft_ros.rft import SpeedLimits
from rft_ros.rft.frames import Vector
from rft_ros.rft.grains import WITH_INERTIA, WITHOUT_INERTIA
from rft_ros.tool import MAX_TOOL_SIZE_M, MIN_TOOL_SIZE_M, Tool

# more than that of any arm, and than the breakout force of an excavator of 50 t
_MAX_FORCE_N = 5e5
_MAX_HEIGHT_M = 50.0  # greatest plausible height of a tool frame above the surface
_MAX_DEPTH_M = (
    0.3  # greatest plausible depth, plus the next number times the tool's largest extent
)
_DEPTH_OVER_SIZE_RATIO = 10.0  # small probes go deep


def _max_depth(tool: Tool) -> float:
    """The greatest plausible depth of the tool's lowest point [m]."""
    return _MAX_DEPTH_M + _DEPTH_OVER_SIZE_RATIO * tool.size


def _is_plausible(tool: Tool) -> bool:
    """Whether a tool of this size can move through grains on an arm."""
    return MIN_TOOL_SIZE_M <= tool.size <= MAX_TOOL_SIZE_M


TOUCH_DEPTH_M = 1e-3
"""Depth from which on a tool is in the grains, beyond the noise of a pose at the surface."""


def begins_in_grains(depth: float) -> str:
    """A sentence on a first estimate that is at this depth in the grains [m]."""
    advice = (
        "if the tool was in the air there, check mesh.origin, mesh.quaternion and surface_height"
    )
    return f"the first estimate is {1e3 * depth:.1f} mm deep in the grains: {advice}"


def sentence_on(tool: Tool, *, depth: float, force: float) -> str:
    """A sentence on what is implausible, or "". `depth`: of the tool's lowest point [m], negative in the air.

    `force`: on the tool [N].
    """
    if depth > _max_depth(tool):
        return (
            f"the tool's lowest point is {depth:g} m deep, {depth / tool.size:,.0f} times the tool's size; poses and"
            " surface_height are in metres: are these in millimetres?"
        )
    if not _is_plausible(tool):
        return (
            f"the tool's largest extent is {tool.size:g} m; mesh.scale (--scale) is in metres per mesh unit, 0.001 for"
            " a mesh in millimetres"
        )
    if depth < -_MAX_HEIGHT_M:
        return (
            f"the tool is {-depth:g} m above the grains; poses and surface_height are in metres: are these in"
            " millimetres?"
        )
    if force > _MAX_FORCE_N:
        return (
            f"the force is {force:g} N, more than any arm's; poses are in metres and mesh.scale (--scale) is in metres"
            " per mesh unit: is one of them in millimetres?"
        )
    return ""


# Kumar et al., arXiv:1712.09057: drag depends on the speed from v / sqrt(g D) = 0.35 on
_MAX_FROUDE_RATIO = 0.4
# across the tool; with fewer the force rises: Paume et al., doi:10.1039/D3SM01242E
_MIN_GRAIN_COUNT = 5.0
_NEAR_REST_FACTOR = 5.0  # times rest_speed
# kinds of issues that are no fault of the mesh
_HARMLESS = {"concave", "size", "degenerate_facets"}
_DEEP_FACTOR = (
    1.02  # times the calibrated depth, so that the bag of the calibration is not flagged
)
_STEEP_DEG = 15.0
_STEEP_SLOPE = math.tan(math.radians(_STEEP_DEG))
_UNEVEN_SHARE = 0.25  # of the depth


@unique
class QualityFlag(IntFlag):
    """Known causes of error that apply to an estimate; `docs/where-it-fails.md` shows most of them."""

    sentence: str

    def __new__(cls, value: int, sentence: str = "") -> "QualityFlag":
        """A flag with a sentence on what it means for an estimate."""
        flag = int.__new__(cls, value)
        flag._value_ = value
        flag.sentence = sentence
        return flag

    @property
    def label(self) -> str:
        """The flag's name in outputs, such as ``fast``."""
        return str(self.name).lower()

    NONE = 0
    FAST = (
        1,
        f"faster than the model was checked: over {WITHOUT_INERTIA.checked:g} m/s without medium.density, or over"
        f" {WITH_INERTIA.checked:g} m/s with it",
    )
    INERTIAL = (
        2,
        f"without medium.density over {WITHOUT_INERTIA.inertial:g} m/s, or over a Froude number of"
        f" {_MAX_FROUDE_RATIO:g} of the tool's width: the grains' inertia matters; or with it over"
        f" {WITH_INERTIA.inertial:g} m/s: the modelled inertia was not checked",
    )
    NEAR_REST = 4, "so slow that noise decides the direction of the motion"
    CONCAVE = (
        16,
        "a hollow tool: the model computes each facet as if no other were near; rft check-mesh says whether to set"
        " mesh.hull",
    )
    WITHDRAWAL = (
        32,
        "the tool moves up: the force of real grains vanishes sooner than the predicted one",
    )
    DEEP = 128, "deeper than medium.calibrated_depth"
    SURPRISE = 256, "the grains are harder or softer than the filter has estimated"
    STEEP = 512, f"the ground is tilted by over {_STEEP_DEG:g} degrees"
    UNEVEN = (
        1024,
        f"the ground departs from the plane under the tool by over {100.0 * _UNEVEN_SHARE:g} % of the depth (RMS)",
    )
    DISAGREEMENT = (
        2048,
        "the load cell reads a force in the air, or one that no strength of the grains explains: rft doctor names the"
        " fault",
    )
    MESH = (
        4096,
        "the mesh has faults, such as repeated or inverted facets, that make the force wrong",
    )
    IMPOSSIBLE = (
        8192,
        f"not plausible: deeper than {_MAX_DEPTH_M:g} m + {_DEPTH_OVER_SIZE_RATIO:g} times the tool's size, over"
        f" {_MAX_HEIGHT_M:g} m above the grains, a tool over {MAX_TOOL_SIZE_M:g} m or under"
        f" {1e3 * MIN_TOOL_SIZE_M:g} mm, or a force over {1e-3 * _MAX_FORCE_N:g} kN, as with poses in millimetres or a"
        " wrong mesh.scale",
    )
    NOISY = (
        16384,
        f"the poses have a noise of over {1e3 * NOISY:g} mm at the tool's farthest point: forces come late",
    )
    FEW_GRAINS = (
        32768,
        f"the tool's width is under {_MIN_GRAIN_COUNT:g} times medium.grain_diameter: the force of real grains is"
        " larger and varies more",
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


class QualityMonitor:
    """Sets the quality flags of one tool's estimates."""

    def __init__(self, tool: Tool) -> None:
        issues = tool.issues.keys()
        self._reach = tool.plates.reach
        self._max_depth = _max_depth(tool)
        self._width = tool.width
        self._max_speed = _MAX_FROUDE_RATIO * math.sqrt(GRAVITY * self._width)
        self._is_plausible = _is_plausible(tool)
        self._mesh_flags = _joined(concave="concave" in issues, mesh=bool(issues - _HARMLESS))

    def flags(
        self,
        motion: Motion,
        surface: LocalSurface,
        medium: MediumConfig,
        limits: SpeedLimits,
        *,
        rest_speed: float,
        force: Vector,
        in_grains: bool,
        depth: Callable[[], float],
        is_withdrawn: bool,
        surprises: bool,
        disagrees: bool,
    ) -> int:
        """Flags of the next estimate: bitwise or of `QualityFlag`.

        `rest_speed` [m/s]: the tool rests below it. `force`: of the model [N]. `depth`: returns the depth of the lowest
        point [m]; called only if needed. `is_withdrawn`: the tool is pulled out. `surprises`: the force is not the
        expected one. `disagrees`: there are issues of the load cell or the model.
        """
        speed = motion.speed_bound
        x, y, z = motion.pose.position
        height = surface.height + surface.slope[0] * x + surface.slope[1] * y
        origin_depth = height - z  # of the tool frame's origin
        if not in_grains:
            return _joined(
                surprise=surprises,
                disagreement=disagrees,
                impossible=origin_depth < -_MAX_HEIGHT_M,
            )
        greatest_depth = origin_depth + self._reach  # the exact depth takes longer to compute

        def is_below(limit: float) -> bool:
            return greatest_depth > limit and depth() > limit

        calibrated_depth = medium.calibrated_depth
        grain = medium.grain_diameter
        return self._mesh_flags | _joined(
            surprise=surprises,
            disagreement=disagrees,
            deep=calibrated_depth is not None and is_below(_DEEP_FACTOR * calibrated_depth),
            few_grains=grain is not None and self._width < _MIN_GRAIN_COUNT * grain,
            impossible=is_below(self._max_depth)
            or not self._is_plausible
            or math.hypot(*force) > _MAX_FORCE_N,
            noisy=motion.is_noisy,
            withdrawal=is_withdrawn,
            inertial=speed > limits.inertial
            or (limits == WITHOUT_INERTIA and speed > self._max_speed),
            fast=speed > limits.checked,
            near_rest=speed < min(_NEAR_REST_FACTOR * rest_speed, limits.checked),
            steep=math.hypot(*surface.slope) > _STEEP_SLOPE,
            uneven=surface.roughness > _UNEVEN_SHARE * surface.depth,
        )


_VALUES = {flag.label: flag.value for flag in QualityFlag}


def _joined(**conditions: bool) -> int:
    """The flags with these labels whose condition holds, as an integer: `QualityFlag`s take a microsecond to join."""
    return sum([_VALUES[label] for label, holds in conditions.items() if holds])
