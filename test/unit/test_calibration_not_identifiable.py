"""What the data do not determine is reported as not identifiable, in a sentence with numbers."""

import re
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation
from synthetic_track import (
    LOAD_CELL,
    REST,
    Path,
    grain_wrenches,
    in_the_air,
    known,
    law,
    parameters,
    read_by,
    recorded,
    track_of,
    unknown,
)

from rft_ros.calibration.calibrate import PARTS, calibrate
from rft_ros.calibration.fitting import SearchRange, fit_curve
from rft_ros.calibration.track import Track
from rft_ros.demo import virtual_arm
from rft_ros.errors import InputError
from rft_ros.installation import share_directory
from rft_ros.parameters import LoadCell, checked, read_parameter_file
from rft_ros.rft.frames import Placement
from rft_ros.tool import load_tool, locate_mesh


def calibrated(path, *, values=None, parts=PARTS, **of_recording):
    """Calibrate to a recording of the path, with 0.1 N of noise."""
    return calibrate([recorded(path, **of_recording)], values or known(), parts=parts)


def fitted(result):
    """The fitted values by name."""
    return {f.name: f.values for f in result.fitted_values}


def refused_for(sentence, result):
    """The calibration must not be used, for a reason that has the sentence, and nothing was fitted."""
    assert any(re.search(sentence, refusal) for refusal in result.refusals), result.refusals
    assert not result.fitted_values


def why(result, name):
    """The reason why `name` is not identifiable; no value was fitted to it."""
    assert name not in fitted(result)
    return result.not_identifiable[name]


def down(millimetres):
    return Path((0.0, 0.0, 0.03)).wait(1.0).move((0.0, 0.0, -0.03 - 1e-3 * millimetres), 0.01)


def along(axis, force):
    """A wrench of that force [N], by the height of the tool, along a world axis."""
    return lambda states: np.outer(force(states[:, 2]), np.eye(6)[axis])


def mounted(axis):
    """The load cell as given, turned by 90° about an axis from where it is."""
    turned = Rotation.from_quat(LOAD_CELL.quaternion) * Rotation.from_euler(
        axis, 90.0, degrees=True
    )
    return {
        "values": known(sensor__quaternion=tuple(turned.as_quat())),
        "parts": ("sensor", "zeta"),
    }


UPRIGHT = Rotation.from_euler("x", 90, degrees=True)
MOVING = Path((0.0, 0.0, 0.05)).move((0.0, 0.0, -0.08), 0.01)
NOISE = {"seed": 1, "parts": ("zeta",), "force": along(0, lambda z: 0.0 * z)}
PULLED = {"force": along(2, lambda z: 1e3 * np.minimum(z, 0.0)), "parts": ("zeta",)}
UNRELATED_FORCE = {
    "force": along(0, lambda z: 30.0 * np.sin(900.0 * z) * (z < 0.0)),
    "parts": ("mobilization",),
}
CHECK = {"medium.zeta": "check sensor.quaternion, sensor.sign, surface_height"}
TOO_HIGH = {"values": known(surface_height=0.1), "parts": ("sensor", "zeta")}
WRONG_SIGN = "the fitted mass is -0.4.*sensor.sign or sensor.quaternion is wrong"
TOO_HEAVY = "sensor.mass is 4.*; it must lie between 0 and 1000"
AND_UP = down(40.0).wait(1.0).move((0.0, 0.0, 0.05), 0.01)


