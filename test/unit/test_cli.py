"""The command line: files in, files out, and one sentence for input that cannot be used."""

import io
import os
import signal
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np
import pytest

from rft_ros.cli import main

ROOT = Path(__file__).resolve().parents[2]
HEADER = "t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz"
ROW = "0,0,0,-0.01,0,0,0,1,0,0,-0.01,0,0,0"
STATE = f"{HEADER}\n{ROW}\n"


def rft(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command line in this process: status and output as of a process of its own."""
    with (
        pytest.MonkeyPatch.context() as process,
        redirect_stdout(io.StringIO()) as out,
        redirect_stderr(io.StringIO()) as err,
    ):
        process.chdir(cwd)
        try:
            status = main([str(word) for word in arguments])
        except SystemExit as error:
            status = error.code
    return subprocess.CompletedProcess(arguments, status, out.getvalue(), err.getvalue())


def predict(tmp_path: Path, text: str, *options: object) -> subprocess.CompletedProcess[str]:
    (tmp_path / "states.csv").write_text(text)
    return rft("predict", "states.csv", "--mesh", "plate", *options, "-o", "out.csv", cwd=tmp_path)


def predicted(tmp_path: Path, text: str, *options: object, header: str = HEADER) -> np.ndarray:
    """The wrenches of states, shape [n, 6]."""
    done = predict(tmp_path, f"{header}\n{text}\n", *options)
    assert done.returncode == 0, done.stderr
    return np.loadtxt(tmp_path / "out.csv", delimiter=",", skiprows=1, ndmin=2)[:, 1:]


def refused(done: subprocess.CompletedProcess[str], *words: str) -> None:
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    for word in words:
        assert word in done.stderr, done.stderr


@pytest.mark.parametrize("model", ["constant", "linear"])
def test_predict_agrees_with_the_authors_code(shared_data, tmp_path, model):
    paper = shared_data / "paper"
    done = rft(
        *(
            "predict",
            paper / "circumnutation_P40_states.csv",
            "--mesh",
            paper / "root-tip.stl",
            "--scale",
            0.001,
        ),
        *(
            "--origin",
            0,
            0,
            35.5,
            "--integration",
            "centroid",
            "--zeta",
            0.33,
            "--alpha-y",
            model,
            "-o",
            "out.csv",
        ),
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out.csv").read_text().splitlines()[0] == "t,fx,fy,fz,tx,ty,tz"
    ours = np.loadtxt(tmp_path / "out.csv", delimiter=",", skiprows=1)
    theirs = np.loadtxt(
        paper / f"circumnutation_P40_expected_{model}.csv", delimiter=",", skiprows=1
    )
    np.testing.assert_array_equal(ours[:, 0], theirs[:, 0])
    for columns in (slice(1, 4), slice(4, 7)):
        scale = np.abs(theirs[:, columns]).max()
        np.testing.assert_allclose(ours[:, columns], theirs[:, columns], atol=1e-9 * scale, rtol=0)


def test_predict_takes_columns_in_any_order_and_a_table_for_alpha_y(tmp_path):
    (tmp_path / "alpha.csv").write_text("beta,alpha_y\n0,0.136\n180,0.136\n")
    moving, low = "3,0,0,-0.01,0,0,0,1,0.003,0.004,-0.01,0,0,0", ("--surface-height", "-1e-3")
    names, numbers = (",".join(reversed(line.split(","))) for line in (HEADER, moving))
    # as of a spreadsheet
    ours = predicted(tmp_path, numbers, "--alpha-y", "alpha.csv", *low, header=f"\ufeff{names}")
    np.testing.assert_allclose(
        ours, predicted(tmp_path, moving, "--alpha-y", "constant", *low), rtol=1e-12
    )


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEADER.replace(",qw", "") + "\n" + ROW[:-2], ("states.csv", "no column qw")),
        (f"{STATE}{ROW.replace('-0.01', 'nan', 1)}\n", ("states.csv", "line 3", "pz is nan")),
        (
            f"{HEADER}\n{ROW.replace('0,0,0,1', '0,0,0,0', 1)}\n",
            ("states.csv", "line 2", "norm 0"),
        ),
        (f"{HEADER}\n\n{ROW.replace('0,0', 'inf,0', 1)}\n", ("line 3", "t is inf")),
        (
            f"{STATE}1,0,0,-1e308,0,0,0,1,0,0,-0.01,0,0,0\n",
            ("states.csv", "t = 1 ", "no finite wrench"),
        ),
    ],
)
def test_states_that_cannot_be_used(tmp_path, text, words):
    refused(predict(tmp_path, text), *words)
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--mesh", "no_such_tool"), ("no_such_tool", "ellipsoid")),
        (("--mesh", "gone.stl"), ("gone.stl",)),
        (("--mesh", "states.csv"), ("states.csv",)),
        (("--medium", "custard"), ("custard", "generic")),
        (("--zeta", "-1"), ("medium.zeta is -1",)),
        (("--alpha-y", "gone.csv"), ("gone.csv",)),
        (("--scale", "-1"), ("scale",)),
        (("--law", "agarwal2023", "--surface-friction", -1), ("medium.surface_friction is -1",)),
    ],
)
def test_options_that_cannot_be_used(tmp_path, options, words):
    refused(predict(tmp_path, STATE, *options), *words)


def test_a_states_file_that_is_not_there_and_outputs_that_cannot_be_written(tmp_path):
    refused(
        rft("predict", "gone.csv", "--mesh", "plate", "-o", "out.csv", cwd=tmp_path), "gone.csv"
    )
    (tmp_path / "states.csv").write_text(STATE)
    done = rft(
        "predict",
        "states.csv",
        "--mesh",
        "plate",
        "-o",
        tmp_path / "states.csv" / "out.csv",
        cwd=tmp_path,
    )
    refused(done, "out.csv")
    done = rft(
        "sweep", ROOT / "config" / "sweep_example.yaml", "-o", "states.csv/out", cwd=tmp_path
    )
    refused(done, "output folder 'states.csv/out' cannot be written: Not a directory")
    assert done.stdout == ""  # refused before the work began


def test_an_output_may_lie_in_the_home_folder_or_in_one_that_has_the_name_of_a_model(
    tmp_path, monkeypatch
):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "states.csv").write_text(STATE)
    (tmp_path / "linear").mkdir()
    words = (
        "predict",
        "~/states.csv",
        "--mesh",
        "plate",
        "--alpha-y",
        "linear",
        "--output=~/linear/out.csv",
    )
    done = rft(*words, cwd=tmp_path / "linear")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "linear" / "out.csv").is_file()


def test_check_mesh_says_what_a_mesh_holds_and_ends_with_1_where_it_finds_something(tmp_path):
    for scale, status, words in ((0.001, 0, "extent 36.000 mm"), (1.0, 1, "mesh.scale")):
        done = rft("check-mesh", "ellipsoid", "--scale", scale, cwd=tmp_path)
        assert done.returncode == status
        assert "facets: 2,352" in done.stdout
        assert words in done.stdout
    refused(rft("check-mesh", "gone.stl", cwd=tmp_path), "gone.stl")


def test_a_concave_tool_is_no_fault_and_its_hull_is_an_option_away(tmp_path):
    done = rft("check-mesh", "scoop", cwd=tmp_path)
    assert done.returncode == 0, done.stdout
    assert "hollows" in done.stdout
    assert "--hull" in next(line for line in done.stdout.splitlines() if "drag along x: " in line)
    hull = rft("check-mesh", "scoop", "--hull", cwd=tmp_path)
    assert (hull.returncode, "hollows" in hull.stdout) == (0, False)
    (tmp_path / "states.csv").write_text(STATE)
    for command, output, notes in (("predict", "out.csv", 1), ("view", "out.html", 0)):
        done = rft(command, "states.csv", "--mesh", "scoop", "-o", output, cwd=tmp_path)
        assert done.stderr.count("hollows") == notes


def test_the_area_of_the_facets_is_told_from_that_of_the_surface_that_they_sample(tmp_path):
    (line,) = (
        s
        for s in rft("check-mesh", "sphere", cwd=tmp_path).stdout.splitlines()
        if s.startswith("area: ")
    )
    assert "mm² of facets; " in line
    assert "of the curved surface" in line


def test_the_names_of_the_package_are_completed():
    code = "import rft_ros; print(set(rft_ros.__all__) <= set(dir(rft_ros)))"
    assert (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout
        == "True\n"
    )


def printing_to(stream: io.TextIOBase, *arguments: str) -> int:
    """Exit status of a command whose stdout is this stream."""
    with redirect_stdout(stream):
        return main(arguments)


def test_a_mesh_whose_name_is_not_utf_8_is_described(tmp_path):
    mesh = tmp_path / os.fsdecode(b"\xff.stl")
    mesh.write_bytes((ROOT / "meshes" / "plate.stl").read_bytes())
    strict = io.TextIOWrapper(io.BytesIO(), encoding="utf-8", errors="strict")
    assert printing_to(strict, "check-mesh", str(mesh)) == 0
    assert strict.buffer.getvalue().startswith(b"\\udcff (")


def test_a_full_disk_is_a_sentence_and_a_reader_that_closes_the_pipe_early_is_none(capsys):
    with Path("/dev/full").open("w") as full:
        assert printing_to(full, "check-mesh", "plate") == 2
    sentence = "rft: the output or the working directory cannot be used: No space left on device\n"
    assert capsys.readouterr().err == sentence
    ours, its = os.pipe()
    os.close(ours)
    with os.fdopen(its, "w") as pipe:
        assert printing_to(pipe, "check-mesh", "plate") == 128 + signal.SIGPIPE
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("quaternion", "is_noted"), [("0,0,0,1", True), ("1,0,0,0", False)], ids=["up", "hanging"]
)
def test_predict_says_when_a_tool_meets_the_grains_with_the_side_of_its_frames_origin(
    tmp_path, quaternion, is_noted
):
    """A plate below a flange whose z points out of the arm: the mesh lies at positive z of the tool frame."""
    z = -0.09 if is_noted else 0.11
    rows = "\n".join(
        f"{0.1 * k},0,0,{z - 0.001 * k},{quaternion},0,0,-0.01,0,0,0" for k in range(30)
    )
    done = predict(tmp_path, f"{HEADER}\n{rows}\n", "--origin", 0, 0, -100)
    assert done.returncode == 0
    assert ("with the side of its frame's origin" in done.stderr) == is_noted
    assert ("quaternion 1 0 0 0" in done.stderr) == is_noted


def test_predict_with_memory_holds_the_force_at_rest_and_wants_the_states_in_order(tmp_path):
    memory = ("--mobilization-length", "0.003")
    moving = [f"{0.1 * k},0,0,{-0.001 * k},0,0,0,1,0,0,-0.01,0,0,0" for k in range(1, 40)]
    resting = [f"{4.0 + 0.1 * k},0,0,-0.04,0,0,0,1,0,0,0,0,0,0" for k in range(10)]
    vertical = predicted(tmp_path, "\n".join([*moving, *resting]), *memory)[:, 2]
    assert vertical[38] > 5.0
    np.testing.assert_allclose(vertical[39:] / vertical[38], 0.04 / 0.039, rtol=0.05)
    refused(predict(tmp_path, f"{HEADER}\n{resting[0]}\n{moving[0]}\n", *memory), "goes back")


def test_control_characters_of_a_damaged_file_do_not_reach_the_terminal(tmp_path):
    (tmp_path / "study.yaml").write_text('"\\e[31m": 1\n')
    done = rft("sweep", "study.yaml", "-o", "out", cwd=tmp_path)
    refused(done, "there is no '\\x1b[31m'")
    assert chr(27) not in done.stderr


def test_predict_by_the_second_law_and_with_inertia(tmp_path):
    """A flat plate down at 1 m/s: the same slow force by both laws, and λ (1 + 2) ρ v² A on top with a density."""
    fast = "0,0,0,-0.01,0,0,0,1,0,0,-1.0,0,0,0"

    def fz(*options: object) -> float:
        return predicted(tmp_path, fast, "--integration", "centroid", *options)[0, 2]

    plain, pushed = fz(), 1.4 * 3.0 * 1500.0 * 0.051**2
    second = ("--law", "agarwal2023")
    assert fz(*second) == pytest.approx(plain, rel=1e-3)
    assert fz("--density", 1500) - plain == pytest.approx(pushed, rel=1e-3)
    assert fz("--density", 1500, "--inertia", 0.7) - plain == pytest.approx(0.5 * pushed, rel=1e-3)
    assert fz(*second, "--density", 1500) - plain == pytest.approx(pushed, rel=1e-3)
