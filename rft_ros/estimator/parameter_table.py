"""The one table of parameters: the node declares them, the replay reads them, the docs print them."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from rft_ros.rft import ALPHA_Y_MODELS, INTEGRATIONS, MEDIA

__all__ = ["PARAMETERS", "Parameter", "Value", "Values"]

Value = str | float | tuple[float, ...]
Values = Mapping[str, Value]
"""Of one parameter, in its own type; of all, by name."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One parameter: its type is that of its default. `low`, `high`: inclusive, for each number of it."""

    name: str
    default: Value
    unit: str
    description: str
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    applies: Literal["live", "restart"] = "live"

    @property
    def type(self) -> Literal["string", "double", "double_array"]:
        """The parameter's ROS type."""
        if isinstance(self.default, str):
            return "string"
        return "double" if isinstance(self.default, float) else "double_array"


_ZERO3 = (0.0, 0.0, 0.0)

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        name="mesh.file",
        default="plate",
        unit="",
        description="Tool mesh: a path, a package:// URI, or the name of a shipped mesh"
        " (plate, ellipsoid, root_tip, sphere, abb_plate).",
    ),
    Parameter(name="mesh.scale", default=0.001, unit="m", low=1e-9, high=1e6, description="Metres per mesh unit."),
    Parameter(
        name="mesh.origin",
        default=_ZERO3,
        unit="mesh units",
        description="Where the tool frame's origin lies, in mesh-file coordinates.",
    ),
    Parameter(
        name="medium.name",
        default="generic",
        unit="",
        choices=tuple(MEDIA),
        description="Medium whose measured stresses are used (Li et al. 2013).",
    ),
    Parameter(
        name="medium.zeta",
        default=1.0,
        unit="",
        low=1e-6,
        high=1e6,
        description="Scale factor of the medium, from calibration.",
    ),
    Parameter(
        name="medium.mobilization_length",
        default=0.0,
        unit="m",
        low=0.0,
        high=1e3,
        description="Path over which grains at a depth of 30 mm come to two thirds of their strength; 0.0: at once, as"
        " published. Over 0.0 the force holds while the tool rests; to begin with it takes a restart.",
    ),
    Parameter(
        name="medium.calibrated_depth",
        default=0.0,
        unit="m",
        low=0.0,
        high=1e3,
        description="Greatest depth of the calibration; deeper estimates are doubtful. 0.0: not known.",
    ),
    Parameter(
        name="alpha_y.model",
        default="constant",
        unit="",
        choices=ALPHA_Y_MODELS,
        description="Stress along the plate's horizontal direction e1.",
    ),
    Parameter(
        name="alpha_y.table",
        default="",
        unit="deg, N/cm3",
        description="CSV of beta, alpha_y or beta, gamma, alpha_y for alpha_y.model table.",
    ),
    Parameter(
        name="integration",
        default="refined",
        unit="",
        choices=INTEGRATIONS,
        description="Integration rule for plates: refined (exact where the surface cuts a plate, smooth at the leading"
        " edge, true to curved tools), or centroid (the published rule).",
    ),
    Parameter(
        name="tolerance",
        default=0.025,
        unit="",
        low=0.0,
        high=1.0,
        description="Reduce the tool to the fewest plates whose wrench stays within this share of the force, at the"
        " 95th percentile of any motion; 0.0: the full tool.",
    ),
    Parameter(
        name="surface_height",
        default=0.0,
        unit="m",
        low=-1e6,
        high=1e6,
        description="z of the undisturbed surface in world_frame.",
    ),
    Parameter(name="world_frame", default="world", unit="", description="frame_id of poses; z up."),
    Parameter(name="tool_frame", default="tool", unit="", description="Frame of the mesh; twists may be in its axes."),
    Parameter(
        name="sensor_frame",
        default="ft_sensor",
        unit="",
        description="frame_id of the load cell, and of all published wrenches.",
    ),
    Parameter(
        name="sensor.position",
        default=_ZERO3,
        unit="m",
        low=-1e3,
        high=1e3,
        description="Origin of sensor_frame in tool_frame.",
    ),
    Parameter(
        name="sensor.quaternion",
        default=(0.0, 0.0, 0.0, 1.0),
        unit="xyzw",
        description="Orientation of sensor_frame in tool_frame, unit length.",
    ),
    Parameter(
        name="sensor.sign",
        default=1.0,
        unit="",
        low=-1.0,
        high=1.0,
        description="1.0: the driver reports the force on the tool; -1.0: the force by the tool.",
    ),
    Parameter(
        name="sensor.bias",
        default=(0.0,) * 6,
        unit="N, N m",
        low=-1e6,
        high=1e6,
        description="What the driver reports with nothing attached: fx, fy, fz, tx, ty, tz.",
    ),
    Parameter(
        name="sensor.mass",
        default=0.0,
        unit="kg",
        low=0.0,
        high=1e3,
        description="Mass that hangs below the load cell.",
    ),
    Parameter(
        name="sensor.center_of_mass",
        default=_ZERO3,
        unit="m",
        low=-1e3,
        high=1e3,
        description="Centre of that mass in sensor_frame.",
    ),
    Parameter(
        name="twist_source",
        default="topic",
        unit="",
        choices=("topic", "pose_difference"),
        description="Velocity from ~/twist, or from the last poses.",
    ),
    Parameter(
        name="twist_window",
        default=0.05,
        unit="s",
        low=1e-4,
        high=1.0,
        description="Span of poses that pose_difference fits a line to.",
    ),
    Parameter(
        name="max_input_age",
        default=0.1,
        unit="s",
        low=1e-6,
        high=1e6,
        description="Greatest difference between a pose's stamp and those of the twist and wrench used with it.",
    ),
    Parameter(
        name="max_rate",
        default=0.0,
        unit="Hz",
        low=0.0,
        high=1e6,
        description="Answer at most this often; 0.0: every pose.",
    ),
    Parameter(
        name="rest_speed",
        default=2e-4,
        unit="m/s",
        low=0.0,
        high=1e3,
        description="Below this speed of its fastest point a tool in the grains is at rest: no estimate.",
    ),
    Parameter(
        name="executor",
        default="single",
        unit="",
        choices=("single", "events"),
        applies="restart",
        description="rclpy executor: single-threaded, or the experimental one with half its latency.",
    ),
)
"""Every parameter, in the order in which they are documented."""