@pytest.mark.parametrize(
    ("path", "given", "reasons"),
    [
        (
            down(1.0),
            {},
            {"medium.zeta": r"penetration of 4.0 mm in \d+ samples is too shallow; ζ needs 5 mm"},
        ),
        (down(40.0).wait(1.0), TOO_HIGH, CHECK),
        (
            down(-20.0),
            {},
            {"surface_height": "a rise of 6 times", "medium.zeta": "no vertical penetration"},
        ),
        (
            Path((0.0, 0.0, 0.05)).move((0.03, 0.0, 0.0), 0.01),
            {},
            {"surface_height": "never goes straight down"},
        ),
        (down(30.0), NOISE, {"medium.zeta": r"the fitted ζ is 0\.0"}),
        (MOVING, {"values": unknown()}, {"sensor.bias": "never rests"}),
        (
            down(30.0),
            {"values": unknown()},
            {"sensor.mass": "turns by 0.0°", "sensor.center_of_mass": "mass unknown"},
        ),
        (
            in_the_air([(60, 0, 0)]),
            {"values": unknown()},
            {"sensor.center_of_mass": "second direction"},
        ),
        (in_the_air(), {"values": {**unknown(), "sensor.sign": 1.0}}, {"sensor.bias": WRONG_SIGN}),
        (
            in_the_air(),
            {"values": unknown(), "cell": replace(LOAD_CELL, mass=4200.0)},
            {"sensor.bias": TOO_HEAVY},
        ),
        (down(40.0).wait(2.0), {"length": 0.003}, {"medium.mobilization_length": "never turns"}),
        (AND_UP, {}, {"medium.mobilization_length": "at once"}),
    ],
)
def test_a_recording_that_lacks_something_is_told_what_it_lacks(path, given, reasons):
    result = calibrated(path, **given)
    for name, reason in reasons.items():
        assert re.search(reason, why(result, name))
    if "sensor.mass" in reasons or "sensor.center_of_mass" in reasons:
        assert "sensor.bias" in fitted(result)


@pytest.mark.parametrize(
    ("path", "given", "remedy"),
    [
        (down(30.0), PULLED, "sensor.sign"),
        (down(40.0).wait(1.0), mounted("x"), "sensor.quaternion"),
        (down(40.0).wait(1.0), mounted("y"), "sensor.quaternion"),
        (AND_UP, UNRELATED_FORCE, "sensor.quaternion"),
    ],
)
def test_forces_that_only_another_mounting_or_sign_or_nothing_explains_are_refused(
    path, given, remedy
):
    refused_for(remedy, calibrated(path, **given))


def test_a_mass_below_its_error_is_no_mass():
    """The readings in the air scatter by some newtons, as those of a cable that pulls."""
    track = recorded(in_the_air(), cell=replace(LOAD_CELL, mass=0.04), noise=(0.0, 0.0))
    track.readings[:, :3] += np.random.default_rng(4).normal(0.0, 4.0, (12, 3))[
        (track.time / 1.3).astype(int)
    ]
    result = calibrate([track], unknown())
    reason = r"the fitted mass is -?0\.\d+ ± 0\.[1-9]\d* kg \(R² -?0\.\d+\).*kept: 0 kg"
    assert re.search(reason, why(result, "sensor.mass"))
    assert "sensor.bias" in fitted(result)


def test_orientations_about_one_axis_identify_the_mass():
    """Turns about one axis move gravity in a plane, which identifies the mass and all of the centre."""
    result = calibrated(in_the_air(((40, 0, 0), (80, 0, 0), (-40, 0, 0))), values=unknown())
    assert fitted(result)["sensor.mass"] == pytest.approx((0.42,), abs=0.02)


def test_a_mass_within_its_error_is_0_and_identifies_no_centre():
    """Such as of a load cell whose driver takes off the weight: noise makes the fitted mass slightly negative."""
    result = calibrated(in_the_air(), values=unknown(), cell=replace(LOAD_CELL, mass=-0.0005))
    assert fitted(result)["sensor.mass"] == (0.0,)
    assert "needs a mass over 3 times its error" in why(result, "sensor.center_of_mass")


def test_a_driver_that_subtracts_too_much_leaves_the_bias_of_the_attitude_in_the_grains():
    """Six attitudes in the air gave a ζ of 1.10 ± 0.04 for 1, and without them it was right."""
    path = in_the_air().move((0, 0, -0.09), 0.01).wait(1.0)
    result = calibrated(path, values=unknown(), cell=replace(LOAD_CELL, mass=-0.25), length=0.003)
    reason = why(result, "sensor.mass")
    assert "payload" in reason
    assert "0.25 kg" in reason
    assert fitted(result)["medium.zeta"] == pytest.approx((0.8,), rel=0.01)


