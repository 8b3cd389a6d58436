"""Makes settings and the model of tool and grains from values of parameters, and these from short names of options."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rft_ros.errors import InputError
from rft_ros.ground import HeightMap, read_height_map
from rft_ros.parameters.medium_file import is_medium_file, read_alpha_y_table, read_medium
from rft_ros.parameters.parameter import Values, field_values
from rft_ros.parameters.settings import LoadCell, Model, Settings
from rft_ros.parameters.table import checked, defaults
from rft_ros.rft import (
    LAW_NUMBERS,
    Medium,
    Table,
    alpha_y_model,
    law_named,
    medium_named,
)
from rft_ros.tool import Tool, load_tool


def settings_of(values: Values) -> Settings:
    """The estimator's settings from checked values."""
    return Settings(
        **field_values(Settings, values), load_cell=LoadCell(**field_values(LoadCell, values))
    )


def tool_of(values: Values) -> Tool:
    """Load the tool from checked values."""
    return load_tool(
        values["mesh.file"],
        scale=values["mesh.scale"],
        origin=values["mesh.origin"],
        quaternion=values["mesh.quaternion"],
        hull=values["mesh.hull"],
        integration=values["integration"],
        tolerance=values["tolerance"],
    )


def ground_of(values: Values) -> HeightMap | None:
    """Load the ground at the start from checked values; None: a level plane."""
    cell = values["ground.cell"]
    file = values["ground.file"]
    if file and not cell:
        raise InputError(
            f"ground.file '{file}' needs ground.cell, the side of a cell [m]; it is 0"
        )
    if not cell:
        return None
    return read_height_map(Path(file), cell) if file else HeightMap.unknown(cell)


OF_TOOL = {
    "mesh": "mesh.file",
    "scale": "mesh.scale",
    "origin": "mesh.origin",
    "rotate": "mesh.quaternion",
    "hull": "mesh.hull",
    "integration": "integration",
    "tolerance": "tolerance",
}
"""The parameter of each short name in an entry on a tool."""

_PARTS: dict[str, tuple[tuple[str, ...], Callable[[Values], Any]]] = {
    "tool": (tuple(OF_TOOL.values()), tool_of),
    "ground": (("ground.cell", "ground.file"), ground_of),
    "medium": (("medium.file",), lambda values: read_medium(values["medium.file"])),
    "table": (
        ("alpha_y.table", "alpha_y.model"),
        lambda values: read_alpha_y_table(values["alpha_y.table"]),
    ),
}
"""The parts of a model that are loaded from files: the parameters of each, and the function of their values.

If the first parameter is 0 or empty, there is nothing to load, and the part is None.
"""


def parts_of(values: Values) -> dict[str, Values]:
    """The parts of a model that are loaded from files, and the values of the parameters that each needs.

    The keys are arguments of `model_of`.
    """
    return {name: {p: values[p] for p in parameters} for name, (parameters, _) in _PARTS.items()}


def unused(part: str, values: Values) -> bool:
    """Whether a part of `parts_of` is None with these values: no file has to be read for it."""
    if part == "table" and values["alpha_y.model"] != "table":
        return True
    parameters, _ = _PARTS[part]
    return not values[parameters[0]]


def load_parts(parts: Mapping[str, Values]) -> dict[str, Any]:
    """Load parts of `parts_of`. Raises InputError for what cannot be used."""
    loaded = {}
    for part, values in parts.items():
        _, load = _PARTS[part]
        loaded[part] = None if unused(part, values) else load(values)
    return loaded


def medium_of(values: Values) -> Medium:
    """The medium from checked values: of medium.file if it is set, otherwise of medium.name. Raises InputError."""
    file = values["medium.file"]
    return read_medium(file) if file else medium_named(values["medium.name"])


def model_of(
    values: Values,
    *,
    tool: Tool | None = None,
    medium: Medium | None = None,
    table: Table | None = None,
    ground: HeightMap | None = None,
    generation: int = 0,
) -> Model:
    """The model from checked values. Parts that are not given are loaded. Raises InputError for unusable files."""
    alpha_y = values["alpha_y.model"]
    if alpha_y == "table" and table is None:
        table = read_alpha_y_table(values["alpha_y.table"])
    if medium is None:
        medium = medium_of(values)
    of_law = {name: values[f"medium.{name}"] for name in LAW_NUMBERS}
    return Model(
        tool=tool or tool_of(values),
        law=law_named(values["law"], medium, alpha_y_model(alpha_y, medium, table), **of_law),
        ground=ground or ground_of(values),
        generation=generation,
    )


OF_MEDIUM = {
    "law": "law",
    "medium": "medium.name",
    "alpha_y": "alpha_y.model",
    "surface_height": "surface_height",
    **{name: f"medium.{name}" for name in LAW_NUMBERS},
}
"""The parameter of each short name in an entry on a medium."""

SHORT_NAMES = OF_TOOL | OF_MEDIUM
"""The parameter of each short name."""


def parameters_of(entry: Mapping[str, Any]) -> Values:
    """The node's parameters from an entry's short names; the others have their defaults. Raises InputError.

    Tools are not reduced. Without an integration, a tool has the rule of its file.
    """
    given = {SHORT_NAMES[key]: value for key, value in entry.items()}
    medium = given.get("medium.name")
    if isinstance(medium, str) and is_medium_file(medium):
        given |= {"medium.name": defaults()["medium.name"], "medium.file": medium}
    checks = {name: checked(name, value) for name, value in given.items()}
    return {**defaults(), "tolerance": 0.0, "integration": None, **checks}
