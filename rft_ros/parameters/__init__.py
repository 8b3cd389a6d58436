"""Parameters: their table, the files that give them, and what they stand for."""

from rft_ros.parameters.alpha_y_table import read_alpha_y_table
from rft_ros.parameters.file import (
    FILES,
    NODE,
    flat,
    gives,
    node_keys,
    node_parameters,
    parameter_tree,
    path_beside,
    read_parameter_file,
    write_parameter_file,
)
from rft_ros.parameters.settings import (
    TOOL_PARAMETERS,
    LearningMode,
    LoadCell,
    Model,
    Settings,
    model_of,
    settings_of,
    tool_request,
)
from rft_ros.parameters.table import PARAMETERS, Parameter, Value, Values, checked, defaults

__all__ = [
    "FILES",
    "NODE",
    "PARAMETERS",
    "TOOL_PARAMETERS",
    "LearningMode",
    "LoadCell",
    "Model",
    "Parameter",
    "Settings",
    "Value",
    "Values",
    "checked",
    "defaults",
    "flat",
    "gives",
    "model_of",
    "node_keys",
    "node_parameters",
    "parameter_tree",
    "path_beside",
    "read_alpha_y_table",
    "read_parameter_file",
    "settings_of",
    "tool_request",
    "write_parameter_file",
]