def test_torques_in_newton_millimetres_are_refused():
    track = recorded(in_the_air())
    track.readings[:, 3:] *= 1e3
    with pytest.raises(InputError, match="N mm"):
        calibrate([track], unknown())


AIR_AND_GRAINS = in_the_air().move((0, 0, -0.09), 0.01).move((0, 0, 0.05), 0.01)


def resting_at(row, share):
    """The load cell repeats a reading, or 0, from that row on."""

    def change(_states, readings):
        readings[row:] = share * readings[row]

    return change


def in_millimetres(states, _readings):
    states[:, [0, 1, 2, 7, 8, 9]] *= 1e3


def beyond_any_load_cell(_states, readings):
    readings[:] = 1e99


def rubbing(friction):
    """A force that reverses with the motion."""

    def change(states, readings):
        readings[:, 2] -= friction * np.sign(np.round(states[:, 9], 6))

    return change


def rubbing_in_weak_grains(states, readings):
    """In grains of a tenth of the given ζ."""
    readings *= 0.1
    rubbing(0.25)(states, readings)


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (
            resting_at(0, 0.0),
            "the load cell reads 0 N and 0 N m from 0.0 s on, over 100 % of the tool's path",
        ),
        (
            resting_at(0, 1.0),
            r"the load cell repeats one reading \(\S+ N along its z\) from 0.0 s on, over 100 %",
        ),
        (
            resting_at(500, 1.0),
            r"repeats one reading \(\S+ N along its z\) from 5.0 s on, over 100 %",
        ),
        (beyond_any_load_cell, r"synthetic has a load-cell reading of 1e\+99"),
    ],
)
def test_a_recording_that_no_load_cell_gives_is_unusable(change, sentence):
    """A dead cell gave a mass of 0 ± 1e-15 kg."""
    track = recorded(AIR_AND_GRAINS)
    change(track.states, track.readings)
    with pytest.raises(InputError, match=sentence):
        calibrate([track], unknown())


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (in_millimetres, r"moves over 90 m at \S+ m/s.*not millimetres"),
        (rubbing(2.0), "reading depends on the motion"),
        (rubbing(16.0), "reading depends on the motion"),
        (rubbing_in_weak_grains, "reading depends on the motion"),
    ],
)
def test_poses_in_millimetres_and_a_zero_that_moves_are_refused(change, sentence):
    """Millimetres gave a ζ of 1.3e-4, and friction a ζ of 0.70 ± 0.08 for 1."""
    track = recorded(AIR_AND_GRAINS)
    change(track.states, track.readings)
    refused_for(sentence, calibrate([track], unknown()))


def test_the_calibrated_depth_is_that_of_a_penetration_with_zeta():
    """In the deeper one the load cell reads only bias and weight. The plate is 6 mm thick."""
    tracks = [
        recorded(down(depth), zeta=zeta, noise=(0.004, 1e-4))
        for depth, zeta in ((20.0, 0.8), (40.0, 1e-6))
    ]
    found = fitted(calibrate(tracks, known(), parts=("zeta",)))
    assert found["medium.calibrated_depth"] == pytest.approx((0.023,), abs=2e-4)


UPSIDE_DOWN = trimesh.transformations.rotation_matrix(np.pi, (1, 0, 0))
ON_ITS_SIDE = trimesh.transformations.rotation_matrix(np.pi / 2.0, (0, 1, 0))
RIGHT = np.eye(4)


