"""Design studies: every variant has exactly one row, however the run ended."""

import csv
import json
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from multiprocessing import active_children
from pathlib import Path

import numpy as np
import pytest
from refusals import refusal

from rft_ros.errors import InputError
from rft_ros.rft import MEDIA, TWIST, Memory, alpha_y_model, treers2021, wrenches_in_time
from rft_ros.sweeps import design
from rft_ros.sweeps import run as runs
from rft_ros.sweeps.design import Content, Variant, checksum_of, read_design
from rft_ros.sweeps.motions import circumnutation, sample
from rft_ros.sweeps.run import evaluate, rows_of, run
from rft_ros.tool import load_tool, locate_mesh

SMALL = """
tools:
  - mesh: [root_tip, gone.stl]
  - {mesh: plate, integration: refined}
motions:
  - {family: circumnutation, pitch: [0.04, 0.1], samples: 30}
  - {family: straight, travel: {from: 0.01, to: 0.03, count: 3}, samples: 20}
media:
  - {zeta: [0.2, 0.33], alpha_y: linear}
"""

LARGE = """
tools: [{mesh: plate, scale: {from: 1, to: 2, count: 100}}]
motions: [{family: straight, travel: {from: 0.01, to: 0.02, count: 100}}]
media: [{zeta: {from: 0.2, to: 0.4, count: 101}}]
"""

LONG = """
tools:
  - mesh: root_tip
motions:
  - {family: circumnutation, pitch: {from: 0.02, to: 0.2, count: 60}, samples: 300}
media:
  - zeta: [0.2, 0.3, 0.4, 0.5]
"""


def study(folder, text, name="study.yaml"):
    (folder / name).write_text(text)
    return folder / name


def table(file):
    with file.open(newline="") as lines:
        return list(csv.DictReader(lines))


def wait_for(condition):
    until = time.monotonic() + 300.0
    while not (found := condition()):
        assert time.monotonic() < until
        time.sleep(0.005)
    return found


def chunks(out):
    return list(out.glob("chunks_*/0*.json"))


def computed_here(found, out):
    """`run` with a thread in place of processes, each of which takes seconds to start."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(runs, "_workers", lambda *_: ThreadPoolExecutor(1))
        return run(found, out)


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
    """The rows of LONG, computed in one go."""
    variants = read_design(study(tmp_path_factory.mktemp("expected"), LONG)).variants
    names = (
        "tool.mesh",
        "motion.family",
        "motion.pitch",
        "motion.samples",
        "medium.zeta",
        *runs.RESULTS,
        "reason",
    )
    return [dict(zip(names, row, strict=True)) for row in rows_of(variants, names)]


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A folder with SMALL and its results, a third of which fail."""
    folder = tmp_path_factory.mktemp("small")
    assert computed_here(read_design(study(folder, SMALL)), folder) == (30, 10)
    return folder


def test_every_tool_meets_every_motion_and_medium_in_one_order(tmp_path):
    variants = read_design(study(tmp_path, SMALL)).variants
    assert len({str(v) for v in variants}) == len(variants) == 3 * 5 * 2
    assert variants[0].motion == {"family": "circumnutation", "pitch": 0.04, "samples": 30}
    assert [v.motion.get("travel") for v in variants[4:10:2]] == pytest.approx([0.01, 0.02, 0.03])
    listed = SMALL.replace("family: straight, travel:", "family: [straight, plate_drag], travel:")
    assert len(read_design(study(tmp_path, listed)).variants) == 3 * (2 + 2 * 3) * 2


def test_a_row_holds_what_the_core_gives_for_its_variant(small):
    row = table(small / "results.csv")[3]
    assert (row["tool.mesh"], row["motion.pitch"], row["medium.zeta"]) == (
        "root_tip",
        "0.1",
        "0.33",
    )
    generic = MEDIA["generic"]
    law = treers2021(
        generic, alpha_y_model("linear", generic), zeta=0.33, mobilization_length=0.003
    )
    times, states = sample(circumnutation(pitch=0.1), 30)
    plates = load_tool("root_tip").plates
    expected = wrenches_in_time(plates, law, states, Memory(plates))[:, :6]
    # sums of another order
    assert float(row["mean_fz"]) == pytest.approx(expected[:, 2].mean(), rel=1e-14)
    assert float(row["peak_force"]) == np.linalg.norm(expected[:, :3], axis=1).max()
    power = -(expected * states[:, TWIST]).sum(axis=1)
    assert float(row["total_work"]) == pytest.approx(
        np.diff(times) @ (power[1:] + power[:-1]) / 2.0
    )


