"""The generated references and config/default.yaml say what the code declares."""

import importlib.util
from pathlib import Path

import pytest

from rft_ros.estimator.quality import QualityFlag
from rft_ros.estimator.samples import Reason
from rft_ros.parameters import defaults, read_parameter_file

ROOT = Path(__file__).resolve().parents[2]
MAKER = ROOT / "docs" / "_site" / "reference_pages.py"
GENERATED = {
    "docs/commands.md": "commands_page",
    "docs/node.md": "node_page",
    "README.md": "readme",
    "config/default.yaml": "default_yaml",
}


@pytest.fixture(scope="module")
def pages():
    spec = importlib.util.spec_from_file_location("reference_pages", MAKER)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", GENERATED)
def test_a_generated_page_is_as_its_generator_writes_it(pages, name):
    written = (ROOT / name).read_text(encoding="utf-8")
    assert written == getattr(pages, GENERATED[name])(), "run python docs/_site/reference_pages.py"


def test_the_default_file_reads_back_as_the_defaults():
    assert read_parameter_file(ROOT / "config" / "default.yaml") == defaults()


def test_every_reason_and_quality_flag_has_a_row(pages):
    text = pages.node_page()
    assert [r.value for r in Reason if text.partition("<!-- reasons")[2].count(f"`{r.value}`") != 1] == []
    assert [d.name for d in QualityFlag if d.value and f"- `{d.name.lower()}`: " not in text] == []
