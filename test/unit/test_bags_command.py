"""`rft replay` of several bags and with --check: one folder each, statuses, and sentences for what cannot be used."""

import json
import math
import os
from pathlib import Path

import pytest
from recordings import TOPICS, moments, plunge, values, write_ros2
from refusals import assert_says

from rft_ros.bags.replay import replay
from rft_ros.bags.summary import check, read_limits
from rft_ros.cli import main
from rft_ros.commands.replay import folder_names
from rft_ros.tool import locate_mesh

CONFIG = Path(__file__).resolve().parents[2] / "config"


@pytest.fixture(scope="module")
def bags(tmp_path_factory):
    """Two recordings of one name in folders of their own."""
    folder = tmp_path_factory.mktemp("bags")
    for name in ("monday", "tuesday"):
        (folder / name).mkdir()
    return write_ros2(folder / "monday" / "run", plunge()), write_ros2(
        folder / "tuesday" / "run", moments()
    )


def rft_replay(*arguments):
    return main(["replay", *map(str, arguments), "--no-report"])


@pytest.mark.parametrize("place", [None, 0, 1, 2])
def test_each_bag_has_its_own_folder(bags, tmp_path, capsys, place):
    """Also beside one that fails, at any place."""
    given = [*bags]
    if place is not None:
        given.insert(place, tmp_path / "gone")
    assert rft_replay(*given, "-o", tmp_path / "out") == len(given) - 2
    out, err = capsys.readouterr()
    lost = (
        f"rft replay: bag '{tmp_path / 'gone'}' does not exist; give the path of one that does\n"
    )
    assert err == ("" if place is None else lost)
    for name, poses in (("run", 650), ("run_2", 60)):
        assert f"-> {tmp_path / 'out' / name / 'summary.json'}" in out
        assert (
            json.loads((tmp_path / "out" / name / "summary.json").read_text())["messages"]["pose"]
            == poses
        )
    if place is None:  # the bytes that a bag gives alone
        assert rft_replay(bags[1], "-o", tmp_path / "alone") == 0
        for name in ("estimates.csv", "summary.json", "estimates/estimates.mcap"):
            assert (tmp_path / "out" / "run_2" / name).read_bytes() == (
                tmp_path / "alone" / name
            ).read_bytes()


def test_a_node_of_several_in_a_file_is_chosen_by_its_name(tmp_path, capsys):
    """Its parameters and its topics."""
    sections = [
        f"/{side}/rft: {{ros__parameters: {{mesh.file: plate, medium.zeta: {z}}}}}\n"
        for side, z in (("left", 0.5), ("right", 0.25))
    ]
    (tmp_path / "cells.yaml").write_text("".join(sections))
    topics = {
        role: (name.replace("/rft", "/right/rft"), kind) for role, (name, kind) in TOPICS.items()
    }
    bag = write_ros2(tmp_path / "bag", moments(), topics=topics)
    given = ["--params", tmp_path / "cells.yaml", "-o", tmp_path / "out"]
    assert rft_replay(bag, *given) == 2
    assert_says(capsys.readouterr().err, "/left/rft, /right/rft", "--node")
    assert rft_replay(bag, *given, "--node", "right/rft") == 0
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert (summary["parameters"]["medium.zeta"], summary["messages"]["pose"]) == (0.25, 60)


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
        ((bags[0], tmp_path / "gone", "-o", bags[0].parent), "would overwrite the input"),
        (
            (bags[0], "-o", tmp_path, "--start", 2, "--end", 1),
            "end is 1 s; it must be after start, 2 s",
        ),
    ):
        assert rft_replay(*arguments) == 2
        (said,) = capsys.readouterr().err.splitlines()
        assert sentence in said
    assert sorted(p.name for p in bags[0].iterdir()) == before


