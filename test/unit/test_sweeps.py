"""Design studies: every variant has exactly one row, however the run ended."""

import csv
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from rft_ros.errors import InputError
from rft_ros.rft import MEDIA, alpha_y_model, treers2021, wrenches
from rft_ros.sweeps import design
from rft_ros.sweeps.design import read_design
from rft_ros.sweeps.motions import Circumnutation, sample
from rft_ros.sweeps.outcomes import evaluate, row_of
from rft_ros.sweeps.run import run
from rft_ros.tool import load_tool, locate_mesh

SMALL = """
tools:
  - mesh: root_tip
  - {mesh: plate, integration: refined}
motions:
  - {family: circumnutation, pitch: [0.04, 0.1], samples: 30}
  - {family: straight, travel: {from: 0.01, to: 0.03, count: 3}, samples: 20}
media:
  - {zeta: [0.2, 0.33], alpha_y: linear}
"""

LONG = """
tools:
  - mesh: root_tip
motions:
  - {family: circumnutation, pitch: {from: 0.02, to: 0.2, count: 60}, samples: 250}
media:
  - zeta: [0.2, 0.3, 0.4, 0.5]
"""


def test_a_parameter_file_is_refused_as_a_study(tmp_path):
    words = "'/\\*\\*' is not an entry of a study; use media, motions, sample, seed, tools"
    with pytest.raises(InputError, match=words):
        read_design(study(tmp_path, "/**: {ros__parameters: {}}"))


def study(tmp_path, text, name="study.yaml"):
    (tmp_path / name).write_text(text)
    return tmp_path / name


def table(file):
    with file.open(newline="") as lines:
        return list(csv.DictReader(lines))


