"""`rft calibrate` on real recordings: held-out trials, memory, and recordings that one ζ does not fit."""

import csv
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml

from rft_ros.bags.playback import read_replay_options
from rft_ros.bags.replay import replay
from rft_ros.cli import main
from rft_ros.parameters import read_parameter_file

ABB = Path(__file__).resolve().parents[2] / "config" / "abb_plate.yaml"
TRIALS = (2, 3)
OTHER = {2: 3, 3: 2}
PLATES = {"cmu_plate_large_60mm_1": 60, "cmu_plate_large_80mm_7": 80, "cmu_plate_large_100mm_4": 100}
BOTTOM = 0.045
"""Depth [m] below which the ABB plate rests, 50 mm deep."""


def bag(shared_data, trial):
    return shared_data / "abb_plate" / f"abb_plate_{trial}"


def record(file):
    return yaml.safe_load(file.read_text())["rft_calibration"]["ros__parameters"]


@pytest.fixture(scope="module")
def calibrated(shared_data, tmp_path_factory):
    """Of each trial alone, and of both: the calibrated file."""
    folder = tmp_path_factory.mktemp("calibrated")
    files = {}
    for name, trials in {2: (2,), 3: (3,), "both": TRIALS}.items():
        files[name] = folder / f"{name}.yaml"
        bags = [str(bag(shared_data, t)) for t in trials]
        assert main(["calibrate", *bags, "--params", str(ABB), "-o", str(files[name])]) == 0
    return files


@pytest.fixture(scope="module")
def held_out(calibrated, shared_data, tmp_path_factory):
    """Of each trial, calibrated on the other, with memory and without: phase, depth, upward force by model and cell."""
    found = {}
    for trial in TRIALS:
        # the calibrated file has the other trial's bias; each trial is tared on its own, as when it was calibrated
        values, options = read_parameter_file(calibrated[OTHER[trial]]), read_replay_options(ABB)
        for memory in (True, False):
            given = values if memory else {**values, "medium.mobilization_length": 0.0}
            out = tmp_path_factory.mktemp("replay")
            replay(bag(shared_data, trial), out, given, options)
            with (out / "estimates.csv").open() as file:
                rows = [r for r in csv.DictReader(file) if r["phase"]]
            columns = ("depth", "predicted_fz", "compensated_fz")
            depth, down, measured = np.array([[float(r[c] or "nan") for c in columns] for r in rows]).T
            found[trial, memory] = np.array([r["phase"] for r in rows]), depth, -down, -measured
    return found


def penetration_residual(columns):
    """RMS over the peak."""
    phase, _, predicted, measured = columns
    sinking = phase == "penetration"
    return np.sqrt(np.nanmean((predicted - measured)[sinking] ** 2)) / np.nanmax(measured)


def test_zeta_of_each_trial_and_of_both(calibrated):
    zeta = {name: read_parameter_file(file)["medium.zeta"] for name, file in calibrated.items()}
    assert zeta[2] == pytest.approx(1.16, abs=0.01)
    assert zeta[3] == pytest.approx(1.01, abs=0.01)
    assert zeta["both"] == pytest.approx(1.09, abs=0.01)


@pytest.mark.parametrize("trial", TRIALS)
@pytest.mark.parametrize("memory", [True, False])
def test_each_trial_predicts_the_others_penetration_within_12_percent_of_its_peak(held_out, trial, memory):
    assert penetration_residual(held_out[trial, memory]) < 0.12


@pytest.mark.parametrize("trial", TRIALS)
def test_penetration_is_no_worse_with_memory_than_without(held_out, trial):
    """Of the peak: 8.2 % without and 8.1 % with it in trial 2, 9.3 and 9.1 % in trial 3; with its own ζ, 2.0 to 1.9 and
    3.7 to 3.5 %. The other's ζ is too low for trial 2, so a force that builds up later is further off."""
    assert penetration_residual(held_out[trial, True]) < penetration_residual(held_out[trial, False]) + 0.0015


@pytest.mark.parametrize(("trial", "held"), [(2, 0.855), (3, 1.068)])
def test_the_force_holds_flat_while_the_plate_rests(held_out, calibrated, trial, held):
    """Flat to 0.1 % of the peak, and within 10 % of it with the trial's own ζ and the other's λ: 98 and 93 %.

    With the other's ζ, which differs by 14 %, trial 2 is held at 86 % of its measured peak (measured: 97 to 100 %) and
    trial 3 at 107 % (measured: 94 to 99 %).
    """
    phase, depth, predicted, measured = held_out[trial, True]
    rest, peak = np.flatnonzero((phase == "dwell") & (depth > BOTTOM)), np.nanmax(measured)
    assert len(rest) > 800
    rest = rest[:-10]  # in the last 50 ms before the phase of withdrawal the arm begins to move
    assert np.ptp(predicted[rest]) < 0.004 * peak
    assert predicted[rest].mean() / peak == pytest.approx(held, abs=0.005)
    zeta = {t: read_parameter_file(calibrated[t])["medium.zeta"] for t in TRIALS}
    assert abs(predicted[rest].mean() * zeta[trial] / zeta[OTHER[trial]] / peak - 1.0) < 0.10


