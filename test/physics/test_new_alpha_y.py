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
PLATE = """
import json, sys
import numpy as np
from rft_ros.rft import MEDIA, Plates, alpha_y_model, checked_states, plate_forces, treers2021, wrenches

beta = np.deg2rad(float(sys.argv[1]))
plates = Plates.from_arrays([[0, 0, 0]], [[np.sin(beta), 0, -np.cos(beta)]], [4e-4])
medium = MEDIA["generic"]
law = treers2021(medium, alpha_y_model("fading", medium), zeta=0.33)
state = checked_states([0, 0, -0.02, 0, 0, 0, 1, 0.006, 0.008, -0.001, 0, 0, 0])
print(json.dumps([wrenches(plates, law, state)[0, :3].tolist(), plate_forces(plates, law, state[0])[0].tolist()]))
"""


@pytest.fixture(scope="module")
def changed(tmp_path_factory):
    """Environment in which `rft_ros` is a copy with the page's listing and its one line."""
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
    return {**os.environ, "PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache")}


def run(changed, *arguments):
    folder = changed["PYTHONPATH"]
    return subprocess.run(
        [sys.executable, *arguments], env=changed, cwd=folder, capture_output=True, text=True, timeout=300
    )


@pytest.mark.parametrize("beta", [45.0, 90.0])
def test_a_plate_gets_the_force_of_the_new_formula(changed, beta):
    """Eq. (8) along e1 = -y, of a plate that moves along y at 0.008 of 0.01005 m/s; e2 = x has no part in it."""
    done = run(changed, "-c", PLATE, str(beta))
    assert done.returncode == 0, done.stderr
    force, drawn = json.loads(done.stdout)
    u = 0.008 / math.hypot(0.006, 0.008, 0.001)
    a2, a3 = 3.62263982880971, 1.60910808139526
    f1 = (math.tanh(a2 * u - a3) + math.tanh(a3)) / (math.tanh(a2 - a3) + math.tanh(a3))
    alpha_y = MEDIA["generic"].alpha_x_flat * (1.0 - 0.5 * math.sin(math.radians(beta)) ** 2)
    assert force[1] == pytest.approx(-0.33 * 1e6 * f1 * alpha_y * 0.02 * 4e-4, rel=1e-9)
    assert drawn == pytest.approx(force, rel=1e-9)


def test_the_command_line_and_the_nodes_parameter_take_its_name(changed):
    folder = Path(changed["PYTHONPATH"])
    columns = "t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz"
    (folder / "states.csv").write_text(f"{columns}\n0,0,0,-0.05,0,0,0,1,0.01,0.01,0,0,0,0\n")
    words = ["predict", "states.csv", "--mesh", str(ROOT / "meshes" / "plate.stl"), "-o", "wrenches.csv"]
    done = run(changed, "-m", "rft_ros.cli", *words, "--alpha-y", "fading")
    assert done.returncode == 0, done.stderr
    code = "from rft_ros.estimator.parameters import PARAMETERS\nprint({p.name: p.choices for p in PARAMETERS})"
    assert "'fading'" in run(changed, "-c", code).stdout