def test_names_that_are_not_utf_8_are_escaped(tmp_path, capsys):
    bag = write_ros2(tmp_path / os.fsdecode(b"on\xe9"), moments())
    (bag / "tool.stl").write_bytes(locate_mesh("plate").read_bytes())
    (bag / "cell.yaml").write_text("rft: {ros__parameters: {mesh.file: tool.stl, tolerance: 0.0}}")
    given = ["--params", str(bag / "cell.yaml"), "-o", str(tmp_path / "out")]
    assert main(["replay", str(bag), str(bag), *given]) == 0
    assert (
        json.loads((tmp_path / "out" / "on\\xe9" / "summary.json").read_text())["bag"] == "on\\xe9"
    )
    capsys.readouterr().out.encode()


def checked(tmp_path, text, *bags):
    limits = tmp_path / "limits.yaml"
    limits.write_text(text)
    return rft_replay(*bags, "-o", tmp_path / "out", "--check", limits)


KEPT = (
    "estimates: {min: 500, max: 650}\nphases.penetration.depth_bins.5-10mm.estimates: {min: 1e0}\n"
)


def test_metrics_within_their_limits_give_status_0_and_a_table_and_one_that_is_not_1(
    bags, tmp_path, capsys
):
    """Also where it is one bag's of several."""
    bag, short = bags
    for text, bags, status, told in (
        (KEPT, [bag], 0, ["ok", "ok"]),
        (
            KEPT + "phases.penetration.rms_over_peak: {max: 0.001}\n",
            [bag],
            1,
            ["ok", "ok", "FAILED"],
        ),
        ("phases.withdrawal.estimates: {min: 1}\n", [bag, short], 1, ["ok", "FAILED"]),
    ):
        assert checked(tmp_path, text, *bags) == status
        lines = capsys.readouterr().out.splitlines()
        assert [
            line.split()[0] for line in lines if line.startswith(("  ok ", "  FAILED"))
        ] == told


def test_what_did_not_occur_counts_as_zero_and_a_metric_without_a_value_fails(bags, tmp_path):
    """No value: a depth that was not reached, a mistyped metric, words."""
    summary = replay(bags[0], tmp_path, values())
    for name in ("reasons.twist_stale", "quality_flags.inertial", "quality_flags.deep"):
        assert check({name: (-math.inf, 0.0)}, summary) == [
            (True, f"  ok     {name}: 0 (min -inf, max 0)")
        ]
    unreached, mistyped = (
        "phases.penetration.depth_bins.200-205mm.estimates",
        "phases.penetraton.rms_over_peak",
    )
    for name in (unreached, mistyped, "bag", "damage", "reasons.pose_out_of_ordr"):
        assert check({name: (-math.inf, math.inf)}, summary) == [
            (False, f"  FAILED {name}: no value (min -inf, max inf)")
        ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "is empty"),
        ("{}", "has no metrics"),
        ("estimates: [", "is not YAML"),
        ("estimates: {max: 2026-02-30}", "decimal number"),
        ("estimates: 5", "estimates is 5; it must be {min: NUMBER, max: NUMBER}"),
        ("estimates: {least: 5}", "it must be {min: NUMBER, max: NUMBER}"),
        ("estimates: {min: many}", "estimates is {'min': 'many'}; it must be {min: NUMBER"),
        ("estimates: {max: true}", "finite numbers"),
        ("estimates: {max: .nan}", "decimal number"),
        (f"estimates: {{max: 1{400 * '0'}}}", "decimal number"),
        ("estimates: {min: 2, max: 1}", "min not above max"),
    ],
)
def test_a_malformed_file_is_refused_before_anything_is_replayed(
    bags, tmp_path, capsys, text, words
):
    assert checked(tmp_path, text, bags[0]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert "limits.yaml" in error
    assert words in error
    assert not (tmp_path / "out").exists()


def test_the_example_holds_for_the_recordings_that_it_names(shared_data, tmp_path, capsys):
    bags = [shared_data / "abb_plate" / f"abb_plate_{trial}" for trial in (2, 3)]
    params, limits = CONFIG / "abb_plate.yaml", CONFIG / "limits_example.yaml"
    status = rft_replay(*bags, "-o", tmp_path, "--params", params, "--check", limits)
    out = capsys.readouterr().out
    assert status == 0, out
    assert out.count("  ok ") == 2 * len(read_limits(limits))
