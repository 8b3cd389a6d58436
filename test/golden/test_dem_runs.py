"""The published model against discrete-element simulations, by the error measure of shared/data/dem/README.md."""

import numpy as np
import pytest

from rft_ros.rft import MEDIA, alpha_y_model, checked_states, treers2021, wrenches
from rft_ros.tool import load_tool

FORCE = slice(14, 17)
MESHES = {"pen": "plate", "plate": "plate", "ellipsoid": "ellipsoid", "root": "paraboloid"}


def law(zeta, alpha_y="constant"):
    generic = MEDIA["generic"]
    return treers2021(generic, alpha_y_model(alpha_y, generic), zeta=zeta)


@pytest.fixture(scope="module")
def run(shared_data):
    """A run by name: its rows in motion, and the model's forces for a law."""
    folder = shared_data / "dem"

    def of(name, law):
        rows = np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1)
        rows = rows[np.any(rows[:, 8:14] != 0.0, axis=1)]
        mesh = folder / "meshes" / f"{MESHES[name.split('_')[0]]}.stl"
        tool = load_tool(str(mesh), scale=1.0)
        return rows, wrenches(tool.plates, law, checked_states(rows[:, 1:14]))[:, :3]

    return of


@pytest.fixture(scope="module")
def zeta(run):
    """ζ by least squares on the flat plate's penetration, above a fifth of its greatest force."""
    rows, unscaled = run("pen_plate_seedA", law(1.0))
    measured = rows[:, FORCE]
    strong = measured[:, 2] > 0.2 * measured[:, 2].max()
    return (measured[strong] * unscaled[strong]).sum() / (unscaled[strong] ** 2).sum()


def error(rows, model):
    smooth = np.apply_along_axis(np.convolve, 0, rows[:, FORCE], np.full(9, 1 / 9), "same")[5:-8]
    size = np.linalg.norm(smooth, axis=1)
    used = size > 0.2 * size.max()
    return np.median(np.linalg.norm(model[5:-8] - smooth, axis=1)[used] / size[used])


def test_zeta_from_the_flat_plates_penetration_is_0_24(zeta):
    assert zeta == pytest.approx(0.24, abs=0.005)


@pytest.mark.parametrize(
    "name",
    [
        "pen_plate_seedA",
        "plate_b30_psi30_phi60",
        "plate_b60_psi0_phi30",
        "plate_b60_psi30_phi30",
        "plate_b90_psi0_phi0",
        "plate_b90_psi30_phi0",
    ],
)
def test_plates_are_predicted_to_8_to_17_percent(run, name):
    """With 2 points' tolerance for how ζ is rounded and the plate is meshed: here 9 to 19 %."""
    assert 0.08 - 0.02 < error(*run(name, law(0.24))) < 0.17 + 0.02


@pytest.mark.parametrize(
    ("name", "published"),
    [
        ("ellipsoid_straight", 0.12),
        ("root_insert_tilt10", 0.18),
        ("ellipsoid_osc9deg_5Hz", 0.35),
        ("root_helix_P40_tilt10", 0.49),
        ("plate_b90_psi90_phi0", 0.71),
    ],
)
def test_bodies_and_the_plate_that_moves_along_itself_are_predicted_as_the_readme_says(run, name, published):
    assert error(*run(name, law(0.24))) == pytest.approx(published, abs=0.01)


def test_the_plate_that_moves_along_itself_lacks_the_friction_of_its_faces(run):
    """Neither face leads: 0.28 N of the measured 1.0 N. One face would add ζ α_y d A: 0.8 N linear, 1.3 N constant."""
    rows, model = run("plate_b90_psi90_phi0", law(0.24))
    predicted = np.median(np.linalg.norm(model, axis=1))
    depth, face = -np.median(rows[:, 3]), 0.03 * 0.03
    assert predicted == pytest.approx(0.28, abs=0.01)
    assert predicted + 0.24e6 * (0.2035 - 0.0015 * 90) * depth * face == pytest.approx(0.8, abs=0.02)
    assert predicted + 0.24e6 * 0.136 * depth * face == pytest.approx(1.3, abs=0.02)
    assert np.median(np.linalg.norm(rows[:, FORCE], axis=1)) == pytest.approx(1.0, abs=0.15)
