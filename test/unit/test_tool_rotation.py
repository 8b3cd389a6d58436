"""mesh.quaternion and --rotate: a mesh whose axes are not those of the tool frame."""

import csv

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rft_ros.cli import main
from rft_ros.errors import InputError
from rft_ros.parameters import Config, MeshConfig
from rft_ros.rft import MEDIA, QUATERNION, alpha_y_model, checked_states, law_named, wrenches
from rft_ros.tool import load_tool, random_motions

HEADER = "t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz"
HALF_TURN = (1.0, 0.0, 0.0, 0.0)  # about x
ANGLE = st.floats(-np.pi, np.pi)


@settings(max_examples=25, deadline=None)
@given(
    st.tuples(ANGLE, ANGLE, ANGLE), st.sampled_from(["centroid", "refined"]), st.integers(0, 1000)
)
def test_a_turned_mesh_in_a_frame_turned_back_has_the_same_force_in_the_world(angles, rule, seed):
    turn = Rotation.from_euler("xyz", angles)
    origin = (1.0, -2.0, 3.0)
    plain = load_tool("root_tip", origin=origin, integration=rule)
    turned = load_tool("root_tip", origin=origin, quaternion=turn.as_quat(), integration=rule)
    np.testing.assert_allclose(turned.vertices, turn.apply(plain.vertices), atol=1e-12)
    states = random_motions(plain.corners, 20, seed=seed)
    back = states.copy()
    back[:, 3:7] = (Rotation.from_quat(states[:, QUATERNION]) * turn.inv()).as_quat()
    law = law_named("treers2021", MEDIA["generic"], alpha_y_model("linear", MEDIA["generic"]))
    force = wrenches(plain.plates, law, states)
    # a facet at the edge of leading, whose normal rounding turns, has next to no force
    np.testing.assert_allclose(
        wrenches(turned.plates, law, checked_states(back)),
        force,
        rtol=1e-6,
        atol=1e-6 * np.abs(force).max(),
    )


def test_the_parameter_turns_the_tool_and_no_rotation_keeps_every_bit():
    plain = load_tool("root_tip", tolerance=Config().values["tolerance"])
    turned = MeshConfig(file="root_tip", quaternion=HALF_TURN).load()
    assert plain.lowest_point(np.eye(3)) == pytest.approx(-0.0345)
    assert turned.lowest_point(np.eye(3)) == pytest.approx(0.0)
    same = MeshConfig(file="root_tip").load()
    assert same.plates.rows.tobytes() == plain.plates.rows.tobytes()
    for wrong in ((0.0, 0.0, 0.0, 2.0), (0.0, 0.0, 0.0, np.nan)):
        with pytest.raises(
            InputError, match=r"mesh\.quaternion is \[0\.0, 0\.0, 0\.0, .*; it must be 1"
        ):
            load_tool("plate", quaternion=wrong)


@pytest.fixture
def states(tmp_path):
    """20 mm deep at the end, straight down."""
    rows = np.zeros((21, 14))
    rows[:, 0] = np.arange(21) * 0.1
    rows[:, 3], rows[:, 7], rows[:, 10] = -0.01 * rows[:, 0], 1.0, -0.01
    np.savetxt(tmp_path / "states.csv", rows, delimiter=",", header=HEADER, comments="")
    return tmp_path / "states.csv"


def test_every_command_that_places_a_mesh_turns_it(states, tmp_path, capsys):
    turn = ["--rotate", "1", "0", "0", "0"]
    assert main(["check-mesh", "root_tip", *turn]) == 0
    assert "z: 0.000 to 34.500 mm" in capsys.readouterr().out
    page = tmp_path / "page.html"

    def predicted(mesh, *options):
        assert (
            main(
                ["predict", str(states), "--mesh", mesh, *options, "-o", str(tmp_path / "out.csv")]
            )
            == 0
        )
        return np.loadtxt(tmp_path / "out.csv", delimiter=",", skiprows=1)[:, 1:4]

    full = predicted("root_tip", *turn)  # its flat base enters first
    assert np.abs(full - predicted("root_tip")).max() > 1.0
    assert main(["view", str(states), "--mesh", "root_tip", *turn, "-o", str(page)]) == 0
    assert "z [mm]" in page.read_text()


def test_a_study_turns_its_tools(tmp_path):
    study = "tools:\n  - {mesh: root_tip, rotate: [[1, 0, 0, 0], [0, 0, 0, 1]]}\n"
    study += "  - {mesh: root_tip, rotate: [0, 0, 0, 1]}\n"
    study += (
        "motions:\n  - {family: straight, travel: 0.02, samples: 20}\nmedia:\n  - {zeta: 1.0}\n"
    )
    (tmp_path / "study.yaml").write_text(study)
    assert (
        main(
            ["sweep", str(tmp_path / "study.yaml"), "-o", str(tmp_path / "out"), "--workers", "1"]
        )
        == 0
    )
    with (tmp_path / "out" / "results.csv").open() as file:
        turned, plain, again = csv.DictReader(file)
    assert plain["peak_force"] == again["peak_force"]
    assert abs(float(turned["peak_force"]) - float(plain["peak_force"])) > 1.0