def shape(name):
    """A tool as it is pressed into the grains [mm]: a cone point first, a scoop, a flat disc, a wheel on its rim."""
    if name == "cone":
        return trimesh.creation.cone(radius=25.0, height=60.0, sections=48).apply_transform(
            UPSIDE_DOWN
        )
    if name == "scoop":
        return trimesh.load_mesh(locate_mesh("scoop"))
    disc = trimesh.creation.cylinder(radius=40.0, height=10.0, sections=48)
    return disc.apply_transform(ON_ITS_SIDE) if name == "wheel" else disc


def result_of(folder, name, turn, *, growth, zeta=0.8):
    """The calibration of a tool with a turned mesh, in grains whose pressure grows as depth to the power 1 + growth."""
    right, given = (folder / f"{file}.stl" for file in ("right", "given"))
    shape(name).export(right)
    shape(name).apply_transform(turn).export(given)
    right, given = (load_tool(str(file), scale=0.001, tolerance=0.05) for file in (right, given))
    path = (
        Path((0.0, 0.0, 0.015 - right.corners[:, 2].min()))
        .wait(1.0)
        .move((0.0, 0.0, -0.055), 0.01)
    )
    time, states = path.states(50.0)
    grains = grain_wrenches(time, states, law(zeta), surface=0.0, tool=right)
    depth = np.maximum(-right.corners[:, 2].min() - states[:, 2], 0.0)
    grains *= (np.maximum(depth, 1e-9) / depth.max())[:, None] ** growth
    readings = read_by(LOAD_CELL, states, grains, np.random.default_rng(2), noise=(0.02, 0.0005))
    track = track_of(time, states, readings, tool=given)
    return calibrate([track], known(), parts=("surface", "zeta"), trusts_surface=True)


@pytest.mark.parametrize(
    ("name", "turn", "growth"),
    [
        ("cone", UPSIDE_DOWN, 0.0),
        ("cone", UPSIDE_DOWN, 0.3),
        ("scoop", UPSIDE_DOWN, 0.0),
        ("scoop", UPSIDE_DOWN, 0.3),
        (
            "plate",
            ON_ITS_SIDE,
            0.0,
        ),  # grows alike in both attitudes; only the force's size differs
    ],
)
def test_a_mesh_that_is_turned_is_refused_and_mesh_quaternion_named(tmp_path, name, turn, growth):
    """Its ζ was written with a warning and exit status 0."""
    refused_for(r"mesh\.quaternion", result_of(tmp_path, name, turn, growth=growth))


@pytest.mark.parametrize("growth", [-0.25, 0.3, 0.5])
@pytest.mark.parametrize(
    ("name", "zeta"), [("plate", 0.5), ("wheel", 0.25), ("cone", 0.8), ("scoop", 0.8)]
)
def test_a_tool_in_its_attitude_is_not_doubted_in_grains_unlike_the_model(
    tmp_path, name, zeta, growth
):
    """The pressure under real plates and wheels grows as depth to the power 1.3 to 1.6; they were called turned."""
    result = result_of(tmp_path, name, RIGHT, growth=growth, zeta=zeta)
    assert not result.warnings
    assert not result.refusals


def test_the_bias_has_an_error_for_the_weight_that_the_poses_do_not_separate_from_it():
    """With gravity turned about one axis between two poses the torques of the bias were 14 errors off."""
    for orientations in ([(40, 0, 0)], [(1, 0, 0)], [(35, 0, 0), (0.1, 0, 0)]):
        result = calibrated(in_the_air(orientations), values=unknown())
        assert "sensor.center_of_mass" in result.not_identifiable
        (bias,) = (f for f in result.fitted_values if f.name == "sensor.bias")
        assert (
            np.abs(np.subtract(bias.values, LOAD_CELL.bias)) <= 3.0 * np.array(bias.errors)
        ).all()


