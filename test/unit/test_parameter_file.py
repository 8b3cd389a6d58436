"""A ROS parameter file read without ROS, and the α_y table's CSV."""

import math
from pathlib import Path

import numpy as np
import pytest

from rft_ros.errors import InputError
from rft_ros.parameters import defaults, read_alpha_y_table, read_parameter_file, write_parameter_file


@pytest.fixture
def read(tmp_path):
    """Read a parameter file with this text, or with these lines for the node."""

    def of(text="", *, node=None, of=read_parameter_file, name="cell.yaml"):
        if node is not None:
            text = f"/**:\n  ros__parameters:\n    {node}\n"
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
        return of(tmp_path / name)

    return of


@pytest.fixture
def table(read):
    """Read an α_y table with this text."""
    return lambda text: read(text, of=lambda file: read_alpha_y_table(str(file)), name="alpha_y.csv")


def test_nested_and_dotted_names_are_the_same_parameter_and_the_others_stay_at_their_defaults(read):
    nested = "rft:\n  ros__parameters:\n    medium:\n      zeta: 0.33\n      name: poppy_seeds_loose\n"
    dotted = "rft:\n  ros__parameters:\n    medium.zeta: 0.33\n    medium.name: poppy_seeds_loose\n"
    assert read(nested) == read(dotted) == {**defaults(), "medium.zeta": 0.33, "medium.name": "poppy_seeds_loose"}


@pytest.mark.parametrize("key", ["/**", "rft", "/rft", "/**/rft"])
def test_the_node_may_be_named_in_any_of_ross_ways(read, key):
    assert read(f"{key}:\n  ros__parameters:\n    max_rate: 50.0\n")["max_rate"] == 50.0


def test_the_nodes_own_section_overrides_the_one_for_all_nodes_and_what_every_ros_node_has_is_ignored(read):
    values = read(
        "rft:\n  ros__parameters:\n    max_rate: 50.0\n"
        "/**:\n  ros__parameters:\n    max_rate: 10.0\n    surface_height: 0.2\n"
        "    use_sim_time: true\n    qos_overrides./tf.depth: 3\n"
        "other_node:\n  ros__parameters:\n    speed: 3\n"
    )
    assert (values["max_rate"], values["surface_height"]) == (50.0, 0.2)


@pytest.mark.parametrize(("written", "value"), [("1e-4", 1e-4), ("1.0e-3", 1e-3), ("2E-4", 2e-4), ("5.e-4", 5e-4)])
def test_numbers_with_an_exponent_are_numbers_as_they_are_to_ros(read, written, value):
    """To YAML 1.1 some of these are strings; ROS reads all of them as doubles."""
    assert read(node=f"rest_speed: {written}")["rest_speed"] == value


@pytest.mark.parametrize("name", ["1e-4x", "e5", "1e", "plate-1e5.stl"])
def test_names_that_only_look_like_numbers_stay_names(read, name):
    assert Path(read(node=f"mesh.file: {name}")["mesh.file"]).name == name


def assert_refused(read, sentence, text, name="cell.yaml"):
    with pytest.raises(InputError) as refused:
        read(text)
    assert sentence in str(refused.value)
    assert name in str(refused.value)
    assert "\n" not in str(refused.value)


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
        ("arm:\n  ros__parameters:\n    x: {y: [1, a]}\n", "x.y is [1, 'a']; ROS takes lists of one type only"),
        (
            "/**:\n  ros__parameters:\n    medium.zetta: 1.0\n",
            "did you mean 'medium.zeta'?",
        ),
        ("/**:\n  ros__parameters:\n    medium.zeta: .nan\n", "medium.zeta is nan; it must be a finite number"),
        (b"\xff\xfe\x00", "cannot be read"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_with_a_sentence_that_names_it(read, text, sentence):
    assert_refused(read, sentence, text)


def test_missing_files_are_named(tmp_path):
    with pytest.raises(InputError, match=r"parameter file '.*nowhere\.yaml' cannot be read: .*No such file"):
        read_parameter_file(tmp_path / "nowhere.yaml")
    with pytest.raises(InputError, match=r"alpha_y\.table '/nowhere\.csv' cannot be read"):
        read_alpha_y_table("/nowhere.csv")


@pytest.mark.parametrize(
    "text",
    [
        "0,0.2\n90,0.1\n180,0.05\n",
        "beta,alpha_y\n0,0.2\n90,0.1\n180,0.05\n",
        "# measured\n\nbeta [deg], alpha_y [N/cm3]\n180, 0.05\n 90,0.1\n0,0.2\n",
        b'\xef\xbb\xbf"beta","alpha_y"\r\n0,0.2\r\n90,0.1\r\n180,0.05\r\n',
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
        ("nan,0.1\n0,0.2\n", "has a value that is not finite"),
        ("0,0.1\n90,-0.2\n", "has a negative alpha_y (-0.2)"),
        ("0,0.1\n0,0.2\n", "has 2 rows; a grid of 1 beta x 1 gamma values needs each pair once (1 rows)"),
        ("0,0,1\n0,30,1\n90,0,1\n", "has 3 rows; a grid of 2 beta x 2 gamma values needs each pair once (4 rows)"),
        ("0,0,1\n0,30,1\n90,0,1\n90,0,1\n", "has 4 rows; a grid of 2 beta x 2 gamma values"),
        (b"\xff\xfe0,1", "cannot be read"),
    ],
)
def test_a_table_that_cannot_be_used_is_refused_with_a_sentence_that_names_it(table, text, sentence):
    assert_refused(table, sentence, text, name="alpha_y.csv")


@pytest.mark.parametrize("parameter", ["mesh.file", "alpha_y.table", "ground.file"])
@pytest.mark.parametrize("named", ["a.stl", "below/a.stl", "/else/a.stl", "~nobody/a.stl"])
def test_a_relative_path_is_beside_the_file_that_names_it(tmp_path, monkeypatch, read, parameter, named):
    monkeypatch.chdir("/")
    there = named if named[0] in "/~" else f"{tmp_path}/{named}"
    assert read(node=f"{parameter}: {named}")[parameter] == there
    assert read(node='alpha_y.table: ""')["alpha_y.table"] == ""


@pytest.mark.parametrize(
    "mesh", ["plate", "package://rft_ros/meshes/plate.stl", "/else/a.stl", "tool.stl", "below/tool"]
)
def test_a_file_that_was_written_means_the_same_tool_from_any_folder(tmp_path, monkeypatch, read, mesh):
    monkeypatch.chdir(tmp_path)
    relative = mesh in ("tool.stl", "below/tool")
    values = {**defaults(), "mesh.file": mesh, "medium.zeta": 0.312, "sensor.position": (0.0, 0.1, 0.2)}
    write_parameter_file(tmp_path / "new" / "saved.yaml", values, comment="from a test")
    written = {**values, "mesh.file": f"{tmp_path}/{mesh}" if relative else mesh}
    assert read_parameter_file(tmp_path / "new" / "saved.yaml") == written
    if not relative:
        assert read(node=f"mesh.file: {mesh}")["mesh.file"] == mesh


def test_writing_never_overwrites_a_file(tmp_path):
    file = tmp_path / "cell.yaml"
    file.write_text("# mine\n")
    with pytest.raises(InputError, match=r"parameter file '.*cell\.yaml' exists; it is not overwritten"):
        write_parameter_file(file, defaults(), comment="from a test")
    assert file.read_text() == "# mine\n"
