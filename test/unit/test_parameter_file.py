"""A ROS parameter file read without ROS, and the α_y table's CSV."""

import math
from pathlib import Path

import numpy as np
import pytest

from rft_ros.errors import InputError
from rft_ros.parameters import defaults, read_alpha_y_table, read_parameter_file, write_parameter_file


@pytest.fixture
def read(tmp_path):
    """Read a parameter file with this text."""

    def of(text):
        file = tmp_path / "cell.yaml"
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_parameter_file(file)

    return of


def refusal(read, text):
    with pytest.raises(InputError) as refused:
        read(text)
    sentence = str(refused.value)
    assert "\n" not in sentence
    return sentence


def test_nested_and_dotted_names_are_the_same_parameter(read):
    nested = "rft:\n  ros__parameters:\n    medium:\n      zeta: 0.33\n      name: poppy_seeds_loose\n"
    dotted = "rft:\n  ros__parameters:\n    medium.zeta: 0.33\n    medium.name: poppy_seeds_loose\n"
    assert read(nested) == read(dotted) == {**defaults(), "medium.zeta": 0.33, "medium.name": "poppy_seeds_loose"}


@pytest.mark.parametrize("key", ["/**", "rft", "/rft", "/**/rft"])
def test_the_node_may_be_named_in_any_of_ross_ways(read, key):
    assert read(f"{key}:\n  ros__parameters:\n    max_rate: 50.0\n")["max_rate"] == 50.0


def test_the_nodes_own_section_overrides_the_one_for_all_nodes(read):
    text = (
        "rft:\n  ros__parameters:\n    max_rate: 50.0\n"
        "/**:\n  ros__parameters:\n    max_rate: 10.0\n    surface_height: 0.2\n"
        "other_node:\n  ros__parameters:\n    speed: 3\n"
    )
    values = read(text)
    assert (values["max_rate"], values["surface_height"]) == (50.0, 0.2)


def test_what_a_file_does_not_say_stays_at_its_default(read):
    assert read("/**:\n  ros__parameters:\n    max_rate: 1.0\n") == {**defaults(), "max_rate": 1.0}


def test_parameters_that_every_ros_node_has_are_ignored(read):
    text = "/**:\n  ros__parameters:\n    use_sim_time: true\n    qos_overrides./tf.depth: 3\n    max_rate: 2.0\n"
    assert read(text)["max_rate"] == 2.0


@pytest.mark.parametrize(("written", "value"), [("1e-4", 1e-4), ("1.0e-3", 1e-3), ("2E-4", 2e-4), ("5.e-4", 5e-4)])
def test_numbers_with_an_exponent_are_numbers_as_they_are_to_ros(read, written, value):
    """To YAML 1.1 some of these are strings; ROS reads all of them as doubles."""
    assert read(f"/**:\n  ros__parameters:\n    rest_speed: {written}\n")["rest_speed"] == value


@pytest.mark.parametrize("name", ["1e-4x", "e5", "1e", "plate-1e5.stl"])
def test_names_that_only_look_like_numbers_stay_names(read, name):
    assert Path(read(f"/**:\n  ros__parameters:\n    mesh.file: {name}\n")["mesh.file"]).name == name


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("a: [1, 2\n", "is not YAML: while parsing a flow sequence"),
        ("rft: &a {ros__parameters: *a}", "is not YAML: line 1 has an alias (*)"),
        ("- 1\n- 2\n", "has no node name at its top level, such as '/**'"),
        ("", "has no node name at its top level, such as '/**'"),
        ("rft:\n  medium.zeta: 1.0\n", "'rft' has no 'ros__parameters'"),
        ("rft: 3\n", "'rft' has no 'ros__parameters'"),
        ("arm:\n  ros__parameters:\n    x: 1\n", "has no parameters for the node /rft; its sections are arm"),
        ("/**:\n  ros__parameters: {}\n", "has no parameters for the node /rft; its sections are /**"),
        ("/**:\n  ros__parameters:\n    zeta: 1.0\n", "there is no parameter 'zeta'"),
        ("/**:\n  ros__parameters:\n    medium.zetta: 1.0\n", "did you mean 'medium.zeta'?"),
        ("/**:\n  ros__parameters:\n    medium.zeta: high\n", "medium.zeta is 'high'; it must be a finite number"),
        ("/**:\n  ros__parameters:\n    medium.zeta: .nan\n", "medium.zeta is nan; it must be a finite number"),
        ("/**:\n  ros__parameters:\n    mesh.origin: [1.0]\n", "mesh.origin is [1.0]; it must be 3 numbers"),
        (
            "/**:\n  ros__parameters:\n    sensor.position: [0, 0, 0.5]\n",
            "sensor.position is [0, 0, 0.5]; ROS takes lists of one type only, such as [0.0, 0.5]",
        ),
        ("arm:\n  ros__parameters:\n    x: {y: [1, a]}\n", "x.y is [1, 'a']; ROS takes lists of one type only"),
        (b"\xff\xfe\x00", "cannot be read"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_with_a_sentence_that_names_it(read, text, sentence):
    assert sentence in refusal(read, text)
    assert "cell.yaml" in refusal(read, text)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"parameter file '.*nowhere\.yaml' cannot be read: .*No such file"):
        read_parameter_file(tmp_path / "nowhere.yaml")


@pytest.fixture
def table(tmp_path):
    """Read an α_y table with this text."""

    def of(text):
        file = tmp_path / "alpha_y.csv"
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_alpha_y_table(str(file))

    return of


