"""The table of all parameters, which node, replay and docs share."""

from difflib import get_close_matches
from typing import Any

from rft_ros.errors import InputError, shown
from rft_ros.parameters.parameter import Parameter, Value, parameter_fields
from rft_ros.parameters.settings import LoadCell, Settings
from rft_ros.rft import ALPHA_Y_MODELS, INERTIA, INTEGRATIONS, LAWS, MEDIA, SURFACE_FRICTION

MESH = (
    "path, package:// or file:// URI, robot.urdf#link, or name of a shipped mesh (plate, ellipsoid, root_tip, sphere,"
    " abb_plate, scoop)"
)
"""The forms of a value of mesh.file, for help texts."""

_OTHERS = (
    Parameter(
        "mesh.file", "plate", f"Tool mesh: {MESH}; a path is relative to the parameter file."
    ),
    Parameter(
        "mesh.scale",
        0.0,
        "Metres per mesh unit. 0.0: the unit that the file declares (COLLADA, glTF, URDF), or a millimetre.",
        "m",
        (0.0, 1e6),
        least=1e-9,
    ),
    Parameter(
        "mesh.origin",
        (0.0, 0.0, 0.0),
        "Where the tool frame's origin lies, in mesh-file coordinates.",
        "mesh units",
    ),
    Parameter(
        "mesh.quaternion",
        (0.0, 0.0, 0.0, 1.0),
        "Orientation of the mesh file's axes in tool_frame, unit length.",
        "xyzw",
        kind="quaternion",
    ),
    Parameter(
        "mesh.hull",
        False,
        "Compute forces on the convex hull of the tool: for a hollow tool whose hollows fill with grains.",
    ),
    Parameter(
        "law",
        "treers2021",
        "Traction law. agarwal2023 has its own coefficients and ignores medium.name, medium.file and alpha_y.model.",
        choices=LAWS,
    ),
    Parameter(
        "medium.name",
        "generic",
        "Medium whose coefficients give the stresses, as measured by Li et al. 2013. medium.zeta scales them.",
        choices=tuple(MEDIA),
    ),
    Parameter(
        "medium.file",
        "",
        "A medium of your own in place of medium.name: nine coefficients (YAML), or a measured stress map (CSV).",
        "N/cm3",
    ),
    Parameter(
        "medium.zeta", 1.0, "Scale factor of the medium, from calibration.", bounds=(1e-6, 1e6)
    ),
    Parameter(
        "medium.mobilization_length",
        0.003,
        "Memory of the grains: displacement over which the force at 30 mm depth reaches 63 % of its full value. "
        "With memory the force holds at rest. 0.0: no memory, as published.",
        "m",
        (0.0, 1e3),
    ),
    Parameter(
        "medium.density",
        0.0,
        "Bulk density, for the grains' inertia. 0.0: no inertia.",
        "kg/m3",
        (0.0, 1e5),
    ),
    Parameter(
        "medium.inertia",
        INERTIA,
        "Factor of the grains' inertia on an upright plate. On a level plate that moves down it is three times "
        "as large.",
        bounds=(0.0, 100.0),
    ),
    Parameter(
        "medium.surface_friction",
        SURFACE_FRICTION,
        "Coefficient of friction between grains and tool, for law agarwal2023.",
        bounds=(0.0, 10.0),
    ),
    Parameter(
        "alpha_y.model",
        "linear",
        "Model of the sideways stress: the stress along the horizontal direction that lies in the plate.",
        choices=ALPHA_Y_MODELS,
    ),
    Parameter(
        "alpha_y.table",
        "",
        "CSV file for alpha_y.model table, with the columns beta, alpha_y, or beta, gamma, alpha_y. Its header "
        "may name other units.",
        "deg, N/cm3",
    ),
    Parameter(
        "integration",
        "refined",
        "Integration rule. refined: cuts facets at the surface, and lets a facet's force grow gradually as it "
        "turns towards the motion. centroid: as published, evaluates each facet at its centroid.",
        choices=INTEGRATIONS,
    ),
    Parameter(
        "tolerance",
        0.025,
        "Reduce the tool to the fewest plates whose force and torque deviate by at most this share in 95 % of "
        "random motions. 0.0: use all plates.",
        bounds=(0.0, 1.0),
    ),
    Parameter(
        "feedforward.gain",
        0.0,
        "Factor of the prediction on ~/wrench_feedforward. -1.0: the wrench that cancels the force of the "
        "grains. 0.0: publish no such wrench.",
        bounds=(-2.0, 2.0),
    ),
    Parameter(
        "feedforward.frame",
        "sensor_frame",
        "Axes of ~/wrench_feedforward. Its torque is about the sensor's origin in sensor_frame, otherwise about "
        "the tool frame's origin.",
        choices=("sensor_frame", "tool_frame", "world_frame"),
        applies="restart",
    ),
    Parameter(
        "feedforward.limit",
        (20.0, 2.0),
        "Largest force and largest torque of ~/wrench_feedforward.",
        "N, N m",
        (0.0, 1e4),
    ),
    Parameter(
        "feedforward.rise_time",
        0.2,
        "Least time from zero to feedforward.limit, and back. When the node ends, the way back takes at most 0.25 s.",
        "s",
        (0.01, 1.0),
    ),
    Parameter(
        "feedforward.timeout",
        0.1,
        "Without an estimate for this time, ~/wrench_feedforward goes to zero.",
        "s",
        (0.005, 1.0),
    ),
    Parameter(
        "ground.cell",
        0.0,
        "Side of a cell of the height map of the ground. 0.0: the ground is a level plane.",
        "m",
        (0.0, 1.0),
        least=1e-4,
    ),
    Parameter(
        "ground.file",
        "",
        "Heights of the ground at the start, in world_frame: CSV with columns x, y, h, or NPZ. Needs ground.cell.",
        "m",
    ),
    Parameter(
        "executor",
        "events",
        "Executor of rclpy. events uses half the CPU of single.",
        choices=("events", "single"),
        applies="restart",
    ),
)
"""Those that are no fields of `Settings` or `LoadCell`."""

_ROWS = (*_OTHERS, *parameter_fields(Settings).values(), *parameter_fields(LoadCell).values())
_GROUPS = [p.name.partition(".")[0] for p in _ROWS]

PARAMETERS = tuple(sorted(_ROWS, key=lambda p: _GROUPS.index(p.name.partition(".")[0])))
"""Every parameter, in the order in which they are documented."""

_BY_NAME = {p.name: p for p in PARAMETERS}


def defaults() -> dict[str, Any]:
    """Every parameter at its default."""
    return {p.name: p.default for p in PARAMETERS}


def unknown_parameter(name: str) -> str:
    """A sentence for a parameter that does not exist; it proposes the most similar name."""
    similar = get_close_matches(name[:99], _BY_NAME, n=1)
    if similar:
        return f"there is no parameter {shown(name)}; did you mean '{similar[0]}'?"
    return f"there is no parameter {shown(name)}"


def checked(name: str, value: object) -> Value:
    """The value in the parameter's type. Raises InputError that names parameter and value and says what is allowed."""
    if name not in _BY_NAME:
        raise InputError(unknown_parameter(name))
    return _BY_NAME[name].checked(value)
