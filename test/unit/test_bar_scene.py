"""A flat bar is pressed 30 mm into the grains, rests, and is dragged along its faces, with noise of its poses.

The bounds were measured on seeds 100 to 105, and have a quarter to spare. They are wide where the drag begins: there
the noise of the differenced velocity decides for how long the flat faces still press (docs/where-it-fails.md).
"""

import numpy as np
import pytest
import trimesh
from one_plate import pose, push

from rft_ros.estimator import Estimate, Estimator
from rft_ros.parameters import Config, Model
from rft_ros.rft import MEDIA, alpha_y_model, treers2021
from rft_ros.tool import load_tool

PERIOD = 4_000_000  # 250 Hz
FLANGE = 0.12  # m above the bar's lower face
PRESS, REST, DRAG = 750, 500, 500  # poses: 30 mm, 2 s, 20 mm at 10 mm/s
BEGIN, LATE = (
    slice(PRESS + REST, PRESS + REST + 125),
    slice(PRESS + REST + 125, PRESS + REST + DRAG),
)


@pytest.fixture(scope="module")
def bar(tmp_path_factory):
    """100 x 33 x 8 mm; the flange is its tool frame."""
    box = trimesh.creation.box((0.1, 0.033, 0.008))
    box.apply_translation((0.0, 0.0, 0.004 - FLANGE))
    for _ in range(3):
        box = box.subdivide()
    file = tmp_path_factory.mktemp("bar") / "bar.stl"
    box.export(file)
    return load_tool(str(file), integration="refined", scale=1.0)


def forces(bar, steps, *, um=0.0, urad=0.0, seed=0):
    """Predicted forces [N], shape [poses, 3], NaN where there is no estimate; `steps`: of the flange [m], [n, 2]."""
    generic = MEDIA["generic"]
    law = treers2021(
        generic, alpha_y_model("linear", generic), zeta=0.33, mobilization_length=0.003
    )
    config = Config.of({"twist_source": "pose_difference"})
    estimator = Estimator(config, Model(tool=bar, law=law, generation=0))
    rng, n = np.random.default_rng(seed), len(steps)
    places = np.zeros((n, 3))
    places[:, [0, 2]] = np.cumsum(steps, axis=0)
    places[:, 2] += FLANGE
    places += 1e-6 * um * rng.normal(size=(n, 3))
    turns = 0.5e-6 * urad * rng.normal(size=(n, 3))
    result = np.full((n, 3), np.nan)
    for k, (place, turn) in enumerate(zip(places.tolist(), turns.tolist(), strict=True)):
        answer = push(estimator, pose(1_000_000_000 + k * PERIOD, tuple(place), (*turn, 1.0)))
        if isinstance(answer, Estimate):
            result[k] = answer.predicted[:3]
    return result


def press_rest_drag(rest=REST, drag=DRAG):
    step = 0.01 * PERIOD * 1e-9
    return np.vstack(
        [[(0.0, -step)] * PRESS, [(0.0, 0.0)] * rest, np.full((drag, 2), (step, 0.0))]
    )


@pytest.fixture(scope="module")
def without_noise(bar):
    return forces(bar, press_rest_drag())


@pytest.mark.parametrize(("um", "urad"), [(1, 0), (3, 0), (0, 30), (3, 30), (5, 100)])
def test_noise_of_poses_changes_the_force_of_a_drag_along_the_faces_by_no_more_than_measured(
    bar, without_noise, um, urad
):
    """Of the peak: RMS of the first half second 8 to 26 %, and after it at most 3.4 %."""
    noisy = forces(bar, press_rest_drag(), um=um, urad=urad, seed=7)
    peak = np.nanmax(np.linalg.norm(without_noise, axis=1))
    error = np.linalg.norm(noisy - without_noise, axis=1) / peak
    assert np.sqrt(np.mean(error[BEGIN] ** 2)) < 0.32
    assert error[LATE].max() < 0.045
    assert error[PRESS + 50 : PRESS + REST].max() < 0.065


@pytest.mark.parametrize(("um", "urad"), [(2, 30), (5, 0), (5, 100)])
def test_a_rest_of_forty_seconds_changes_the_force_by_less_than_a_percent(bar, um, urad):
    """By -0.1 to 0.4 %; at 5 µm the noise now and then exceeds the dead band, and moves the plates a little."""
    held = forces(bar, press_rest_drag(rest=10_000, drag=0), um=um, urad=urad, seed=7)[PRESS:, 2]
    begin, middle, end = (np.nanmean(held[k : k + 250]) for k in (125, 5_000, 9_750))
    assert end == pytest.approx(begin, rel=0.01)
    assert middle == pytest.approx(begin, rel=0.01)