def test_a_variant_that_fails_is_a_row_with_its_reason(small):
    rows = table(small / "results.csv")
    assert {row["tool.mesh"] for row in rows if row["reason"]} == {"gone.stl"}
    assert all("gone.stl" in row["reason"] and not row["mean_fz"] for row in rows if row["reason"])


def test_a_sample_is_drawn_by_its_seed(tmp_path):
    first, again, other = (
        read_design(study(tmp_path, SMALL + f"sample: 7\nseed: {seed}\n")).variants
        for seed in (2**55, 2**55, 2**55 + 1)
    )
    assert len(first) == 7
    assert first == again != other


def test_a_sweep_continues_after_an_interrupt_a_killed_driver_and_a_killed_worker(
    tmp_path, expected
):
    """No row is lost or computed twice, and nothing runs on."""
    design, out = read_design(study(tmp_path, LONG)), tmp_path / "out"
    command = [
        sys.executable,
        "-m",
        "rft_ros.cli",
        "sweep",
        str(design.file),
        "-o",
        str(out),
        "--workers",
        "1",
    ]
    for number, status in (
        (signal.SIGINT, 130),
        (signal.SIGTERM, 130),
        (signal.SIGKILL, -signal.SIGKILL),
    ):
        before = len(chunks(out))
        streams = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        with subprocess.Popen(command, **streams, start_new_session=True) as driver:
            wait_for(lambda: len(chunks(out)) > before)  # noqa: B023
            started = Path(f"/proc/{driver.pid}/task/{driver.pid}/children").read_text().split()
            # a terminal interrupts all
            os.kill(-driver.pid if number == signal.SIGINT else driver.pid, number)
            _, said = driver.communicate()
        assert driver.returncode == status
        assert "Traceback" not in said
        assert said.endswith("rft sweep: interrupted\n") or number == signal.SIGKILL
        assert started
        wait_for(lambda: not any(Path(f"/proc/{pid}").exists() for pid in started))  # noqa: B023

    before = len(chunks(out))
    killer = threading.Thread(
        target=lambda: wait_for(lambda: len(chunks(out)) > before) and active_children()[0].kill()
    )
    killer.start()
    with pytest.raises(
        InputError, match=r"the system ended a worker, .* the same command continues"
    ):
        run(design, out, workers=1)
    killer.join()
    done = sum(len(json.loads(file.read_text())) for file in chunks(out))
    assert 0 < done < 240
    assert run(design, out, workers=1) == (240 - done, 0)
    assert table(out / "results.csv") == expected
    assert run(design, out, workers=1) == (0, 0)


def test_the_rows_of_another_study_are_not_mixed_in(small, tmp_path):
    other = SMALL.replace("0.33", "0.34").replace("root_tip, ", "")
    assert computed_here(read_design(study(tmp_path, other)), small)[0] == 20
    assert len(table(small / "results.csv")) == 20


def test_another_mesh_states_file_or_version_makes_another_study(tmp_path, monkeypatch):
    mesh, states = tmp_path / "my.stl", tmp_path / "states.csv"
    file = study(
        tmp_path,
        f"tools: [{{mesh: {mesh}}}]\nmotions: [{{states_file: {states}}}]\nmedia: [{{zeta: 1}}]",
    )
    prints = [read_design(file).fingerprint()]
    for changed, content in ((mesh, "one"), (mesh, "two"), (states, "three")):
        changed.write_text(content)
        prints.append(read_design(file).fingerprint())
    monkeypatch.setattr(design, "release", lambda: "another")
    prints.append(read_design(file).fingerprint())
    assert len(set(prints)) == 5


def test_a_worker_of_two_studies_reads_a_changed_mesh_again(tmp_path):
    mesh, plates = tmp_path / "my.stl", []
    variant = Variant({"mesh": str(mesh)}, {"family": "straight"}, {})
    for name in ("plate", "sphere"):
        mesh.write_bytes(locate_mesh(name).read_bytes())
        content = Content("mesh", str(mesh), checksum_of("mesh", str(mesh)))
        plates += rows_of([variant], ["plates"], (content,))
    assert plates[0] != plates[1]


