"""Each kind of wrong set-up is named by its hypothesis, with a remedy near the truth; a right cell needs nothing.

The kinds are tried over random sizes of the fault. All of them see the same motion: a press, drags along x and y, up.
"""

import re

import numpy as np
import pytest
from cells import MOUNT, PARAMETERS, SURFACE, cell_of, loads, motion, wrong
from hypothesis import given, settings
from hypothesis import strategies as st
from recordings import START, STEP
from scipy.spatial.transform import Rotation

from rft_ros.demo import virtual_arm
from rft_ros.doctor.checkup import Checkup
from rft_ros.estimator import TransformSample, WrenchSample
from rft_ros.parameters import defaults
from rft_ros.rft import POSITION, QUATERNION, VELOCITY

STATES = motion(100.0)
LOADS = loads(STATES)
PEAK = np.abs(LOADS[:, 2]).max()
NOISE = np.random.default_rng(3).standard_normal(LOADS.shape) * (0.02, 0.02, 0.02, 2e-4, 2e-4, 2e-4)
SOURCES = st.sampled_from(["topic", "pose_difference"])
few = settings(max_examples=5, deadline=None)


def faults(*, states=STATES, readings=LOADS, **more):
    """What the doctor finds wrong with the cell."""
    return wrong(states, readings, **more)


@given(
    st.floats(0.6, 1.8), st.floats(0.0, 2.0), st.sampled_from([0.0, 0.0015, 0.003]), st.floats(-0.002, 0.002), SOURCES
)
@settings(max_examples=12, deadline=None)
def test_a_right_cell_in_other_grains_than_the_models_needs_nothing(strength, noise, length, above, source):
    said = faults(
        readings=strength * LOADS + noise * NOISE,
        twist_source=source,
        medium__mobilization_length=length,
        surface_height=SURFACE + above,
    )
    assert said == []


@given(st.floats(0.03, 0.15), st.sampled_from([-1.0, 1.0]), SOURCES)
@few
def test_a_delay_is_found_at_stops_and_turns_with_the_parameter_that_mends_it(delay, side, source):
    said = [text for text in faults(readings=LOADS + NOISE, late=side * delay, twist_source=source) if "delay" in text]
    assert len(said) == 1
    assert float(re.search(r"set sensor\.delay: (-?[\d.]+)", said[0])[1]) == pytest.approx(side * delay, abs=0.012)


@given(st.integers(0, 7))
@few
def test_a_delay_is_found_although_a_busy_machine_loses_up_to_80_ms_ten_times(seed):
    stops = np.random.default_rng(seed).integers(0, len(STATES), 10)
    said = faults(late=0.08, lost={k + n for k in stops.tolist() for n in range(8)})
    assert any("set sensor.delay: 0.0" in text for text in said)


def test_a_delay_much_shorter_than_the_time_between_samples_is_not_told():
    """A busy machine left 90 ms without samples; a right cell seemed 16 ms early."""
    lost = {k + n for k in range(0, len(STATES), 40) for n in range(8)}
    assert not any("delay" in text for text in faults(late=0.03, lost=lost))
    assert any("delay" in text for text in faults(late=0.03))


@given(st.floats(0.15, 0.4), SOURCES)
@few
def test_friction_in_the_air_is_a_zero_that_moves_and_nothing_else(share, source):
    readings = LOADS + NOISE
    readings[:, 2] += share * PEAK * np.sign(STATES[:, 9])
    (said,) = faults(readings=readings, twist_source=source)
    assert said.startswith("zero that moves")


def test_a_drift_of_the_zero_is_not_taken_for_friction():
    drift = np.linspace(0.0, 0.1 * PEAK, len(LOADS))[:, None] * (0, 0, 1, 0, 0, 0)
    assert not any("zero that moves" in text for text in faults(readings=LOADS + NOISE + drift))


@given(st.floats(0.3, 0.7))
@few
def test_a_clipped_load_cell_is_saturated(share):
    (said,) = faults(readings=np.clip(LOADS, -share * PEAK, share * PEAK) + 0.1 * NOISE)
    assert said.startswith("saturation: the force along z")


@given(st.integers(0, 100))
@settings(max_examples=3, deadline=None)
def test_a_reading_in_world_axes_is_told_from_a_turned_cell_at_any_attitude(seed):
    states = STATES.copy()
    states[:, QUATERNION] = Rotation.from_rotvec(np.radians(120.0) * _unit(seed)).as_quat()
    own = loads(states) + NOISE
    to_world = Rotation.from_quat(states[:, QUATERNION]) * Rotation.from_quat(MOUNT.quaternion)
    world = np.hstack([to_world.apply(own[:, :3]), to_world.apply(own[:, 3:])])
    assert faults(states=states, readings=own) == []
    (said,) = faults(states=states, readings=world)
    assert "set sensor.frame_source: world" in said
    assert "sensor.quaternion" not in said
    assert faults(states=states, readings=world, sensor__frame_source="world") == []


def _unit(seed):
    axis = np.random.default_rng(seed).standard_normal(3)
    return axis / np.linalg.norm(axis)