def sweep(file, out, *options):
    return [sys.executable, "-m", "rft_ros.cli", "sweep", str(file), "-o", str(out), *options]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The table of LONG, computed here without interruption."""
    folder = tmp_path_factory.mktemp("whole")
    return run(read_design(study(folder, LONG)), folder / "out", workers=1).file.read_bytes()


@pytest.fixture(scope="module")
def computed(tmp_path_factory):
    """A folder with SMALL and its results."""
    folder = tmp_path_factory.mktemp("small")
    report = run(read_design(study(folder, SMALL)), folder / "out", workers=1)
    assert (report.rows, report.computed, report.failed) == (20, 20, 0)
    return folder


@pytest.fixture
def small(computed, tmp_path):
    """A copy of `computed`."""
    return shutil.copytree(computed, tmp_path / "small")


def children(pid):
    """The workers that a sweep has started."""
    started = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(c) for c in started if b"spawn_main" in Path(f"/proc/{c}/cmdline").read_bytes()]


def test_every_tool_meets_every_motion_and_medium_in_one_order(tmp_path):
    design = read_design(study(tmp_path, SMALL))
    variants = [design.variant(k) for k in range(len(design))]
    assert len(variants) == 2 * 5 * 2
    assert len({str(v) for v in variants}) == len(variants)
    assert variants[0]["motion"] == {"family": "circumnutation", "pitch": 0.04, "samples": 30}
    assert [v["motion"].get("travel") for v in variants[4:10:2]] == pytest.approx([0.01, 0.02, 0.03])


def test_a_row_holds_what_the_core_gives_for_its_variant(computed):
    row = table(computed / "out" / "results.csv")[3]
    assert (row["tool.mesh"], row["motion.pitch"], row["medium.zeta"]) == ("root_tip", "0.1", "0.33")
    generic = MEDIA["generic"]
    law = treers2021(generic, alpha_y_model("linear", generic), zeta=0.33)
    _, states = sample(Circumnutation(pitch=0.1), 30)
    expected = wrenches(load_tool("root_tip").plates, law, states)
    assert float(row["mean_fz"]) == pytest.approx(expected[:, 2].mean(), rel=1e-14)  # sums of another order
    assert float(row["peak_force"]) == np.linalg.norm(expected[:, :3], axis=1).max()


def test_a_variant_that_fails_is_a_row_with_its_reason(tmp_path):
    text = SMALL.replace("  - mesh: root_tip\n", "  - mesh: [root_tip, gone.stl]\n")
    report = run(read_design(study(tmp_path, text)), tmp_path / "out", workers=1)
    rows = table(report.file)
    assert report.failed == 10
    assert {row["tool.mesh"] for row in rows if row["reason"]} == {"gone.stl"}
    assert all("gone.stl" in row["reason"] and not row["mean_fz"] for row in rows if row["reason"])


def test_a_sample_is_drawn_by_its_seed(tmp_path):
    first, again, other = (
        read_design(study(tmp_path, SMALL + f"sample: 7\nseed: {seed}\n", f"{k}.yaml"))
        for k, seed in enumerate((1, 1, 2))
    )
    assert len(first) == 7
    assert first.picked == again.picked != other.picked


def test_a_killed_sweep_continues_without_losing_or_repeating_a_row(tmp_path, whole):
    file = study(tmp_path, LONG)
    command = sweep(file, tmp_path / "out", "--workers", "1")
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    until = time.monotonic() + 300.0
    while len(list((tmp_path / "out").glob("chunks/*.csv"))) < 2:
        assert time.monotonic() < until
        assert process.poll() is None
        time.sleep(0.01)
    workers = children(process.pid)
    assert workers
    process.kill()
    process.wait()
    until = time.monotonic() + 300.0
    while any(Path(f"/proc/{pid}").exists() for pid in workers):  # nobody else would end them
        assert time.monotonic() < until
        time.sleep(0.1)
    done = sum(len(f.read_text().splitlines()) for f in (tmp_path / "out" / "chunks").glob("*.csv"))
    assert 0 < done < 240
    report = run(read_design(file), tmp_path / "out", workers=1)
    assert (report.rows, report.computed) == (240, 240 - done)
    assert report.file.read_bytes() == whole


def test_a_killed_worker_loses_no_row(tmp_path):
    file = study(tmp_path, LONG)
    process = subprocess.Popen(sweep(file, tmp_path / "out", "--workers", "1"), stdout=subprocess.DEVNULL)
    until = time.monotonic() + 300.0
    while not list((tmp_path / "out").glob("chunks/*.csv")):
        assert time.monotonic() < until
        time.sleep(0.01)
    os.kill(children(process.pid)[0], signal.SIGKILL)
    assert process.wait(timeout=300) == 0
    rows = table(tmp_path / "out" / "results.csv")
    assert len(rows) == 240
    assert not any(row["reason"] for row in rows)


def test_the_rows_of_another_study_are_not_mixed_in(computed, tmp_path):
    with pytest.raises(InputError, match="a study other than"):
        run(read_design(study(tmp_path, SMALL.replace("0.33", "0.34"))), computed / "out", workers=1)


def test_another_mesh_states_file_or_version_makes_another_study(tmp_path, monkeypatch):
    mesh, states = tmp_path / "my.stl", tmp_path / "states.csv"
    file = study(tmp_path, f"tools: [{{mesh: {mesh}}}]\nmotions: [{{states_file: {states}}}]\nmedia: [{{zeta: 1}}]")
    prints = [read_design(file).fingerprint]
    for changed, content in ((mesh, "one"), (mesh, "two"), (states, "three")):
        changed.write_text(content)
        prints.append(read_design(file).fingerprint)
    monkeypatch.setattr(design, "release", lambda: "another")
    prints.append(read_design(file).fingerprint)
    assert len(set(prints)) == 5


def test_a_chunk_with_a_failed_row_is_computed_again(small):
    before = (small / "out" / "results.csv").read_bytes()
    chunk = small / "out" / "chunks" / "000001.csv"
    rows = chunk.read_text().splitlines()
    chunk.write_text("\n".join([*rows[:-1], rows[-1] + "out of memory"]) + "\n")
    report = run(read_design(small / "study.yaml"), small / "out", workers=1)
    assert (report.computed, report.failed) == (len(rows), 0)
    assert report.file.read_bytes() == before


@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning")
@pytest.mark.parametrize(
    ("part", "name", "value", "reason"),
    [
        ("medium", "mobilization_length", -0.003, "mobilization_length is -0.003; it must be finite and not negative"),
        ("medium", "mobilization_length", float("nan"), "mobilization_length is nan"),
        ("medium", "zeta", 1e300, "has no finite wrench"),
        ("motion", "travel", 1e300, "its forces, work or path are too large"),
        ("motion", "samples", float("inf"), "samples is inf; it must be from 2 to 1,000,000"),
        ("motion", "samples", 10**12, "samples is 1000000000000"),
        pytest.param("motion", "travel", 10**400, "too large", id="too large for a float"),
    ],
)
def test_a_value_that_cannot_be_computed_gives_a_reason(part, name, value, reason):
    variant = {"tool": {"mesh": "plate"}, "motion": {"family": "straight", "descent_deg": 0.0}, "medium": {}}
    variant[part][name] = value
    assert reason in row_of(variant, ["reason"])[0]


def test_a_worker_of_two_studies_reads_a_changed_mesh_again(tmp_path):
    mesh, plates = tmp_path / "my.stl", []
    variant = {"tool": {"mesh": str(mesh)}, "motion": {"family": "straight"}, "medium": {}}
    for fingerprint, name in enumerate(("plate", "sphere")):
        mesh.write_bytes(locate_mesh(name).read_bytes())
        plates.append(evaluate(variant, fingerprint)["plates"])
    assert plates[0] != plates[1]


def test_families_may_be_listed(tmp_path):
    text = SMALL.replace("family: straight, travel:", "family: [straight, plate_drag], travel:")
    assert len(read_design(study(tmp_path, text))) == 2 * (2 + 2 * 3) * 2


def test_parquet_holds_numbers(small):
    parquet = pytest.importorskip("pyarrow.parquet")
    report = run(read_design(small / "study.yaml"), small / "out", form="parquet")
    read = parquet.read_table(report.file)
    assert read.num_rows == 20
    assert read.column("mean_fz").to_pylist()[0] > 0.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("family: straight", "family: sideways"), ("motions 2", "sideways", "circumnutation")),
        (("zeta:", "zetta:"), ("media 1", "zetta")),
        (("mesh: plate", "mesh: 3"), ("tools 2", "mesh", "3")),
        (("family: straight", "family: [[straight]]"), ("motions 2", "family is ['straight']")),
        (("count: 3", "number: 3"), ("motions 2", "travel", "from, to and count")),
        (("count: 3", "count: .inf"), ("motions 2", "travel", "from, to and count")),
        (("count: 3", "count: 1000000000000"), ("motions 2", "travel", "count from 1 to 1,000,000")),
        (("[0.04, 0.1]", "[]"), ("motions 1", "pitch", "empty")),
        (("alpha_y: linear", "alpha_y: cubic"), ("media 1", "cubic")),
        (("media:", "mediums:"), ("mediums",)),
    ],
)
def test_a_wrong_entry_is_named(tmp_path, change, words):
    with pytest.raises(InputError) as error:
        read_design(study(tmp_path, SMALL.replace(*change)))
    for word in ("study.yaml", *words):
        assert word in str(error.value)


def test_a_cluster_gives_the_same_table_and_survives_the_loss_of_a_worker(tmp_path, whole):
    pytest.importorskip("distributed")
    dask = [sys.executable, "-m", "distributed.cli"]
    address = tmp_path / "scheduler.json"
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    options = ["--scheduler-file", str(address)]
    scheduler = [f"{dask[2]}.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", *options]
    worker = [f"{dask[2]}.dask_worker", *options, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    processes = [subprocess.Popen([*dask[:2], *scheduler], **quiet)]
    try:
        processes += [subprocess.Popen([*dask[:2], *worker], **quiet) for _ in range(2)]
        until = time.monotonic() + 300.0
        from distributed import Client

        while not address.exists():
            assert time.monotonic() < until
            time.sleep(0.05)
        with Client(scheduler_file=str(address)) as client:
            client.wait_for_workers(2, timeout=300)
            tcp = client.scheduler.address
        file = study(tmp_path, LONG)
        driver = subprocess.Popen(sweep(file, tmp_path / "cluster", "--scheduler", tcp), **quiet)
        while not list((tmp_path / "cluster").glob("chunks/*.csv")):
            assert time.monotonic() < until
            assert driver.poll() is None
            time.sleep(0.01)
        processes[1].kill()
        assert driver.wait(timeout=300) == 0
    finally:
        for process in processes:
            process.kill()
            process.wait()
    assert (tmp_path / "cluster" / "results.csv").read_bytes() == whole


def test_a_scheduler_that_does_not_answer_is_named(tmp_path):
    pytest.importorskip("distributed")
    with pytest.raises(InputError, match=r"127\.0\.0\.1:9"):
        run(read_design(study(tmp_path, SMALL)), tmp_path / "out", scheduler="tcp://127.0.0.1:9")


def test_a_study_compares_laws_and_densities(tmp_path):
    text = SMALL.replace("media:\n", "media:\n  - law: [treers2021, agarwal2023]\n    density: [0.0, 1500.0]\n")
    design = read_design(study(tmp_path, text))
    media = [v["medium"] for v in (design.variant(k) for k in range(len(design)))]
    law, dense = {"law": "agarwal2023", "density": 1500.0}, {"law": "treers2021", "density": 1500.0}
    assert law in media
    assert dense in media
    tool, motion = {"mesh": "plate"}, {"family": "straight", "speed": 1.0, "travel": 0.03, "tilt_deg": 30.0}
    peaks = [evaluate({"tool": tool, "motion": motion, "medium": m})["peak_force"] for m in ({}, law, dense)]
    assert len(set(peaks)) == 3
    assert peaks[2] > peaks[0]
    refused = study(tmp_path, SMALL.replace("media:\n", "media:\n  - law: li2013\n"))
    with pytest.raises(InputError, match="law is 'li2013'; it must be one of treers2021, agarwal2023"):
        read_design(refused)
