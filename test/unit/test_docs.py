"""Commands and parameters in the README and docs/ exist; `test_docs_site.py` sees to the links."""

import re
import shlex
from pathlib import Path

from rft_ros.cli import parser
from rft_ros.parameters import defaults

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
NAMED = ("rft_ros", "test", "studies", "bench", "docs", "examples")


def commands(page):
    """Lines of code and inline code that begin with ``rft ``, without what the shell makes of them."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"```(?:sh|bash)\n(.*?)```", text, flags=re.DOTALL)
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    lines += re.findall(r"`(rft [^`]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL).replace("\n", " "))
    return [line for line in lines if line.startswith("rft ")]


def test_every_command_in_the_docs_is_one_that_can_be_typed():
    names = next(a for a in parser()._actions if a.dest == "command").choices
    for line in (line for page in PAGES for line in commands(page)):
        words = shlex.split(line, comments=True)[1:]
        if not words or words[0].startswith("-"):
            continue
        assert words[0] in names, line
        options = {o for action in names[words[0]]._actions for o in action.option_strings}
        for word in words[1:]:
            if re.fullmatch(r"--?[a-z][a-z-]*", word):
                assert word in options, f"{line}: {word}"


def test_every_parameter_in_the_docs_is_one_of_the_node():
    for page in PAGES:
        named = re.findall(r"`((?:mesh|medium|alpha_y|sensor)\.(?!py\b)[a-z_]+)", page.read_text(encoding="utf-8"))
        assert set(named) <= set(defaults()), page.name


def test_the_readme_names_every_command():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    names = next(a for a in parser()._actions if a.dest == "command").choices
    assert [name for name in names if f"rft {name}" not in text and name != "demo"] == []


def test_every_module_that_the_docs_name_is_there():
    files = {"setup.py"} | {
        file.relative_to(ROOT).as_posix() for folder in NAMED for file in (ROOT / folder).rglob("*.py")
    }
    for page in PAGES:
        for name in re.findall(r"`([\w/]+\.py)\b", page.read_text(encoding="utf-8")):
            assert any(f"/{file}".endswith(f"/{name}") for file in files), f"{page.name}: {name}"