@given(force=st.floats(-12.0, 6.0), place=st.floats(-3.0, 3.0), offset=st.floats(-7.0, 7.0))
@settings(max_examples=12)
@example(force=-9.0, place=0.0, offset=0.0)
def test_whatever_the_units_of_a_recording_are_it_is_refused_or_its_values_are_those_of_parameters(
    force, place, offset
):
    track = recorded(
        down(30.0).wait(1.0).move((0.0, 0.0, 0.05), 0.01),
        length=0.003,
        cell=LoadCell(),
        noise=(0.0, 0.0),
    )
    track.readings[:] *= 10.0**force
    track.states[:, [0, 1, 2, 7, 8, 9]] *= 10.0**place
    track.states[:, 2] += 10.0**offset
    with suppress(InputError):
        for fit in calibrate([track], parameters(medium__mobilization_length=0.003)).fitted_values:
            assert (
                checked(fit.name, fit.values if len(fit.values) > 1 else fit.values[0]) is not None
            )


def test_the_error_of_a_bias_is_no_smaller_than_what_the_resolution_of_the_load_cell_hides():
    """A cell that reads in steps of 0.5 N, whose noise is smaller, repeats one reading at rest: ± 3e-16 N."""
    track = recorded(in_the_air(), noise=(0.03, 0.001), seed=1)
    track.readings[:, :3] = 0.5 * np.round(track.readings[:, :3] / 0.5)
    result = calibrate([track], unknown(), parts=("sensor",))
    (bias,) = (f for f in result.fitted_values if f.name == "sensor.bias")
    off = np.abs(np.subtract(bias.values, LOAD_CELL.bias))
    assert (off <= 3.0 * np.array(bias.errors)).all()
    first = {name: getattr(track, name)[:300] for name in ("time", "states", "readings")}
    one_pose = calibrate([replace(track, **first)], unknown(), parts=("sensor",))
    (bias,) = (f for f in one_pose.fitted_values if f.name == "sensor.bias")
    assert min(bias.errors[:3]) > 0.1


def test_recordings_whose_transforms_place_the_load_cell_differently_are_refused():
    track = recorded(in_the_air())
    at_cell = Placement(LOAD_CELL.position, LOAD_CELL.quaternion)
    turned = at_cell._replace(quaternion=(0.0, 0.0, 0.0, 1.0))
    one, other = (
        replace(track, name=name, mount=mount) for name, mount in (("a", at_cell), ("b", turned))
    )
    of_tf = unknown(sensor__frame_source="tf")
    calibrate([one, replace(one, name="c")], of_tf, parts=["sensor"])
    with pytest.raises(InputError) as refused:
        calibrate([one, other], of_tf, parts=["sensor"])
    assert {"a", "b", "differently;", "calibrate"} <= set(
        str(refused.value).replace(":", "").split()
    )


PRESS_AND_LIFT = in_the_air().move((0.0, 0.0, -0.09), 0.01).wait(1.0).move((0.0, 0.0, 0.09), 0.01)


def pressed(rate):
    """A tool that was tilted in the air, pressed into the grains and lifted."""
    return recorded(PRESS_AND_LIFT, rate=rate, length=0.003, noise=(0.02, 0.0004), seed=1)


def test_a_load_cell_that_is_clipped_is_refused():
    """At half of the peak it gave a mass 40 % and a ζ 16 % too small, with a warning."""
    track, values = pressed(125.0), known(medium__mobilization_length=0.003)
    assert not calibrate([track], values).refusals
    forces = track.readings[:, :3]
    zero = np.median(forces[-100:], axis=0)
    limit = 0.5 * np.abs(forces - zero).max()
    forces[:] = np.clip(forces, zero - limit, zero + limit)
    refused_for("saturation:", calibrate([track], values))


def test_a_force_that_stays_alike_in_a_drag_is_not_cut_off():
    """Its plateau has the noise of the load cell."""
    path = in_the_air()
    for _ in range(2):
        path.move((0.0, 0.0, -0.08), 0.01).wait(1.0).move((0.05, 0.0, 0.0), 0.01)
        path.wait(1.0).move((0.0, 0.0, 0.08), 0.02)
    result = calibrated(path, length=0.003, noise=(0.02, 0.0004), parts=("zeta",))
    assert not result.refusals


