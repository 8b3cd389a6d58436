"""Statistics of each phase and depth bin agree with numpy on the table."""

import numpy as np
import pytest
from recordings import plunge, write_ros2
from replays import rows_of, values

from rft_ros.bags.estimates import ROW
from rft_ros.bags.phases import PHASES, Phase
from rft_ros.bags.replay import replay
from rft_ros.bags.summary import statistics


@pytest.fixture(scope="module")
def plunged(tmp_path_factory):
    """Summary and table of a plunge with noisy velocities."""
    folder = tmp_path_factory.mktemp("plunge")
    bag = write_ros2(folder / "bag", plunge(noise=3e-5))
    summary = replay(bag, folder / "out", values())
    return summary, rows_of(folder / "out")


def forces(rows, kind):
    return np.array([[float(r[f"{kind}_f{a}"]) for a in "xyz"] for r in rows]).reshape(-1, 3)


def agrees(group, rows):
    measured, residual = (forces(rows, kind) for kind in ("compensated", "residual"))
    size, left = np.linalg.norm(measured, axis=1), np.linalg.norm(residual, axis=1)
    assert group.estimates == len(rows)
    assert group.wrench["force"].measured.peak == pytest.approx(size.max(), rel=1e-6)
    assert group.wrench["force"].residual.rms == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-6)
    assert group.wrench["fz"].residual.mean == pytest.approx(residual[:, 2].mean(), rel=1e-6)
    assert group.rms_over_peak == pytest.approx(np.sqrt(np.mean(left**2)) / size.max(), rel=1e-6)
    big = size > 0.2 * np.hypot(30.0, 0.05)
    if big.any():
        assert group.median_relative_error == pytest.approx(np.median(left[big] / size[big]), rel=1e-6)
    else:
        assert group.median_relative_error is None


def test_a_plunge_has_every_phase_in_the_table(plunged):
    _, rows = plunged
    order = list(dict.fromkeys(r["phase"] for r in rows))
    assert order == ["approach", "penetration", "dwell", "ploughing", "withdrawal"]


@pytest.mark.parametrize("phase", [p for p in Phase if p is not Phase.DWELL])
def test_a_phases_statistics_are_those_of_its_rows(plunged, phase):
    summary, rows = plunged
    chosen = [r for r in rows if r["phase"] == phase.value]
    assert summary.phases[phase.value].poses == len(chosen)
    agrees(summary.phases[phase.value], [r for r in chosen if not r["reason"]])


def test_a_dwell_counts_poses_and_has_no_estimate(plunged):
    dwell = plunged[0].phases["dwell"]
    assert dwell.poses >= 45
    assert dwell.estimates == 0
    assert dwell.rms_over_peak is None
    assert dwell.wrench["force"].measured.peak is None


def test_a_depth_bins_statistics_are_those_of_its_rows(plunged):
    summary, rows = plunged
    bins = summary.phases["penetration"].depth_bins
    assert list(bins) == [f"{low}-{low + 5}mm" for low in range(0, 35, 5)]
    for name, group in bins.items():
        low, high = (1e-3 * float(edge) for edge in name.removesuffix("mm").split("-"))
        chosen = [r for r in rows if r["phase"] == "penetration" and low <= float(r["depth"]) < high]
        agrees(group, [r for r in chosen if not r["reason"]])
    assert sum(g.estimates for g in bins.values()) == summary.phases["penetration"].estimates


def test_the_phases_add_up_to_the_whole(plunged):
    """The air, where all is zero, makes the mean over everything small; penetration alone does not."""
    summary, _ = plunged
    assert summary.wrench["force"].residual.rms < summary.phases["penetration"].wrench["force"].residual.rms
    parts = [p.wrench["force"].residual.rms ** 2 * p.estimates for p in summary.phases.values() if p.estimates]
    assert summary.wrench["force"].residual.rms ** 2 * summary.estimates == pytest.approx(sum(parts))


def test_without_poses_there_are_no_statistics():
    whole, phases = statistics(np.empty(0, ROW))
    assert (whole.estimates, whole.rms_over_peak, whole.median_relative_error) == (0, None, None)
    assert {phase.poses for phase in phases.values()} == {0}


def test_an_estimate_without_measured_wrench_has_no_residual():
    row = np.zeros(1, ROW)
    row["reason"], row["phase"], row["depth"] = -1, PHASES.index(Phase.PENETRATION), 0.003
    row["predicted"], row["compensated"], row["sigma"] = (0.0, 3.0, 4.0, 0.0, 0.0, 0.0), np.nan, 0.1
    group = statistics(row)[1]["penetration"]
    assert group.estimates == 1
    assert group.wrench["force"].predicted.rms == pytest.approx(5.0)
    assert group.wrench["force"].residual.rms is group.rms_over_peak is None
    assert sum(b.estimates for b in group.depth_bins.values()) == 1
