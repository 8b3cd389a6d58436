"""``make fuzz``: damaged input files for `rft predict` and `rft replay`; each must be used or refused with a sentence.

Accepted outcomes: status 0 with finite numbers, 2 with one sentence on stderr, 1 of a replay without estimates. Any
other is a finding, kept with its input in ``out/fuzz``. The same seed gives the same inputs in the same order.
"""

import argparse
import contextlib
import faulthandler
import io
import math
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from recordings import StoragePlugin, moments, write_ros1, write_ros2

from rft_ros.cli import main

SPECIAL = (
    *("nan", "inf", "-inf", "-0", "0", "1e309", "-1e308", "5e-324", "1e-310", "1e200", "-1e30", "1", "", " ", "abc"),
    *("1,2", "1_0", "0x10", "1e", "--1", "٣", "\ufeff1", "\x00", "1;2", '"1"', "1.0.0", "True", "9" * 400, "\n", "\r"),
)
HEADER = "t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz"
MOST_SECONDS = 300
"""Limit for one input, also on a busy machine."""

ADDRESS_SPACE = 6 * 2**30
"""A damaged length must not make the machine swap [bytes]."""

Random = np.random.Generator
Case = tuple[str, list[str], Path]  # kind of input, arguments of `rft`, the damaged file or folder
Finding = tuple[str, int, str]  # kind of input, its number, traceback or reason


def damaged(data: bytes, random: Random) -> bytes:
    """Apply one to four damages: flip a bit; set, remove, repeat, reverse or insert bytes, also to the end."""
    out = bytearray(data)
    for _ in range(random.integers(1, 5)):
        if not out:
            break
        a = int(random.integers(len(out)))
        b = min(len(out), a + int(random.choice([1, 2, 4, 8, 50, 400, len(out)])))
        part, byte = out[a:b], int(random.choice([0, 1, 127, 128, 255]))
        flipped = bytes([part[0] ^ 1 << int(random.integers(8))]) + part[1:]
        ways = [flipped, bytes([byte]) * (b - a), b"", part * 2, part[::-1], random.bytes(b - a) + part]
        out[a:b] = ways[random.integers(len(ways))]
    return bytes(out)


