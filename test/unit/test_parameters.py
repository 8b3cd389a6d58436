"""The parameter table, models made from its values, a ROS parameter file read without ROS, the α_y table's CSV."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from refusals import assert_says, refusal

from rft_ros.errors import InputError, shown
from rft_ros.parameters import (
    OPTIONS,
    PARAMETERS,
    Config,
    LearningConfig,
    MediumConfig,
    checked,
    read_alpha_y_table,
    read_parameter_file,
    write_parameter_file,
)
from rft_ros.parameters.config import CALIBRATED_ERROR, GROUPS
from rft_ros.parameters.parameter import parameter_fields
from rft_ros.rft import LAW_NUMBERS, LAWS, MEDIA, Constant, Linear, law_named


@pytest.mark.parametrize("parameter", PARAMETERS, ids=lambda p: p.name)
def test_a_parameter_is_described_passes_its_own_check_and_refuses_what_has_another_type(
    parameter,
):
    name, (low, high) = parameter.name, parameter.bounds
    assert re.fullmatch(r"\S.{15,}\.", parameter.description)
    assert checked(name, parameter.default) == parameter.default == Config().values[name]
    for value in (None, {}, object(), b"x"):
        assert_says(refusal(checked, name, value), name, repr(value), "must be")
    if isinstance(parameter.default, str):
        return
    if isinstance(parameter.default, bool):
        assert checked(name, True) is True
        assert_says(refusal(checked, name, 1.0), name, "1.0", "true or false")
        return
    for value in (math.nan, math.inf, -math.inf, True, "1.0", 10**400):
        words = name, shown(value), "finite number"
        if isinstance(parameter.default, float):
            assert_says(refusal(checked, name, value), *words)
            continue
        for k in range(len(parameter.default)):
            numbers = [value if i == k else v for i, v in enumerate(parameter.default)]
            assert_says(refusal(checked, name, numbers), *words)
    if isinstance(parameter.default, float) and name != "sensor.sign":
        for limit, beyond in ((low, -math.inf), (high, math.inf)):
            assert checked(name, limit) == limit
            outside = math.nextafter(limit, beyond)
            assert_says(
                refusal(checked, name, outside), name, f"{outside:g}", f"{low:g}", f"{high:g}"
            )


@pytest.mark.parametrize(
    ("name", "value", "remedy"),
    [
        ("medium.name", "mars", ("generic", "poppy_seeds_loose", "poppy_seeds_close")),
        ("sensor.sign", 0.5, ("1.0", "-1.0")),
        ("ground.cell", 1e-5, ("0.0001",)),
        ("sensor.bias", [0.0, 0.0, 0.0, 0.0, 0.0], ("6 numbers",)),
        ("mesh.origin", "abc", ("3 numbers",)),
        ("learning.mode", True, ("string",)),
    ],
)
def test_a_wrong_value_is_refused_with_parameter_value_and_remedy(name, value, remedy):
    given = f"{value:g}" if isinstance(value, float) else repr(value)
    assert_says(refusal(checked, name, value), name, given, *remedy)


def test_a_wrong_name_or_norm_is_refused():
    assert_says(refusal(checked, "medium.zetta", 1.0), "'medium.zetta'", "'medium.zeta'")
    assert_says(refusal(checked, "qqq", 1.0), "'qqq'")
    assert_says(refusal(checked, "sensor.quaternion", [0, 0, 0, 2]), "sensor.quaternion", "norm 2")


def test_an_integer_a_norm_near_1_and_an_unquoted_off_are_accepted():
    assert checked("sensor.quaternion", [0.0, 0.0, 0.0, 1.005]) == (0.0, 0.0, 0.0, 1.0)
    assert isinstance(checked("medium.zeta", 2), float)
    assert checked("mesh.origin", [1, 2, 3]) == (1.0, 2.0, 3.0)
    assert checked("learning.mode", False) == "off"  # unquoted in YAML


@pytest.mark.parametrize("name", ["zeta_error", "calibrated_depth", "grain_diameter"])
def test_a_parameter_of_0_is_none_in_python_where_0_means_not_known(name):
    assert getattr(Config.of({f"medium.{name}": 0.0}).medium, name) is None
    assert getattr(Config.of({f"medium.{name}": 0.2}).medium, name) == 0.2
    for value in (0.0, -0.1, math.nan):
        with pytest.raises(InputError, match=name):
            MediumConfig(**{name: value})


def test_a_zeta_whose_error_is_not_known_counts_as_calibrated_only_where_nothing_corrects_it():
    known = MediumConfig(zeta_error=0.07)
    for mode, error in (("off", CALIBRATED_ERROR), ("observe", 1.0), ("apply", 1.0)):
        learning = LearningConfig(mode=mode)
        assert Config(learning=learning).strength_error == error
        assert Config(learning=learning, medium=known).strength_error == 0.07


def test_default_values_make_the_default_config_and_other_values_reach_each_field():
    assert Config.of(Config().values) == Config()
    of_kind = {"sign": -1.0, "quaternion": (1.0, 0.0, 0.0, 0.0), "motions": "press"}
    of_type = {str: "other", float: 0.25, bool: True}
    for group, owner in {"": Config, **GROUPS}.items():
        for name, parameter in parameter_fields(owner).items():
            other = of_kind.get(parameter.kind) or of_type.get(type(parameter.default))
            if parameter.choices:
                other = parameter.choices[-1]
            if other is None:
                other = tuple(1.0 + k for k in range(len(parameter.default)))
            changed = Config.of({parameter.name: other})
            assert getattr(getattr(changed, group) if group else changed, name) == other
            assert changed.values == {**Config().values, parameter.name: other}
            assert changed.changed({parameter.name: parameter.default}) == Config()


def test_an_unknown_kind_of_motion_is_refused_with_those_that_exist():
    name = "medium.calibrated_motions"
    assert checked(name, "press, drag") == "press, drag"
    assert_says(
        refusal(checked, name, "press, drags"), name, "'press, drags'", "drag", "withdrawal"
    )


def test_one_frame_for_two_is_refused():
    words = "world_frame", "tool_frame", "'base'", "different frames"
    assert_says(
        refusal(Config.of, {**Config().values, "world_frame": "base", "tool_frame": "base"}),
        *words,
    )


@pytest.fixture
def values(tmp_path):
    file = tmp_path / "square.obj"
    file.write_text("v 0 0 0\nv 10 0 0\nv 10 10 0\nv 0 10 0\nf 1 3 2\nf 1 4 3\n")
    return {**Config().values, "mesh.file": str(file)}


def test_a_model_is_the_tool_medium_and_alpha_y_of_the_values(values):
    given = {
        "mesh.origin": (5.0, 5.0, 0.0),
        "medium.zeta": 0.33,
        "medium.name": "poppy_seeds_loose",
    }
    model = Config.of({**values, **given}).model(generation=7)
    assert model.law.stresses == {"medium": "poppy_seeds_loose", "alpha_y": "linear"}
    assert (model.law.zeta, model.generation) == (0.33, 7)
    constant = Config.of({**values, **given, "alpha_y.model": "constant"}).model().law
    assert constant.alpha_y == Constant(pytest.approx(-0.026 + 0.057 + 0.000))
    assert model.law.stiffness == 0.33e6
    assert model.tool.plates.area == pytest.approx(1e-4)
    assert model.tool.vertices.min(axis=0) == pytest.approx([-0.005, -0.005, 0.0])
    # it is not loaded again
    again = Config.of({**values, "mesh.file": "/nowhere.stl"}).model({"tool": model.tool})
    assert again.tool is model.tool


def test_the_alpha_y_model_is_chosen_by_name(values, table, tmp_path):
    read = table("beta,alpha_y\n0,0.2\n90,0.1\n")
    assert Config.of({**values, "alpha_y.model": "linear"}).model().law.alpha_y == Linear(
        0.2035, -0.0015
    )
    chosen = (
        Config.of(
            {**values, "alpha_y.model": "table", "alpha_y.table": str(tmp_path / "alpha_y.csv")}
        )
        .model()
        .law.alpha_y
    )
    assert chosen == read
    with pytest.raises(
        InputError, match=r"alpha_y\.model 'table' needs alpha_y\.table to name a CSV file"
    ):
        Config.of({**values, "alpha_y.model": "table"}).model()


def values_in_file(file):
    return read_parameter_file(file).values


@pytest.fixture
def read(tmp_path):
    """Read a parameter file with this text, or with these lines for the node."""

    def of(text="", *, node=None, of=values_in_file, name="cell.yaml"):
        if node is not None:
            text = f"/**:\n  ros__parameters:\n    {node}\n"
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
        return of(tmp_path / name)

    return of


@pytest.fixture
def table(read):
    """Read an α_y table with this text."""
    return lambda text: read(
        text, of=lambda file: read_alpha_y_table(str(file)), name="alpha_y.csv"
    )


def test_nested_and_dotted_names_are_the_same_parameter_and_the_others_stay_at_their_defaults(
    read,
):
    nested = (
        "rft:\n  ros__parameters:\n    medium:\n      zeta: 0.33\n      name: poppy_seeds_loose\n"
    )
    dotted = (
        "rft:\n  ros__parameters:\n    medium.zeta: 0.33\n    medium.name: poppy_seeds_loose\n"
    )
    assert (
        read(nested)
        == read(dotted)
        == {**Config().values, "medium.zeta": 0.33, "medium.name": "poppy_seeds_loose"}
    )


@pytest.mark.parametrize("key", ["/**", "rft", "/rft", "/**/rft"])
def test_the_node_may_be_named_in_any_of_ross_ways(read, key):
    assert read(f"{key}:\n  ros__parameters:\n    max_rate: 50.0\n")["max_rate"] == 50.0


def test_a_later_section_overrides_an_earlier_one_and_parameters_of_every_node_are_ignored(read):
    own = "rft:\n  ros__parameters:\n    max_rate: 50.0\n"
    every = "/**:\n  ros__parameters:\n    max_rate: 10.0\n    surface_height: 0.2\n"
    every += "    use_sim_time: true\n    qos_overrides./tf.depth: 3\n"
    other = "other_node:\n  ros__parameters:\n    speed: 3\n    list: []\n"
    for text, rate in (
        (every + own, 50.0),
        (own + every, 10.0),
        (other + own + other.replace("node", "name"), 50.0),
    ):
        assert read(text)["max_rate"] == rate
    assert read(own + every)["surface_height"] == 0.2


def test_text_with_an_exponent_is_a_number_as_in_ros_and_names_that_look_like_one_stay_names(read):
    for number in ("1e-4", "1.0e-3", "2E-4", "5.e-4"):
        assert read(node=f"rest_speed: {number}")["rest_speed"] == float(number)
    for name in ("1e-4x", "e5", "1e", "plate-1e5.stl"):
        assert Path(read(node=f"mesh.file: {name}")["mesh.file"]).name == name


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("rft: {ros__parameters: {a: [1, 2\n", "is not YAML: while parsing a flow sequence"),
        ("rft: &a {ros__parameters: *a}", "line 1 has an alias (*)"),
        ("rft: {ros__parameters: {a: &a 1, b: *a}}", "line 1 has an alias (*)"),
        ("- 1\n- 2\n", "has no node name at its top level, such as '/**'"),
        ("rft:\n  medium.zeta: 1.0\n", "'rft' has no 'ros__parameters'"),
        ("rft: 3\n", "'rft' has no 'ros__parameters'"),
        (
            "arm:\n  ros__parameters:\n    x: 1\n",
            "has no parameters for the node /rft; its sections are arm",
        ),
        (
            "arm:\n  ros__parameters:\n    x: {y: [1, a]}\n",
            "x.y is [1, 'a']; ROS takes lists of one type only",
        ),
        ("/**:\n  ros__parameters:\n    medium.zetta: 1.0\n", "did you mean 'medium.zeta'?"),
        ("/**:\n  ros__parameters:\n    medium.zeta: .nan\n", "line 3 has '.nan'"),
        (b"\xff\xfe\x00", "cannot be read"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_with_a_sentence_that_names_it(read, text, sentence):
    said = refusal(read, text)
    assert sentence in said
    assert "cell.yaml" in said


def test_missing_files_are_named(tmp_path):
    file = tmp_path / "nowhere.yaml"
    assert f"parameter file '{file}' does not exist; give the path" in refusal(
        read_parameter_file, file
    )
    assert "alpha_y.table '/nowhere.csv' does not exist" in refusal(
        read_alpha_y_table, "/nowhere.csv"
    )


@pytest.mark.parametrize(
    "text",
    [
        "beta,alpha_y\n0,0.2\n90,0.1\n180,0.05\n",
        "beta;alpha_y\n0;0,2\n90;0,1\n180;0,05\n",
        "# measured\n\nalpha_y [N/m³], beta [deg]\n5e4, 180\n1e5,90\n2e5, 0\n",
        b'\xef\xbb\xbf"beta_rad","alpha_y"\r\n0,0.2\r\n1.570796326794897,0.1\r\n3.141592653589793,0.05\r\n',
    ],
    ids=[
        "plain",
        "decimal commas",
        "order and unit by the header",
        "as spreadsheets write it, in radians",
    ],
)
def test_a_table_of_beta_is_read_as_a_medium_is(table, text):
    read = table(text)
    assert (read.beta, read.beta_nodes) == pytest.approx((0.0, 2.0 / math.pi))
    assert [row[0] for row in read.values] == pytest.approx([0.2, 0.1, 0.05])
    assert all(len(set(row)) == 1 for row in read.values)


def test_a_table_of_beta_and_gamma_is_a_full_grid_in_any_order(table):
    read = table("beta,gamma,alpha_y\n90,-30,3\n0,-30,1\n0,60,2\n90,60,4\n")
    assert (read.beta, read.beta_nodes) == pytest.approx((0.0, 2.0 / math.pi))
    assert (read.gamma, read.gamma_nodes) == pytest.approx((-math.pi / 6, 2.0 / math.pi))
    assert np.array(read.values) == pytest.approx(np.array([[1.0, 2.0], [3.0, 4.0]]))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("beta,alpha_y\n0,0.1\n90,0,0.1\n", "line 3 is not 2 numbers"),
        ("beta,alpha_y\n0,O.1\n90,0.2\n", "line 2 is not 2 numbers"),
        ("0,0.1\n90,0.2\n", "has no column beta; its first line must name beta,alpha_y"),
        (
            "# beta,alpha_y\n0,0.1\n",
            "has no column beta; its first line must name beta,alpha_y, without #",
        ),
        ("beta,gamma_grad,alpha_y\n0,0,0.2\n", "gamma must be in deg or rad"),
        ("beta,alpha_y\nnan,0.1\n0,0.2\n", "line 2: beta is nan; it must be a finite number"),
        ("beta,alpha_y\n0,0.1\n90,-0.2\n", "has alpha_y from -0.2 to 0.1 N/cm³"),
        (
            "beta,alpha_y\n0,0.1\n0,0.2\n",
            "has 2 rows; a grid of 1 beta x 1 gamma values needs each pair once (1 rows)",
        ),
        (
            "beta,gamma,alpha_y\n0,0,1\n0,30,1\n90,0,1\n",
            "has 3 rows; a grid of 2 beta x 2 gamma values needs each pair once (4 rows)",
        ),
        (b"\xff\xfe0,1", "cannot be read"),
        ("beta,alpha_y\n0,200000\n45,136000\n90,60000\n180,0\n", "N/cm³"),
        ("beta,alpha_y\n0.2,0\n0.136,45\n0.06,90\n0,180\n", "order of the columns"),
        ("beta_rad,alpha_y\n0,0.2\n90,0.1\n", "beta_deg"),
        ("beta,alpha_y\n0,0.2\n0.785,0.136\n1.571,0.06\n3.1416,0\n", "radians"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_with_a_sentence_that_names_it(
    table, text, sentence
):
    said = refusal(table, text)
    assert sentence in said
    assert "alpha_y.csv" in said


@pytest.mark.parametrize("parameter", ["mesh.file", "alpha_y.table", "ground.file"])
@pytest.mark.parametrize("named", ["a.stl", "below/a.stl", "/else/a.stl", "~nobody/a.stl"])
def test_a_relative_path_is_beside_the_file_that_names_it(
    tmp_path, monkeypatch, read, parameter, named
):
    monkeypatch.chdir("/")
    there = named if named[0] in "/~" else f"{tmp_path}/{named}"
    assert read(node=f"{parameter}: {named}")[parameter] == there
    assert read(node='alpha_y.table: ""')["alpha_y.table"] == ""


@pytest.mark.parametrize(
    "mesh",
    ["plate", "package://rft_ros/meshes/plate.stl", "/else/a.stl", "tool.stl", "below/tool"],
)
def test_a_file_that_was_written_means_the_same_tool_from_any_folder(
    tmp_path, monkeypatch, read, mesh
):
    monkeypatch.chdir(tmp_path)
    relative = mesh in ("tool.stl", "below/tool")
    values = {
        **Config().values,
        "mesh.file": mesh,
        "medium.zeta": 0.312,
        "sensor.position": (0.0, 0.1, 0.2),
    }
    write_parameter_file(tmp_path / "new" / "saved.yaml", Config.of(values), comment="from a test")
    written = {**values, "mesh.file": f"{tmp_path}/{mesh}" if relative else mesh}
    assert read_parameter_file(tmp_path / "new" / "saved.yaml").values == written
    if not relative:
        assert read(node=f"mesh.file: {mesh}")["mesh.file"] == mesh


@pytest.mark.parametrize("number", LAW_NUMBERS)
def test_a_number_of_a_law_is_a_parameter_and_can_be_varied_in_a_study(number):
    name = OPTIONS[number].name
    assert name == f"medium.{number}"
    models = [
        Config.of({**Config().values, "law": law, name: Config().values[name] + 0.25}).model()
        for law in LAWS
    ]
    assert Config().values[name] + 0.25 in [getattr(model.law, number, None) for model in models]


@pytest.mark.parametrize("name", LAWS)
def test_a_law_is_made_by_its_name_and_has_the_defaults_of_the_table_but_no_memory(name):
    law, values = law_named(name, MEDIA["generic"], Constant(0.1)), Config().values
    numbers = [number for number in LAW_NUMBERS if hasattr(law, number)]
    assert law.name == name
    assert {number: values[f"medium.{number}"] for number in numbers} | {
        "mobilization_length": 0.0
    } == {number: getattr(law, number) for number in numbers}


def test_a_number_that_no_law_has_is_refused_by_its_name():
    with pytest.raises(TypeError, match=r"'stiffness'.*zeta"):
        law_named("treers2021", MEDIA["generic"], Constant(0.1), stiffness=2.0)


def test_a_config_is_the_values_by_name_and_back_and_refuses_what_no_parameter_allows():
    assert Config.of(Config().values) == Config()
    assert Config().values == Config().values
    config = Config.of({"medium.zeta": 0.4, "sensor.bias": [1, 2, 3, 0, 0, 0]})
    assert config.medium.zeta == 0.4
    assert config.sensor.bias == (1.0, 2.0, 3.0, 0.0, 0.0, 0.0)
    assert config.changed({"medium.zeta": 1.0, "sensor.bias": (0.0,) * 6}) == Config()
    for values, words in (
        ({"mesh.fle": "x"}, ("mesh.fle",)),
        ({"medium.zeta": "x"}, ("medium.zeta", "number")),
    ):
        assert_says(refusal(Config.of, values), *words)


def test_a_change_of_surface_height_or_of_numbers_of_the_medium_loads_nothing():
    config = Config.of({"ground.cell": 0.01, "medium.file": "own.yaml"})
    other = {"surface_height": 0.1, "medium.zeta": 0.5, "medium.zeta_error": 0.2}
    assert config.changed(other).parts() == config.parts()