def test_a_worker_with_another_file_of_the_same_name_is_refused(tmp_path, monkeypatch):
    """Such as a worker of a cluster, which has another working directory."""
    for folder, name in (("here", "plate"), ("there", "sphere")):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "my.stl").write_bytes(locate_mesh(name).read_bytes())
    monkeypatch.chdir(tmp_path / "here")
    text = "tools: [{mesh: my.stl}]\nmotions: [{family: straight, samples: 5}]\nmedia: [{zeta: 1}]"
    variants, contents = (found := read_design(study(tmp_path, text))).variants, found.contents()
    assert rows_of(variants, ["reason"], contents) == [[""]]
    for folder in ("there", "."):
        monkeypatch.chdir(tmp_path / folder)
        runs._check_contents.cache_clear()  # as in a worker of its own
        with pytest.raises(
            InputError, match=r"another mesh 'my\.stl' than this process; give an absolute path"
        ):
            rows_of(variants, ["reason"], contents)


def test_chunks_that_were_cut_anywhere_are_computed_again(small):
    found = read_design(small / "study.yaml")
    computed_here(found, small)
    table = (small / "results.csv").read_bytes()
    files = sorted((small / f"chunks_{found.fingerprint():08x}").glob("*.json"))
    for k, file in enumerate(files):  # from none of the first to most of the last
        whole = file.read_bytes()
        file.write_bytes(whole[: k * len(whole) // len(files)])
    assert computed_here(found, small)[0] == len(found.variants)
    assert (small / "results.csv").read_bytes() == table


@pytest.mark.parametrize(
    "error",
    [BlockingIOError(11, "no process"), RuntimeError("no thread")],
    ids=["process", "thread"],
)
def test_a_worker_that_cannot_be_started_is_named_and_not_the_folder(tmp_path, monkeypatch, error):
    def submit(*_):
        raise error

    monkeypatch.setattr(runs.ProcessPoolExecutor, "submit", submit)
    said = refusal(run, read_design(study(tmp_path, SMALL)), tmp_path / "out")
    assert said.startswith("a worker cannot be started: no ")
    assert "--workers" in said


@pytest.mark.parametrize("text", ["{}", '{"a": 1}', "1", "[]", "[[]]", '["row"]', "[[1], [2]]"])
def test_a_chunk_without_its_rows_is_computed_again(small, text):
    found = read_design(small / "study.yaml")
    computed_here(found, small)
    table = (small / "results.csv").read_bytes()
    next(small.glob(f"chunks_{found.fingerprint():08x}/*.json")).write_text(text)
    assert computed_here(found, small)[0] == 1
    assert (small / "results.csv").read_bytes() == table


def test_a_chunk_that_is_lost_before_the_table_is_written_is_named(small, monkeypatch):
    found = read_design(small / "study.yaml")
    computed_here(found, small)
    table = (small / "results.csv").read_bytes()
    lost = next(small.glob(f"chunks_{found.fingerprint():08x}/*.json"))
    monkeypatch.setattr(runs, "_is_finished", lambda *_: True)
    for text in ("", "[]"):
        lost.write_text(text)
        assert lost.name in refusal(computed_here, found, small)
        assert (small / "results.csv").read_bytes() == table
    monkeypatch.undo()
    computed_here(found, small)


@pytest.mark.filterwarnings("ignore:overflow:RuntimeWarning")
@pytest.mark.parametrize(
    ("motion", "medium", "reason"),
    [
        (
            {"states_file": "far.csv"},
            {"mobilization_length": 0.0},
            "its forces, work or path are too large",
        ),
        ({"states_file": "back.csv"}, {}, "'back.csv': t goes back; work needs it in order"),
        ({"family": "straight"}, {"alpha_y": "table"}, "needs alpha_y.table"),
    ],
)
def test_a_variant_that_cannot_be_computed_gives_a_reason(
    tmp_path, monkeypatch, motion, medium, reason
):
    monkeypatch.chdir(tmp_path)
    for name, times in (("far.csv", (0, 1)), ("back.csv", (1, 0))):
        rows = "".join(f"{t},0,0,-1e150,0,0,0,1,1e200,0,0,0,0,0\n" for t in times)
        (tmp_path / name).write_text("t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz\n" + rows)
    assert reason in rows_of([Variant({"mesh": "plate"}, motion, medium)], ["reason"])[0][0]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("family: straight", "family: sideways"), ("motions 2", "sideways", "circumnutation")),
        (("family: straight", "family: [[straight]]"), ("motions 2", "family is ['straight']")),
        (("pitch: ", "pitsch: "), ("motions 1", "there is no 'pitsch'", "tilt_deg")),
        (("[0.04, 0.1]", "[]"), ("motions 1", "pitch", "empty")),
        (
            ("[0.04, 0.1]", "[spam]"),
            ("motions 1", "pitch is 'spam'; it must be a number from 1e-09 to"),
        ),
        (("mesh: plate", "mesh: plaet"), ("tools 2", "mesh.file 'plaet' is not a shipped mesh")),
        (("count: 3", "number: 3"), ("motions 2", "travel", "from, to and count")),
        (
            ("count: 3", "count: 1000000000000"),
            ("motions 2", "travel", "count, of 1 to 1,000,000"),
        ),
        ((SMALL, LARGE), ("has 1,010,000 variants; the limit is 1,000,000",)),
        (("samples: 30", "samples: 30.7"), ("motions 1", "samples is 30.7", "a whole number")),
        (
            ("samples: 30", "samples: {from: 2, to: 3, count: 3}"),
            ("motions 1", "samples is 2.5", "a whole number"),
        ),
        (("samples: 30", "samples: .inf"), ("line", ".inf", "decimal number")),
        (("mesh: plate", "mesh: 3"), ("tools 2", "mesh", "3")),
        (("mesh: plate, ", ""), ("tools 2", "mesh")),
        (("zeta:", "zetta:"), ("media 1", "zetta")),
        (("alpha_y: linear", "mobilization_length: -0.003"), ("media 1", "must lie between 0")),
        (
            ("alpha_y: linear", "law: li2013"),
            ("law is 'li2013'; it must be one of treers2021, agarwal2023",),
        ),
        (("media:", "mediums:"), ("mediums",)),
        (
            ("\ntools:", "\nsample: 31\ntools:"),
            ("sample is 31; it must be a whole number from 1 to 30",),
        ),
        (("\ntools:", "\nsample: true\ntools:"), ("sample is True", "a whole number")),
        (("\ntools:", "\nseed: true\ntools:"), ("seed is True", "a whole number from 0")),
        (("\ntools:", f"\nseed: {2**60}\ntools:"), ("seed", "a whole number from 0")),
        (("\ntools:", "\nseed: 1.5\ntools:"), ("seed is 1.5", "a whole number from 0")),
        (
            (SMALL, "/**: {ros__parameters: {}}"),
            ("there is no '/**'; use tools, motions, media, sample",),
        ),
    ],
)
def test_a_wrong_entry_is_named(tmp_path, change, words):
    said = refusal(read_design, study(tmp_path, SMALL.replace(*change)))
    assert all(word in said for word in ("study.yaml", *words)), said


