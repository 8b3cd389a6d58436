"""docs/architecture.md says how to add an α_y model. Here its listing is put into a copy of the package, and used.

No cache has the copy's machine code: its first process compiles all of it, as at a first start.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
FIRST_START = """
from rft_ros.estimator.warm_up import prepare
prepare(frozenset({"forces", "around"}))
"""
# The plate moves along y at 0.008 of 0.01005 m/s: Eq. (8)
# along e1 = -y, in which e2 = x has no part.
SCRIPT = """
import math, sys
from pathlib import Path
import numpy as np
from rft_ros.cli import main
from rft_ros.parameters import PARAMETERS
from rft_ros.rft import MEDIA, Plates, alpha_y_model, checked_states, plate_forces, treers2021, wrenches

medium = MEDIA["generic"]
law = treers2021(medium, alpha_y_model("fading", medium), zeta=0.33)
state = checked_states([0, 0, -0.02, 0, 0, 0, 1, 0.006, 0.008, -0.001, 0, 0, 0])
f1 = lambda u: math.tanh(3.62263982880971 * u - 1.60910808139526) + math.tanh(1.60910808139526)
for beta in (math.pi / 4, math.pi / 2):
    across, along = np.array([0.0, 0.01, 0.0]), 0.01 * np.array([math.cos(beta), 0.0, math.sin(beta)])
    square = np.array([-across - along, across - along, across + along, along - across])
    plates = Plates.from_triangles(square[[[0, 1, 2], [0, 2, 3]]], [0.01, 0.01])
    force = wrenches(plates, law, state)[0, :3]
    weight = f1(0.008 / math.hypot(0.006, 0.008, 0.001)) / f1(1.0)
    expected = -0.33e6 * weight * medium.alpha_x_flat * (1.0 - 0.5 * math.sin(beta) ** 2) * 0.02 * 4e-4
    assert math.isclose(force[1], expected, rel_tol=1e-9), (force, expected)
    np.testing.assert_allclose(plate_forces(plates, law, state[0]).sum(axis=0), force, rtol=1e-9)
columns = "t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz"
Path("states.csv").write_text(columns + "\\n0,0,0,-0.05,0,0,0,1,0.01,0.01,0,0,0,0\\n")
assert main(["predict", "states.csv", "--mesh", sys.argv[1], "-o", "wrenches.csv", "--alpha-y", "fading"]) == 0
assert "fading" in {p.name: p.choices for p in PARAMETERS}["alpha_y.model"]
"""


def python(folder, *command):
    own = {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(folder / "cache")}
    done = subprocess.run(
        [sys.executable, "-c", *command],
        env={**os.environ, **own},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="session")
def copy(once):
    """A folder with the copy, compiled by a first start, and its cache."""
    return once("new_alpha_y", copied)


def copied(folder):
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "rft_ros", folder / "rft_ros", ignore=ignored)
    # a checkout, so that the shipped files are found
    for name in ("package.xml", "meshes", "config"):
        (folder / name).symlink_to(ROOT / name)
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    section = page.partition("## A new α_y model")[2].partition("\n## ")[0]
    (listing,) = re.findall(r"```python\n(.*?)```", section, flags=re.DOTALL)
    (line,) = re.findall(r'^`("fading".*)`$', section, flags=re.MULTILINE)
    assert len(listing.splitlines()) + 1 <= 20
    file = folder / "rft_ros" / "rft" / "alpha_y.py"
    above, marked, below = file.read_text(encoding="utf-8").partition("\n_MODELS: ")
    head, brace, entries = below.partition("{\n")
    assert marked and brace
    changed = f"{above}\n{listing}\n{marked}{head}{brace}    {line}\n{entries}"
    file.write_text(changed, encoding="utf-8")
    python(folder, FIRST_START)


def test_a_model_added_as_the_page_says_gives_its_force_in_command_and_node(copy):
    python(copy, SCRIPT, str(ROOT / "meshes" / "plate.stl"))


@pytest.mark.parametrize("part", ["_tractions", "_add_memory"])
def test_a_part_of_the_loop_that_one_child_compiles_for_the_other_is_the_part_that_the_loop_loads(
    copy, part
):
    """Other types would be a second file: then a first start compiles that part twice."""
    assert len(list((copy / "cache").rglob(f"*.{part}.*.nbc"))) == 1