@given(st.integers(0, 100), st.floats(0.1, 0.25))
@few
def test_the_place_that_explains_the_torque_is_proposed(seed, distance):
    wrong = np.array(MOUNT.position) + distance * _unit(seed)
    (said,) = faults(readings=LOADS + 0.1 * NOISE, sensor__position=wrong.tolist())
    place = [float(number) for number in re.search(r"sensor\.position: \[(.*?)\]", said)[1].split(",")]
    assert place == pytest.approx(MOUNT.position, abs=0.01)


@given(st.integers(2, 6), SOURCES)
@few
def test_repeated_poses_are_counted(times, source):
    (said,) = faults(poses=STATES[np.arange(len(STATES)) // times * times, :3], twist_source=source)
    assert f"sent {times:.1f} times" in said


@given(st.floats(1.5e-4, 5e-4), SOURCES)
@few
def test_noise_of_poses_is_named_and_nothing_is_blamed_on_the_load_cell(sigma, source):
    noise = np.random.default_rng(1).normal(0.0, sigma, (len(STATES), 3))
    (said,) = faults(poses=STATES[:, POSITION] + noise, twist_source=source)
    assert said.startswith("noise: the poses have a noise of")


@given(st.integers(0, 100), SOURCES)
@few
def test_stamps_that_jitter_on_a_busy_machine_are_no_noise_of_poses(seed, source):
    late = np.abs(np.random.default_rng(seed).normal(0.0, 0.002, len(STATES)))[:, None]
    poses = STATES[:, POSITION] + late * STATES[:, VELOCITY]  # where the tool is when the stamp is said
    assert not any(text.startswith("noise") for text in faults(poses=poses, twist_source=source))


DEMO = {
    "surface_height": 0.0,
    "medium.zeta": 0.33,
    "alpha_y.model": "constant",
    "medium.mobilization_length": 0.0,
    "sensor.position": [0.0, 0.0, 0.12],
    "sensor.quaternion": [1.0, 0.0, 0.0, 0.0],
    "sensor.mass": 0.35,
    "sensor.center_of_mass": [0.0, 0.0, 0.05],
}
PITCHING = list(virtual_arm.moments(10.0))


@given(st.floats(0.0, 3.3), st.floats(5.0, 10.0), st.sampled_from([0.0, 0.35]))
@settings(max_examples=8, deadline=None)
def test_an_untared_cell_on_a_tool_that_pitches_needs_a_tare_only(start, end, mass):
    """In other grains than the model's, which get harder, from any moment in the air; also without the tool's mass."""
    times, states, readings = zip(*(moment for moment in PITCHING if start <= moment[0] <= end), strict=True)
    stamps = [START + round(1e9 * t) for t in times]
    said = wrong(np.array(states), np.array(readings), stamps=stamps, live=False, **{**DEMO, "sensor.mass": mass})
    assert not [text for text in said if text.startswith(("saturation", "lever", "zero that moves", "delay", "units"))]


UNITS = {
    "poses in mm": ("not millimetres", {"poses": 1e3 * STATES[:, POSITION]}),
    "twists in mm/s": ("not mm/s", {"twists": 1e3 * STATES[:, VELOCITY]}),
    "torque in N mm": ("not N mm", {"readings": LOADS * (1, 1, 1, 1e3, 1e3, 1e3)}),
    "force in kgf": ("as if it were kgf", {"readings": LOADS / 9.80665}),
    "force in kN": ("as if it were kN", {"readings": LOADS / 1e3}),
}


@pytest.mark.parametrize("unit", UNITS)
def test_another_unit_is_named(unit):
    sentence, change = UNITS[unit]
    (said,) = faults(**change)
    assert sentence in said


def _recorded(arrivals):
    """The faults of a recording of poses from TF, of which the transforms of `odom` arrive as given."""
    values = {**defaults(), **PARAMETERS, "pose_source": "tf", "twist_source": "pose_difference"}
    checkup = Checkup(cell_of(values), live=False)
    for k, (state, reading) in enumerate(zip(STATES.tolist(), LOADS.tolist(), strict=True)):
        now, stamp = START + k * STEP, arrivals(k)
        checkup.push(WrenchSample(stamp, "ft_sensor", tuple(reading)), now)
        if k % 10 == 0:
            ahead = TransformSample(stamp + 500_000_000, "world", "odom", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
            checkup.push((ahead,), now)
        checkup.push((TransformSample(stamp, "odom", "tool", tuple(state[:3]), tuple(state[3:7])),), now)
    return [finding.text for finding in checkup.findings() if not finding.ok]


def test_a_transform_that_is_dated_ahead_is_no_fault():
    assert _recorded(lambda k: START + k * STEP) == []


@given(st.floats(0.5, 100.0), st.sampled_from([-1.0, 1.0]), st.integers(300, 700))
@few
def test_a_clock_that_steps_in_a_recording_is_not_blamed_on_this_machine(step, side, row):
    said = _recorded(lambda k: START + k * STEP + round(side * step * 1e9) * (k >= row))
    assert any(text.startswith("clock: the stamps on /rft/wrench_measured step by") for text in said)
    assert not any("machine" in text or "surface_height" in text for text in said)
