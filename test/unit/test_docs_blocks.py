"""Code blocks of the README and docs/ work; a block that cannot run here says why, and where it is tested."""

import os
import re
import shlex
import shutil
import subprocess
import sysconfig
import textwrap
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import yaml
from distribution import ROOT, own_domain, without_ros
from recordings import POSE, WRENCH, write_run
from synthetic_track import LOAD_CELL, TOOL_FILE, grain_wrenches, law, read_by
from synthetic_track import Path as Way
from test_cli import rft

from rft_ros.bags.options import read_replay_options
from rft_ros.bags.summary import read_limits
from rft_ros.parameters import LoadCell, read_parameter_file
from rft_ros.sweeps.design import read_design

pytestmark = pytest.mark.repository

README = ROOT / "README.md"
PAGES = sorted((ROOT / "docs").glob("*.md"))

RUN = ("sh", "python", "yaml")
SHOWN = ("", "text", "math")

_BLOCK = re.compile(
    r"^(?P<indent> *)```(?P<language>[^\n`]*)\n(?P<text>.*?)^(?P=indent)```$",
    flags=re.DOTALL | re.MULTILINE,
)
_MARK = re.compile(r"<!-- not run: (.*?) -->\s*$")
_REFERENCE = "../shared/data"
_SURFACE = 0.12
"""Height of the grains in `my_cell.yaml` [m]."""

_TOPICS = {
    "pose": ("/tcp_pose_broadcaster/pose", POSE),
    "wrench": ("/force_torque_sensor_broadcaster/wrench", WRENCH),
}
_FRAMES = {"pose": "base", "wrench": "tool0_controller"}


class Block(NamedTuple):
    """A fenced block: `where` is FILE:LINE; `mark` the reason why it is not run, if there is one."""

    where: str
    language: str
    text: str
    mark: str | None


def blocks(page: Path) -> list[Block]:
    """All fenced blocks of a page, in its order."""
    text, found = page.read_text(encoding="utf-8"), []
    for match in _BLOCK.finditer(text):
        before = text[: match.start()].rstrip("\n")
        mark = _MARK.search(before.rsplit("\n", 1)[-1])
        where = f"{page.name}:{text.count(chr(10), 0, match.start()) + 1}"
        language, content = match["language"].strip(), textwrap.dedent(match["text"])
        found.append(Block(where, language, content, mark[1] if mark else None))
    return found


def try_page(page: Path, folder: Path) -> int:
    """Run a page's blocks one after the other in a prepared folder; how many. AssertionError names the block."""
    namespace: dict[str, object] = {}
    count = 0
    for block in blocks(page):
        if block.language not in RUN or block.mark is not None:
            continue
        if _REFERENCE in block.text and not (folder / _REFERENCE).is_dir():
            continue
        if block.language == "sh":
            _sh(block, folder)
        elif block.language == "python":
            _python(block, folder, namespace)
        else:
            _yaml(block, folder)
        count += 1
    return count


def _sh(block: Block, folder: Path) -> None:
    """In bash; where every line is a plain `rft` command, in this process, which spares each 2 s of imports."""
    lines = block.text.replace("\\\n", " ").splitlines()
    if all(re.fullmatch(r"rft (?!demo)[^#|&;<>{}$`(]*(#.*)?", line) for line in lines):
        ended = (rft(*shlex.split(line, comments=True)[1:], cwd=folder) for line in lines)
    else:
        path = f"{folder / '.venv' / 'bin'}{os.pathsep}{os.environ['PATH']}"
        environment = without_ros() | own_domain() | {"PATH": path}
        command = ["bash", "-e", "-o", "pipefail", "-c", block.text]
        ended = [
            subprocess.run(
                command, cwd=folder, env=environment, capture_output=True, text=True, timeout=600
            )
        ]
    for done in ended:
        assert done.returncode == 0, (
            f"{block.where}: exit status {done.returncode}\n{done.stdout}\n{done.stderr}"
        )


def _python(block: Block, folder: Path, namespace: dict[str, object]) -> None:
    with pytest.MonkeyPatch.context() as process:
        process.syspath_prepend(folder)
        process.chdir(folder)
        exec(compile(block.text, block.where, "exec"), namespace)


