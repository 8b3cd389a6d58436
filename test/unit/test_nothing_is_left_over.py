"""A parameter that nobody reads is found, a quality flag that nobody sets, and a flag or an option without a test."""

import ast
from dataclasses import fields
from pathlib import Path

import rft_ros
from rft_ros.cli import parser
from rft_ros.estimator.quality import QualityFlag
from rft_ros.parameters import PARAMETERS, LoadCell, Settings
from rft_ros.rft import LAW_NUMBERS

PACKAGE = Path(rft_ros.__file__).parent
TESTS = Path(__file__).parents[1]
SOURCES = {f: ast.parse(f.read_text(encoding="utf-8")) for f in PACKAGE.rglob("*.py")}
NODES = [node for tree in SOURCES.values() for node in ast.walk(tree)]


def unread(parameters):
    """The parameters whose value no code takes: by its name, as an attribute of the settings, or as one of a law."""
    attributes = {node.attr for node in NODES if isinstance(node, ast.Attribute)}
    keys = {
        node.slice.value for node in NODES if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant)
    }
    taken = keys | {f"medium.{name}" for name in LAW_NUMBERS if name in attributes}
    taken |= {f"sensor.{f.name}" for f in fields(LoadCell) if f.name in attributes}
    taken |= {f.name for f in fields(Settings) if f.name in attributes}
    return [name for name in parameters if name not in taken]


def test_every_parameter_is_read_somewhere():
    assert unread(p.name for p in PARAMETERS) == []


def test_a_parameter_that_nobody_reads_is_found_even_if_the_end_of_its_name_is_a_common_word():
    assert unread(["medium.zeta", "medium.limit", "sensor.name", "medium.path"]) == [
        "medium.limit",
        "sensor.name",
        "medium.path",
    ]


def terminal(node):
    """The last name of an expression, such as `settings` of `self.settings`; empty if it has none."""
    return getattr(node, "attr", None) or getattr(node, "id", "")


def unused(owner, names):
    """The fields that no code outside of parameters/ takes of a value whose name has the word `owner` in it.

    The estimator also calls settings `s`, `old` and `before`.
    """
    nodes = [node for f, tree in SOURCES.items() if f.parent.name != "parameters" for node in ast.walk(tree)]
    local_names = ("s", "old", "before") if owner == "settings" else ()
    taken = {
        node.attr
        for node in nodes
        if isinstance(node, ast.Attribute)
        and isinstance(node.ctx, ast.Load)
        and (owner in terminal(node.value) or terminal(node.value) in local_names)
    }
    return [name for name in names if name not in taken]


IN_PROPERTIES = {"zeta_error"}
"""Fields that a property of `Settings` uses, and others do not need."""


def test_every_field_of_the_settings_is_used_somewhere():
    assert unused("settings", (f.name for f in fields(Settings) if f.name not in IN_PROPERTIES)) == []
    assert unused("cell", (f.name for f in fields(LoadCell))) == []


def test_a_field_that_nobody_uses_is_found_if_others_have_an_attribute_of_its_name():
    assert unused("settings", ["sign", "mass", "surface_height"]) == ["sign", "mass"]
    assert unused("cell", ["surface_height", "mass"]) == ["surface_height"]


def other_tests():
    """The syntax trees of all tests but this one: a word in a comment is no test."""
    files = [f for f in TESTS.rglob("*.py") if f.name != Path(__file__).name]
    return [ast.parse(f.read_text(encoding="utf-8")) for f in files]


def test_every_quality_flag_is_named_in_a_test():
    nodes = [node for tree in other_tests() for node in ast.walk(tree) if isinstance(node, ast.Attribute)]
    tested = {node.attr for node in nodes if terminal(node.value) == "QualityFlag"}
    assert {flag.name for flag in QualityFlag if flag} - tested == set()


def test_every_option_of_every_command_is_given_in_a_test():
    commands = next(action for action in parser()._actions if action.dest == "command").choices
    options = {option for c in commands.values() for a in c._actions for option in a.option_strings[-1:]}
    nodes = [node for tree in other_tests() for node in ast.walk(tree) if isinstance(node, ast.Constant)]
    texts = [node.value for node in nodes if isinstance(node.value, str)]
    given = {word.partition("=")[0].strip("`',;:()") for text in texts for word in text.split()}
    without_a_cluster = {"--scheduler"}  # `run` itself is tested with one
    assert options - given - without_a_cluster == set()


def flags_set():
    """The quality flags that the estimator's code adds to others, or returns."""
    statements = [
        node
        for file, tree in SOURCES.items()
        if "estimator" in file.parts
        for node in ast.walk(tree)
        if isinstance(node, ast.Return) or (isinstance(node, ast.AugAssign) and isinstance(node.op, ast.BitOr))
    ]
    parts = [part for statement in statements if statement.value for part in ast.walk(statement.value)]
    return {p.attr for p in parts if isinstance(p, ast.Attribute) and terminal(p.value) in ("f", "QualityFlag")}


def test_every_quality_flag_is_set_somewhere():
    assert {flag.name for flag in QualityFlag if flag} - flags_set() == set()