def test_a_peak_beyond_which_the_model_grows_is_not_cut_off():
    """As in the demo, where a layer is stronger than the grains above."""
    times, states, readings = map(np.array, zip(*virtual_arm.moments(12.0), strict=True))
    tool = load_tool("ellipsoid")
    track = Track(
        name="demo",
        begin=0,
        time=times,
        states=states,
        readings=readings,
        cell=LoadCell(),
        tool=tool,
        rest_speed=REST,
    )
    values = read_parameter_file(share_directory("rft_ros") / "config" / "demo.yaml")
    assert "saturation" not in " ".join(calibrate([track], values).warnings)


def test_a_load_cell_that_is_turned_by_any_angle_is_refused():
    """At 60° its ζ was written with a warning and exit status 0."""
    turn = Rotation.from_rotvec(np.radians(60.0) * np.array((0.6, 0.8, 0.0)))
    quaternion = Rotation.from_quat(LOAD_CELL.quaternion) * turn
    path = in_the_air().move((0.0, 0.0, -0.09), 0.01).wait(1.0).move((0.04, 0.0, 0.0), 0.01)
    wrong = known(sensor__quaternion=tuple(quaternion.as_quat().tolist()))
    refused_for("sensor.quaternion", calibrated(path, values=wrong, length=0.003))


def test_a_slow_filter_of_the_driver_is_said_as_a_delay_or_a_filter():
    """At 5 Hz it hides within the model's errors; λ is then 8 mm for 3."""
    track = pressed(125.0)
    follows = np.exp(-2.0 * np.pi * 2.0 / 125.0)
    late = lfilter([1.0 - follows], [1.0, -follows], track.readings - track.readings[0], axis=0)
    track.readings[:] = late + track.readings[0]
    (sentence,) = calibrate([track], known(medium__mobilization_length=0.003)).warnings
    assert "delay:" in sentence


def test_a_press_that_begins_in_the_grains_is_no_contact():
    """After a way up of 2 cm out of 3; the mean with its height gave a ζ of 1.16 for 0.8."""
    press = in_the_air().move((0.0, 0.0, -0.09), 0.01).move((0.0, 0.0, 0.02), 0.01)
    found = fitted(calibrated(press.move((0.0, 0.0, -0.02), 0.01), length=0.003))
    assert found["surface_height"] == pytest.approx((0.0,), abs=3e-4)
    assert found["medium.zeta"] == pytest.approx((0.8,), rel=0.02)


def from_second(track, second):
    """The recording from there on."""
    rows = track.time >= second
    return replace(
        track,
        time=track.time[rows] - second,
        states=track.states[rows],
        readings=track.readings[rows],
    )


def test_a_turn_soon_after_a_recording_begins_in_the_grains_tells_no_length():
    """The grains hold a force from the way down before: λ was 1.0 ± 0.5 mm for 3."""
    path = Path((0.0, 0.0, 0.03)).wait(1.0).move((0.0, 0.0, -0.06), 0.01).move((0.03, 0, 0), 0.01)
    track = recorded(path, length=0.003)
    assert fitted(calibrate([track], known(), parts=("mobilization",)))
    late = calibrate([from_second(track, 6.8)], known(), parts=("mobilization",))
    assert "never turns" in why(late, "medium.mobilization_length")


