"""What the README and docs/ name exists, and what is generated is up to date; `test_docs_site.py` sees to the links."""

import importlib.util
import re
import shlex
from inspect import signature
from pathlib import Path

import pytest

import rft_ros
import rft_ros.simulation
from rft_ros.cli import parser
from rft_ros.parameters import Config, read_parameter_file
from rft_ros.rft import MEDIA
from rft_ros.rft import traction as weights
from rft_ros.sweeps.motions import FAMILIES

pytestmark = pytest.mark.repository

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
MAKER = ROOT / "docs" / "_site" / "reference_pages.py"
GENERATED = {
    "docs/check-a-cell.md": "check_page",
    "docs/reasons.md": "reasons_page",
    "config/default.yaml": "default_yaml",
}
COMMANDS = next(a for a in parser()._actions if a.dest == "command").choices
METHOD = (ROOT / "docs" / "method.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in METHOD.splitlines()
    if line.startswith("|")
]


def commands(page):
    """Lines of code and inline code that begin with ``rft ``, without what the shell makes of them."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"```(?:sh|bash)\n(.*?)```", text, flags=re.DOTALL)
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    lines += re.findall(
        r"`(rft [^`]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL).replace("\n", " ")
    )
    return [line for line in lines if line.startswith("rft ")]


def test_every_command_in_the_docs_is_one_that_can_be_typed():
    for line in (line for page in PAGES for line in commands(page)):
        words = shlex.split(line, comments=True)[1:]
        if not words or words[0].startswith("-"):
            continue
        assert words[0] in COMMANDS, line
        options = {o for action in COMMANDS[words[0]]._actions for o in action.option_strings}
        for word in words[1:]:
            if re.fullmatch(r"--?[a-z][a-z-]*", word):
                assert word in options, f"{line}: {word}"


def test_every_parameter_in_the_docs_is_one_of_the_node():
    for page in PAGES:
        named = re.findall(
            r"`((?:mesh|medium|alpha_y|sensor)\.(?!py\b)[a-z_]+)", page.read_text(encoding="utf-8")
        )
        assert set(named) <= set(Config().values), page.name


def test_the_python_reference_has_every_public_name():
    text = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    listed = re.findall(r"^::: (\S+)$", text, flags=re.MULTILINE)
    assert sorted(listed) == sorted(
        f"{module.__name__}.{name}"
        for module in (rft_ros, rft_ros.simulation)
        for name in module.__all__
    )


def test_the_page_of_design_studies_has_every_parameter_of_every_family_of_motion():
    text = (ROOT / "docs" / "sweep.md").read_text(encoding="utf-8")
    for name, family in FAMILIES.items():
        (row,) = re.findall(rf"^- `{name}`: .*(?:\n  .*)*", text, flags=re.MULTILINE)
        for parameter in signature(family).parameters.values():
            number = f"{parameter.default:g}"
            assert re.search(rf"`{parameter.name}`\s+\({number}\b", row), (
                f"{name}: {parameter.name} ({number})"
            )


def test_the_readme_names_every_command():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert [name for name in COMMANDS if f"rft {name}" not in text and name != "demo"] == []


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
    assert read_parameter_file(ROOT / "config" / "default.yaml").values == Config().values


@pytest.mark.parametrize("name", MEDIA)
def test_the_coefficients_of_a_medium_are_those_in_use(name):
    (printed,) = [row[1:] for row in ROWS if row[0] == f"`{name}`"]
    (header,) = [row[1:] for row in ROWS if row[0] == "medium"]
    in_use = [getattr(MEDIA[name], coefficient.replace("-1", "m1", 1)) for coefficient in header]
    assert [float(value) for value in printed] == in_use


def test_the_coefficients_of_the_weights_are_those_in_use():
    printed = {
        name: float(value) for name, value in re.findall(r"\b([ABN]\d+) = ([\d.]{8,})", METHOD)
    }
    names = ("A1", "A2", "A3", "B1", "B2", "B3")
    assert {name: printed[name] for name in names} == {
        name: getattr(weights, name) for name in names
    }


MOST_WORDS = {"README.md": 1_200, "docs": 19_000}
_CODE = re.compile(r"^ *```.*?^ *```$", flags=re.DOTALL | re.MULTILINE)
_GENERATED = re.compile(r"<!-- [\w ]+: begin.*?<!-- [\w ]+: end -->", flags=re.DOTALL)


def words(page):
    """Words of a page's prose and tables, without code and what is generated; the bar of a table is no word."""
    text = _GENERATED.sub("", _CODE.sub("", page.read_text(encoding="utf-8")))
    return sum(1 for word in text.split() if re.search(r"\w", word))


def test_the_pages_stay_as_short_as_a_reader_has_time_for():
    readme, *pages = PAGES
    assert readme.name == "README.md"
    assert len(readme.read_text(encoding="utf-8").split()) <= MOST_WORDS["README.md"]
    assert sum(map(words, pages)) <= MOST_WORDS["docs"]


def test_the_figure_of_the_concepts_shows_what_the_estimator_says_today(tmp_path):
    """Trust, flags and reasons of its run."""
    concepts = pytest.importorskip("studies.concepts")
    concepts.write_concepts(tmp_path / "concepts.svg")
    drawn, in_docs = (
        (folder / "concepts.svg").read_text(encoding="utf-8")
        for folder in (tmp_path, ROOT / "docs" / "images")
    )
    said = re.compile(r">(trust \w+|no estimate|[a-z]+(?:_[a-z]+)+|[a-z]+\+[a-z]+)<")
    assert said.findall(drawn) == said.findall(in_docs) != []