def _yaml(block: Block, folder: Path) -> None:
    """By the reader of what the block is: parameters, options of a replay, a sweep, else limits."""
    file = folder / "block.yaml"
    file.write_text(block.text, encoding="utf-8")
    tree = yaml.safe_load(block.text)
    if "rft_replay" in tree:
        assert read_replay_options(file).remap, block.where
    elif any(isinstance(value, dict) and "ros__parameters" in value for value in tree.values()):
        assert read_parameter_file(file).values, block.where
    elif "motions" in tree:
        assert read_design(file).variants, block.where
    else:
        assert read_limits(file), block.where


def prepared(folder: Path, *, scripts: str = sysconfig.get_path("scripts")) -> Path:
    """A copy of the project below `folder`, with what the pages assume: the reader's files, named as on the pages.

    The package itself is not copied, so that what runs is the installed one, which numba has compiled before.
    `make` finds its environment ready: that of `scripts`. `my_cell.yaml` is the README's block, its ``/path/to`` this
    folder.
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
    # a tenth of its variants, of shorter motions
    study = project / "config" / "sweep_example.yaml"
    study.write_text(
        study.read_text().replace("count: 50", "count: 5").replace("samples: 200", "samples: 50")
    )
    shutil.copy(TOOL_FILE, project / "my_tool.stl")
    cell = next(b.text for b in blocks(README) if b.language == "yaml" and "my_tool.stl" in b.text)
    (project / "my_cell.yaml").write_text(cell.replace("/path/to", str(project)), encoding="utf-8")
    (project / "limits.yaml").write_text("estimates: {min: 100}\n", encoding="utf-8")
    # still in the air for 2.5 s, 45 mm into the grains and out again, the tool level
    way = Way((0.1, 0.2, _SURFACE + 0.02)).wait(2.5).move((0.0, 0.0, -0.065), 0.02).wait(1.5)
    time, states = way.move((0.0, 0.0, 0.065), 0.02).states()
    header = "t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz"
    np.savetxt(
        project / "states.csv",
        np.column_stack([time, states]),
        delimiter=",",
        header=header,
        comments="",
    )
    for k, name in enumerate(("my_bag", "monday", "tuesday", "friday")):
        _recording(project / name, time, states, seed=k)
    (project / "friday" / "friday.mcap").rename(project / "friday.mcap")
    shutil.rmtree(project / "friday")
    return project


def _recording(folder: Path, time: np.ndarray, states: np.ndarray, *, seed: int) -> None:
    """What a cell like that of `my_cell.yaml` records, in grains of ζ = 0.9 with a memory of 3 mm."""
    grains = grain_wrenches(time, states, law(0.9), surface=_SURFACE, length=0.003)
    cell = LoadCell(bias=LOAD_CELL.bias)
    readings = read_by(cell, states, grains, np.random.default_rng(seed), noise=(0.05, 0.002))
    write_run(folder, time, states, readings, topics=_TOPICS, frames=_FRAMES)


WITH_CODE = [
    page for page in PAGES if any(b.language in RUN and b.mark is None for b in blocks(page))
]
ALL = [README, *PAGES]


@pytest.fixture(scope="module")
def project(tmp_path_factory):
    """One folder for all pages."""
    return prepared(tmp_path_factory.mktemp("docs"))


@pytest.mark.parametrize("page", WITH_CODE, ids=lambda page: page.name)
def test_the_blocks_of_a_page_work(page, project):
    assert try_page(page, project) > 0


def test_the_blocks_of_the_readme_work_in_its_order_where_nothing_but_the_wheel_was_installed(
    installed, tmp_path
):
    pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'rft_ros[ros]'")
    project = prepared(tmp_path, scripts=str(installed / "bin"))
    assert try_page(README, project) > 0
    assert (project / "out" / "demo" / "replay" / "report.html").is_file()


def test_a_block_is_run_or_says_where_it_is_tested():
    for block in (block for page in ALL for block in blocks(page)):
        assert block.language in (*RUN, *SHOWN), block.where
        named = re.findall(r" in (\S+)$", block.mark or "")
        assert all((ROOT / name).is_file() for name in named), block.where