def test_poses_that_are_repeated_are_left_out_and_said():
    """A topic of 500 Hz with poses of 90 Hz gave a ζ of 1.18 for 1."""
    track = pressed(500.0)
    states = track.states[np.arange(len(track.time)) // 5 * 5]
    states[:, 0] += 12.3e-6  # else each step is one of 0.1 mm, as of poses that are rounded
    repeated = replace(track, states=states)
    result = calibrate([repeated], known(medium__mobilization_length=0.003), parts=("zeta",))
    assert any("repeat" in warning for warning in result.warnings)
    (zeta,) = (f for f in result.fitted_values if f.name == "medium.zeta")
    assert abs(zeta.values[0] - 0.8) <= 3.0 * zeta.errors[0]
    assert zeta.errors[0] < 0.05


def test_poses_that_are_sent_five_times_give_no_delay():
    """The last repeats of a rest belong to a tool that had started: the delay was -20 ± 4 ms."""
    path = Path((0.0, 0.0, 0.03)).wait(1.0).move((0.0, 0.0, -0.06), 0.01).wait(1.0)
    path = path.move((0.03, 0.0, 0.0), 0.01).wait(1.0).move((0.0, 0.0, 0.06), 0.01)
    track = recorded(path, rate=125.0, length=0.003)
    often = track.states[np.arange(len(track.time)) // 5 * 5]
    result = calibrate([replace(track, states=often)], known(medium__mobilization_length=0.003))
    found = {f.name: f for f in result.fitted_values}
    assert abs(found["sensor.delay"].values[0]) < 0.005
    assert abs(found["surface_height"].values[0]) <= 3.0 * found["surface_height"].errors[0]


def test_a_press_that_is_followed_by_a_roll_half_a_millimetre_deeper_is_a_press():
    """Its lowest point is in the roll; "the tool never goes straight down" was said."""
    pressed_first = Path((0.0, 0.0, 0.03)).wait(1.0).move((0.0, 0.0, -0.06), 0.01).wait(1.0)
    rolled = pressed_first.roll(
        (0.03, 0.0, -0.0005), Rotation.from_euler("y", 25.0, degrees=True), seconds=4.0
    )
    result = calibrated(rolled.wait(1.0).move((0.0, 0.0, 0.08), 0.01), length=0.003)
    assert fitted(result)["surface_height"] == pytest.approx((0.0,), abs=3e-4)
    assert fitted(result)["medium.zeta"] == pytest.approx((0.8,), rel=0.02)


def test_a_surface_far_from_the_known_one_is_refused_and_otherwise_a_warning():
    """A mesh upside down, or another TCP, moves the surface by the tool's length: ζ 0.84 for 0.6 was written."""
    values = known(surface_height=-0.05)
    track = recorded(PRESS_AND_LIFT, length=0.003)
    trusted = calibrate([track], values, trusts_surface=True)
    assert any(refusal.startswith("surface_height") for refusal in trusted.refusals)
    searched = calibrate([track], values)
    assert not searched.refusals
    assert any(warning.startswith("surface_height") for warning in searched.warnings)


def test_positions_that_are_rounded_to_a_millimetre_give_no_surface_of_any_error():
    """A logger with three decimals gave `-0 ± 1.8e+10 m`, which was written with exit status 0."""
    track = recorded(PRESS_AND_LIFT, rate=125.0, length=0.003)
    track.states[:, :3] = np.round(track.states[:, :3], 3)
    result = calibrate([track], known(), parts=("surface",))
    for fit in result.fitted_values:
        if fit.name == "surface_height":
            assert fit.errors[0] < 0.01


def test_several_events_of_one_recording_have_their_times():
    path = Path((0.0, 0.0, 0.03)).wait(1.0).move((0.0, 0.0, -0.06), 0.01).wait(1.0)
    path = path.move((0.03, 0.0, 0.0), 0.01).wait(1.0).move((0.0, 0.0, 0.06), 0.01)
    result = calibrated(path, length=0.003, parts=("mobilization",))
    (length,) = (f for f in result.fitted_values if f.name == "medium.mobilization_length")
    assert re.findall(r"synthetic at (\d+\.\d) s", length.source) == ["6.7", "10.7"]


def test_a_parameter_that_changes_nothing_has_no_finite_error():
    def level(_):
        return np.ones((40, 1, 1))

    observed = np.random.default_rng(1).normal(1.0, 0.1, (40, 1))
    fit = fit_curve(level, [SearchRange(0.1, -1.0, 1.0)], observed, [np.zeros(1)])
    assert fit.error == np.inf