def test_a_cluster_gives_the_same_table_and_survives_the_loss_of_a_worker(tmp_path, expected):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None
    ) as cluster:
        loss = threading.Thread(
            target=lambda: (
                wait_for(lambda: chunks(tmp_path)) and os.kill(cluster.workers[0].pid, 9)
            )
        )
        loss.start()
        run(read_design(study(tmp_path, LONG)), tmp_path, scheduler=cluster.scheduler_address)
        loss.join()
    assert table(tmp_path / "results.csv") == expected


def test_a_scheduler_that_does_not_answer_is_named(tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr(runs, "_SCHEDULER_TIMEOUT_S", 1.0)
    with pytest.raises(InputError, match=r"127\.0\.0\.1:9"):
        run(read_design(study(tmp_path, SMALL)), tmp_path / "out", scheduler="tcp://127.0.0.1:9")


def test_a_study_compares_laws_and_densities():
    tool, motion = (
        {"mesh": "plate"},
        {"family": "straight", "speed": 1.0, "travel": 0.03, "tilt_deg": 30.0},
    )
    media = {}, {"law": "agarwal2023", "density": 1500.0}, {"density": 1500.0}
    peaks = [evaluate(Variant(tool, motion, m))["peak_force"] for m in media]
    assert len(set(peaks)) == 3
    assert peaks[2] > peaks[0]
