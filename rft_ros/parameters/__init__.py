"""Parameters: all of them as one `Config`, the files that set them, and the models made from their values."""

from rft_ros.parameters.config import PARAMETERS, Config, load_parts
from rft_ros.parameters.file import (
    NODE,
    named_files,
    node_parameters,
    read_parameter_file,
    section_parameters,
    write_parameter_file,
)
from rft_ros.parameters.from_values import config_of_options
from rft_ros.parameters.groups import (
    MESH,
    FeedforwardConfig,
    FramesConfig,
    InputsConfig,
    LearningConfig,
    LoadCell,
    MediumConfig,
    MeshConfig,
    Part,
)
from rft_ros.parameters.medium_file import (
    is_medium_file,
    read_alpha_y_table,
    read_medium,
    read_stress_map,
    write_medium,
)
from rft_ros.parameters.model import Model
from rft_ros.parameters.parameter import Parameter, Value, Values, parameter_values
from rft_ros.parameters.sections import Section, read_sections, read_value
from rft_ros.parameters.table import FILES, OPTIONS, checked

__all__ = [
    "FILES",
    "MESH",
    "NODE",
    "OPTIONS",
    "PARAMETERS",
    "Config",
    "FeedforwardConfig",
    "FramesConfig",
    "InputsConfig",
    "LearningConfig",
    "LoadCell",
    "MediumConfig",
    "MeshConfig",
    "Model",
    "Parameter",
    "Part",
    "Section",
    "Value",
    "Values",
    "checked",
    "config_of_options",
    "is_medium_file",
    "load_parts",
    "named_files",
    "node_parameters",
    "parameter_values",
    "read_alpha_y_table",
    "read_medium",
    "read_parameter_file",
    "read_sections",
    "read_stress_map",
    "read_value",
    "section_parameters",
    "write_medium",
    "write_parameter_file",
]
