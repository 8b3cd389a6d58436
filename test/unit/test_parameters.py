"""The parameter table: what it offers, what it refuses and in which words, and models made from its values."""

import math
import re
from dataclasses import fields

import pytest

from rft_ros.errors import InputError
from rft_ros.estimator import LoadCell, Settings
from rft_ros.parameters import PARAMETERS, checked, defaults, model_of, settings_of
from rft_ros.rft import Constant, Linear, Table


def refusal(name, value):
    with pytest.raises(InputError) as refused:
        checked(name, value)
    return str(refused.value)


@pytest.mark.parametrize("parameter", PARAMETERS, ids=lambda p: p.name)
def test_a_parameter_is_described_passes_its_own_check_and_refuses_what_has_another_type(parameter):
    name, (low, high) = parameter.name, parameter.bounds
    assert re.fullmatch(r"\S.{15,}\.", parameter.description)
    assert checked(name, parameter.default) == parameter.default == defaults()[name]
    for value in (None, {}, object(), b"x"):
        assert refusal(name, value).startswith(f"{name} is {value!r}; it must be ")
    if parameter.type == "string":
        return
    for value in (math.nan, math.inf, -math.inf, True, "1.0", 10**400):
        sentence = f"{name} is {value!r}; it must be a finite number (such as 1.0)"
        if parameter.type == "double":
            assert refusal(name, value) == sentence
            continue
        for k in range(len(parameter.default)):
            assert refusal(name, [value if i == k else v for i, v in enumerate(parameter.default)]) == sentence
    if parameter.type == "double" and name != "sensor.sign":
        for limit, beyond in ((low, -math.inf), (high, math.inf)):
            assert checked(name, limit) == limit
            outside = math.nextafter(limit, beyond)
            assert refusal(name, outside) == f"{name} is {outside:g}; it must lie between {low:g} and {high:g}"


@pytest.mark.parametrize(
    "sentence",
    [
        "medium.name is 'mars'; it must be one of generic, poppy_seeds_loose, poppy_seeds_close",
        "integration is 'exact'; it must be one of centroid, refined",
        "sensor.sign is 0.5; it must be 1.0 or -1.0",
        "sensor.mass is -1; it must lie between 0 and 1000",
        "sensor.bias is [0.0, 0.0, 0.0, 0.0, 0.0]; it must be 6 numbers",
        "mesh.origin is 'abc'; it must be 3 numbers",
        "mesh.origin is 1.0; it must be 3 numbers",
        "world_frame is 7; it must be a string",
        "learning.mode is True; it must be a string",
        "medium.name is False; it must be a string",
    ],
)
def test_a_wrong_value_is_refused_with_a_sentence_that_names_parameter_and_value(sentence):
    name, value = re.match(r"(\S+) is (.*?); it must", sentence).groups()
    assert refusal(name, eval(value)) == sentence


def test_a_wrong_name_or_norm_is_refused_and_an_integer_or_a_norm_near_1_is_not():
    assert refusal("medium.zetta", 1.0) == "there is no parameter 'medium.zetta'; did you mean 'medium.zeta'?"
    assert refusal("qqq", 1.0) == "there is no parameter 'qqq'"
    for size in (0, 2):
        assert refusal("sensor.quaternion", [0, 0, 0, size]) == f"sensor.quaternion has norm {size}; it must be 1"
    assert checked("sensor.quaternion", [0.0, 0.0, 0.0, 1.005]) == (0.0, 0.0, 0.0, 1.0)
    assert isinstance(checked("medium.zeta", 2), float)
    assert checked("mesh.origin", [1, 2, 3]) == (1.0, 2.0, 3.0)


def test_an_unquoted_off_which_yaml_reads_as_false_switches_off():
    assert checked("learning.mode", False) == "off"


def test_default_values_make_the_default_settings_and_every_other_value_reaches_them():
    assert settings_of(defaults()) == Settings()
    for owner, prefix in ((Settings, ""), (LoadCell, "sensor.")):
        for name in (prefix + f.name for f in fields(owner)):
            parameter = next((p for p in PARAMETERS if p.name == name), None)
            if parameter is None:
                continue
            value = parameter.default
            if parameter.type == "string":
                value = parameter.choices[-1] if parameter.choices else "other"
            elif parameter.type == "double":
                value = -1.0 if name == "sensor.sign" else 0.5 * value + 0.25
            else:
                value = value[::-1] if name == "sensor.quaternion" else tuple(range(len(value)))
            changed = settings_of({**defaults(), name: value})
            assert getattr(changed.load_cell if prefix else changed, name.removeprefix(prefix)) == value, name


def test_one_frame_for_world_and_tool_is_refused():
    with pytest.raises(InputError, match="world_frame and tool_frame are both 'base'; name two different frames"):
        settings_of({**defaults(), "world_frame": "base", "tool_frame": "base"})


@pytest.fixture
def values(tmp_path):
    file = tmp_path / "square.obj"
    file.write_text("v 0 0 0\nv 10 0 0\nv 10 10 0\nv 0 10 0\nf 1 3 2\nf 1 4 3\n")
    return {**defaults(), "mesh.file": str(file)}


def test_a_model_is_the_tool_medium_and_alpha_y_of_the_values(values):
    given = {"mesh.origin": (5.0, 5.0, 0.0), "medium.zeta": 0.33, "medium.name": "poppy_seeds_loose"}
    model = model_of({**values, **given}, generation=7)
    assert (model.medium, model.zeta, model.alpha_y, model.generation) == ("poppy_seeds_loose", 0.33, "constant", 7)
    assert model.law.alpha_y == Constant(pytest.approx(-0.026 + 0.057 + 0.000))
    assert model.law.stiffness == 0.33e6
    assert model.tool.plates.area == pytest.approx(1e-4)
    assert model.tool.vertices.min(axis=0) == pytest.approx([-0.005, -0.005, 0.0])
    again = model_of({**values, "mesh.file": "/nowhere.stl"}, tool=model.tool)  # it is not loaded again
    assert again.tool is model.tool


def test_the_alpha_y_model_is_chosen_by_name(values, tmp_path):
    table = tmp_path / "table.csv"
    table.write_text("0,0.2\n90,0.1\n")
    assert model_of({**values, "alpha_y.model": "linear"}).law.alpha_y == Linear(0.2035, -0.0015)
    chosen = model_of({**values, "alpha_y.model": "table", "alpha_y.table": str(table)}).law.alpha_y
    assert isinstance(chosen, Table)
    assert (chosen.beta, chosen.beta_nodes) == pytest.approx((0.0, 2.0 / math.pi))
    with pytest.raises(InputError, match=r"alpha_y\.model 'table' needs alpha_y\.table to name a CSV file"):
        model_of({**values, "alpha_y.model": "table"})
