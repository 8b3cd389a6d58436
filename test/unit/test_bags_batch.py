"""Several bags in one call: one folder each, and a failure does not affect other bags."""

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


@pytest.mark.parametrize("place", [None, 0, 1, 2])
def test_each_bag_has_its_own_folder(bags, tmp_path, capsys, place):
    """Also beside one that fails, at any place."""
    given = [*bags]
    if place is not None:
        given.insert(place, tmp_path / "gone")
    assert replay(*given, "-o", tmp_path / "out") == len(given) - 2
    out, err = capsys.readouterr()
    assert err == ("" if place is None else f"rft replay: bag '{tmp_path / 'gone'}' does not exist\n")
    for name, poses in (("run", 650), ("run_2", 60)):
        assert f"-> {tmp_path / 'out' / name / 'summary.json'}" in out
        assert json.loads((tmp_path / "out" / name / "summary.json").read_text())["messages"]["pose"] == poses
    if place is None:  # the bytes that a bag gives alone
        assert replay(bags[1], "-o", tmp_path / "alone") == 0
        for name in ("estimates.csv", "summary.json", "estimates/estimates.mcap"):
            assert (tmp_path / "out" / "run_2" / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()


def test_folder_names_are_unique_and_follow_the_bags_names(tmp_path):
    for name in ("a/run", "b/run", "c/run", "run_2", "v1.5"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "run.mcap").touch()
    names = [tmp_path / n for n in ("a/run", "b/run", "run_2", "c/run", "run.mcap", "v1.5")]
    assert folder_names(names) == ["run", "run_2", "run_2_2", "run_2_2_2", "run_2_2_2_2", "v1.5"]
    assert folder_names([tmp_path / "a" / "." / "run"] * 2) == ["run", "run_2"]


def test_what_cannot_be_replayed_is_unusable_input(bags, tmp_path, capsys):
    """Results in the folder above the bags would land in the bags themselves."""
    before = sorted(p.name for p in bags[0].iterdir())
    for arguments, sentence in (
        ((tmp_path / "gone", "-o", tmp_path / "out"), "does not exist"),
        ((bags[0], "-o", bags[0]), "would overwrite the input"),
        ((bags[0], tmp_path / "gone", "-o", bags[0].parent), "would overwrite the input"),
        ((bags[0], "-o", tmp_path, "--start", 2, "--end", 1), "end is 1 s; it must be after start, 2 s"),
    ):
        assert replay(*arguments) == 2
        (said,) = capsys.readouterr().err.splitlines()
        assert sentence in said
    assert sorted(p.name for p in bags[0].iterdir()) == before


def test_names_that_are_not_utf_8_are_escaped(tmp_path, capsys):
    bag = write_ros2(tmp_path / os.fsdecode(b"on\xe9"), moments())
    (bag / "tool.stl").write_bytes(locate_mesh("plate").read_bytes())
    (bag / "cell.yaml").write_text("rft: {ros__parameters: {mesh.file: tool.stl, tolerance: 0.0}}")
    given = ["--params", str(bag / "cell.yaml"), "-o", str(tmp_path / "out")]
    assert main(["replay", str(bag), str(bag), *given]) == 0
    assert json.loads((tmp_path / "out" / "on\\xe9" / "summary.json").read_text())["bag"] == "on\\xe9"
    capsys.readouterr().out.encode()
