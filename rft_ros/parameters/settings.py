"""The estimator's settings, the load cell, and the model of tool and grains: values that do not change."""

from dataclasses import dataclass, field, replace
from typing import Literal

from rft_ros.errors import InputError
from rft_ros.ground import HeightMap
from rft_ros.parameters.parameter import setting
from rft_ros.rft import Law, described
from rft_ros.rft.frames import Placement, Quaternion, Vector, Wrench
from rft_ros.rft.motion_kinds import MOTIONS
from rft_ros.tool import Tool

CALIBRATED_ERROR = 0.15
"""Relative standard error that a ζ from a calibration is taken to have, if the calibration does not say."""

_UNCALIBRATED_ERROR = 1.0
"""The same for a ζ that may be no calibration at all: wide enough to learn any grains from ζ = 1 within centimetres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadCell:
    """The load cell's mounting, sign and bias, and the mass attached to it: the parameters ``sensor.*``."""

    position: Vector = setting(
        "sensor.position",
        (0.0, 0.0, 0.0),
        "Origin of sensor_frame in tool_frame.",
        "m",
        (-1e3, 1e3),
    )
    quaternion: Quaternion = setting(
        "sensor.quaternion",
        (0.0, 0.0, 0.0, 1.0),
        "Orientation of sensor_frame in tool_frame, unit length.",
        "xyzw",
        kind="quaternion",
    )
    sign: float = setting(
        "sensor.sign",
        1.0,
        "1.0: the driver reports the force that acts on the tool. -1.0: the force with which the tool pushes.",
        bounds=(-1.0, 1.0),
        kind="sign",
    )
    bias: Wrench = setting(
        "sensor.bias",
        (0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        "Reading of the load cell without load: fx, fy, fz, tx, ty, tz.",
        "N, N m",
        (-1e6, 1e6),
    )
    mass: float = setting(
        "sensor.mass", 0.0, "Mass that hangs below the load cell.", "kg", (0.0, 1e3)
    )
    center_of_mass: Vector = setting(
        "sensor.center_of_mass",
        (0.0, 0.0, 0.0),
        "Centre of that mass in sensor_frame.",
        "m",
        (-1e3, 1e3),
    )
    delay: float = setting(
        "sensor.delay",
        0.0,
        "How much later than the poses' stamps those of the load cell are for one event; negative: earlier.",
        "s",
        (-10.0, 10.0),
    )

    @property
    def place(self) -> Placement:
        """The sensor frame in the tool frame."""
        return Placement(self.position, self.quaternion)

    def at(self, place: Placement) -> "LoadCell":
        """The same load cell at another place in the tool frame."""
        return replace(self, position=place.position, quaternion=place.quaternion)


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """The estimator's settings: parameters of the node, in m, s, m/s and Hz.

    `calibrated_depth`, `grain_diameter` and `zeta_error` are None if they are not known; the parameter is 0 then.
    Raises InputError if they are not positive, and if `world_frame` and `tool_frame` have the same name, because the
    frame_id of a twist then does not say in which axes the twist is.
    """

    load_cell: LoadCell = field(default_factory=LoadCell)
    zeta_error: float | None = setting(
        "medium.zeta_error",
        0.0,
        "Relative standard error of medium.zeta. 0.0: not known.",
        bounds=(0.0, 2.0),
        is_optional=True,
    )
    calibrated_depth: float | None = setting(
        "medium.calibrated_depth",
        0.0,
        "Greatest depth reached in the calibration. Estimates at greater depth get the flag deep. 0.0: not known.",
        "m",
        (0.0, 1e3),
        is_optional=True,
    )
    grain_diameter: float | None = setting(
        "medium.grain_diameter",
        0.0,
        "Mean diameter of the grains. Estimates with a tool under five grains wide get the flag few_grains. 0.0: not "
        "known.",
        "m",
        (0.0, 1.0),
        is_optional=True,
    )
    calibrated_motions: str = setting(
        "medium.calibrated_motions",
        "",
        f"Kinds of motion that the calibration had, with commas: {', '.join(MOTIONS)}. Another kind is reported once. "
        "Empty: not known.",
        kind="motions",
    )
    learning_mode: Literal["off", "observe", "apply"] = setting(
        "learning.mode",
        "off",
        "Estimate the medium from the load cell. observe: only report the estimates. apply: also correct the "
        "predictions.",
    )
    learning_lag: float = setting(
        "learning.lag",
        0.002,
        "Path of the tool between a load-cell sample and the first prediction that uses it.",
        "m",
        (1e-5, 1.0),
    )
    surface_height: float = setting(
        "surface_height",
        0.0,
        "z of the undisturbed surface in world_frame.",
        "m",
        (-1e6, 1e6),
        option="surface_height",
    )
    world_frame: str = setting("world_frame", "world", "frame_id of poses; z up.")
    tool_frame: str = setting(
        "tool_frame", "tool", "Frame of the mesh; twists may be in its axes."
    )
    sensor_frame: str = setting(
        "sensor_frame", "ft_sensor", "frame_id of the load cell, and of all published wrenches."
    )
    sensor_source: Literal["parameters", "tf", "world"] = setting(
        "sensor.frame_source",
        "parameters",
        "Source of the sensor's place on the tool. parameters: sensor.position and sensor.quaternion. tf: fixed "
        "transforms. world: as parameters, but the readings are in the axes of world_frame, whatever their "
        "frame_id says.",
    )
    pose_source: Literal["topic", "tf"] = setting(
        "pose_source",
        "topic",
        "Source of the pose. topic: ~/pose. tf: the transforms of TF.",
        applies="restart",
    )
    tf_rate: float = setting(
        "tf_rate",
        0.0,
        "Rate of the poses from TF. 0.0: a pose at each stamp of the load cell.",
        "Hz",
        (0.0, 1e4),
    )
    twist_source: Literal["topic", "pose_difference"] = setting(
        "twist_source",
        "topic",
        "Source of the velocity. topic: ~/twist. pose_difference: computed from the last poses.",
    )
    twist_window: float = setting(
        "twist_window",
        0.2,
        "Longest span of poses to which pose_difference fits a curve.",
        "s",
        (1e-4, 1.0),
    )
    max_input_age: float = setting(
        "max_input_age",
        0.1,
        "Greatest time between a pose and another sample that is used with it.",
        "s",
        (1e-6, 1e6),
    )
    max_rate: float = setting(
        "max_rate",
        0.0,
        "Highest rate of estimates. 0.0: an estimate at every pose.",
        "Hz",
        (0.0, 1e6),
    )
    rest_speed: float = setting(
        "rest_speed",
        2e-4,
        "A tool that is slower than this is at rest, and may be tared. If the model has no memory and the tool is "
        "in the grains, there is no estimate.",
        "m/s",
        (0.0, 1e3),
    )

    def __post_init__(self) -> None:
        if self.world_frame == self.tool_frame:
            raise InputError(
                f"world_frame and tool_frame are both '{self.tool_frame}'; name two different frames"
            )
        for name in ("calibrated_depth", "grain_diameter", "zeta_error"):
            value = getattr(self, name)
            if value is not None and not value > 0.0:
                raise InputError(
                    f"{name} is {value}; it must be positive, or None if it is not known"
                )

    @property
    def max_age(self) -> int:
        """`max_input_age` [ns]."""
        return round(1e9 * self.max_input_age)

    @property
    def strength_error(self) -> float:
        """Relative standard error of the strength of the grains, ζ, that predictions assume.

        If `zeta_error` is not known, it depends on what happens with a wrong ζ. With learning the load cell's readings
        correct it, so that a wide prior costs little. Without learning nothing does: a ζ of which nothing is known
        would have no useful standard deviation, so it is taken to be from a calibration.
        """
        if self.zeta_error is not None:
            return self.zeta_error
        return CALIBRATED_ERROR if self.learning_mode == "off" else _UNCALIBRATED_ERROR


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Model:
    """The model of tool and grains. It is immutable: a change of any part makes a new model.

    `law`: the traction law, with all parameters of the grains. `ground`: the map of the ground at the start; None: the
    ground is a level plane at ``surface_height``. `generation`: the node counts it up with each new model.
    """

    tool: Tool
    law: Law
    ground: HeightMap | None = None
    generation: int = 0

    @property
    def in_words(self) -> str:
        """Tool, rule and grains, such as "tool plate (672 plates), integration refined, law ..., memory 3 mm"."""
        plates = self.tool.reduction or f"{len(self.tool.plates):,} plates"
        rule = self.tool.plates.integration
        return f"tool {self.tool.name} ({plates}), integration {rule}, {described(self.law)}"
