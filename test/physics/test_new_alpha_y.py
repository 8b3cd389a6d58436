"""docs/architecture.md says how to add an α_y model. Here its listing is put into a copy of the package, and used."""

import json
import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from rft_ros.rft import MEDIA

ROOT = Path(__file__).resolve().parents[2]
# One process compiles the new law once, by the default rule. A submerged plate that leads has the published force.
SCRIPT = """
import json, sys
import numpy as np
from rft_ros.cli import main
from rft_ros.parameters import PARAMETERS
from rft_ros.rft import MEDIA, Plates, alpha_y_model, checked_states, plate_forces, treers2021, wrenches

medium = MEDIA["generic"]
law = treers2021(medium, alpha_y_model("fading", medium), zeta=0.33)
state = checked_states([0, 0, -0.02, 0, 0, 0, 1, 0.006, 0.008, -0.001, 0, 0, 0])
forces = {}
for degrees in (45.0, 90.0):
    beta = np.deg2rad(degrees)
    across, along = np.array([0.0, 0.01, 0.0]), 0.01 * np.array([np.cos(beta), 0.0, np.sin(beta)])
    square = np.array([-across - along, across - along, across + along, along - across])
    plates = Plates.from_triangles(square[[[0, 1, 2], [0, 2, 3]]], [0.01, 0.01])
    of_plates = plate_forces(plates, law, state[0]).sum(axis=0)
    forces[degrees] = wrenches(plates, law, state)[0, :3].tolist(), of_plates.tolist()
columns = "t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz"
with open("states.csv", "w") as file:
    file.write(columns + "\\n0,0,0,-0.05,0,0,0,1,0.01,0.01,0,0,0,0\\n")
words = ["predict", "states.csv", "--mesh", sys.argv[1], "-o", "wrenches.csv", "--alpha-y", "fading"]
found = {"forces": forces, "status": main(words), "names": {p.name: p.choices for p in PARAMETERS}}
with open("found.json", "w") as file:
    json.dump(found, file)
"""


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What `SCRIPT` finds where `rft_ros` is a copy with the page's listing and its one line."""
    folder = tmp_path_factory.mktemp("changed")
    shutil.copytree(ROOT / "rft_ros", folder / "rft_ros", ignore=shutil.ignore_patterns("__pycache__"))
    section = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8").partition("## A new α_y model")[2]
    section = section.partition("\n## ")[0]
    (listing,) = re.findall(r"```python\n(.*?)```", section, flags=re.DOTALL)
    (line,) = re.findall(r'^`("fading".*)`$', section, flags=re.MULTILINE)
    assert len(listing.splitlines()) + 1 <= 20
    file = folder / "rft_ros" / "rft" / "alpha_y.py"
    above, marked, below = file.read_text(encoding="utf-8").partition("\n_MODELS: ")
    head, brace, entries = below.partition("{\n")
    assert marked and brace
    file.write_text(f"{above}\n{listing}\n{marked}{head}{brace}    {line}\n{entries}", encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache")}
    command = [sys.executable, "-c", SCRIPT, str(ROOT / "meshes" / "plate.stl")]
    done = subprocess.run(command, env=environment, cwd=folder, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return json.loads((folder / "found.json").read_text())


@pytest.mark.parametrize("beta", [45.0, 90.0])
def test_a_plate_gets_the_force_of_the_new_formula(found, beta):
    """Eq. (8) along e1 = -y, of a plate that moves along y at 0.008 of 0.01005 m/s; e2 = x has no part in it."""
    force, drawn = found["forces"][str(beta)]
    u = 0.008 / math.hypot(0.006, 0.008, 0.001)
    a2, a3 = 3.62263982880971, 1.60910808139526
    f1 = (math.tanh(a2 * u - a3) + math.tanh(a3)) / (math.tanh(a2 - a3) + math.tanh(a3))
    alpha_y = MEDIA["generic"].alpha_x_flat * (1.0 - 0.5 * math.sin(math.radians(beta)) ** 2)
    assert force[1] == pytest.approx(-0.33 * 1e6 * f1 * alpha_y * 0.02 * 4e-4, rel=1e-9)
    assert drawn == pytest.approx(force, rel=1e-9)


def test_the_command_line_and_the_nodes_parameter_take_its_name(found):
    assert found["status"] == 0
    assert "fading" in found["names"]["alpha_y.model"]
