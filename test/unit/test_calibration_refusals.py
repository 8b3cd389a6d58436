"""What the data cannot tell is refused by name, in a sentence with the numbers that say so."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic_track import (
    HANGING,
    ORIENTATIONS,
    Path,
    dragged,
    grain_wrenches,
    hanging,
    known,
    law,
    read_by,
    track_of,
    unknown,
)

from rft_ros.calibration import CannotTell, Options, calibrate
from rft_ros.calibration.alpha_y_fit import fit_alpha_y
from rft_ros.calibration.plate_runs import PlateRun, sheet_of
from rft_ros.calibration.sigmoids import fit_f1, runs_over_psi
from rft_ros.errors import InputError
from rft_ros.tool import load_tool


def calibrated(path, *, values=None, surface=0.0, length=1e-9, force=None, parts=None, tare=None, cell=HANGING):
    """Calibrate to a recording of the path, with 0.1 N of noise."""
    time, states = path.states()
    grains = grain_wrenches(time, states, law(0.8), surface=surface, length=length) if force is None else force(states)
    readings = read_by(cell, states, grains, np.random.default_rng(5), noise=(0.1, 0.002))
    options = Options(tare=tare) if parts is None else Options(parts=parts, tare=tare)
    return calibrate([track_of(time, states, readings)], values or known(), options)


def why(result, name):
    """The sentence with which `name` was refused; nothing was told of it."""
    assert name not in result.parameters
    return next(r.why for r in result.refusals if r.name == name)


def down(millimetres, *, start=0.03):
    return Path((0.0, 0.0, start)).wait(1.0).move((0.0, 0.0, -start - 1e-3 * millimetres), 0.01)


def test_too_shallow_a_penetration():
    sentence = why(calibrated(down(1.0)), "medium.zeta")
    assert "too shallow" in sentence
    assert "5 mm" in sentence


def test_a_recording_that_never_reaches_the_grains():
    result = calibrated(Path((0.0, 0.0, 0.08)).wait(1.0).move((0.0, 0.0, -0.05), 0.01))
    assert "must rise by 6 times" in why(result, "surface_height")
    assert "no vertical penetration" in why(result, "medium.zeta")
    assert "medium.calibrated_depth" not in result.parameters


def test_a_recording_that_never_goes_straight_down():
    result = calibrated(Path((0.0, 0.0, 0.05)).wait(1.0).move((0.03, 0.0, 0.0), 0.01))
    assert "never goes straight down" in why(result, "surface_height")


def test_grains_that_pull_a_sinking_tool_down_mean_a_wrong_sign():
    time, states = down(30.0).states()
    readings = read_by(replace(HANGING, sign=1.0), states, -grain_wrenches(time, states, law(0.8), surface=0.0))
    cell = {"sensor.sign": 1.0, "surface_height": 0.0}
    result = calibrate([track_of(time, states, readings)], {**known(), **cell}, Options(parts=("zeta",)))
    assert "check sensor.sign" in why(result, "medium.zeta")


def test_no_hanging_pose():
    result = calibrated(Path((0.0, 0.0, 0.05)).move((0.0, 0.0, -0.08), 0.01), values=unknown())
    assert "never hangs still" in why(result, "sensor.bias")


def test_one_orientation_tells_the_bias_and_no_mass():
    result = calibrated(down(30.0), values=unknown())
    assert "turns by 0.0°" in why(result, "sensor.mass")
    assert "mass is not told" in why(result, "sensor.center_of_mass")
    assert "sensor.bias" in result.parameters


def test_orientations_about_one_axis_tell_the_mass():
    """Turns about one axis move gravity in a plane: that tells the mass, and of the centre all three parts too."""
    result = calibrated(hanging(Path((0.0, 0.0, 0.06)), ((40, 0, 0), (80, 0, 0), (-40, 0, 0))), values=unknown())
    assert result.parameters["sensor.mass"] == pytest.approx(0.42, abs=0.02)


def test_collinear_orientations_tell_no_centre_of_mass():
    """Two poses alone: one difference of gravity, and what lies along it is not seen."""
    result = calibrated(hanging(Path((0.0, 0.0, 0.06)), ((60, 0, 0),)), values=unknown())
    assert "second direction" in why(result, "sensor.center_of_mass")
    assert "sensor.mass" in result.parameters


def test_a_negative_mass_means_a_wrong_sign():
    values = {**unknown(), "sensor.sign": 1.0}
    result = calibrated(hanging(Path((0.0, 0.0, 0.06)), ORIENTATIONS), values=values)
    assert "the mass comes out as -0.4" in why(result, "sensor.bias")


def test_a_tare_with_the_tool_in_motion():
    with pytest.raises(InputError, match="tare refused"):
        calibrated(Path((0.0, 0.0, 0.05)).move((0.0, 0.0, -0.08), 0.01), tare=1.0)


def test_a_stop_alone_tells_no_mobilization_length():
    result = calibrated(down(40.0).wait(2.0), length=0.003)
    assert "never turns round" in why(result, "medium.mobilization_length")


def test_no_memory_is_seen_where_the_force_follows_at_once():
    result = calibrated(down(40.0).wait(1.0).move((0.0, 0.0, 0.05), 0.01), parts=("mobilization",))
    assert "at once" in why(result, "medium.mobilization_length")


def test_a_force_that_has_nothing_to_do_with_the_path_tells_no_mobilization_length():
    def waves(states):
        up = 30.0 * np.sin(900.0 * states[:, 2]) * (states[:, 2] < 0.0)
        return np.column_stack([up, np.zeros((len(states), 5))])

    path = down(40.0).wait(1.0).move((0.0, 0.0, 0.05), 0.01)
    sentence = why(calibrated(path, force=waves, parts=("mobilization",)), "medium.mobilization_length")
    assert "it needs 50 % and less than 100 mm" in sentence


def test_a_plate_dragged_along_itself_tells_no_mobilization_length():
    """The model has neither face lead: what it misses must not be taken for memory."""
    time, states, grains = dragged((90.0,), lambda beta: 0.1 + 0.0 * beta, zeta=0.8)
    track = track_of(time, states, read_by(HANGING, states, grains))
    sentence = why(calibrate([track], known(), Options(parts=("mobilization",))), "medium.mobilization_length")
    assert "after" in sentence
    assert "λ" in sentence


def test_no_level_run():
    result = calibrated(down(40.0))
    assert "ψ of the runs: none" in why(result, "alpha_y")
    assert "5 or more ψ" in why(result, "f1")
    assert "5 or more ψ" in why(result, "f23")


def test_a_horizontal_plate_has_no_e1():
    result = calibrated(down(40.0).move((0.04, 0.0, 0.0), 0.01))
    assert "has no e1" in why(result, "alpha_y")


def test_a_level_run_that_is_too_short():
    upright = Path((0.0, 0.0, -0.05), Rotation.from_euler("x", 90, degrees=True)).wait(0.5).move((0.006, 0, 0), 0.01)
    assert "it needs 10 mm" in why(calibrated(upright), "alpha_y")


def test_a_ball_is_no_plate():
    ball = load_tool("sphere", scale=0.001)
    with pytest.raises(CannotTell, match="sphere is no plate"):
        sheet_of(ball.plates, "sphere")


def run_at(psi, beta=90.0, along=7.0, across=0.0):
    return PlateRun(
        bag="synthetic",
        beta=beta,
        psi=psi,
        depth=0.05,
        load=7e-5,
        along=along,
        across=across,
        up=0.0,
        along_error=0.1,
        across_error=0.1,
        edges=(0.0, 0.0),
    )


@pytest.mark.parametrize("model", ["linear", "table"])
def test_one_beta_tells_no_alpha_y_over_beta(model):
    with pytest.raises(CannotTell, match="span 2° of β in 1 steps"):
        fit_alpha_y([run_at(90.0, 88.0), run_at(90.0, 90.0)], zeta=0.8, model=model)


def test_runs_across_tell_no_alpha_y():
    with pytest.raises(CannotTell, match="ψ of the runs: 30°, 60°"):
        fit_alpha_y([run_at(30.0), run_at(60.0)], zeta=0.8)


def test_faces_that_are_pushed_along_tell_no_alpha_y():
    with pytest.raises(CannotTell, match="comes out as -0"):
        fit_alpha_y([run_at(90.0, along=-7.0)], zeta=0.8)


@pytest.mark.parametrize("psi", [(0, 30, 60, 90), (0, 10, 20, 30, 40, 50), (90, 90, 90, 90, 90, 90)])
def test_too_few_directions_tell_no_weights(psi):
    with pytest.raises(CannotTell, match="need 5 over 60°"):
        runs_over_psi([run_at(float(p)) for p in psi])


def test_scatter_that_hides_the_curve_is_refused():
    forces = np.random.default_rng(0).uniform(0.0, 10.0, 7)
    with pytest.raises(CannotTell, match="do not fix the curve"):
        fit_f1([run_at(p, along=f) for p, f in zip(np.linspace(0.0, 90.0, 7), forces, strict=True)], zeta=0.8)


def test_forces_that_help_the_motion_are_refused():
    with pytest.raises(CannotTell, match="do not oppose"):
        fit_f1([run_at(p, along=-1.0) for p in np.linspace(0.0, 90.0, 7)], zeta=0.8)
