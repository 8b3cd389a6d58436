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
    Law,
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


def ground_of(values: Values) -> HeightMap:
    """Load the ground at the start from checked values whose `ground.cell` is not 0."""
    cell = values["ground.cell"]
    file = values["ground.file"]
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
"""The parts of a model that take time to load: the parameters of each, and the function of their values."""


def parts_of(values: Values) -> dict[str, Values]:
    """The parts of the model that have to be loaded for checked values, each with the values of its parameters.

    Raises InputError if a parameter that belongs to another one is missing.
    """
    ground_file = values["ground.file"]
    cell = values["ground.cell"]
    if ground_file and not cell:
        raise InputError(
            f"ground.file '{ground_file}' needs ground.cell, the side of a cell [m]; it is 0"
        )
    has_table = values["alpha_y.model"] == "table"
    if has_table and not values["alpha_y.table"]:
        raise InputError(
            "alpha_y.model 'table' needs alpha_y.table to name a CSV file; set that first"
        )
    used = {"tool": True, "ground": cell, "medium": values["medium.file"], "table": has_table}
    return {
        part: {name: values[name] for name in parameters}
        for part, (parameters, _) in _PARTS.items()
        if used[part]
    }


def load_parts(parts: Mapping[str, Values]) -> dict[str, Any]:
    """Load parts of `parts_of`. Raises InputError for what cannot be used."""
    loaded = {}
    for part, values in parts.items():
        _, load = _PARTS[part]
        loaded[part] = load(values)
    return loaded


def law_of(values: Values, parts: Mapping[str, Any]) -> Law:
    """The law from checked values. `parts`: of `load_parts`, those of the medium and of α_y."""
    medium = parts.get("medium") or medium_named(values["medium.name"])
    alpha_y = alpha_y_model(values["alpha_y.model"], medium, parts.get("table"))
    of_law = {name: values[f"medium.{name}"] for name in LAW_NUMBERS}
    return law_named(values["law"], medium, alpha_y, **of_law)


def model_of(
    values: Values, parts: Mapping[str, Any] | None = None, *, generation: int = 0
) -> Model:
    """The model from checked values. `parts`: those of `load_parts`; None: they are loaded here.

    Raises InputError for unusable files.
    """
    if parts is None:
        parts = load_parts(parts_of(values))
    return Model(
        tool=parts["tool"],
        law=law_of(values, parts),
        ground=parts.get("ground"),
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

    Tools are not reduced.
    """
    given = {SHORT_NAMES[key]: value for key, value in entry.items()}
    medium = given.get("medium.name")
    if isinstance(medium, str) and is_medium_file(medium):
        given |= {"medium.name": defaults()["medium.name"], "medium.file": medium}
    checks = {name: checked(name, value) for name, value in given.items()}
    return {**defaults(), "tolerance": 0.0, **checks}
