"""The parameter table: what it offers, what it refuses and in which words, and models made from its values."""

import math
import re

import pytest

from rft_ros.errors import InputError
from rft_ros.estimator import Settings
from rft_ros.parameters import PARAMETERS, checked, defaults, model_of, settings_of
from rft_ros.rft import Constant, Linear, Table

# Parameters whose names users depend on (docs/node.md).
CONTRACT = {
    *("mesh.file", "mesh.scale", "mesh.origin", "medium.name", "medium.zeta", "alpha_y.model", "alpha_y.table"),
    *("integration", "surface_height", "world_frame", "tool_frame", "sensor_frame", "sensor.position"),
    *("sensor.quaternion", "sensor.sign", "sensor.bias", "sensor.mass", "sensor.center_of_mass", "twist_source"),
    *("max_input_age", "max_rate"),
}
by_name = pytest.mark.parametrize("parameter", PARAMETERS, ids=lambda p: p.name)


def refusal(name, value):
    with pytest.raises(InputError) as refused:
        checked(name, value)
    return str(refused.value)


def test_every_parameter_of_the_contract_is_there_once():
    names = [p.name for p in PARAMETERS]
    assert len(names) == len(set(names))
    assert set(names) >= CONTRACT


@by_name
def test_a_default_passes_its_own_check_unchanged(parameter):
    assert checked(parameter.name, parameter.default) == parameter.default
    assert defaults()[parameter.name] == parameter.default


@by_name
def test_a_parameter_is_described_in_one_sentence_with_its_unit_or_its_values(parameter):
    assert re.fullmatch(r"\S.{15,}\.", parameter.description)
    assert parameter.bounds[0] < parameter.bounds[1]
    if parameter.choices:
        assert parameter.default in parameter.choices


@by_name
@pytest.mark.parametrize("value", [None, {}, object(), b"x"], ids=["none", "mapping", "object", "bytes"])
def test_an_unusable_value_is_refused_by_name(parameter, value):
    assert refusal(parameter.name, value).startswith(f"{parameter.name} is {value!r}; it must be ")


@pytest.mark.parametrize("parameter", [p for p in PARAMETERS if p.type != "string"], ids=lambda p: p.name)
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, True, "1.0", 10**400], ids=lambda v: str(v)[:9])
def test_a_value_that_is_not_a_number_is_refused_everywhere(parameter, value):
    sentence = f"{parameter.name} is {value!r}; it must be a finite number (such as 1.0)"
    if parameter.type == "double":
        assert refusal(parameter.name, value) == sentence
        return
    for k in range(len(parameter.default)):
        numbers = [value if i == k else v for i, v in enumerate(parameter.default)]
        assert refusal(parameter.name, numbers) == sentence


@pytest.mark.parametrize(
    "parameter", [p for p in PARAMETERS if p.type == "double" and p.name != "sensor.sign"], ids=lambda p: p.name
)
def test_the_range_of_a_number_ends_where_the_table_says(parameter):
    low, high = parameter.bounds
    for limit, beyond in ((low, -math.inf), (high, math.inf)):
        assert checked(parameter.name, limit) == limit
        outside = math.nextafter(limit, beyond)
        assert refusal(parameter.name, outside) == (
            f"{parameter.name} is {outside:g}; it must lie between {low:g} and {high:g}"
        )


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        (
            "medium.name",
            "mars",
            "medium.name is 'mars'; it must be one of generic, poppy_seeds_loose, poppy_seeds_close",
        ),
        ("alpha_y.model", "cubic", "alpha_y.model is 'cubic'; it must be one of constant, linear, table"),
        ("twist_source", "tf", "twist_source is 'tf'; it must be one of topic, pose_difference"),
        ("medium.zeta", 0.0, "medium.zeta is 0; it must lie between 1e-06 and 1e+06"),
        ("medium.zeta", -0.3, "medium.zeta is -0.3; it must lie between 1e-06 and 1e+06"),
        ("medium.zeta", "x", "medium.zeta is 'x'; it must be a finite number (such as 1.0)"),
        ("sensor.sign", 0.5, "sensor.sign is 0.5; it must be 1.0 or -1.0"),
        ("sensor.mass", -1.0, "sensor.mass is -1; it must lie between 0 and 1000"),
        ("sensor.bias", [0.0] * 5, "sensor.bias is [0.0, 0.0, 0.0, 0.0, 0.0]; it must be 6 numbers"),
        ("mesh.origin", "abc", "mesh.origin is 'abc'; it must be 3 numbers"),
        ("mesh.origin", 1.0, "mesh.origin is 1.0; it must be 3 numbers"),
        ("sensor.quaternion", [0.0] * 4, "sensor.quaternion has norm 0; it must be 1"),
        ("sensor.quaternion", [0, 0, 0, 2], "sensor.quaternion has norm 2; it must be 1"),
        ("world_frame", 7, "world_frame is 7; it must be a string"),
        ("medium.zetta", 1.0, "there is no parameter 'medium.zetta'; did you mean 'medium.zeta'?"),
        ("sensor.positon", 1.0, "there is no parameter 'sensor.positon'; did you mean 'sensor.position'?"),
        ("qqq", 1.0, "there is no parameter 'qqq'"),
    ],
)
def test_a_wrong_value_is_refused_with_a_sentence_that_names_parameter_and_value(name, value, sentence):
    assert refusal(name, value) == sentence


