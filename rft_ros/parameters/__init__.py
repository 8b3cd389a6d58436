"""Parameters: the table of all of them, the files that set them, and the settings and models made from their values."""

from rft_ros.parameters.file import (
    FILES,
    NODE,
    named_files,
    node_parameters,
    read_parameter_file,
    section_parameters,
    sections_for,
    write_parameter_file,
)
from rft_ros.parameters.from_values import (
    load_parts,
    medium_of,
    model_of,
    parts_of,
    settings_of,
    tool_of,
    unused,
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
    "Parameter",
    "Value",
    "Values",
    "checked",
    "defaults",
]
__all__ += ["LoadCell", "Model", "Settings"]
__all__ += ["load_parts", "medium_of", "model_of", "parts_of", "settings_of", "tool_of", "unused"]
__all__ += [
    "is_medium_file",
    "read_alpha_y_table",
    "read_medium",
    "read_stress_map",
    "write_medium",
]
__all__ += ["Section", "named_files", "node_parameters", "read_sections"]
__all__ += [
    "read_parameter_file",
    "read_value",
    "section_parameters",
    "sections_for",
    "write_parameter_file",
]
