"""``make fuzz``: hostile input files for the commands, and random estimators; each is used, or refused with a sentence.

Accepted outcomes of a command: status 0 with finite numbers, 2 with one sentence on stderr, 1 of a replay without
estimates or of a doctor or a calibration that found nothing. Any other is a finding, kept with its input in
``out/fuzz``. The same seed gives the same inputs in the same order.
"""

import argparse
import contextlib
import faulthandler
import io
import json
import math
import os
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

import fuzz_estimators
import numpy as np
import trimesh
from hostile_parameters import hostile_file
from recordings import (
    FRAMES,
    TOPICS,
    StoragePlugin,
    cdr,
    moments,
    write_messages,
    write_ros1,
    write_ros2,
)

from rft_ros.cli import main
from rft_ros.parameters import read_parameter_file

SPECIAL = (
    *(
        "nan",
        "inf",
        "-inf",
        "-0",
        "0",
        "1e309",
        "-1e308",
        "5e-324",
        "1e-310",
        "1e200",
        "-1e30",
        "1",
        "",
        " ",
        "abc",
    ),
    *(
        "1,2",
        "1_0",
        "0x10",
        "1e",
        "--1",
        "٣",
        "\ufeff1",
        "\x00",
        "1;2",
        '"1"',
        "1.0.0",
        "True",
        "9" * 400,
        "\n",
        "\r",
    ),
)
HEADER = "t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz"
MOST_LETTERS = 2000
"""Characters of a sentence that can still be read."""

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
        ways = [
            flipped,
            bytes([byte]) * (b - a),
            b"",
            part * 2,
            part[::-1],
            random.bytes(b - a) + part,
        ]
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


