"""Several bags in one call: one folder each, a common summary, and a failure does not affect other bags."""

import json
import os

import pytest
from recordings import moments, plunge, write_ros2

from rft_ros.cli import main
from rft_ros.commands.replay import folder_names
from rft_ros.tool import locate_mesh


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Two recordings of one name in folders of their own."""
    folder = tmp_path_factory.mktemp("bags")
    for name in ("monday", "tuesday"):
        (folder / name).mkdir()
    return write_ros2(folder / "monday" / "run", plunge()), write_ros2(folder / "tuesday" / "run", moments())


def replay(*arguments):
    return main(["replay", *map(str, arguments), "--no-report"])


def test_each_bag_has_its_own_folder_and_all_have_a_common_summary(bags, tmp_path, capsys):
    assert replay(*bags, "-o", tmp_path / "out") == 0
    together = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert list(together["bags"]) == ["run", "run_2"]
    assert together["failures"] == {}
    for name, summary in together["bags"].items():
        assert summary == json.loads((tmp_path / "out" / name / "summary.json").read_text())
        assert (tmp_path / "out" / name / "estimates" / "metadata.yaml").exists()
    assert [s["messages"]["pose"] for s in together["bags"].values()] == [650, 60]
    assert "2 of 2 bags replayed" in capsys.readouterr().out


def test_a_bag_in_a_batch_gives_the_bytes_that_it_gives_alone(bags, tmp_path):
    assert replay(*bags, "-o", tmp_path / "out") == 0
    assert replay(bags[1], "-o", tmp_path / "alone") == 0
    for name in ("estimates.csv", "summary.json", "estimates/estimates.mcap"):
        together = "estimates/estimates.mcap" if name.endswith("mcap") else name
        assert (tmp_path / "out" / "run_2" / together).read_bytes() == (tmp_path / "alone" / name).read_bytes()


@pytest.mark.parametrize("place", [0, 1, 2])
def test_one_failing_bag_does_not_lose_the_others(bags, tmp_path, capsys, place):
    given = [*bags]
    given.insert(place, tmp_path / "gone")
    assert replay(*given, "-o", tmp_path / "out") == 1
    out, err = capsys.readouterr()
    assert err == f"rft replay: bag '{tmp_path / 'gone'}' does not exist\n"
    assert "2 of 3 bags replayed" in out
    together = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert list(together["bags"]) == ["run", "run_2"]
    assert list(together["failures"]) == ["gone"]


def test_a_failing_bag_alone_is_unusable_input(tmp_path, capsys):
    assert replay(tmp_path / "gone", "-o", tmp_path / "out") == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


def test_folder_names_are_unique_and_follow_the_bags_names(tmp_path):
    for name in ("a/run", "b/run", "c/run", "run_2", "v1.5"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "run.mcap").touch()
    names = [tmp_path / n for n in ("a/run", "b/run", "run_2", "c/run", "run.mcap", "v1.5")]
    found = folder_names(names)
    assert found == ["run", "run_3", "run_2", "run_4", "run_5", "v1.5"]
    assert folder_names([tmp_path / "a" / "." / "run"] * 2) == ["run", "run_2"]


def test_a_bag_is_never_the_output_folder(bags, tmp_path, capsys):
    """Results in the folder above the bags would land in the bags themselves."""
    before = sorted(p.name for p in bags[0].iterdir())
    assert replay(bags[0], "-o", bags[0]) == 2
    assert replay(bags[0], tmp_path / "gone", "-o", bags[0].parent) == 2
    assert capsys.readouterr().err.count("would overwrite the input") == 2
    assert sorted(p.name for p in bags[0].iterdir()) == before


def test_names_that_are_not_utf_8_are_escaped(tmp_path, capsys):
    bag = write_ros2(tmp_path / os.fsdecode(b"on\xe9"), moments())
    (bag / "tool.stl").write_bytes(locate_mesh("plate").read_bytes())
    (bag / "cell.yaml").write_text("rft: {ros__parameters: {mesh.file: tool.stl, tolerance: 0.0}}")
    given = ["--params", str(bag / "cell.yaml"), "-o", str(tmp_path / "out")]
    assert main(["replay", str(bag), str(bag), *given]) == 0
    assert json.loads((tmp_path / "out" / "on\\xe9" / "summary.json").read_text())["bag"] == "on\\xe9"
    capsys.readouterr().out.encode()


def test_an_end_before_the_start_is_refused(bags, tmp_path, capsys):
    assert replay(bags[0], "-o", tmp_path / "out", "--start", 2, "--end", 1) == 2
    assert "end is 1 s; it must be after start, 2 s" in capsys.readouterr().err
