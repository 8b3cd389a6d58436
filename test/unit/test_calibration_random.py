"""Random recordings: at least 95 % of the fitted values lie within three of their standard errors.

``python test/unit/test_calibration_random.py COUNT FIRST_SEED`` tries many recordings and prints a table.
"""

import sys
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path as File
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation
from synthetic_track import (
    LOAD_CELL,
    ORIENTATIONS,
    Path,
    differenced,
    grain_wrenches,
    known,
    law,
    noisy,
    read_by,
    shaken,
    track_of,
    unknown,
)

from rft_ros.calibration.calibrate import calibrate
from rft_ros.calibration.smoothing import interpolated
from rft_ros.errors import InputError
from rft_ros.rft import Memory, wrenches_in_time
from rft_ros.tool import load_tool

NAMES = ("surface_height", "medium.zeta", "medium.mobilization_length", "medium.calibrated_depth")
NAMES += ("sensor.bias", "sensor.mass", "sensor.center_of_mass", "sensor.delay")
FILE_ERROR = 0.002  # m, of the file's surface height, which is used where the recording does not show the surface


@cache
def tool_of(name, integration):
    """A coarse tool: the plate, a shipped mesh, a cylinder on its end, or a wheel on its rim."""
    if name in ("abb_plate", "scoop", "sphere"):
        return load_tool(name, scale=0.001, integration=integration, tolerance=0.1)
    radius, height, turn = {"cylinder": (20.0, 50.0, 0.0), "wheel": (60.0, 30.0, np.pi / 2.0)}[
        name
    ]
    mesh = trimesh.creation.cylinder(radius=radius, height=height, sections=48)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(turn, (0, 1, 0)))
    with TemporaryDirectory() as folder:
        mesh.export(File(folder) / "tool.stl")
        return load_tool(
            str(File(folder) / "tool.stl"), scale=0.001, integration=integration, tolerance=0.1
        )


def recording(seed):
    """Tilts in the air, straight down into grains with memory, sometimes a rest, and up; the truth, and the file's.

    The load cell lags or leads, and sometimes reads a friction that resists the motion, such as of a cable.

    Grains and load cell follow the motion at 1 kHz; of the poses and readings some are recorded, so that corners lie
    between them. Under the centroid rule noise would decide whether walls along the motion lead, so its poses have
    none.
    """
    rng = np.random.default_rng(seed)
    name = str(rng.choice(["abb_plate", "scoop", "sphere", "cylinder", "wheel"]))
    integration, every = (
        str(rng.choice(["refined", "refined", "centroid"])),
        int(rng.choice([8, 8, 8, 4, 4, 2])),
    )
    noise, shakes, difference = rng.choice([0.02, 0.3]), rng.random() < 0.5, rng.random() < 0.5
    rest, tilt = float(rng.choice([0.0, 1.0])), float(rng.choice([0.0, 0.0, 20.0]))
    zeta, length, surface = (
        rng.uniform(0.3, 1.5),
        rng.uniform(0.001, 0.006),
        rng.uniform(-0.01, 0.02),
    )
    depth, speed = rng.uniform(0.02, 0.05), rng.uniform(0.005, 0.015)
    tool = tool_of(name, integration)
    last = Rotation.from_euler("xyz", (tilt, 0.4 * tilt, 0.0), degrees=True)
    below, reach = (
        -float((tool.corners @ last.as_matrix()[2]).min()),
        float(np.linalg.norm(tool.corners, axis=1).max()),
    )
    path = Path((0.3, 0.1, surface + reach + 0.03))
    for angles in ORIENTATIONS:
        path.turn_to(Rotation.from_euler("xyz", angles, degrees=True)).wait(0.8)
    path.turn_to(last).wait(0.8).move((0.0, 0.0, below - reach - 0.03 - depth), speed)
    if rest:
        path.wait(rest)
    time, states = path.move((0.0, 0.0, 0.01 + depth), speed).states(1000.0)
    grains = replace(law(zeta), mobilization_length=length)
    force = wrenches_in_time(
        tool.plates, grains, states, Memory(tool.plates), surface_height=surface
    )
    some = slice(int(rng.integers(every)), None, every)
    friction, speeds = (
        rng.choice([0.0, 0.0, 0.05, 0.5, 2.0]),
        np.linalg.norm(states[:, 7:10], axis=1)[:, None],
    )
    force[:, :3] -= friction * states[:, 7:10] / np.maximum(speeds, 1e-6)
    delay = rng.uniform(-0.1, 0.1)
    late = interpolated(time - delay, time, read_by(LOAD_CELL, states, force))
    readings = noisy(late[some], rng, (noise, noise / 50.0))
    time, states = time[some] - time[some][0], states[some].copy()
    if shakes and integration == "refined":
        states = shaken(states, rng, 3e-6, 3e-5)
    if difference:
        states = differenced(time, states)
    cell = LOAD_CELL
    truth = (
        (surface,),
        (zeta,),
        (length,),
        (depth,),
        cell.bias,
        (cell.mass,),
        cell.center_of_mass,
        (delay,),
    )
    given = surface + rng.normal(0.0, FILE_ERROR)
    return track_of(time, states, readings, tool=tool), dict(zip(NAMES, truth, strict=True)), given


def scores(seeds):
    """By name, how many standard errors each fitted value is off."""
    found = {name: [] for name in NAMES}
    for seed in seeds:
        track, truth, given = recording(seed)
        with suppress(InputError):  # too much friction is refused
            for f in calibrate([track], unknown(surface_height=given)).fitted_values:
                found[f.name] += (np.abs(np.subtract(f.values, truth[f.name])) / f.errors).tolist()
    return found