@pytest.mark.parametrize(
    "text",
    [
        "0,0.2\n90,0.1\n180,0.05\n",
        "beta,alpha_y\n0,0.2\n90,0.1\n180,0.05\n",
        "# measured\n\nbeta [deg], alpha_y [N/cm3]\n180, 0.05\n 90,0.1\n0,0.2\n",
        b"\xef\xbb\xbf0,0.2\r\n90,0.1\r\n180,0.05\r\n",
    ],
    ids=["plain", "header", "comment and any order", "as spreadsheets write it"],
)
def test_a_table_of_beta_is_read_in_degrees(table, text):
    read = table(text)
    assert (read.beta, read.beta_nodes) == pytest.approx((0.0, 2.0 / math.pi))
    assert read.values[:, 0].tolist() == pytest.approx([0.2, 0.1, 0.05])
    assert (read.values[:, 1:] == read.values[:, :1]).all()


def test_a_table_of_beta_and_gamma_is_a_full_grid_in_any_order(table):
    read = table("beta,gamma,alpha_y\n90,-30,3\n0,-30,1\n0,60,2\n90,60,4\n")
    assert (read.beta, read.beta_nodes) == pytest.approx((0.0, 2.0 / math.pi))
    assert (read.gamma, read.gamma_nodes) == pytest.approx((-math.pi / 6, 2.0 / math.pi))
    assert read.values == pytest.approx(np.array([[1.0, 2.0], [3.0, 4.0]]))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "needs rows of 2 numbers"),
        ("beta,alpha_y\n", "needs rows of 2 numbers"),
        ("1\n2\n", "needs rows of 2 numbers"),
        ("0,0.1\n90,0,0.1\n", "needs rows of 2 numbers"),
        ("0,0.1\nx,0.2\n", "line 2 is not numbers"),
        ("0,O.1\n90,0.2\n", "line 1 is not numbers"),
        ("0,0.1\nbeta,alpha_y\n", "line 2 is not numbers"),
        ("0,0.1,\n", "line 1 is not numbers"),
        ("0,nan\n", "has a value that is not finite"),
        ("0,0.1\n90,-0.2\n", "has a negative alpha_y (-0.2)"),
        ("0,0.1\n0,0.2\n", "has 2 rows; a grid of 1 beta x 1 gamma values needs each pair once (1 rows)"),
        ("0,0,1\n0,30,1\n90,0,1\n", "has 3 rows; a grid of 2 beta x 2 gamma values needs each pair once (4 rows)"),
        ("0,0,1\n0,30,1\n90,0,1\n90,0,1\n", "has 4 rows; a grid of 2 beta x 2 gamma values"),
        (b"\xff\xfe0,1", "cannot be read"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_with_a_sentence_that_names_it(table, text, sentence):
    with pytest.raises(InputError) as refused:
        table(text)
    assert sentence in str(refused.value)
    assert "alpha_y.csv" in str(refused.value)


@pytest.mark.parametrize("name", ["table.csv", "below/table.csv"])
def test_a_tables_path_is_relative_to_the_parameter_file_that_names_it(tmp_path, monkeypatch, name):
    file = tmp_path / "cell.yaml"
    file.write_text(f"/**:\n  ros__parameters:\n    alpha_y.model: table\n    alpha_y.table: {name}\n")
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text("0,0.1\n90,0.2\n")
    monkeypatch.chdir("/")
    path = str(read_parameter_file(file)["alpha_y.table"])
    assert path == str(tmp_path / name)
    read_alpha_y_table(path)


def test_an_absolute_path_of_a_table_and_none_are_kept(tmp_path):
    file = tmp_path / "cell.yaml"
    for written in ("/else/table.csv", ""):
        file.write_text(f'/**:\n  ros__parameters:\n    alpha_y.table: "{written}"\n')
        assert read_parameter_file(file)["alpha_y.table"] == written


def test_a_written_file_means_the_same_tool_from_any_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    absolute = {
        "tool.stl": f"{tmp_path}/tool.stl",
        "below/tool": f"{tmp_path}/below/tool",
        "/else/a.stl": "/else/a.stl",
    }
    kept = {name: name for name in ("plate", "package://rft_ros/meshes/plate.stl")}
    for k, (mesh, written) in enumerate({**absolute, **kept}.items()):
        file = tmp_path / f"{k}.yaml"
        write_parameter_file(file, {**defaults(), "mesh.file": mesh}, comment="from a test")
        assert read_parameter_file(file)["mesh.file"] == written


def test_a_relative_mesh_is_beside_the_file_that_names_it_and_a_shipped_one_is_not(tmp_path):
    file = tmp_path / "cell.yaml"
    kept = ("/else/a.stl", "~nobody/a.stl", "plate", "package://rft_ros/meshes/plate.stl")
    for written, read in {"tool.stl": f"{tmp_path}/tool.stl", **{name: name for name in kept}}.items():
        file.write_text(f"/**:\n  ros__parameters:\n    mesh.file: {written}\n")
        assert read_parameter_file(file)["mesh.file"] == read


def test_writing_never_overwrites_a_file(tmp_path):
    file = tmp_path / "cell.yaml"
    file.write_text("# mine\n")
    with pytest.raises(InputError, match=r"parameter file '.*cell\.yaml' exists; it is not overwritten"):
        write_parameter_file(file, defaults(), comment="from a test")
    assert file.read_text() == "# mine\n"


def test_a_missing_table_is_named():
    with pytest.raises(InputError, match=r"alpha_y\.table '/nowhere\.csv' cannot be read"):
        read_alpha_y_table("/nowhere.csv")
