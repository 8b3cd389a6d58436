"""Code blocks of the README and docs/ work; a block that cannot run here says why, and where it is tested."""

import re

import pytest
from page_blocks import PAGES, README, ROOT, RUN, SHOWN, blocks, prepared, try_page

WITH_CODE = [page for page in PAGES if any(b.language in RUN and b.mark is None for b in blocks(page))]
ALL = [README, *PAGES]


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """One folder for all pages."""
    replay_section = [b.text for b in blocks(ROOT / "docs" / "replay.md") if b.text.startswith("rft_replay:")]
    return prepared(tmp_path_factory.mktemp("docs"), more_cell=replay_section[0])


@pytest.mark.parametrize("page", WITH_CODE, ids=lambda page: page.name)
def test_the_blocks_of_a_page_work(page, project):
    assert try_page(page, project) > 0


def test_the_blocks_of_the_readme_work_in_its_order_where_nothing_but_the_wheel_was_installed(installed, tmp_path):
    pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'rft_ros[ros]'")
    project = prepared(tmp_path, scripts=str(installed / "bin"))
    assert try_page(README, project) > 0
    assert (project / "out" / "demo" / "replay" / "report.html").is_file()


def test_blocks_that_are_not_run_give_a_reason_and_name_files_that_exist():
    for mark in (b.mark for page in ALL for b in blocks(page) if b.mark is not None):
        file = re.fullmatch(r"needs .+ in (\S+)|minutes long; tested in (\S+)|the suite itself", mark)
        assert file, mark
        assert all((ROOT / name).is_file() for name in file.groups() if name), mark


def test_every_code_block_is_run_or_marked():
    """In an unknown language, in a fence that was not found, or as an indented block."""
    command = re.compile(r"^ {4,}(?:rft|make|python3?|pip|ros2|colcon|git|import|from) .*$", flags=re.MULTILINE)
    for page in ALL:
        assert [b.where for b in blocks(page) if b.language not in (*RUN, *SHOWN)] == []
        text = page.read_text(encoding="utf-8")
        assert len(re.findall(r"^ *```", text, flags=re.MULTILINE)) == 2 * len(blocks(page)), page.name
        outside = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.DOTALL | re.MULTILINE)
        assert command.findall(outside) == [], page.name
