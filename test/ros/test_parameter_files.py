"""Node and commands read parameter files alike: random ones, and those that once differed."""

import itertools
from array import array
from functools import cache

import numpy as np
import pytest
import rclpy
from distribution import free_domain
from hostile_parameters import hostile_file
from rclpy.node import Node
from refusals import assert_says, refusal

from rft_ros.errors import InputError
from rft_ros.node.node_parameters import NodeParameters, given_sections
from rft_ros.parameters import Config, read_parameter_file, read_sections


@cache
def own_domain_id():
    """Beside the participant of the other tests, Fast DDS may deadlock when the next of these contexts is destroyed."""
    return free_domain()


def as_a_node(file, node="/rft", *more):
    """The values that the parameters of a real node have, or why they are refused. `more`: further ROS arguments."""
    arguments = ["--ros-args", "--params-file", str(file), *more]
    namespace, _, name = node.rpartition("/")
    context = rclpy.Context()
    try:
        list(given_sections(arguments))  # as the node's `main` does, before ROS reads them
        rclpy.init(args=arguments, context=context, domain_id=own_domain_id())
        made = Node(
            name,
            namespace=namespace,
            context=context,
            enable_rosout=False,
            start_parameter_services=False,
        )
        try:
            if not more:
                assert_ros_reads_the_same(made, for_node(file, node))
            return NodeParameters(
                made, arguments, prepare=lambda _: None, apply=lambda _: None
            ).config.values
        finally:
            made.destroy_node()
    except InputError as error:
        return str(error)
    except AssertionError:
        raise
    except Exception as error:  # of ROS
        return f"{type(error).__name__}: {error}"
    finally:
        context.try_shutdown()


def for_node(file, node):
    return [section for section in read_sections(file) if section.is_for(node)]


def assert_ros_reads_the_same(made, sections):
    """But for empty lists, which ROS leaves out."""
    given = {name: value for section in sections for name, value in section.parameters.items()}
    of_ros = {name: parameter.value for name, parameter in made._parameter_overrides.items()}
    for name, value in given.items():
        if value != []:
            read = of_ros[name]
            assert repr(value) == repr(list(read) if isinstance(read, array | tuple) else read), (
                name
            )


def as_a_command(file, node="/rft"):
    try:
        return read_parameter_file(file, node).values
    except InputError as error:
        return str(error)


@pytest.mark.parametrize("seed", [1, 2])
def test_node_and_commands_agree_on_random_parameter_files(tmp_path, seed):
    random, nodes = np.random.default_rng(seed), ("/rft", "/cell/rft")
    files = [tmp_path / f"{k}.yaml" for k in range(60)]
    for k, file in enumerate(files):
        file.write_text(
            hostile_file(random, strange=(0.03, 0.5)[k % 2]), encoding="utf-8", newline=""
        )
    used = 0
    for file, node in itertools.product(files, nodes):
        theirs, ours = as_a_node(file, node), as_a_command(file, node)
        if "has no parameters for the node" in ours or (
            isinstance(theirs, dict) and not for_node(file, node)
        ):
            continue  # the node takes nothing from the file; for /rft, a command takes what is rft's in a namespace
        if isinstance(ours, str) and isinstance(theirs, str) and "use_sim_time" in theirs:
            continue  # both refuse the file; in the node, ROS is the first to
        assert ours == theirs, (file.read_text(), node)
        used += not isinstance(ours, str)
    assert used > 10


SECTION = "/**:\n  ros__parameters:\n"
"""The beginning of a file for all nodes."""


REFUSED = [
    (SECTION + "    <<: {mesh.file: sphere}\n", ("line 3", "<<", "write its values out")),
    (
        SECTION + "    base: &b {mesh.file: sphere}\n    copy: *b\n",
        ("line 4", "alias", "write its values out"),
    ),
    (
        SECTION + "    mesh.file: plate\n    mesh.file: sphere\n",
        ("line 4", "'mesh.file' a second time", "remove one"),
    ),
    (
        SECTION + "    mesh.file: plate\n    mesh: {file: sphere}\n",
        ("'mesh.file' stands twice", "remove one"),
    ),
    (
        SECTION + "    mesh: {file: plate}\n    mesh: {scale: 1.0}\n",
        ("line 4", "'mesh' a second time", "remove one"),
    ),
    (
        "a: {b: {ros__parameters: {c: 1}}}\na/b: {ros__parameters: {c: 1}}\n",
        ("'a/b' stands twice", "one section"),
    ),
    (SECTION + "    medium.zeta: '0.3'\n", ("medium.zeta is '0.3'", "number")),
    (SECTION + "    medium.zeta: !!str 0.3\n", ("line 3", "tag", "quotes")),
    (SECTION + "    medium.zeta: |-\n      0.3\n", ("line 3", "block", "one line")),
    (SECTION + "    medium.zeta:\n", ("medium.zeta has no value", "give it one")),
    (SECTION + "    mesh.file: off\n", ("mesh.file is False", "string")),
    (SECTION + "    medium.zetta: 1.0\n", ("medium.zetta", "did you mean 'medium.zeta'?")),
    (SECTION + "    mesh.origin: [0, 0.0, 0]\n", ("mesh.origin is [0, 0.0, 0]", "one type only")),
    ("a/b:\n  c/d:\n    ros__parameters: {}\n", ("'c/d'", "write both in one")),
    (
        SECTION + "    mesh.file: plate\n---\n" + SECTION + "    mesh.file: sphere\n",
        ("line 4", "document", "each"),
    ),
    *(
        (f"{SECTION}    medium.name: {text}\n", ("line 3", text, "decimal number", "quotes"))
        for text in (
            "010",
            "08",
            "0x1p3",
            "0x1F",
            "0b11",
            "1_000",
            "12:30",
            "2001-01-01",
            "yes",
            "y",
            "On",
            ".nan",
            "inf",
        )
    ),
]
"""Files, and words of the sentence that refuses them."""


