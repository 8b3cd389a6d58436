"""Links, pictures, commands and parameters in the README and docs/ exist."""

import re
import shlex
from pathlib import Path

from rft_ros.cli import parser
from rft_ros.parameters import defaults

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
LINK = re.compile(r"\[[^\]]*\]\(([^)#\s]*)(?:#([^)\s]+))?\)")


def links(page):
    """(path, anchor) of each link and picture that points into the project."""
    found = LINK.findall(page.read_text(encoding="utf-8"))
    return [(path, anchor) for path, anchor in found if not path.startswith(("http:", "https:", "mailto:"))]


def anchors(page):
    """The names that GitHub gives the headings of a page.

    Lower case; only letters, digits, hyphens and underscores stay; spaces become hyphens; repeats are numbered.
    """
    prose = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    names: list[str] = []
    for heading in re.findall(r"^#{1,6} +(.+?)[ #]*$", prose, flags=re.MULTILINE):
        shown = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        name = re.sub(r"[^\w\- ]", "", shown.lower()).replace(" ", "-")
        before = sum(re.fullmatch(rf"{re.escape(name)}(-\d+)?", other) is not None for other in names)
        names.append(f"{name}-{before}" if before else name)
    return names


def test_every_link_and_picture_exists():
    assert [f"{p.name}: {path}" for p in PAGES for path, _ in links(p) if not (p.parent / path).exists()] == []


def test_every_anchor_is_a_heading_of_its_page():
    for page in PAGES:
        pointed = [(page.parent / path if path else page, anchor) for path, anchor in links(page) if anchor]
        assert [f"{file.name}#{anchor}" for file, anchor in pointed if anchor not in anchors(file)] == [], page.name


def test_anchors_are_those_that_github_makes(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "# On *your* `robot`\n## α_y, or [not](x.md)?\n```sh\n# no heading\n```\n### Beside - it\n## Beside - it\n"
    )
    assert anchors(page) == ["on-your-robot", "α_y-or-not", "beside---it", "beside---it-1"]


def test_every_picture_of_the_docs_is_shown_on_a_page():
    shown = {(page.parent / path).resolve() for page in PAGES for path, _ in links(page) if path}
    assert sorted(p.name for p in (ROOT / "docs" / "images").iterdir() if p.resolve() not in shown) == []


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