@pytest.mark.parametrize("trial", TRIALS)
def test_the_push_is_gone_after_3_mm_of_withdrawal(held_out, trial):
    """Less than 5 % of the peak after 3 mm of withdrawal: no push is left, and only part of the law's pull.

    In the law the upper face leads when the plate goes up. Without memory it pulls with 18 % (22 %) of the peak from
    the first moment; with memory 4 % after 3 mm and 10 % (11 %) after 10 mm. The load cell reads 1 %.
    """
    phase, depth, predicted, measured = held_out[trial, True]
    peak = np.nanmax(measured)
    up = np.flatnonzero(phase == "withdrawal")
    after = up[np.argmin(np.abs(depth[up[0]] - depth[up] - 0.003))]
    assert -0.05 < predicted[after] / peak < 0.0
    assert abs(measured[after]) / peak < 0.015


@pytest.mark.parametrize("trial", TRIALS)
def test_memory_halves_the_residual_of_the_withdrawal(held_out, trial):
    """RMS over the peak: 21.4 to 7.3 % in trial 2, 22.2 to 8.7 % in trial 3."""

    def residual(columns):
        phase, depth, predicted, measured = columns
        up = (phase == "withdrawal") & (depth > 0.0)
        return np.sqrt(np.nanmean((predicted - measured)[up] ** 2))

    assert residual(held_out[trial, True]) < 0.5 * residual(held_out[trial, False])


def test_mobilization_length_agrees_between_the_trials(calibrated):
    """5.5 and 4.8 mm with errors of 1.3 and 1.5 mm, since the measured decay is straighter than the model's."""
    fits = {name: record(file)["fitted"]["medium_mobilization_length"] for name, file in calibrated.items()}
    lengths = {name: fit["value"][0] for name, fit in fits.items()}
    errors = {name: fit["standard_error"][0] for name, fit in fits.items()}
    assert lengths["both"] == pytest.approx(0.0052, abs=0.0002)
    assert abs(lengths[2] - lengths[3]) < np.hypot(errors[2], errors[3])
    assert errors["both"] < 0.0018


def test_the_node_reads_the_calibrated_file_and_the_file_names_its_sources(calibrated, shared_data, tmp_path):
    values, text = read_parameter_file(calibrated["both"]), calibrated["both"].read_text()
    assert values["sensor.bias"][2] == pytest.approx(1.82, abs=0.02)
    assert values["medium.calibrated_depth"] == pytest.approx(0.0504, abs=2e-4)
    assert "abb_plate_2, recorded 2021-05-25" in text
    assert "abb_plate_3, recorded 2021-05-25" in text
    reasons = record(calibrated["both"])["not_identifiable"]
    assert any(line.startswith("sensor.mass: gravity turns by 0.0°") for line in reasons)
    out = tmp_path / "replay"
    command = ["replay", str(bag(shared_data, 2)), "--params", str(calibrated["both"]), "-o", str(out)]
    assert main([*command, "--end", "12"]) == 0
    assert (out / "estimates.csv").stat().st_size > 0


def test_the_same_bags_give_the_same_bytes(calibrated, shared_data, tmp_path):
    again = tmp_path / "again.yaml"
    assert main(["calibrate", str(bag(shared_data, 2)), "--params", str(ABB), "-o", str(again)]) == 0
    assert again.read_bytes() == calibrated[2].read_bytes()


@pytest.fixture(scope="module")
def round_plates(shared_data, tmp_path_factory):
    """The three round plates calibrated together: the calibrated file."""
    folder = tmp_path_factory.mktemp("cmu")
    rules, bags = [], []
    for name, diameter in PLATES.items():
        mesh = folder / f"{name}.stl"
        trimesh.creation.cylinder(radius=0.5 * diameter, height=10.0, sections=96).export(mesh)
        rules += ["--mesh", f"{name}={mesh}"]
        bags.append(str(shared_data / "cmu_plate" / name))
    given = {
        "mesh": {"file": str(mesh), "scale": 0.001, "origin": [0.0, 0.0, 5.0]},
        "tolerance": 0.0,
        "twist_source": "pose_difference",
    }
    remap = {"remap": ["~/pose:=/tool_pose", "~/wrench_measured:=/ft_sensor/wrench"]}
    file, out = folder / "cmu.yaml", folder / "calibrated.yaml"
    file.write_text(yaml.safe_dump({n: {"ros__parameters": p} for n, p in (("/**", given), ("rft_replay", remap))}))
    assert main(["calibrate", *bags, "--params", str(file), *rules, "-o", str(out)]) == 0
    return out


def test_a_zeta_that_depends_on_the_plate_is_noted_with_numbers(round_plates):
    """In the model the pressure under a plate does not depend on its size."""
    note = record(round_plates)["notes"][-1]
    assert "ζ differs by 41 % between cmu_plate_large_60mm_1 (1.28) and cmu_plate_large_100mm_4 (1.81)" in note


def test_one_zeta_for_three_plates_has_a_large_error(round_plates):
    zeta = record(round_plates)["fitted"]["medium_zeta"]
    assert zeta["value"] == [pytest.approx(1.54, abs=0.01)]
    assert zeta["standard_error"][0] > 0.1
