"""The code blocks of docs/ work, page by page; those that cannot run here say why, out of a closed set of reasons."""

import re

import pytest
from page_blocks import PAGES, README, ROOT, RUN, SHOWN, Block, blocks, try_page, why_not_run
from page_folder import prepared


def name_of(page):
    return page.name


WITH_CODE = [page for page in PAGES if any(b.language in RUN and b.mark is None for b in blocks(page))]


@pytest.mark.parametrize("page", WITH_CODE, ids=name_of)
def test_the_blocks_of_the_page_work(page, tmp_path):
    replay_section = [b.text for b in blocks(ROOT / "docs" / "replay.md") if b.text.startswith("rft_replay:")]
    assert try_page(page, prepared(tmp_path, more_cell=replay_section[0])) > 0


@pytest.mark.parametrize("page", [README, *PAGES], ids=name_of)
def test_what_is_not_run_says_why(page):
    assert [wrong for b in blocks(page) if b.mark is not None and (wrong := why_not_run(b))] == []


@pytest.mark.parametrize("page", [README, *PAGES], ids=name_of)
def test_no_code_hides_from_being_run(page):
    """In a language that no test knows, in a fence that was not found, or as an indented block."""
    assert [b.where for b in blocks(page) if b.language not in (*RUN, *SHOWN)] == []
    text = page.read_text(encoding="utf-8")
    assert len(re.findall(r"^ *```", text, flags=re.MULTILINE)) == 2 * len(blocks(page))
    outside = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.DOTALL | re.MULTILINE)
    assert (
        re.findall(r"^ {4,}(?:rft|make|python3?|pip|ros2|colcon|git|import|from) .*$", outside, flags=re.MULTILINE)
        == []
    )


@pytest.mark.parametrize("page", [README, *PAGES], ids=name_of)
def test_commands_stand_in_blocks_that_are_run(page):
    shown = [b for b in blocks(page) if b.language in SHOWN]
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
def test_a_reason_of_ones_own_is_refused(reason):
    assert why_not_run(Block(where="page.md:1", language="sh", text="", mark=reason)) is not None
