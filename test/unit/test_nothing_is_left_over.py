"""A parameter that nobody reads is found, and a quality flag or an option without a test."""

import ast
from pathlib import Path

import rft_ros
from rft_ros.cli import parser
from rft_ros.estimator import QualityFlag
from rft_ros.parameters import PARAMETERS, Config
from rft_ros.parameters.config import GROUPS
from rft_ros.parameters.parameter import parameter_fields
from rft_ros.rft import LAW_NUMBERS

PACKAGE = Path(rft_ros.__file__).parent
TESTS = Path(__file__).parents[1]
SOURCES = {f: ast.parse(f.read_text(encoding="utf-8")) for f in PACKAGE.rglob("*.py")}
NODES = [node for tree in SOURCES.values() for node in ast.walk(tree)]


def unread(parameters):
    """The parameters whose value no code takes as an attribute of the config, or as a number of a law."""
    attributes = {node.attr for node in NODES if isinstance(node, ast.Attribute)}
    taken = {f"medium.{name}" for name in LAW_NUMBERS}
    for owner in (Config, *GROUPS.values()):
        taken |= {
            parameter.name
            for field, parameter in parameter_fields(owner).items()
            if field in attributes
        }
    return [name for name in parameters if name not in taken]


def test_every_parameter_is_read_somewhere():
    assert unread(p.name for p in PARAMETERS) == []


def other_tests():
    """The syntax trees of all tests but this one: a word in a comment is no test."""
    files = [f for f in TESTS.rglob("*.py") if f.name != Path(__file__).name]
    return [ast.parse(f.read_text(encoding="utf-8")) for f in files]


def test_every_quality_flag_is_named_in_a_test():
    nodes = [
        node
        for tree in other_tests()
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
    ]
    tested = {
        node.attr
        for node in nodes
        if isinstance(node.value, ast.Name) and node.value.id == "QualityFlag"
    }
    assert {flag.name for flag in QualityFlag if flag} - tested == set()


def test_every_option_of_every_command_is_given_in_a_test():
    commands = next(action for action in parser()._actions if action.dest == "command").choices
    options = {
        option for c in commands.values() for a in c._actions for option in a.option_strings[-1:]
    }
    nodes = [
        node for tree in other_tests() for node in ast.walk(tree) if isinstance(node, ast.Constant)
    ]
    texts = [node.value for node in nodes if isinstance(node.value, str)]
    given = {word.partition("=")[0].strip("`',;:()") for text in texts for word in text.split()}
    without_a_cluster = {"--scheduler"}  # `run` itself is tested with one
    assert options - given - without_a_cluster == set()
