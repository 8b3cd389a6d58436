"""The code blocks of README.md and docs/: what is run, what is not and why, and how each is tried."""

import os
import re
import shlex
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import NamedTuple

import yaml
from distribution import ROOT, own_domain, without_ros
from test_cli import inside, rft

from rft_ros.bags.playback import read_replay_options
from rft_ros.bags.summary import read_limits
from rft_ros.parameters import read_parameter_file
from rft_ros.sweeps.design import read_design

README = ROOT / "README.md"
PAGES = sorted((ROOT / "docs").glob("*.md"))

RUN = ("sh", "python", "yaml")
SHOWN = ("", "text", "math")

_BLOCK = re.compile(
    r"^(?P<indent> *)```(?P<language>[^\n`]*)\n(?P<text>.*?)^(?P=indent)```$", flags=re.DOTALL | re.MULTILINE
)
_MARK = re.compile(r"<!-- not run: (.*?) -->\s*$")
_REFERENCE = "../shared/data"


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
    if not all(re.fullmatch(r"rft (?!demo)[^#|&;<>{}$`(]*(#.*)?", line) for line in lines):
        _bash(block, folder)
        return
    for line in lines:
        done = rft(*shlex.split(line, comments=True)[1:], cwd=folder)
        assert done.returncode == 0, f"{block.where}: exit status {done.returncode}\n{done.stdout}\n{done.stderr}"


def _bash(block: Block, folder: Path) -> None:
    path = f"{folder / '.venv' / 'bin'}{os.pathsep}{os.environ['PATH']}"
    environment = without_ros() | own_domain() | {"PATH": path}
    command = ["bash", "-e", "-o", "pipefail", "-c", block.text]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, f"{block.where}: exit status {done.returncode}\n{done.stdout}\n{done.stderr}"


def _python(block: Block, folder: Path, namespace: dict[str, object]) -> None:
    sys.path.insert(0, str(folder))
    try:
        with inside(folder):
            exec(compile(block.text, block.where, "exec"), namespace)
    finally:
        sys.path.remove(str(folder))


def _yaml(block: Block, folder: Path) -> None:
    """By the reader of what the block is: parameters, options of a replay, a sweep, else limits."""
    file = folder / "block.yaml"
    file.write_text(block.text, encoding="utf-8")
    tree = yaml.safe_load(block.text)
    if "rft_replay" in tree:
        assert read_replay_options(file).remap, block.where
    elif any(isinstance(value, dict) and "ros__parameters" in value for value in tree.values()):
        assert read_parameter_file(file), block.where
    elif "motions" in tree:
        assert read_design(file).variants, block.where
    else:
        assert read_limits(file), block.where