def damaged_table(text: str, random: Random) -> bytes:
    """Set one to three cells, or lines, to special values, change line ends; sometimes damage bytes as well."""
    for _ in range(random.integers(1, 4)):
        cells = re.split(r"(\n)" if random.random() < 0.3 else r"([,\n])", text)
        cells[2 * int(random.integers(len(cells) // 2 + 1))] = str(random.choice(SPECIAL))
        text = "".join(cells)
    data = text.replace("\n", str(random.choice(["\n", "\r\n", "\r", "\n\n"]))).encode()
    return damaged(data, random) if random.random() < 0.2 else data


def strange(random: Random) -> list[tuple[object, ...]]:
    """Moments of a recording with strange numbers and stamps."""
    numbers = (math.nan, math.inf, -math.inf, 0.0, -0.0, 5e-324, 1e-310, 1e200, -1e308, 1e30, 1.0, -1.0)
    told = []
    for role, time_, stamp, values in moments(30):
        if random.random() < 0.2:
            values = tuple(float(random.choice(numbers)) if random.random() < 0.3 else v for v in values)
        if random.random() < 0.1:
            stamp = int(random.choice([0, 1, stamp - 5 * 10**9, stamp + 10**9, 2**31 * 10**9 - 1, stamp // 2]))
        told.append((role, time_, stamp, values))
    return told


def cases(folder: Path) -> list[Callable[[Random], Case]]:
    """Write good inputs to a folder; functions that damage a copy of one, each for another kind of input."""
    ball = trimesh.creation.icosphere(1, radius=20.0)
    meshes = {}
    for kind in ("stl", "stl_ascii", "obj", "ply", "glb", "dae"):
        data = ball.export(file_type=kind)
        meshes[kind] = data.encode() if isinstance(data, str) else bytes(data)
    mesh, states, params = folder / "ball.stl", folder / "states.csv", folder / "params.yaml"
    mesh.write_bytes(meshes["stl"])
    random = np.random.default_rng(0)
    rows = [[0.1 * k, 0, 0, -0.01, 0, 0, 0, 1, *random.normal(0.0, 0.02, 6).round(4)] for k in range(6)]
    table = "\n".join([HEADER, *(",".join(map(str, row)) for row in rows)])
    states.write_text(table)
    alpha_y = "beta,gamma,alpha_y\n0,0,0.1\n0,90,0.2\n90,0,0.1\n90,90,0.3"
    params.write_text(f"rft:\n  ros__parameters:\n    mesh: {{file: {mesh}}}\n    tolerance: 0.0\n")
    main(["reduce", str(mesh), "--tolerance", "0.3", "-o", str(folder / "ball.npz")])
    meshes["npz"] = (folder / "ball.npz").read_bytes()
    for plugin in (StoragePlugin.MCAP, StoragePlugin.SQLITE3):
        write_ros2(folder / plugin.name, moments(40), plugin=plugin)
    write_ros1(folder / "ROS1.bag", moments(40))

    def predict(states: Path, mesh: Path, *options: str) -> list[str]:
        return ["predict", str(states), "--mesh", str(mesh), *options, "-o", str(folder / "out.csv")]

    def replay(bag: Path, params: Path = params) -> list[str]:
        out = folder / "replayed"
        shutil.rmtree(out, ignore_errors=True)
        return ["replay", str(bag), "-o", str(out), "--params", str(params), "--no-report"]

    def bad(name: str, data: bytes) -> Path:
        file = folder / name
        file.write_bytes(data)
        return file

    def bad_states(random: Random) -> Case:
        file = bad("bad.csv", damaged_table(table, random))
        choices = ["--integration", "refined"], ["--mobilization-length", "0.002"], ["--alpha-y", "linear"], []
        return "states", predict(file, mesh, *choices[random.integers(len(choices))]), file

    def bad_mesh(random: Random) -> Case:
        kind = str(random.choice(list(meshes)))
        file = bad(f"bad.{kind.partition('_')[0]}", damaged(meshes[kind], random))
        return f"mesh {kind}", predict(states, file), file

    def bad_alpha_y(random: Random) -> Case:
        file = bad("bad_alpha_y.csv", damaged_table(alpha_y, random))
        return "α_y table", predict(states, mesh, "--alpha-y", str(file)), file

    def bad_bag(random: Random) -> Case:
        """A bag of strange numbers, or a file of a good bag damaged, or its metadata."""
        name = str(random.choice(["strange", "MCAP", "SQLITE3", "ROS1.bag"]))
        good, copy = folder / name, folder / f"bad_{name}"
        shutil.rmtree(copy, ignore_errors=True)
        if name == "strange":
            write_ros2(copy, strange(random))
        elif good.is_file():
            bad(copy.name, damaged(good.read_bytes(), random))
        else:
            shutil.copytree(good, copy)
            file = sorted(copy.iterdir())[random.integers(2)]
            file.write_bytes(damaged(file.read_bytes(), random))
        return f"bag {name}", replay(copy), copy

    def bad_parameters(random: Random) -> Case:
        file = bad("bad.yaml", damaged(params.read_bytes(), random))
        return "parameters", replay(folder / "MCAP", file), file

    return [bad_states, bad_mesh, bad_alpha_y, bad_bag, bad_parameters]


def wrong_with(arguments: list[str], folder: Path) -> tuple[str, str]:
    """The outcome of a call of `rft`, and what is wrong with it, if anything."""
    said = io.StringIO()
    signal.alarm(MOST_SECONDS)
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
            status = main(arguments)
    except SystemExit as error:
        status = int(error.code or 0)
    except BaseException:
        return "traceback", traceback.format_exc()
    finally:
        signal.alarm(0)
    # warnings about the mesh come before the error
    text = "\n".join(line for line in said.getvalue().splitlines() if not line.startswith("warning: "))
    wrong = ""
    if "Traceback" in text or status not in (0, 1, 2) or (status == 1 and "has no estimate" not in text):
        wrong = text or "no sentence"
    elif status and (not text.startswith("rft ") or len(text.splitlines()) != 1):
        wrong = f"not one sentence: {text!r}"
    elif status == 0 and arguments[0] == "predict":
        table = np.loadtxt(folder / "out.csv", delimiter=",", skiprows=1, ndmin=2)
        wrong = "" if np.isfinite(table).all() else "numbers in the output are not finite"
    return f"status {status}", wrong


def _too_long(*_: object) -> None:
    raise TimeoutError(f"took more than {MOST_SECONDS} s")


def fuzz(
    *, seed: int, count: int | None = None, seconds: float = math.inf, keep: Path | None = None
) -> tuple[Counter[str], list[Finding]]:
    """Try damaged inputs one after the other: `count` of them, or for so many seconds; outcomes and findings."""
    random, outcomes, findings, number = np.random.default_rng(seed), Counter[str](), list[Finding](), 0
    before = signal.signal(signal.SIGALRM, _too_long)
    try:
        with tempfile.TemporaryDirectory() as name, np.errstate(all="ignore"):
            inputs, ends = cases(Path(name)), time.monotonic() + seconds
            while number != count and time.monotonic() < ends:
                kind, arguments, bad = inputs[random.integers(len(inputs))](random)
                outcome, wrong = wrong_with(arguments, Path(name))
                outcomes[f"{kind.split()[0]}: {outcome}"] += 1
                if wrong:
                    findings.append((kind, number, wrong))
                    print(f"input {number}, {kind}: {wrong.strip()[-1500:]}")
                if wrong and keep:
                    (shutil.copytree if bad.is_dir() else shutil.copy)(bad, keep / f"{number:05d}_{bad.name}")
                number += 1
    finally:
        signal.signal(signal.SIGALRM, before)
    return outcomes, findings


if __name__ == "__main__":
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--seconds", type=float, default=300.0)
    options.add_argument("--seed", type=int, default=0)
    given = options.parse_args()
    faulthandler.enable()
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, ADDRESS_SPACE))
    kept = Path("out/fuzz")
    shutil.rmtree(kept, ignore_errors=True)
    kept.mkdir(parents=True)
    outcomes, findings = fuzz(seconds=given.seconds, seed=given.seed, keep=kept)
    for outcome, count in sorted(outcomes.items()):
        print(f"{count:6d}  {outcome}")
    sys.exit(1 if findings else 0)
