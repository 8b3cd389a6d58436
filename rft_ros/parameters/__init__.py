"""Parameters: the table of all of them, the files that set them, and the settings and models made from their values."""

from rft_ros.parameters.file import (
    FILES,
    NODE,
    named_files,
    node_parameters,
    read_parameter_file,
    section_parameters,
    write_parameter_file,
)
from rft_ros.parameters.from_values import (
    law_of,
    load_parts,
    model_of,
    parts_of,
    settings_of,
    tool_of,
)
from rft_ros.parameters.medium_file import (
    is_medium_file,
    read_alpha_y_table,
    read_medium,
    read_stress_map,
    write_medium,
)
from rft_ros.parameters.parameter import Parameter, Value, Values
from rft_ros.parameters.sections import Section, read_sections, read_value
from rft_ros.parameters.settings import LoadCell, Model, Settings
from rft_ros.parameters.table import MESH, PARAMETERS, checked, defaults

__all__ = [
    "FILES",
    "MESH",
    "NODE",
    "PARAMETERS",
    "LoadCell",
    "Model",
    "Parameter",
    "Section",
    "Settings",
    "Value",
    "Values",
    "checked",
    "defaults",
    "is_medium_file",
    "law_of",
    "load_parts",
    "model_of",
    "named_files",
    "node_parameters",
    "parts_of",
    "read_alpha_y_table",
    "read_medium",
    "read_parameter_file",
    "read_sections",
    "read_stress_map",
    "read_value",
    "section_parameters",
    "settings_of",
    "tool_of",
    "write_medium",
    "write_parameter_file",
]
