"""One value for all parameters, in groups: what YAML files, the command line, ROS and Python code set alike."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from difflib import get_close_matches
from typing import Any, Literal

from rft_ros.errors import InputError, shown
from rft_ros.parameters.groups import (
    FeedforwardConfig,
    FramesConfig,
    GroundConfig,
    InputsConfig,
    LearningConfig,
    LoadCell,
    MediumConfig,
    MeshConfig,
    Part,
)
from rft_ros.parameters.model import Model
from rft_ros.parameters.parameter import (
    Parameter,
    Value,
    Values,
    parameter_fields,
    parameter_values,
    setting,
    with_values,
)

CALIBRATED_ERROR = 0.15
"""Relative standard error that a ζ from a calibration is taken to have, if the calibration does not say."""

_UNCALIBRATED_ERROR = 1.0
"""The same for a ζ that may be no calibration at all: wide enough to learn any grains from ζ = 1 within centimetres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Config:
    """All parameters: eight groups, and two parameters that belong to none.

    `Config.of({"sensor.mass": 0.5, "surface_height": 0.1})` and `Config(sensor=LoadCell(mass=0.5), surface_height=0.1)`
    set the same fields; only `of` and `changed` check the values.
    """

    mesh: MeshConfig = field(default_factory=MeshConfig)
    medium: MediumConfig = field(default_factory=MediumConfig)
    feedforward: FeedforwardConfig = field(default_factory=FeedforwardConfig)
    ground: GroundConfig = field(default_factory=GroundConfig)
    executor: Literal["events", "single"] = setting(
        "executor",
        "events",
        "Executor of rclpy. events uses half the CPU of single.",
        applies="restart",
    )
    learning: LearningConfig = field(default_factory=LearningConfig)
    surface_height: float = setting(
        "surface_height",
        0.0,
        "z of the undisturbed surface in world_frame.",
        "m",
        (-1e6, 1e6),
        option="surface_height",
    )
    frames: FramesConfig = field(default_factory=FramesConfig)
    sensor: LoadCell = field(default_factory=LoadCell)
    inputs: InputsConfig = field(default_factory=InputsConfig)

    @classmethod
    def of(cls, values: "Config | Values") -> "Config":
        """From values by the names of the parameters; those that are missing have their defaults.

        A `Config` is returned as it is. Raises InputError that names a value that is not allowed, or a name that no
        parameter has.
        """
        return values if isinstance(values, Config) else cls().changed(values)

    @property
    def values(self) -> dict[str, Value]:
        """The values by the names of the parameters, as YAML files and ROS have them."""
        found = parameter_values(self)
        for name in GROUPS:
            found |= parameter_values(getattr(self, name))
        return {parameter.name: found[parameter.name] for parameter in PARAMETERS}

    def changed(self, values: Values) -> "Config":
        """The same with other values of some parameters. Raises InputError as `of`."""
        unknown = values.keys() - NAMES
        if unknown:
            raise InputError(unknown_parameter(min(unknown)))
        groups = {name: with_values(getattr(self, name), values) for name in GROUPS}
        return replace(with_values(self, values), **groups)

    @property
    def strength_error(self) -> float:
        """Relative standard error of the strength of the grains, ζ, that predictions assume.

        If `medium.zeta_error` is not known, it depends on what happens with a wrong ζ. With learning the load cell's
        readings correct it, so that a wide prior costs little. Without learning nothing does: a ζ of which nothing is
        known would have no useful standard deviation, so it is taken to be from a calibration.
        """
        if self.medium.zeta_error is not None:
            return self.medium.zeta_error
        return CALIBRATED_ERROR if self.learning.mode == "off" else _UNCALIBRATED_ERROR

    def parts(self) -> dict[str, Part]:
        """The parts of the model that have to be loaded.

        Raises InputError if a parameter that belongs to another one is missing.
        """
        found: dict[str, Part] = {"tool": self.mesh}
        if self.ground.cell:
            found["ground"] = self.ground
        elif self.ground.file:
            raise InputError(
                f"ground.file '{self.ground.file}' needs ground.cell, the side of a cell [m]; it is 0"
            )
        return found | self.medium.parts()

    def model(
        self, parts_by_name: Mapping[str, Any] | None = None, *, generation: int = 0
    ) -> Model:
        """The model. `parts_by_name`: by `load_parts`; None: the parts are loaded here. Raises InputError."""
        if parts_by_name is None:
            parts_by_name = load_parts(self.parts())
        return Model(
            tool=parts_by_name["tool"],
            law=self.medium.law_of(parts_by_name),
            ground=parts_by_name.get("ground"),
            generation=generation,
        )


GROUPS: dict[str, type] = {
    f.name: type(getattr(Config(), f.name))
    for f in fields(Config)
    if f.name not in parameter_fields(Config)
}
"""The groups by the names of their fields in `Config`."""


def _parameters() -> Iterator[Parameter]:
    """The parameters in the order of the fields of `Config` and of its groups."""
    in_no_group = parameter_fields(Config)
    for f in fields(Config):
        if f.name in GROUPS:
            yield from parameter_fields(GROUPS[f.name]).values()
        else:
            yield in_no_group[f.name]


PARAMETERS = tuple(_parameters())
"""Every parameter, in the order in which they are documented."""

NAMES = frozenset(parameter.name for parameter in PARAMETERS)


def unknown_parameter(name: str) -> str:
    """A sentence for a parameter that does not exist; it proposes the most similar name."""
    similar = get_close_matches(name[:99], NAMES, n=1)
    if similar:
        return f"there is no parameter {shown(name)}; did you mean '{similar[0]}'?"
    return f"there is no parameter {shown(name)}"


def load_parts(parts: Mapping[str, Part]) -> dict[str, Any]:
    """Load parts of `Config.parts`. Raises InputError for what cannot be used."""
    return {name: part.load() for name, part in parts.items()}
