"""``make fuzz``: damaged input files for `rft predict` and `rft replay`; each must be used or refused with a sentence.

Accepted outcomes: status 0 with finite numbers, 2 with one sentence on stderr, 1 of a replay without estimates. Any
other is a finding, kept with its input in ``out/fuzz``. The same seed gives the same inputs in the same order.
"""

import argparse
import contextlib
import faulthandler
import io
import math
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import trimesh

sys.path.insert(0, str(Path(__file__).parent / "unit"))

from recordings import StoragePlugin, moments, write_ros1, write_ros2

from rft_ros.cli import main

SPECIAL = (
    *("nan", "inf", "-inf", "-0", "0", "1e309", "-1e308", "5e-324", "1e-310", "1e200", "-1e30", "1", "", " ", "abc"),
    *("1,2", "1_0", "0x10", "1e", "--1", "٣", "\ufeff1", "\x00", "1;2", '"1"', "1.0.0", "True", "9" * 400),
)
HEADER = "t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz"
MOST_SECONDS = 300
"""Limit for one input, also on a busy machine."""

ADDRESS_SPACE = 6 * 2**30
"""A damaged length must not make the machine swap [bytes]."""

Random = np.random.Generator


@dataclass(slots=True)
class Tally:
    """Outcomes of the inputs, and the findings: kind of input, its number, traceback or reason."""

    outcomes: Counter[str] = field(default_factory=Counter)
    findings: list[tuple[str, int, str]] = field(default_factory=list)


def damaged(data: bytes, random: Random) -> bytes:
    """Apply one to four damages: flip bits; set, remove, repeat, insert or reverse bytes; cut the end off."""
    out = bytearray(data)
    for _ in range(random.integers(1, 5)):
        if not out:
            return bytes(out)
        a = int(random.integers(len(out)))
        b = min(len(out), a + int(random.choice([1, 2, 4, 8, 50, 400])))
        kind = random.integers(7)
        if kind == 0:
            out[a] ^= 1 << int(random.integers(8))
        elif kind == 1:
            out[a:b] = bytes([int(random.choice([0, 1, 127, 128, 255]))]) * (b - a)
        elif kind == 2:
            del out[a:b]
        elif kind == 3:
            out[a:a] = out[a:b]
        elif kind == 4:
            out[a:a] = random.bytes(b - a)
        elif kind == 5:
            out[a:b] = out[a:b][::-1]
        else:
            del out[a:]
    return bytes(out)


def damaged_table(text: str, random: Random) -> bytes:
    """Set cells to special values, move lines and columns, change line ends; sometimes damage bytes as well."""
    rows = [line.split(",") for line in text.splitlines()]
    for _ in range(random.integers(1, 4)):
        row = int(random.integers(len(rows)))
        kind = random.integers(7)
        if kind <= 2 and rows[row]:
            rows[row][int(random.integers(len(rows[row])))] = str(random.choice(SPECIAL))
        elif kind == 3:
            rows[row] = rows[row][: int(random.integers(len(rows[row]) + 1))]
        elif kind == 4:
            rows.insert(row, list(rows[int(random.integers(len(rows)))]))
        elif kind == 5:
            order = random.permutation(max(map(len, rows)))
            rows = [[r[k] for k in order if k < len(r)] for r in rows]
        else:
            rows[row] = [str(random.choice(SPECIAL)) for _ in rows[row]]
    data = str(random.choice(["\n", "\r\n", "\r", "\n\n"])).join(",".join(r) for r in rows).encode()
    return damaged(data, random) if random.random() < 0.2 else data


