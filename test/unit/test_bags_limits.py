"""--check: status 0 within the limits, 1 if a limit is exceeded, 2 if something cannot be checked."""

from pathlib import Path

import pytest
from recordings import plunge, values, write_ros2

from rft_ros.bags.replay import replay
from rft_ros.bags.summary import Limit, check, read_limits
from rft_ros.cli import main

CONFIG = Path(__file__).resolve().parents[2] / "config"


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return write_ros2(tmp_path_factory.mktemp("bags") / "plunge", plunge())


@pytest.fixture(scope="module")
def summary(bag, tmp_path_factory):
    return replay(bag, tmp_path_factory.mktemp("out"), values())


def checked(tmp_path, text, *bags):
    limits = tmp_path / "limits.yaml"
    limits.write_text(text)
    return main(["replay", *map(str, bags), "-o", str(tmp_path / "out"), "--no-report", "--check", str(limits)])


KEPT = "estimates: {min: 500, max: 650}\nphases.penetration.depth_bins.5-10mm.estimates: {min: 1e0}\n"


def test_metrics_within_their_limits_give_status_0_and_a_table_and_one_that_is_not_1(bag, tmp_path, capsys):
    """Also where it is one bag's of several."""
    short = write_ros2(tmp_path / "short", list(plunge())[:1000])
    for text, bags, status, told in (
        (KEPT, [bag], 0, ["ok", "ok"]),
        (KEPT + "phases.penetration.rms_over_peak: {max: 0.001}\n", [bag], 1, ["ok", "ok", "FAILED"]),
        ("phases.withdrawal.estimates: {min: 1}\n", [bag, short], 1, ["ok", "FAILED"]),
    ):
        assert checked(tmp_path, text, *bags) == status
        lines = capsys.readouterr().out.splitlines()
        assert [line.split()[0] for line in lines if line.startswith(("  ok ", "  FAILED"))] == told


@pytest.mark.parametrize("name", ["reasons.twist_stale", "quality_flags.inertial", "quality_flags.deep"])
def test_reasons_and_flags_that_did_not_occur_count_as_zero(summary, name):
    assert check([Limit(name, max=0.0)], summary) == [(True, f"  ok     {name}: 0 (min -inf, max 0)")]


@pytest.mark.parametrize(
    "metric",
    ["phases.penetration.depth_bins.200-205mm.estimates", "phases.penetraton.rms_over_peak", "bag", "damage",
     "reasons.pose_out_of_ordr"],
)  # fmt: skip
def test_what_has_no_value_fails_the_check(summary, metric):
    """A depth that was not reached, a mistyped metric, words."""
    assert check([Limit(metric)], summary) == [(False, f"  FAILED {metric}: no value (min -inf, max inf)")]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds no metrics"),
        ("- estimates", "holds no metrics"),
        ("estimates: [", "is not YAML"),
        ("estimates: {max: 2026-02-30}", "is not YAML: day is out of range for month"),
        ("estimates: 5", "estimates is 5; it must be {min: NUMBER, max: NUMBER}"),
        ("estimates: {least: 5}", "it must be {min: NUMBER, max: NUMBER}"),
        ("estimates: {}", "it must be {min: NUMBER, max: NUMBER}"),
        ("estimates: {min: many}", "estimates min is 'many'; it must be a finite number"),
        ("estimates: {max: true}", "must be a finite number"),
        ("estimates: {max: .nan}", "must be a finite number"),
        (f"estimates: {{max: 1{400 * '0'}}}", "must be a finite number"),
        ("estimates: {min: 2, max: 1}", "min 2 above max 1"),
    ],
)
def test_a_malformed_file_is_refused_before_anything_is_replayed(bag, tmp_path, capsys, text, words):
    assert checked(tmp_path, text, bag) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert "limits.yaml" in error
    assert words in error
    assert not (tmp_path / "out").exists()


def test_the_example_holds_for_the_recordings_that_it_names(shared_data, tmp_path, capsys):
    bags = [str(shared_data / "abb_plate" / f"abb_plate_{trial}") for trial in (2, 3)]
    options = ["--params", str(CONFIG / "abb_plate.yaml"), "--check", str(CONFIG / "limits_example.yaml")]
    status = main(["replay", *bags, "-o", str(tmp_path), "--no-report", *options])
    out = capsys.readouterr().out
    assert status == 0, out
    assert out.count("  ok ") == 2 * len(read_limits(CONFIG / "limits_example.yaml"))