def test_the_truth_lies_within_three_standard_errors_of_random_recordings():
    """Six recordings; the module, run by itself, tries more. Of 43 such 83 % of ζ and λ did, before the tests below."""
    found = scores(range(7000, 7006))
    of_grains = np.concatenate([found[name] for name in NAMES[:3]])
    assert len(of_grains) >= 14  # of 18
    assert np.mean(of_grains <= 3.0) >= 0.95
    assert np.mean(np.concatenate([*found.values()]) <= 3.0) >= 0.95
    assert np.mean(of_grains <= 1.0) >= 0.4  # no more than chance


def test_a_turn_between_two_poses_does_not_shift_lambda():
    """At 125 Hz the arm does 36 µm after a pose and undoes them before the next: λ was 10 % too short."""
    path = (
        Path((0.0, 0.0, 0.03))
        .wait(1.0)
        .move((0.0, 0.0, -0.065), 0.0115)
        .move((0.0, 0.0, 0.03), 0.0115)
    )
    time, states = path.states(1000.0)
    grains = replace(law(0.8), mobilization_length=0.003)
    tool = tool_of("abb_plate", "refined")
    force = wrenches_in_time(tool.plates, grains, states, Memory(tool.plates), surface_height=0.0)
    for first in (0, 3, 6):
        some = slice(first, None, 8)
        readings = read_by(
            LOAD_CELL, states[some], force[some], np.random.default_rng(1), noise=(0.02, 0.0004)
        )
        result = calibrate(
            [track_of(time[some] - time[first], states[some], readings, tool=tool)], known()
        )
        (length,) = (f for f in result.fitted_values if f.name == "medium.mobilization_length")
        assert abs(length.values[0] - 0.003) <= 3.0 * length.errors[0]
        assert abs(length.values[0] - 0.003) < 0.03 * 0.003


def late_by(delay, time, states, force, *, seed):
    """The recording of a load cell that is late, with poses and readings of every eighth moment."""
    readings = interpolated(time - delay, time, read_by(LOAD_CELL, states, force))[3::8]
    noise = np.random.default_rng(seed)
    return track_of(
        time[3::8] - time[3],
        states[3::8],
        noisy(readings, noise, (0.02, 0.0004)),
        tool=tool_of("abb_plate", "refined"),
    )


def found_in(track):
    return {f.name: f for f in calibrate([track], known()).fitted_values}


@pytest.mark.parametrize("delay", [0.003, 0.021, 0.2, -0.1])
def test_an_unknown_delay_does_not_shift_lambda_or_the_depth(delay):
    """A delay within two errors was not used, and the model was straight between two poses across a corner."""
    path = Path((0.0, 0.0, 0.03)).wait(1.0).move((0.0, 0.0, -0.065), 0.0115)
    time, states = path.move((0.0, 0.0, 0.03), 0.0115).wait(0.5).states(1000.0)
    grains = replace(law(0.8), mobilization_length=0.003)
    plates = tool_of("abb_plate", "refined").plates
    force = wrenches_in_time(plates, grains, states, Memory(plates), surface_height=0.0)
    found = found_in(late_by(delay, time, states, force, seed=1))
    assert found["sensor.delay"].values[0] == pytest.approx(delay, abs=0.001)
    assert found["medium.mobilization_length"].values[0] == pytest.approx(0.003, rel=0.07)
    depth = -float(tool_of("abb_plate", "refined").lowest_points(states)[0].min())
    assert found["medium.calibrated_depth"].values[0] == pytest.approx(depth, abs=2e-5)


def test_a_slow_start_is_no_delay():
    """Poses that follow behind a dead band start late: the delay was -9 ms."""
    path = Path((0.0, 0.0, 0.03)).wait(1.0).move((0.0, 0.0, -0.065), 0.0115).wait(1.0)
    time, states = path.wait(8.0).states(1000.0)
    share = np.clip((time - (time[-1] - 8.0)) / 8.0, 0.0, 1.0)
    states[:, 0] += 0.03 * share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    states[:, 7] = np.gradient(states[:, 0], time)
    grains = replace(law(0.8), mobilization_length=0.003)
    plates = tool_of("abb_plate", "refined").plates
    force = wrenches_in_time(plates, grains, states, Memory(plates), surface_height=0.0)
    found = found_in(late_by(0.0, time, states, force, seed=1))
    assert found["sensor.delay"].values[0] == pytest.approx(0.0, abs=0.005)


def test_the_error_of_zeta_has_that_of_a_surface_that_no_contact_shows():
    """The recording begins in the grains, and the file's height, which is 3 mm off, was taken as exact."""
    time, states = Path((0.0, 0.0, -0.01)).wait(1.0).move((0.0, 0.0, -0.03), 0.01).states()
    force = grain_wrenches(time, states, law(0.8), surface=0.0)
    readings = read_by(LOAD_CELL, states, force, np.random.default_rng(1), noise=(0.02, 0.0004))
    result = calibrate([track_of(time, states, readings)], known(surface_height=0.003))
    assert "surface_height" in result.not_identifiable
    (zeta,) = (f for f in result.fitted_values if f.name == "medium.zeta")
    assert abs(zeta.values[0] - 0.8) <= 3.0 * zeta.errors[0]
    assert zeta.errors[0] < 0.1


if __name__ == "__main__":
    count, first = map(int, sys.argv[1:])
    for name, off in scores(range(first, first + count)).items():
        within = [100.0 * np.mean(np.array(off) <= n) for n in (1.0, 2.0, 3.0)]
        print(
            f"{name:28s} {len(off):4d} values, within 1, 2, 3 errors: {within[0]:.0f} {within[1]:.0f} {within[2]:.1f} %"
        )
