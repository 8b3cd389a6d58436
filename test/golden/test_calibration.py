"""`rft calibrate` on real recordings: held-out trials, memory, and recordings that one ζ does not fit."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from rft_ros.bags.options import read_replay_options
from rft_ros.bags.replay import replay
from rft_ros.cli import main
from rft_ros.parameters import read_parameter_file
from studies.choice import DEFAULT

ABB = Path(__file__).resolve().parents[2] / "config" / "abb_plate.yaml"
OTHER = {2: 3, 3: 2}
"""The two trials, and the one that each is calibrated on."""


def bag(shared_data, trial):
    return shared_data / "abb_plate" / f"abb_plate_{trial}"


def record(file):
    return yaml.safe_load(file.read_text())["rft_calibration"]["ros__parameters"]


@pytest.fixture(scope="module")
def calibrated(shared_data, tmp_path_factory):
    """Of each trial: the calibrated file."""
    folder = tmp_path_factory.mktemp("calibrated")
    files = {}
    for trial in OTHER:
        files[trial] = folder / f"{trial}.yaml"
        given = ["calibrate", str(bag(shared_data, trial)), "--params", str(ABB)]
        assert main([*given, "-o", str(files[trial])]) == 0
    return files


@pytest.fixture(scope="module")
def held_out(calibrated, shared_data, tmp_path_factory):
    """Of each trial, calibrated on the other, with memory and without: phase, depth, upward force by model and cell.

    Forces relative to the greatest measured one.
    """
    found = {}
    for trial, other in OTHER.items():
        # the calibrated file has the other trial's bias; each trial is tared on its own
        values, options = read_parameter_file(calibrated[other]).values, read_replay_options(ABB)
        for memory in (True, False):
            given = values if memory else {**values, "medium.mobilization_length": 0.0}
            out = tmp_path_factory.mktemp("replay")
            replay(bag(shared_data, trial), out, given, options)
            table = np.genfromtxt(
                out / "estimates.csv", delimiter=",", names=True, dtype=None, encoding="utf-8"
            )
            predicted, measured = -table["predicted_fz"], -table["compensated_fz"]
            peak = np.nanmax(measured)
            found[trial, memory] = (
                table["phase"],
                table["depth"],
                predicted / peak,
                measured / peak,
            )
    return found


def residual(columns, wanted):
    """RMS in a phase in the grains, over the peak."""
    phase, depth, predicted, measured = columns
    return np.sqrt(np.nanmean((predicted - measured)[(phase == wanted) & (depth > 0.0)] ** 2))


def test_what_is_fitted_to_each_trial(calibrated):
    """λ has errors of 3.1 and 3.0 mm, since the measured decay is straighter than the model's."""
    found = []
    for trial, zeta, length, bias in ((2, 1.159, 5.7e-3, 1.84), (3, 1.015, 4.9e-3, 1.81)):
        values, made = read_parameter_file(calibrated[trial]).values, record(calibrated[trial])
        assert values["medium.zeta"] == pytest.approx(zeta, abs=0.01)
        assert values["medium.calibrated_depth"] == pytest.approx(0.0506, abs=2e-4)
        assert values["sensor.bias"][2] == pytest.approx(bias, abs=0.02)
        assert any(
            line.startswith("sensor.mass: gravity turns by 0.0°")
            for line in made["not_identifiable"]
        )
        assert [line.partition("T")[0] for line in made["bags"]] == [
            f"abb_plate_{trial} (2021-05-25"
        ]
        fit = made["fitted"]["medium_mobilization_length"]
        assert fit["value"] == [pytest.approx(length, abs=2e-4)]
        assert fit["standard_error"][0] < 0.0035
        found.append((*fit["value"], *fit["standard_error"]))
    (one, error), (other, error_of_other) = found
    assert abs(one - other) < np.hypot(error, error_of_other)


@pytest.mark.parametrize("trial", OTHER)
def test_each_trial_predicts_the_others_penetration_within_12_percent_of_its_peak(held_out, trial):
    """8.2 % without and 8.1 % with memory in trial 2, 9.3 and 9.1 % in trial 3; with its own ζ about 2 and 3.6 %."""
    kept, without = (residual(held_out[trial, memory], "penetration") for memory in (True, False))
    assert kept < 0.12
    assert without < 0.12
    assert kept < without + 0.0015


@pytest.mark.parametrize(("trial", "held"), [(2, 0.861), (3, 1.068)])
def test_the_force_holds_flat_while_the_plate_rests(held_out, calibrated, trial, held):
    """At 98 and 93 % of the peak with its own ζ (measured: 97 to 100 and 94 to 99 %); the other's differs by 14 %."""
    phase, depth, predicted, _ = held_out[trial, True]
    rest = np.flatnonzero((phase == "dwell") & (depth > 0.045))  # at 50 mm
    assert len(rest) > 800
    rest = rest[:-10]  # in the last 50 ms before the phase of withdrawal the arm begins to move
    assert np.ptp(predicted[rest]) < 0.004
    assert predicted[rest].mean() == pytest.approx(held, abs=0.005)
    own, others = (
        read_parameter_file(calibrated[t]).values["medium.zeta"] for t in (trial, OTHER[trial])
    )
    assert abs(predicted[rest].mean() * own / others - 1.0) < 0.10


@pytest.mark.parametrize("trial", OTHER)
def test_memory_halves_the_residual_of_the_withdrawal_and_the_push_is_gone_after_3_mm(
    held_out, trial
):
    """RMS over the peak: 21.4 to 7.3 % in trial 2, 22.2 to 8.7 % in trial 3. In the law the upper face leads then."""
    kept, without = (residual(held_out[trial, memory], "withdrawal") for memory in (True, False))
    assert kept < 0.5 * without
    phase, depth, predicted, measured = held_out[trial, True]
    up = np.flatnonzero(phase == "withdrawal")
    after = up[np.argmin(np.abs(depth[up[0]] - depth[up] - 0.003))]
    assert -0.05 < predicted[after] < 0.0
    assert abs(measured[after]) < 0.015


@pytest.mark.usefixtures("shared_data")
def test_a_zeta_that_depends_on_the_plate_is_noted_and_has_a_large_error(calibration_of):
    """In the model the pressure under a plate does not depend on its size."""
    out = calibration_of("cmu", DEFAULT)
    # a plate on its edge has a force of the measured growth
    assert "mesh points" not in (out.parent / "said.txt").read_text()
    zeta = record(out)["fitted"]["medium_zeta"]
    assert "ζ differs by 40 %: tools of different size" in zeta["goodness"]
    assert "60mm_1 1.29" in zeta["source"]
    assert "100mm_4 1.8" in zeta["source"]
    assert zeta["value"] == [pytest.approx(1.545, abs=0.01)]
    assert zeta["standard_error"][0] > 0.1
    assert "ζ grows with the tool's size, 60 to 100 mm wide" in zeta["goodness"]
    # of the smallest tool
    assert read_parameter_file(out).values["medium.zeta_error"] == pytest.approx(0.19, abs=0.02)
