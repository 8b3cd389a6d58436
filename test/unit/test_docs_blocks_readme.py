"""The README's code blocks work, in its order, in a fresh copy of the project."""

from page_blocks import README, skip_without_ros, try_page
from page_folder import prepared


def test_the_blocks_of_the_readme_work(tmp_path):
    skip_without_ros()
    project = prepared(tmp_path)
    assert try_page(README, project) > 0
    assert (project / "out" / "demo" / "force_over_depth.png").is_file()
