"""The table of all parameters, which node, replay and docs share."""

from difflib import get_close_matches
from typing import Any

from rft_ros.errors import InputError
from rft_ros.parameters.parameter import LONGEST_NAME, Parameter, Value, parameters_of
from rft_ros.parameters.settings import LoadCell, Settings
from rft_ros.rft import ALPHA_Y_MODELS, INERTIA, INTEGRATIONS, LAWS, MEDIA, SURFACE_FRICTION

MESH = (
    "path, package:// or file:// URI, robot.urdf#link, or name of a shipped mesh (plate, ellipsoid, root_tip, sphere,"
    " abb_plate, scoop)"
)
"""The forms of a value of mesh.file, for help texts."""

_OTHERS = (
    Parameter("mesh.file", "plate").means(
        f"Tool mesh: {MESH}; a path is relative to the parameter file."
    ),
    Parameter("mesh.scale", 0.0, "m", (0.0, 1e6), least=1e-9).means(
        "Metres per mesh unit. 0.0: the unit that the file declares (COLLADA, glTF, URDF), or a millimetre."
    ),
    Parameter("mesh.origin", (0.0, 0.0, 0.0), "mesh units").means(
        "Where the tool frame's origin lies, in mesh-file coordinates."
    ),
    Parameter("mesh.quaternion", (0.0, 0.0, 0.0, 1.0), "xyzw", kind="quaternion").means(
        "Orientation of the mesh file's axes in tool_frame, unit length."
    ),
    Parameter("mesh.hull", False).means(
        "Compute forces on the convex hull of the tool: for a hollow tool whose hollows fill with grains."
    ),
    Parameter("law", "treers2021", choices=LAWS).means(
        "Traction law. agarwal2023 has its own coefficients and ignores medium.name, medium.file and alpha_y.model."
    ),
    Parameter("medium.name", "generic", choices=tuple(MEDIA)).means(
        "Medium whose coefficients give the stresses, as measured by Li et al. 2013. medium.zeta scales them."
    ),
    Parameter("medium.file", "", "N/cm3").means(
        "A medium of your own in place of medium.name: nine coefficients (YAML), or a measured stress map (CSV)."
    ),
    Parameter("medium.zeta", 1.0, bounds=(1e-6, 1e6)).means(
        "Scale factor of the medium, from calibration."
    ),
    Parameter("medium.mobilization_length", 0.003, "m", (0.0, 1e3)).means(
        "Memory of the grains: displacement over which the force at 30 mm depth reaches 63 % of its full value. "
        "With memory the force holds at rest. 0.0: no memory, as published."
    ),
    Parameter("medium.density", 0.0, "kg/m3", (0.0, 1e5)).means(
        "Bulk density, for the grains' inertia. 0.0: no inertia."
    ),
    Parameter("medium.inertia", INERTIA, bounds=(0.0, 100.0)).means(
        "Factor of the grains' inertia on an upright plate. On a level plate that moves down it is three times "
        "as large."
    ),
    Parameter("medium.surface_friction", SURFACE_FRICTION, bounds=(0.0, 10.0)).means(
        "Coefficient of friction between grains and tool, for law agarwal2023."
    ),
    Parameter("alpha_y.model", "linear", choices=ALPHA_Y_MODELS).means(
        "Model of the sideways stress: the stress along the horizontal direction that lies in the plate."
    ),
    Parameter("alpha_y.table", "", "deg, N/cm3").means(
        "CSV file for alpha_y.model table, with the columns beta, alpha_y, or beta, gamma, alpha_y. Its header "
        "may name other units."
    ),
    Parameter("integration", "refined", choices=INTEGRATIONS).means(
        "Integration rule. refined: cuts facets at the surface, and lets a facet's force grow gradually as it "
        "turns towards the motion. centroid: as published, evaluates each facet at its centroid."
    ),
    Parameter("tolerance", 0.025, bounds=(0.0, 1.0)).means(
        "Reduce the tool to the fewest plates whose force and torque deviate by at most this share in 95 % of "
        "random motions. 0.0: use all plates."
    ),
    Parameter("feedforward.gain", 0.0, bounds=(-2.0, 2.0)).means(
        "Factor of the prediction on ~/wrench_feedforward. -1.0: the wrench that cancels the force of the "
        "grains. 0.0: publish no such wrench."
    ),
    Parameter(
        "feedforward.frame",
        "sensor_frame",
        choices=("sensor_frame", "tool_frame", "world_frame"),
        applies="restart",
    ).means(
        "Axes of ~/wrench_feedforward. Its torque is about the sensor's origin in sensor_frame, otherwise about "
        "the tool frame's origin."
    ),
    Parameter("feedforward.limit", (20.0, 2.0), "N, N m", (0.0, 1e4)).means(
        "Largest force and largest torque of ~/wrench_feedforward."
    ),
    Parameter("feedforward.rise_time", 0.2, "s", (0.01, 1.0)).means(
        "Least time from zero to feedforward.limit, and back. When the node ends, the way back takes at most 0.25 s."
    ),
    Parameter("feedforward.timeout", 0.1, "s", (0.005, 1.0)).means(
        "Without an estimate for this time, ~/wrench_feedforward goes to zero."
    ),
    Parameter("ground.cell", 0.0, "m", (0.0, 1.0), least=1e-4).means(
        "Side of a cell of the height map of the ground. 0.0: the ground is a level plane."
    ),
    Parameter("ground.file", "", "m").means(
        "Heights of the ground at the start, in world_frame: CSV with columns x, y, h, or NPZ. Needs ground.cell."
    ),
    Parameter("executor", "events", choices=("events", "single"), applies="restart").means(
        "Executor of rclpy. events uses half the CPU of single."
    ),
)
"""Those that are no fields of `Settings` or `LoadCell`."""

_ROWS = (*_OTHERS, *parameters_of(Settings).values(), *parameters_of(LoadCell).values())
_GROUPS = [p.name.partition(".")[0] for p in _ROWS]

PARAMETERS = tuple(sorted(_ROWS, key=lambda p: _GROUPS.index(p.name.partition(".")[0])))
"""Every parameter, in the order in which they are documented."""

_BY_NAME = {p.name: p for p in PARAMETERS}


def defaults() -> dict[str, Any]:
    """Every parameter at its default."""
    return {p.name: p.default for p in PARAMETERS}


def unknown_parameter(name: str) -> str:
    """A sentence for a parameter that does not exist; it proposes the most similar name."""
    if len(name) > LONGEST_NAME:
        return f"there is no parameter with a name of {len(name):,} characters"
    similar = get_close_matches(name, _BY_NAME, n=1)
    if similar:
        return f"there is no parameter '{name}'; did you mean '{similar[0]}'?"
    return f"there is no parameter '{name}'"


def checked(name: str, value: object) -> Value:
    """The value in the parameter's type. Raises InputError that names parameter and value and says what is allowed."""
    if name not in _BY_NAME:
        raise InputError(unknown_parameter(name))
    return _BY_NAME[name].checked(value)