@pytest.mark.parametrize(("text", "words"), REFUSED)
def test_what_ros_or_yaml_would_read_otherwise_is_refused_in_node_and_commands_alike(
    tmp_path, text, words
):
    file = tmp_path / "cell.yaml"
    file.write_text(text)
    said = refusal(read_parameter_file, file)
    assert_says(said, file.name, *words)
    assert as_a_node(file) == said


def test_a_time_that_is_not_true_or_false_is_refused_in_node_and_commands_alike(tmp_path):
    file = tmp_path / "cell.yaml"
    file.write_text(SECTION + "    use_sim_time: 1\n")
    assert "use_sim_time is 1; it must be true or false" in refusal(read_parameter_file, file)
    assert "use_sim_time" in as_a_node(file)


ORDERED = {
    "rft:\n  ros__parameters: {mesh.file: sphere}\n/**:\n  ros__parameters: {mesh.file: plate}\n": "plate",
    "/**:\n  ros__parameters: {mesh.file: plate}\nrft:\n  ros__parameters: {mesh.file: sphere}\n": "sphere",
    "/rft:\n  ros__parameters: {mesh.file: sphere}\n/*:\n  ros__parameters: {mesh.file: plate}\n": "plate",
    "/**/rft:\n  ros__parameters: {mesh.file: plate}\n'*':\n  ros__parameters: {mesh: {file: sphere}}\n": "sphere",
}
"""Files of several sections for the node, and the mesh that the later one gives."""

NUMBERS = {"1e-1": 0.1, "1": 1.0, "+2": 2.0, ".5": 0.5, "1e-4": 1e-4, "01.5": 1.5}
"""Numbers that every reader reads alike."""


@pytest.mark.parametrize(
    ("text", "value"),
    [
        *((text, {"mesh.file": mesh}) for text, mesh in ORDERED.items()),
        *(
            (f"{SECTION}    medium.zeta: {text}\n", {"medium.zeta": number})
            for text, number in NUMBERS.items()
        ),
    ],
)
def test_later_sections_override_and_numbers_are_read_in_node_and_commands_alike(
    tmp_path, text, value
):
    file = tmp_path / "cell.yaml"
    file.write_text(text)
    assert read_parameter_file(file).values == as_a_node(file) == Config().values | value


def test_a_file_for_two_nodes_is_read_for_each(tmp_path):
    file = tmp_path / "cells.yaml"
    file.write_text(
        "".join(
            f"/{side}/rft:\n  ros__parameters: {{medium.zeta: {z}}}\n" for side, z in SIDES.items()
        )
    )
    for side, zeta in SIDES.items():
        assert read_parameter_file(file, f"/{side}/rft").values == as_a_node(file, f"/{side}/rft")
        assert read_parameter_file(file, f"/{side}/rft").values["medium.zeta"] == zeta
    assert_says(refusal(read_parameter_file, file), "/left/rft, /right/rft", "--node")


SIDES = {"left": 0.5, "right": 0.25}


def test_the_later_of_two_values_counts_whatever_its_type(tmp_path):
    """ROS would keep the integer 1 of the file, and forget the 0.5 that comes after it."""
    file, other = tmp_path / "cell.yaml", tmp_path / "other.yaml"
    file.write_text(f"{SECTION}    medium.zeta: 1\n")
    other.write_text(f"{SECTION}    medium.zeta: 0.5\n")
    for arguments in (("-p", "medium.zeta:=0.5"), ("--params-file", str(other))):
        assert as_a_node(file, "/rft", *arguments)["medium.zeta"] == 0.5


def test_a_value_of_the_command_line_stands_in_the_place_of_its_section_as_in_ros(tmp_path):
    """``-p`` sets a parameter of ``/**``, which the file's own section for the node overrides."""
    file = tmp_path / "cell.yaml"
    file.write_text(
        f"{SECTION}    medium.zeta: 1.0\nrft:\n  ros__parameters: {{medium.zeta: 0.25}}\n"
    )
    for name, zeta in (("medium.zeta", 0.25), ("rft:medium.zeta", 0.5)):
        assert as_a_node(file, "/rft", "-p", f"{name}:=0.5")["medium.zeta"] == zeta
