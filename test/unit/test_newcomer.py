"""A newcomer's bag goes through tare, replay, calibrate, doctor and learning to right numbers; each fault is named.

Poses at 250 Hz with noise, no twists, a load cell with an offset that is mounted turned by 90 degrees, a surface at
120 mm, and grains 30 % stronger than the file says.
"""

import json

import pytest
import yaml
from cells import PARAMETERS, SURFACE, ZETA, record_of_a_newcomer

from rft_ros.cli import main
from rft_ros.parameters import read_parameter_file

pytestmark = pytest.mark.repository

OFFSET = (1.5, -0.8, 2.2, 0.01, 0.02, -0.03)
CELL = PARAMETERS | {"tolerance": 0.0, "world_frame": "base", "twist_source": "pose_difference"}
REMAP = {"remap": ["~/pose:=/tcp", "~/wrench_measured:=/ft"]}


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return str(record_of_a_newcomer(tmp_path_factory.mktemp("cell") / "my_bag", offset=OFFSET))


@pytest.fixture
def rft(bag, tmp_path, capsys):
    """Run a command on the bag with these parameters: exit status, and what it said."""

    def run(command, *arguments, parameters=CELL):
        file = tmp_path / "my_cell.yaml"
        sections = {
            "/**": {"ros__parameters": parameters},
            "rft_replay": {"ros__parameters": REMAP},
        }
        file.write_text(yaml.safe_dump(sections))
        where = [str(file), "--bag", bag] if command == "doctor" else [bag, "--params", str(file)]
        status = main([command, *where, *arguments])
        said = capsys.readouterr()
        return status, said.out + said.err

    return run


def test_the_newcomers_way_leads_to_right_numbers(bag, rft, tmp_path, capsys):
    out, calibrated = tmp_path / "replay", tmp_path / "calibrated.yaml"
    status, said = rft("replay", "--tare", "1", "--no-report", "-o", str(out))
    assert status == 0 and "warning" not in said, said
    assert json.loads((out / "summary.json").read_text())["bias"] == pytest.approx(
        OFFSET, abs=0.02
    )
    parts = ("--fit", "sensor", "--fit", "surface", "--fit", "zeta")  # λ takes most of the time
    status, said = rft("calibrate", *parts, "-o", str(calibrated))
    values = read_parameter_file(calibrated).values
    # its standard error
    assert values["medium.zeta"] == pytest.approx(1.3 * ZETA, rel=0.065), said
    assert values["surface_height"] == pytest.approx(SURFACE, abs=1e-3)
    assert values["sensor.bias"] == pytest.approx(OFFSET, abs=0.02)
    main(["doctor", str(calibrated), "--bag", bag])
    said = capsys.readouterr().out
    assert [line for line in said.splitlines() if line.startswith("FIX")] == []
    learning = CELL | {"learning.mode": "apply", "medium.zeta_error": 0.3}
    status, said = rft("replay", "--tare", "1", "--no-report", "-o", str(out), parameters=learning)
    summary = json.loads((out / "summary.json").read_text())
    assert status == 0 and "warning" not in said, said
    assert summary["learning"]["off"]["median_relative_error"] == pytest.approx(
        0.3 / 1.3, abs=0.03
    )
    assert summary["median_relative_error"] < 0.05


LEARNING = {"learning.mode": "observe"}
FAULTS = {
    "no tare": ("N more in the air than its bias and weight", {}, False),
    "tared at the wrong height": ("set surface_height: 0.1", {"surface_height": SURFACE - 0.03}),
    "no tare, learning": ("; tare it there (~/tare, --tare)", LEARNING, False),
    "sign": (" %: check the set-up with rft doctor", {"sensor.sign": -1.0}),
    "sign, learning": ("rft doctor --bag searches the cause", LEARNING | {"sensor.sign": -1.0}),
    "turned, learning": (
        "rft doctor --bag searches the cause",
        LEARNING | {"sensor.quaternion": [0.0, 0.0, 0.0, 1.0]},
    ),
    "surface": (
        "in the grains (of the first 1 s, surface_height 0.22 m",
        {"surface_height": SURFACE + 0.1},
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_replay_names_the_fault(rft, tmp_path, fault):
    sentence, parameters, *untared = FAULTS[fault]
    tare = () if untared else ("--tare", "1")
    _, said = rft(
        "replay", "--no-report", "-o", str(tmp_path / "out"), *tare, parameters=CELL | parameters
    )
    assert sentence in said