class Inputs:
    """Good inputs in a folder, and the calls of `rft` with damaged copies of them."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        mesh = trimesh.creation.icosphere(1, radius=20.0)
        self.meshes = {kind: _exported(mesh, kind) for kind in ("stl", "stl_ascii", "obj", "ply", "glb", "dae")}
        self.mesh, self.states, self.params = folder / "ball.stl", folder / "states.csv", folder / "params.yaml"
        self.mesh.write_bytes(self.meshes["stl"])
        random = np.random.default_rng(0)
        rows = [[0.1 * k, 0, 0, -0.01, 0, 0, 0, 1, *random.normal(0.0, 0.02, 6).round(4)] for k in range(6)]
        self.table = "\n".join([HEADER, *(",".join(map(str, row)) for row in rows)])
        self.states.write_text(self.table)
        self.alpha_y = "beta,gamma,alpha_y\n0,0,0.1\n0,90,0.2\n90,0,0.1\n90,90,0.3"
        self.params.write_text(f"rft:\n  ros__parameters:\n    mesh: {{file: {self.mesh}}}\n    tolerance: 0.0\n")
        main(["reduce", str(self.mesh), "--plates", "20", "-o", str(folder / "ball.npz")])
        self.meshes["npz"] = (folder / "ball.npz").read_bytes()
        for plugin in (StoragePlugin.MCAP, StoragePlugin.SQLITE3):
            write_ros2(folder / plugin.name, moments(40), plugin=plugin)
        write_ros1(folder / "ROS1.bag", moments(40))

    def call(self, random: Random) -> tuple[str, list[str], Path]:
        """Kind, arguments, and the damaged file or folder of the next input."""
        kinds: list[Callable[[Random], tuple[str, list[str], Path]]] = [self._states, self._mesh, self._table]
        kinds += [self._bag, self._strange_bag, self._parameters]
        return kinds[int(random.integers(len(kinds)))](random)

    def _predict(self, states: Path, mesh: Path, random: Random, *more: str) -> list[str]:
        choices = (["--integration", "refined"], ["--mobilization-length", "0.002"], ["--alpha-y", "linear"], [])
        extra = list(choices[int(random.integers(len(choices)))]) if not more else list(more)
        return ["predict", str(states), "--mesh", str(mesh), *extra, "-o", str(self.folder / "out.csv")]

    def _states(self, random: Random) -> tuple[str, list[str], Path]:
        bad = self.folder / "bad.csv"
        bad.write_bytes(damaged_table(self.table, random))
        return "states", self._predict(bad, self.mesh, random), bad

    def _mesh(self, random: Random) -> tuple[str, list[str], Path]:
        kind = str(random.choice(list(self.meshes)))
        bad = self.folder / f"bad.{kind.partition('_')[0]}"
        bad.write_bytes(damaged(self.meshes[kind], random))
        return f"mesh {kind}", self._predict(self.states, bad, random), bad

    def _table(self, random: Random) -> tuple[str, list[str], Path]:
        bad = self.folder / "bad_alpha_y.csv"
        bad.write_bytes(damaged_table(self.alpha_y, random))
        return "α_y table", self._predict(self.states, self.mesh, random, "--alpha-y", str(bad)), bad

    def _bag(self, random: Random) -> tuple[str, list[str], Path]:
        """A file of a good bag damaged, or its metadata."""
        name = str(random.choice(["MCAP", "SQLITE3", "ROS1.bag"]))
        good, bad = self.folder / name, self.folder / f"bad_{name}"
        if good.is_file():
            bad.write_bytes(damaged(good.read_bytes(), random))
            return f"bag {name}", self._replay(bad), bad
        shutil.rmtree(bad, ignore_errors=True)
        shutil.copytree(good, bad)
        file = sorted(bad.iterdir())[int(random.integers(2))]
        file.write_bytes(damaged(file.read_bytes(), random))
        return f"bag {name} {file.suffix}", self._replay(bad), bad

    def _strange_bag(self, random: Random) -> tuple[str, list[str], Path]:
        """A sound bag of strange numbers and stamps."""
        numbers = (math.nan, math.inf, -math.inf, 0.0, -0.0, 5e-324, 1e-310, 1e200, -1e308, 1e30, 1.0, -1.0)
        rows = []
        for role, time_, stamp, values in moments(30):
            if random.random() < 0.2:
                values = tuple(float(random.choice(numbers)) if random.random() < 0.3 else v for v in values)
            if random.random() < 0.1:
                stamp = int(random.choice([0, 1, stamp - 5 * 10**9, stamp + 10**9, 2**31 * 10**9 - 1, stamp // 2]))
            rows.append((role, time_, stamp, values))
        bad = self.folder / "strange"
        shutil.rmtree(bad, ignore_errors=True)
        write_ros2(bad, rows)
        return "bag of strange numbers", self._replay(bad), bad

    def _parameters(self, random: Random) -> tuple[str, list[str], Path]:
        bad = self.folder / "bad.yaml"
        bad.write_bytes(damaged(self.params.read_bytes(), random))
        return "parameters", self._replay(self.folder / "MCAP", bad), bad

    def _replay(self, bag: Path, params: Path | None = None) -> list[str]:
        out = self.folder / "replayed"
        shutil.rmtree(out, ignore_errors=True)
        return ["replay", str(bag), "-o", str(out), "--params", str(params or self.params), "--no-report"]


def _exported(mesh: trimesh.Trimesh, kind: str) -> bytes:
    data = mesh.export(file_type=kind)
    return data.encode() if isinstance(data, str) else bytes(data)


def wrong_with(arguments: list[str], folder: Path) -> tuple[str, str]:
    """The outcome of a call of `rft`, and what is wrong with it, if anything."""
    said, told = io.StringIO(), io.StringIO()
    signal.alarm(MOST_SECONDS)
    try:
        with contextlib.redirect_stdout(told), contextlib.redirect_stderr(said):
            status = main(arguments)
    except SystemExit as error:
        status = int(error.code or 0)
    except BaseException:
        return "traceback", traceback.format_exc()
    finally:
        signal.alarm(0)
    # warnings about the mesh come before the error
    text = "\n".join(line for line in said.getvalue().splitlines() if not line.startswith("warning: "))
    if "Traceback" in text or status not in (0, 1, 2) or (status == 1 and "has no estimate" not in text):
        return f"status {status}", text
    if status and (not text.startswith("rft ") or len(text.splitlines()) != 1):
        return f"status {status}", f"not one sentence: {text!r}"
    if status == 0 and arguments[0] == "predict":
        table = np.loadtxt(folder / "out.csv", delimiter=",", skiprows=1, ndmin=2)
        if not np.isfinite(table).all():
            return "status 0", "numbers in the output are not finite"
    return f"status {status}", ""


def _too_long(*_: object) -> None:
    raise TimeoutError(f"took more than {MOST_SECONDS} s")


def fuzz(*, seed: int, count: int | None = None, seconds: float = math.inf, keep: Path | None = None) -> Tally:
    """Try damaged inputs one after the other: `count` of them, or for so many seconds."""
    random, tally = np.random.default_rng(seed), Tally()
    before = signal.signal(signal.SIGALRM, _too_long)
    try:
        with tempfile.TemporaryDirectory() as name, np.errstate(all="ignore"):
            inputs, number = Inputs(Path(name)), 0
            ends = time.monotonic() + seconds
            while number != count and time.monotonic() < ends:
                kind, arguments, bad = inputs.call(random)
                outcome, wrong = wrong_with(arguments, Path(name))
                tally.outcomes[f"{kind.split()[0]}: {outcome}"] += 1
                if wrong:
                    tally.findings.append((kind, number, wrong))
                    if keep:
                        _keep(keep / f"{number:05d}", bad, " ".join(arguments) + "\n" + wrong)
                number += 1
    finally:
        signal.signal(signal.SIGALRM, before)
    return tally


def _keep(folder: Path, bad: Path, text: str) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (shutil.copytree if bad.is_dir() else shutil.copy)(bad, folder / bad.name)
    (folder / "finding.txt").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seconds", type=float, default=300.0)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--keep", type=Path, default=Path("out/fuzz"))
    given = options.parse_args()
    faulthandler.enable()
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    result = fuzz(seconds=given.seconds, seed=given.seed, keep=given.keep)
    for outcome, count in sorted(result.outcomes.items()):
        print(f"{count:6d}  {outcome}")
    alike: dict[str, list[tuple[str, int, str]]] = {}
    for finding in result.findings:
        alike.setdefault(finding[2].strip().rpartition("\n")[2], []).append(finding)
    for found in alike.values():
        kind, number, wrong = found[0]
        print(f"\n--- {len(found)} times; first input {number}, {kind}\n{wrong.strip()[-1500:]}")
    sys.exit(1 if result.findings else 0)
