"""--check: status 0 within the limits, 1 if a limit is exceeded, 2 if something cannot be checked."""

from pathlib import Path

import pytest
from recordings import TOPICS, plunge, write_ros2
from replays import values

from rft_ros.bags.replay import replay
from rft_ros.bags.summary import Limit, check, read_limits
from rft_ros.cli import main
from rft_ros.errors import InputError

CONFIG = Path(__file__).resolve().parents[2] / "config"


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return write_ros2(tmp_path_factory.mktemp("bags") / "plunge", plunge())


@pytest.fixture(scope="module")
def summary(bag, tmp_path_factory):
    return replay(bag, tmp_path_factory.mktemp("out"), values())


def checked(bag, tmp_path, text, *bags):
    limits = tmp_path / "limits.yaml"
    limits.write_text(text)
    out = tmp_path / "out"
    return main(["replay", *map(str, (bag, *bags)), "-o", str(out), "--no-report", "--check", str(limits)])


KEPT = "estimates: {min: 500, max: 650}\nphases.penetration.depth_bins.5-10mm.estimates: {min: 1}\n"
FAILED = KEPT + "phases.penetration.rms_over_peak: {max: 0.001}\n"


def test_metrics_within_their_limits_give_status_0_and_a_table(bag, tmp_path, capsys):
    assert checked(bag, tmp_path, KEPT) == 0
    lines = capsys.readouterr().out.splitlines()
    table = lines[lines.index("plunge: limits") :]
    assert [line.split()[-1] for line in table[2:]] == ["ok", "ok"]


def test_an_exceeded_limit_gives_status_1_and_is_marked(bag, tmp_path, capsys):
    assert checked(bag, tmp_path, FAILED) == 1
    failed = [line for line in capsys.readouterr().out.splitlines() if line.endswith("FAILED")]
    assert [line.split()[0] for line in failed] == ["phases.penetration.rms_over_peak"]


def test_every_bag_of_a_batch_is_checked(bag, tmp_path, capsys):
    short = write_ros2(tmp_path / "short", list(plunge())[:1000])
    assert checked(bag, tmp_path, "phases.withdrawal.estimates: {min: 1}\n", short) == 1
    out = capsys.readouterr().out
    assert "plunge: limits" in out
    assert "short: limits" in out
    assert out.count("FAILED") == 1


def test_reasons_and_flags_that_did_not_occur_count_as_zero(summary):
    names = ("reasons.twist_stale", "quality_flags.inertial", "quality_flags.deep")
    checks = check([Limit(metric=name, max=0.0) for name in names], summary)
    assert [value for _, value in checks] == [0.0, 0.0, 0.0]
    assert all(limit.allows(value) for limit, value in checks)


def test_a_metric_without_value_fails_the_check(tmp_path):
    blind = write_ros2(tmp_path / "blind", plunge(), topics={r: TOPICS[r] for r in ("pose", "twist")})
    ((limit, value),) = check([Limit(metric="rms_over_peak", max=9.0)], replay(blind, tmp_path / "out", values()))
    assert value is None
    assert not limit.allows(value)


@pytest.mark.parametrize("metric", ["phases.penetraton.depth_bins.0-5mm.estimates", "depth_bins.0-5mm.estimates"])
def test_a_misspelt_depth_bin_is_an_error(summary, metric):
    with pytest.raises(InputError, match="has no metric"):
        check([Limit(metric=metric, min=0.0)], summary)


def test_a_depth_that_a_bag_did_not_reach_fails_the_check(summary):
    limit = Limit(metric="phases.penetration.depth_bins.200-205mm.estimates", min=0.0)
    assert check([limit], summary) == [(limit, None)]


def test_an_unknown_metric_is_refused_with_the_nearest_one(bag, tmp_path, capsys):
    assert checked(bag, tmp_path, "phases.penetration.rms_over_peek: {max: 1}\n") == 2
    error = capsys.readouterr().err
    assert "no metric 'phases.penetration.rms_over_peek'; did you mean 'phases.penetration.rms_over_peak'?" in error
    assert len(error.splitlines()) == 1


@pytest.mark.parametrize("word", ["bag", "damage", "parameters.medium.zeta", "topics.pose"])
def test_only_metrics_can_be_limited(summary, word):
    with pytest.raises(InputError, match="no metric"):
        check([Limit(metric=word, max=1.0)], summary)


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
    assert checked(bag, tmp_path, text) == 2
    error = capsys.readouterr().err
    assert "limits.yaml" in error
    assert words in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_limit_with_an_exponent_is_a_number_as_in_a_parameter_file(tmp_path):
    (tmp_path / "limits.yaml").write_text("rms_over_peak: {max: 1e-3}\n")
    assert read_limits(tmp_path / "limits.yaml") == [Limit(metric="rms_over_peak", max=1e-3)]


def test_a_missing_limits_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.yaml.*cannot be read"):
        read_limits(tmp_path / "none.yaml")


def test_the_example_holds_for_the_recordings_that_it_names(shared_data, tmp_path, capsys):
    bags = [str(shared_data / "abb_plate" / f"abb_plate_{trial}") for trial in (2, 3)]
    options = ["--params", str(CONFIG / "abb_plate.yaml"), "--check", str(CONFIG / "limits_example.yaml")]
    status = main(["replay", *bags, "-o", str(tmp_path), "--no-report", *options])
    out = capsys.readouterr().out
    assert status == 0, out
    assert out.count(" ok\n") == 2 * len(read_limits(CONFIG / "limits_example.yaml"))
