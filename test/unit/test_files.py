"""Files that parameters and users name: hostile ones are refused unread, outputs are whole, inputs stay."""

import os
import pickle
import re

import numpy as np
import pytest
from refusals import refusal
from test_cli import STATE

from rft_ros.cli import main
from rft_ros.errors import InputError
from rft_ros.files import read_yaml, whole, whole_folder
from rft_ros.ground import read_height_map
from rft_ros.parameters import read_alpha_y_table
from rft_ros.states_file import read_states
from rft_ros.tool import load_tool

READERS = {
    "mesh.stl": lambda file: load_tool(file),
    "mesh.npz": lambda file: load_tool(str(file)),
    "table.csv": lambda file: read_alpha_y_table(str(file)),
    "ground.csv": lambda file: read_height_map(file, 0.01),
    "ground.npz": lambda file: read_height_map(file, 0.01),
    "states.csv": read_states,
    "cell.yaml": lambda file: read_yaml(file, "parameter file"),
}


@pytest.mark.parametrize("reader", READERS)
def test_a_device_a_pipe_and_a_folder_are_refused_without_opening_them(tmp_path, reader):
    file = tmp_path / reader
    file.symlink_to("/dev/zero")
    assert "is not a regular file" in refusal(READERS[reader], file)
    file.unlink()
    os.mkfifo(file)
    assert "is not a regular file" in refusal(READERS[reader], file)
    file.unlink()
    file.mkdir()
    assert "is a folder" in refusal(READERS[reader], file)


@pytest.mark.parametrize("reader", READERS)
def test_a_file_over_the_limit_is_refused_before_it_is_read(tmp_path, reader):
    with (tmp_path / reader).open("wb") as file:
        file.truncate(2**38)
    assert "the limit is" in refusal(READERS[reader], tmp_path / reader)


def test_arrays_that_unpack_to_gigabytes_are_refused_before_they_are_unpacked(tmp_path):
    file = tmp_path / "mesh.npz"
    np.savez_compressed(file, x=np.zeros(2**25 + 2**17))
    assert file.stat().st_size < 2**20
    for reader in ("mesh.npz", "ground.npz"):
        file = file.rename(tmp_path / reader)
        assert "unpacked has 257 MiB or more; the limit is 256 MiB" in refusal(READERS[reader], file)


@pytest.mark.parametrize("reader", ["mesh.npz", "ground.npz"])
@pytest.mark.parametrize("in_arrays", [True, False])
def test_a_pickle_is_refused_without_advice_to_load_it(tmp_path, reader, in_arrays):
    file = tmp_path / reader
    if in_arrays:
        names = ("x", "y", "h", "vertices", "faces", "plates", "about")
        np.savez(file, **dict.fromkeys(names, np.array([{}], dtype=object)))
    else:
        file.write_bytes(pickle.dumps({"x": 1.0}))
    assert re.search("is not a valid NPZ file with the arrays of numbers [a-z, ]*$", refusal(READERS[reader], file))


@pytest.mark.parametrize("reader", ["mesh.stl", "table.csv", "ground.csv"])
def test_a_refusal_does_not_quote_the_file(tmp_path, reader):
    (tmp_path / reader).write_text("x,y,h\nroot:hunter2:19000,0,99999\nvertex root:hunter2:19000 0 1\n")
    assert "hunter2" not in refusal(READERS[reader], tmp_path / reader)


@pytest.mark.parametrize("text", ["a: &x 1.0\nb: *x\n", "base: &x {a: 1.0}\nb: {<<: *x}\n"])
def test_yaml_that_ros_does_not_read_is_refused(tmp_path, text):
    (tmp_path / "cell.yaml").write_text(text)
    assert "line 2 has an alias" in refusal(READERS["cell.yaml"], tmp_path / "cell.yaml")


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError(28, "No space left on device")])
def test_an_output_that_is_not_finished_leaves_the_old_one_and_no_other_file(tmp_path, error):
    file = tmp_path / "out" / "wrenches.csv"
    with whole(file) as part:
        part.write_text("good")
    file.chmod(0o640)
    with pytest.raises((KeyboardInterrupt, InputError)), whole(file) as part:
        part.write_text("half")
        raise error
    assert file.read_text() == "good"
    with pytest.raises((KeyboardInterrupt, InputError)), whole_folder(file.parent, [file.name]) as folder:
        (folder / file.name).write_text("half")
        raise error
    assert (file.read_text(), [*file.parent.iterdir()]) == ("good", [file])
    with whole(file) as part:
        part.write_text("better")
    assert (file.read_text(), [*file.parent.iterdir()]) == ("better", [file])
    assert file.stat().st_mode & 0o777 == 0o640


def test_a_device_is_written_and_not_replaced(tmp_path):
    link = tmp_path / "null"
    link.symlink_to("/dev/null")
    with whole(link) as part:
        part.write_text("gone")
    assert link.resolve().is_char_device()


@pytest.mark.parametrize(
    "command",
    [
        "predict states.csv --mesh tool.stl -o states.csv",
        "predict states.csv --mesh tool.stl -o tool.stl",
        "predict states.csv --mesh tool.stl --alpha-y table.csv -o table.csv",
        "predict states.csv --mesh file://{folder}/tool.stl -o tool.stl",
        "view states.csv --mesh tool.stl -o link.html",
        "reduce tool.npz -o tool.npz",
        "reduce tool.stl --scene states.npz -o states.npz",
        "predict states.csv --mesh tool.stl --alpha-y=~/table.csv -o ~/table.csv",
        "replay bag --params cell.yaml -o .",
        "replay bag --params cell.yaml -o bag/out",
        "replay bag --check out/summary.json -o out",
        "replay bag --params out/report.html -o out",
        "calibrate bag --params cell.yaml -o tool.stl",
        "calibrate bag --params cell.yaml -o .",
        "calibrate bag --params cell.yaml --mesh bag=fits.html -o fits.html",
        "sweep study.yaml -o out",
    ],
)
def test_no_command_overwrites_its_input(tmp_path, monkeypatch, capsys, command):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    for name in ("bag", "out"):
        (tmp_path / name).mkdir()
    cell = "/**: {ros__parameters: {mesh.file: tool.stl, alpha_y.table: estimates.csv}}\n"
    contents = {"states.csv": STATE, "states.npz": "", "cell.yaml": cell, "out/report.html": cell, "tool.stl": ""}
    contents |= {"table.csv": "0,0.1\n90,0.2\n", "tool.npz": "", "fits.html": "", "estimates.csv": "0,0.1\n90,0.2\n"}
    contents |= {"out/summary.json": "estimates: {min: 1}", "out/results.csv": STATE}
    contents["study.yaml"] = "{tools: [{mesh: plate}], motions: [{states_file: out/results.csv}], media: [{zeta: 1.0}]}"
    for name, content in contents.items():
        (tmp_path / name).write_text(content)
    (tmp_path / "link.html").symlink_to("states.csv")
    assert main(command.format(folder=tmp_path).split()) == 2
    assert "would overwrite the input" in capsys.readouterr().err
    assert {name: (tmp_path / name).read_text() for name in contents} == contents