def test_an_integer_counts_as_the_number_it_is():
    assert checked("medium.zeta", 2) == 2.0
    assert isinstance(checked("medium.zeta", 2), float)
    assert checked("mesh.origin", [1, 2, 3]) == (1.0, 2.0, 3.0)


def test_a_sensor_quaternion_is_made_unit_length():
    assert checked("sensor.quaternion", [0.0, 0.0, 0.0, 1.005]) == (0.0, 0.0, 0.0, 1.0)


def test_default_values_make_the_default_settings():
    assert settings_of(defaults()) == Settings()


def test_one_frame_for_world_and_tool_is_refused():
    sentence = "world_frame and tool_frame are both 'base'; name two different frames"
    with pytest.raises(InputError, match=sentence):
        settings_of({**defaults(), "world_frame": "base", "tool_frame": "base"})


def test_every_value_reaches_the_settings():
    changed = {
        "world_frame": "base_link",
        "tool_frame": "plate",
        "sensor_frame": "cell",
        "surface_height": 0.1,
        "twist_source": "pose_difference",
        "twist_window": 0.02,
        "max_input_age": 0.3,
        "max_rate": 50.0,
        "rest_speed": 1e-3,
        "sensor.position": (1.0, 2.0, 3.0),
        "sensor.quaternion": (1.0, 0.0, 0.0, 0.0),
        "sensor.sign": -1.0,
        "sensor.bias": (1.0, 2.0, 3.0, 4.0, 5.0, 6.0),
        "sensor.mass": 0.7,
        "sensor.center_of_mass": (0.1, 0.2, 0.3),
    }
    settings = settings_of({**defaults(), **changed})
    cell = settings.load_cell
    for name, value in changed.items():
        owner, attribute = (cell, name.removeprefix("sensor.")) if name.startswith("sensor.") else (settings, name)
        assert getattr(owner, attribute) == value, name


@pytest.fixture
def mesh(tmp_path):
    file = tmp_path / "square.obj"
    file.write_text("v 0 0 0\nv 10 0 0\nv 10 10 0\nv 0 10 0\nf 1 3 2\nf 1 4 3\n")
    return str(file)


def test_a_model_is_the_tool_medium_and_alpha_y_of_the_values(mesh):
    values = {**defaults(), "mesh.file": mesh, "mesh.origin": (5.0, 5.0, 0.0), "medium.zeta": 0.33}
    model = model_of({**values, "medium.name": "poppy_seeds_loose"}, generation=7)
    assert (model.medium, model.zeta, model.alpha_y, model.generation) == ("poppy_seeds_loose", 0.33, "constant", 7)
    assert model.law.alpha_y == Constant(pytest.approx(-0.026 + 0.057 + 0.000))
    assert model.law.stiffness == 0.33e6
    assert model.tool.plates.area == pytest.approx(1e-4)
    assert model.tool.vertices.min(axis=0) == pytest.approx([-0.005, -0.005, 0.0])


def test_the_alpha_y_model_is_chosen_by_name(mesh, tmp_path):
    table = tmp_path / "table.csv"
    table.write_text("0,0.2\n90,0.1\n")
    values = {**defaults(), "mesh.file": mesh}
    assert model_of({**values, "alpha_y.model": "linear"}).law.alpha_y == Linear(0.2035, -0.0015)
    chosen = model_of({**values, "alpha_y.model": "table", "alpha_y.table": str(table)}).law.alpha_y
    assert isinstance(chosen, Table)
    assert (chosen.beta, chosen.beta_nodes) == pytest.approx((0.0, 2.0 / math.pi))
    with pytest.raises(InputError, match=r"alpha_y\.model 'table' needs alpha_y\.table to name a CSV file"):
        model_of({**values, "alpha_y.model": "table"})


def test_a_tool_that_is_there_is_not_loaded_again(mesh):
    values = {**defaults(), "mesh.file": mesh}
    tool = model_of(values).tool
    assert model_of({**values, "mesh.file": "/nowhere.stl"}, tool=tool).tool is tool


def test_an_unquoted_off_which_yaml_reads_as_false_switches_off():
    assert checked("learning.mode", False) == "off"
    with pytest.raises(InputError, match="must be a string"):
        checked("learning.mode", True)
    with pytest.raises(InputError, match="must be a string"):
        checked("medium.name", False)
