"""The estimator's settings, the load cell, and the model of tool and grains: values that do not change."""

from dataclasses import dataclass, field
from typing import Literal

from rft_ros.errors import InputError
from rft_ros.ground import HeightMap
from rft_ros.rft import Law, described
from rft_ros.rft.frames import Quaternion, Vector, Wrench
from rft_ros.tool import Tool

__all__ = ["CALIBRATED_ERROR", "LoadCell", "Model", "Settings"]

CALIBRATED_ERROR = 0.15
"""Relative standard error that a ζ from a calibration is taken to have, if the calibration does not say."""

_UNCALIBRATED_ERROR = 1.0
"""The same for a ζ that may be no calibration at all: wide enough to learn any grains from ζ = 1 within centimetres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadCell:
    """The load cell's mounting, sign and bias, and the mass attached to it.

    `position` [m] and `quaternion` xyzw: place of the sensor frame in the tool frame. `sign`: +1 if the driver reports
    the force that acts on the tool, -1 if it reports the force with which the tool pushes. `bias`: the driver's raw
    reading with nothing attached [N, N m]. `mass` [kg] and `center_of_mass` [m, sensor frame]: of everything that is
    attached below the cell. `delay` [s]: how much later than the event its stamps are.
    """

    position: Vector = (0.0, 0.0, 0.0)
    quaternion: Quaternion = (0.0, 0.0, 0.0, 1.0)
    sign: float = 1.0
    bias: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    mass: float = 0.0
    center_of_mass: Vector = (0.0, 0.0, 0.0)
    delay: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """The estimator's settings, in m, s, m/s and Hz. Each field is the parameter of the node with the same name.

    Some names differ: `load_cell` holds ``sensor.*``, `sensor_source` is ``sensor.frame_source``, `calibrated_depth`
    and `zeta_error` are ``medium.*``, and `learning_mode` and `learning_lag` are ``learning.*``. config/default.yaml
    lists the parameters. A value of 0 has a special meaning in some fields. `max_rate`: every pose gets an estimate.
    `tf_rate`: transforms give a pose at each load-cell stamp. `calibrated_depth` and `zeta_error` are None if they are
    not known; the parameter is 0 then.

    Raises InputError if `world_frame` and `tool_frame` have the same name, because the frame_id of a twist then does
    not say in which axes the twist is, and for a `calibrated_depth` or `zeta_error` that is not positive.
    """

    world_frame: str = "world"
    tool_frame: str = "tool"
    sensor_frame: str = "ft_sensor"
    load_cell: LoadCell = field(default_factory=LoadCell)
    sensor_source: Literal["parameters", "tf", "world"] = "parameters"
    surface_height: float = 0.0
    pose_source: Literal["topic", "tf"] = "topic"
    tf_rate: float = 0.0
    twist_source: Literal["topic", "pose_difference"] = "topic"
    twist_window: float = 0.2
    max_input_age: float = 0.1
    max_rate: float = 0.0
    rest_speed: float = 2e-4
    calibrated_depth: float | None = None
    zeta_error: float | None = None
    learning_mode: Literal["off", "observe", "apply"] = "off"
    learning_lag: float = 0.002

    def __post_init__(self) -> None:
        if self.world_frame == self.tool_frame:
            raise InputError(f"world_frame and tool_frame are both '{self.tool_frame}'; name two different frames")
        for name, value in (("calibrated_depth", self.calibrated_depth), ("zeta_error", self.zeta_error)):
            if value is not None and not value > 0.0:
                raise InputError(f"{name} is {value}; it must be positive, or None if it is not known")

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
