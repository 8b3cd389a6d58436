"""config/default.yaml and the README's table say what the parameter table says."""

from pathlib import Path

from rft_ros.estimator.parameter_docs import BEGIN, END, default_yaml, markdown_table
from rft_ros.estimator.parameters import defaults, read_parameter_file

ROOT = Path(__file__).resolve().parents[2]


def test_the_default_file_is_the_table():
    assert (ROOT / "config" / "default.yaml").read_text(encoding="utf-8") == default_yaml()


def test_the_readme_holds_the_table():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert text[text.index(BEGIN) + len(BEGIN) : text.index(END)] == markdown_table()


def test_the_default_file_reads_back_as_the_defaults():
    assert read_parameter_file(ROOT / "config" / "default.yaml") == defaults()
