"""A folder in which the blocks of a page can run: the project, and the reader's own tool, cell and recordings."""

import csv
import shutil
import sysconfig
from pathlib import Path

import numpy as np
from page_blocks import README, ROOT, blocks
from recordings import POSE, WRENCH, write_ros2
from synthetic_track import LOAD_CELL, grain_wrenches, law, read_by
from synthetic_track import Path as Way

from rft_ros.estimator import LoadCell

SURFACE = 0.12
"""Height of the grains in `my_cell.yaml` [m]."""

_TOPICS = {"pose": ("/tcp_pose_broadcaster/pose", POSE), "wrench": ("/force_torque_sensor_broadcaster/wrench", WRENCH)}
_FRAMES = {"pose": "base", "wrench": "tool0_controller"}
_START = 1_700_000_000_000_000_000
_CELL = LoadCell(bias=LOAD_CELL.bias)


def prepared(folder: Path, *, more_cell: str = "", scripts: str = sysconfig.get_path("scripts")) -> Path:
    """A copy of the project below `folder`, with what the pages assume: the reader's files, named as on the pages.

    The package itself is not copied, so that what runs is the installed one, which numba has compiled before.
    `make` finds its environment ready: that of `scripts`. `my_cell.yaml` is the README's block, its ``/path/to`` this
    folder, and `more_cell` what a page adds to it.
    """
    project = folder / "project"
    for name in ("bench", "config", "docs", "meshes"):
        shutil.copytree(ROOT / name, project / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("Makefile", "setup.py", "package.xml"):
        shutil.copy(ROOT / name, project)
    reference = ROOT.parent / "shared" / "data"
    if reference.is_dir():
        (folder / "shared").mkdir()
        (folder / "shared" / "data").symlink_to(reference.resolve())
    (project / ".venv").mkdir()
    (project / ".venv" / "bin").symlink_to(scripts)
    for stamp in (".demo", ".installed"):
        (project / ".venv" / stamp).touch()
    study = project / "config" / "sweep_example.yaml"  # a tenth of its variants, of shorter motions
    study.write_text(study.read_text().replace("count: 50", "count: 5").replace("samples: 200", "samples: 50"))
    shutil.copy(project / "meshes" / "abb_plate.stl", project / "my_tool.stl")
    cell = next(b.text for b in blocks(README) if b.language == "yaml" and "my_tool.stl" in b.text)
    (project / "my_cell.yaml").write_text(cell.replace("/path/to", str(project)) + more_cell, encoding="utf-8")
    (project / "limits.yaml").write_text("estimates: {min: 100}\n", encoding="utf-8")
    _states(project / "states.csv")
    for k, name in enumerate(("my_bag", "monday", "tuesday", "friday")):
        _recording(project / name, seed=k)
    (project / "friday" / "friday.mcap").rename(project / "friday.mcap")
    shutil.rmtree(project / "friday")
    return project


def _plunge() -> tuple[np.ndarray, np.ndarray]:
    """Still in the air for 2.5 s, 45 mm into the grains and out again, the tool level."""
    way = Way((0.1, 0.2, SURFACE + 0.02)).wait(2.5)
    return way.move((0.0, 0.0, -0.065), 0.02).wait(1.5).move((0.0, 0.0, 0.065), 0.02).states()


def _states(file: Path) -> None:
    time, states = _plunge()
    with file.open("w", newline="") as out:
        rows = csv.writer(out)
        rows.writerow(["t", "px", "py", "pz", "qx", "qy", "qz", "qw", "vx", "vy", "vz", "wx", "wy", "wz"])
        rows.writerows(np.column_stack([time, states]).tolist())


def _recording(folder: Path, *, seed: int) -> None:
    """What a cell like that of `my_cell.yaml` records of the plunge, in grains of ζ = 0.9 with a memory of 3 mm."""
    time, states = _plunge()
    grains = grain_wrenches(time, states, law(0.9), surface=SURFACE, length=0.003)
    readings = read_by(_CELL, states, grains, np.random.default_rng(seed), noise=(0.05, 0.002))
    rows = []
    for t, state, reading in zip(time, states, readings, strict=True):
        stamp = _START + round(1e9 * t)
        rows += [("wrench", stamp, stamp, reading), ("pose", stamp, stamp, state[:7])]
    write_ros2(folder, rows, topics=_TOPICS, frames=_FRAMES)
