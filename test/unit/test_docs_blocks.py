"""Code blocks of the README and docs/ work; a block that cannot run here gives a reason out of a closed set."""

import re

import pytest
from page_blocks import PAGES, README, ROOT, RUN, SHOWN, Block, blocks, skip_without_ros, try_page, why_not_run
from page_folder import prepared

WITH_CODE = [page for page in PAGES if any(b.language in RUN and b.mark is None for b in blocks(page))]
ALL = [README, *PAGES]


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """One folder for all pages of docs/."""
    replay_section = [b.text for b in blocks(ROOT / "docs" / "replay.md") if b.text.startswith("rft_replay:")]
    return prepared(tmp_path_factory.mktemp("docs"), more_cell=replay_section[0])


@pytest.mark.parametrize("page", WITH_CODE, ids=lambda page: page.name)
def test_the_blocks_of_a_page_work(page, project):
    assert try_page(page, project) > 0


def test_the_blocks_of_the_readme_work_in_its_order(tmp_path):
    skip_without_ros()
    project = prepared(tmp_path)
    assert try_page(README, project) > 0
    assert (project / "out" / "demo" / "replay" / "report.html").is_file()


def test_blocks_that_are_not_run_give_a_reason():
    marked = [b for page in ALL for b in blocks(page) if b.mark is not None]
    assert [wrong for b in marked if (wrong := why_not_run(b))] == []


def test_every_code_block_is_run_or_marked():
    """In an unknown language, in a fence that was not found, or as an indented block."""
    command = re.compile(r"^ {4,}(?:rft|make|python3?|pip|ros2|colcon|git|import|from) .*$", flags=re.MULTILINE)
    for page in ALL:
        assert [b.where for b in blocks(page) if b.language not in (*RUN, *SHOWN)] == []
        text = page.read_text(encoding="utf-8")
        assert len(re.findall(r"^ *```", text, flags=re.MULTILINE)) == 2 * len(blocks(page)), page.name
        outside = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.DOTALL | re.MULTILINE)
        assert command.findall(outside) == [], page.name


def test_commands_are_in_code_blocks_that_are_run():
    shown = [b for page in ALL for b in blocks(page) if b.language in SHOWN]
    assert [b.where for b in shown if re.search(r"^\$? ?(?:rft|make|ros2|colcon) ", b.text, flags=re.MULTILINE)] == []


def page_of(folder, text):
    page = folder / "page.md"
    page.write_text(text)
    return page


@pytest.mark.parametrize(
    ("code", "error"),
    [
        ("```sh\nfalse\ntrue\n```\n", "page.md:3: exit status 1"),
        ("```sh\nrft check-mesh no_such_mesh.stl\n```\n", "no_such_mesh"),
        ("```sh\nrft predict --no-such-option | cat\n```\n", "exit status 2"),
        ("```python\nraise ValueError('of the page')\n```\n", "of the page"),
        ("```yaml\n/**:\n  ros__parameters:\n    medium.zetta: 1.0\n```\n", "zetta"),
        ("```yaml\nestimates: {least: 3}\n```\n", "least"),
        ("```yaml\ntools: [{mesh: plate}]\nmotions: [{family: flying}]\nmedia: [{}]\n```\n", "flying"),
    ],
)
def test_a_block_that_does_not_work_fails(tmp_path, code, error):
    with pytest.raises(Exception, match=error):
        try_page(page_of(tmp_path, f"# Page\n\n{code}"), tmp_path)


def test_python_blocks_of_a_page_share_their_names_and_marked_ones_are_left_out(tmp_path):
    code = (
        "```python\nx = 1\n```\n<!-- not run: needs your robot -->\n```sh\nfalse\n```\n```python\nassert x == 1\n```\n"
    )
    assert try_page(page_of(tmp_path, code), tmp_path) == 2


@pytest.mark.parametrize("reason", ["no time", "minutes long; tested in test/no_such_file.py", "minutes long"])
def test_any_other_reason_is_refused(reason):
    assert why_not_run(Block(where="page.md:1", language="sh", text="", mark=reason)) is not None
