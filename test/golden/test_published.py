"""config/published.yaml is the model of the paper, to the last bit."""

import numpy as np
import pytest

from rft_ros.parameters import Config, read_parameter_file
from rft_ros.rft import MEDIA, alpha_y_model, treers2021, wrenches
from rft_ros.states_file import read_states
from rft_ros.tool import load_tool

CONFIG = "config/published.yaml"


@pytest.fixture
def published(request):
    return read_parameter_file(request.config.rootpath / CONFIG).values


@pytest.mark.parametrize("alpha_y", ["constant", "linear"])
def test_it_gives_the_authors_forces_on_the_root_tip(published, shared_data, alpha_y):
    paper = shared_data / "paper"
    mesh = {
        "mesh.file": str(paper / "root-tip.stl"),
        "mesh.origin": (0.0, 0.0, 35.5),
        "medium.zeta": 0.33,
    }
    model = Config.of({**published, **mesh, "alpha_y.model": alpha_y}).model()
    _, states = read_states(paper / "circumnutation_P40_states.csv")
    found = wrenches(model.tool.plates, model.law, states)[:, :6]
    expected = np.loadtxt(
        paper / f"circumnutation_P40_expected_{alpha_y}.csv", delimiter=",", skiprows=1
    )[:, 1:7]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-9 * np.abs(expected).max())


def test_it_is_the_centroid_rule_with_all_plates_and_no_memory_bit_by_bit(published):
    model = Config.of({**published, "mesh.file": "ellipsoid", "medium.zeta": 0.33}).model()
    assert (model.law.mobilization_length, model.law.stresses["alpha_y"]) == (0.0, "constant")
    state = np.array(
        [[0.0, 0.0, -0.02, 0.1, 0.2, 0.3, 0.9273618495495703, 0.003, 0.002, -0.01, 0.1, 0.2, 0.3]]
    )
    generic = MEDIA["generic"]
    law = treers2021(generic, alpha_y_model("constant", generic), zeta=0.33)
    by_hand = wrenches(load_tool("ellipsoid", integration="centroid").plates, law, state)
    np.testing.assert_array_equal(wrenches(model.tool.plates, model.law, state), by_hand)