def strange(random: Random) -> list[tuple[int, str, str, bytes]]:
    """Messages of a recording with strange numbers, units, quaternions, stamps and frames: time, topic, type, bytes."""
    scale = 1e3 if random.random() < 0.1 else 1.0  # of a driver that gives millimetres
    found = []
    for role, time_, stamp, values in moments(30):
        values, frame = [scale * v for v in values[:3]] + list(values[3:]), FRAMES[role]
        if random.random() < 0.2:
            numbers = random.choice(fuzz_estimators.NUMBERS, size=len(values))
            values = [
                float(n) if random.random() < 0.3 else v
                for n, v in zip(numbers, values, strict=True)
            ]
        if random.random() < 0.1:
            factor = float(random.choice([0.0, 1e-320, 1.005, 1.02, -1.0, 1e3]))
            values = values[:3] + [factor * v for v in values[3:]]
        if random.random() < 0.1:
            stamp = int(
                random.choice(
                    [0, 1, stamp - 5 * 10**9, stamp + 10**9, 2**31 * 10**9 - 1, stamp // 2]
                )
            )
        if random.random() < 0.1:
            frame = str(random.choice(fuzz_estimators.NAMES))
        topic, kind = TOPICS[role]
        with np.errstate(all="ignore"):
            found.append((time_, topic, kind, cdr(role, stamp, values, frame)))
    return found


def spoiled(bag: Path, random: Random) -> None:
    """Cut a file of a bag, fill its end with zeros, or put what is no file into its place or beside it."""
    files = [file for file in sorted(bag.iterdir()) if file.is_file()] if bag.is_dir() else [bag]
    file = files[random.integers(len(files))]
    data, at = file.read_bytes(), int(random.integers(file.stat().st_size))
    kind = random.integers(6)
    if kind == 0:
        file.write_bytes(data[:at])
    elif kind == 1:
        file.write_bytes(data[:at] + bytes(len(data) - at))
    elif kind == 2:  # as of a computer that lost its power
        file.write_bytes(data[:at])
        os.truncate(file, 2**30)
    elif kind == 3:
        os.truncate(file, 2**31)
    else:
        place = (
            file
            if kind == 4 or not bag.is_dir()
            else bag / f"more{random.choice(['.mcap', '.db3', '.bag'])}"
        )
        place.unlink(missing_ok=True)
        deeds = (
            os.mkfifo,
            os.mkdir,
            lambda p: p.symlink_to(p),
            lambda p: p.symlink_to("/dev/zero"),
            Path.touch,
        )
        deeds[random.integers(len(deeds))](place)


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
    rows = [
        [0.1 * k, 0, 0, -0.01, 0, 0, 0, 1, *random.normal(0.0, 0.02, 6).round(4)] for k in range(6)
    ]
    table = "\n".join([HEADER, *(",".join(map(str, row)) for row in rows)])
    states.write_text(table)
    alpha_y = "beta,gamma,alpha_y\n0,0,0.1\n0,90,0.2\n90,0,0.1\n90,90,0.3"
    params.write_text(
        f"rft:\n  ros__parameters:\n    mesh: {{file: {mesh}}}\n    tolerance: 0.0\n"
    )
    for plugin in (StoragePlugin.MCAP, StoragePlugin.SQLITE3):
        write_ros2(folder / plugin.name, moments(40), plugin=plugin)
    write_ros1(folder / "ROS1.bag", moments(40))

    def predict(states: Path, mesh: Path, *options: str) -> list[str]:
        return [
            "predict",
            str(states),
            "--mesh",
            str(mesh),
            *options,
            "-o",
            str(folder / "out.csv"),
        ]

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
        choices = (
            ["--integration", "refined"],
            ["--mobilization-length", "0.002"],
            ["--alpha-y", "linear"],
            [],
        )
        return "states", predict(file, mesh, *choices[random.integers(len(choices))]), file

    def bad_mesh(random: Random) -> Case:
        kind = str(random.choice(list(meshes)))
        file = bad(f"bad.{kind.partition('_')[0]}", damaged(meshes[kind], random))
        return f"mesh {kind}", predict(states, file), file

    def bad_alpha_y(random: Random) -> Case:
        file = bad("bad_alpha_y.csv", damaged_table(alpha_y, random))
        return "α_y table", predict(states, mesh, "--alpha-y", str(file)), file

    def of_bag(bag: Path, random: Random) -> list[str]:
        """A command that reads a bag."""
        shutil.rmtree(folder / "replayed", ignore_errors=True)
        calibrated = [
            "calibrate",
            str(bag),
            "--params",
            str(params),
            "-o",
            str(folder / "calibrated.yaml"),
        ]
        viewed = ["view", str(bag), "--params", str(params), "-o", str(folder / "out.html")]
        doctor = ["doctor", str(params), "--bag", str(bag)]
        return [replay(bag), replay(bag), calibrated, viewed, doctor][random.integers(5)]

    def bad_bag(random: Random) -> Case:
        """A bag of strange messages, or a file of a good bag damaged, or its metadata."""
        kind = str(random.choice(["strange", "damaged", "spoiled"]))
        name = str(random.choice(["MCAP", "SQLITE3", "ROS1.bag"]))
        copy = folder / ("bad" if kind == "strange" else f"bad_{name}")
        if copy.is_symlink() or not copy.is_dir():
            copy.unlink(missing_ok=True)
        shutil.rmtree(copy, ignore_errors=True)
        if kind == "strange":
            write_messages(copy, strange(random))
        else:
            shutil.copytree(folder / name, copy) if (folder / name).is_dir() else shutil.copy(
                folder / name, copy
            )
            if kind == "spoiled":
                spoiled(copy, random)
            else:
                file = sorted(copy.iterdir())[random.integers(2)] if copy.is_dir() else copy
                file.write_bytes(damaged(file.read_bytes(), random))
        return f"bag {kind} {name}", of_bag(copy, random), copy

    def bad_parameters(random: Random) -> Case:
        """A parameter file that is damaged, or that YAML and ROS may read otherwise."""
        data = damaged(params.read_bytes(), random)
        if random.random() < 0.6:
            data = hostile_file(random, strange=float(random.choice([0.03, 0.5]))).encode(
                errors="replace"
            )
        file = bad("bad.yaml", data)
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
    # warnings about the mesh come before the error, and on a busy machine lines on what takes long
    text = "\n".join(
        line
        for line in said.getvalue().splitlines()
        if not line.startswith(("warning: ", "note: ")) and not line.endswith(" ...")
    )
    wrong = ""
    if (
        "Traceback" in text
        or status not in (0, 1, 2)
        or (status == 1 and not _says_why(arguments[0], text))
    ):
        wrong = text or "no sentence"
    elif status == 2 and (
        not text.startswith("rft ") or len(text.splitlines()) != 1 or len(text) > MOST_LETTERS
    ):
        wrong = f"not one sentence: {text!r}"
    elif status == 0 and text:
        wrong = f"on stderr, although all is well: {text!r}"
    elif status == 0:
        wrong = _wrong_output(arguments[0], folder)
    return f"status {status}", wrong


def _says_why(command: str, text: str) -> bool:
    """Whether a command may end with status 1 and this text on stderr."""
    return (
        "has no estimate" in text
        if command == "replay"
        else command in ("doctor", "calibrate")
        and all(line.startswith("refused: ") for line in text.splitlines())
    )


def _wrong_output(command: str, folder: Path) -> str:
    """What is wrong with what a command has written; empty if nothing is."""
    if command == "predict":
        table = np.loadtxt(folder / "out.csv", delimiter=",", skiprows=1, ndmin=2)
        return "" if np.isfinite(table).all() else "numbers in the output are not finite"
    if command == "replay":
        words = (
            (folder / "replayed" / "estimates.csv").read_text(encoding="utf-8").splitlines()[1:]
        )
        json.loads(
            (folder / "replayed" / "summary.json").read_text(encoding="utf-8"),
            parse_constant=_refuse,
        )
        return next((line for line in words if re.search(r"(^|,)-?(nan|inf)", line)), "")
    if command == "calibrate":
        read_parameter_file(folder / "calibrated.yaml")
    return ""


def _refuse(number: str) -> None:
    raise ValueError(f"{number} is no number of JSON")


def _too_long(*_: object) -> None:
    raise TimeoutError(f"took more than {MOST_SECONDS} s")


def fuzz(
    *, seed: int, count: int | None = None, seconds: float = math.inf, keep: Path | None = None
) -> tuple[Counter[str], list[Finding]]:
    """Try damaged inputs one after the other: `count` of them, or for so many seconds; outcomes and findings."""
    random, outcomes, findings, number = (
        np.random.default_rng(seed),
        Counter[str](),
        list[Finding](),
        0,
    )
    before = signal.signal(signal.SIGALRM, _too_long)
    try:
        with tempfile.TemporaryDirectory() as name:
            inputs, ends = cases(Path(name)), time.monotonic() + seconds
            while number != count and time.monotonic() < ends:
                kind, arguments, bad = inputs[random.integers(len(inputs))](random)
                outcome, wrong = wrong_with(arguments, Path(name))
                outcomes[f"{kind.split()[0]}: {outcome}"] += 1
                if wrong:
                    findings.append((kind, number, wrong))
                    print(f"input {number}, {kind}: {wrong.strip()[-1500:]}")
                if wrong and keep:
                    (shutil.copytree if bad.is_dir() else shutil.copy)(
                        bad, keep / f"{number:05d}_{bad.name}"
                    )
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
    outcomes, findings = fuzz(seconds=0.75 * given.seconds, seed=given.seed, keep=kept)
    more, wrong = fuzz_estimators.fuzz(seconds=0.25 * given.seconds, first=given.seed)
    for outcome, count in sorted((outcomes + more).items()):
        print(f"{count:6d}  {outcome}")
    sys.exit(1 if findings or wrong else 0)
