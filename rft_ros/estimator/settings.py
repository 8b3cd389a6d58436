"""The estimator's configuration: settings, the load cell, and the model of tool and medium."""

from dataclasses import dataclass, field
from typing import Literal

from rft_ros.estimator.samples import Reason, Vector, Wrench
from rft_ros.ground import HeightMap
from rft_ros.rft import Law
from rft_ros.tool import Tool

__all__ = ["LearningMode", "LoadCell", "Model", "Settings"]

LearningMode = Literal["off", "observe", "apply"]
"""Whether the medium is learned from the load cell, and whether predictions use it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadCell:
    """The load cell's mounting, sign and bias, and the mass attached to it.

    `position` [m] and `quaternion` xyzw: sensor frame in the tool frame. `sign`: +1 if the driver reports the force on
    the tool, -1 if the force by the tool. `bias`: the driver's raw reading with nothing attached [N, N m].
    `mass` [kg] and `center_of_mass` [m, sensor frame]: of everything attached below the cell.
    """

    position: Vector = (0.0, 0.0, 0.0)
    quaternion: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    sign: float = 1.0
    bias: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    mass: float = 0.0
    center_of_mass: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Frames, sources, limits and learning in m, s, m/s, Hz.

    `max_rate` 0: answer every pose. `calibrated_depth` and `zeta_error` (relative standard error of ζ) 0: unknown.

    `tf_rate` 0: a pose from transforms at each load-cell stamp. `learning_lag`: path between a load-cell sample and the
    first prediction that it may change.
    """

    world_frame: str = "world"
    tool_frame: str = "tool"
    sensor_frame: str = "ft_sensor"
    load_cell: LoadCell = field(default_factory=LoadCell)
    sensor_source: Literal["parameters", "tf"] = "parameters"
    surface_height: float = 0.0
    pose_source: Literal["topic", "tf"] = "topic"
    tf_rate: float = 0.0
    twist_source: Literal["topic", "pose_difference"] = "topic"
    twist_window: float = 0.2
    max_input_age: float = 0.1
    max_rate: float = 0.0
    rest_speed: float = 2e-4
    calibrated_depth: float = 0.0
    zeta_error: float = 0.0
    learning_mode: LearningMode = "off"
    learning_lag: float = 0.002

    def frame_sentence(self, reason: Reason, frame: str) -> str:
        """A sentence for a reason ``*_frame_unknown``: the refused frame_id and the expected one."""
        world, tool = f"world_frame {self.world_frame!r}", f"tool_frame {self.tool_frame!r}"
        return {
            Reason.POSE_FRAME_UNKNOWN: f"pose frame_id {frame!r} is not {world}",
            Reason.TWIST_FRAME_UNKNOWN: f"twist frame_id {frame!r} is neither {world} nor {tool}",
            Reason.SURFACE_FRAME_UNKNOWN: f"surface_points frame_id {frame!r} is not {world}, nor fixed in it",
            Reason.WRENCH_FRAME_UNKNOWN: f"wrench frame_id {frame!r} is not sensor_frame {self.sensor_frame!r}",
        }[reason]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Model:
    """A tool, a law and the ground at the start, replaced as a whole; `generation` counts the models of a run.

    `mobilization_length`: λ of the medium [m]; 0 disables memory, as published. `ground`: known heights; None: a level
    plane. The rest names the law's parameters.
    """

    tool: Tool
    law: Law
    medium: str
    zeta: float
    alpha_y: str
    law_name: str = "treers2021"
    mobilization_length: float = 0.0
    ground: HeightMap | None = None
    generation: int = 0
