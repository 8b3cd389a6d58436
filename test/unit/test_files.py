"""Files that parameters and users name: hostile ones are refused unread, outputs are whole, inputs stay."""

import io
import pickle
import re
import zipfile

import numpy as np
import pytest
from refusals import refusal
from test_cli import STATE

from rft_ros.cli import main
from rft_ros.errors import InputError
from rft_ros.files import whole, whole_folder
from rft_ros.ground import read_height_map
from rft_ros.parameters import checked, read_alpha_y_table
from rft_ros.tool import checked_mesh, load_tool

READERS = {
    "mesh.stl": lambda file: load_tool(file),
    "ground.npz": lambda file: read_height_map(file, 0.01),
}


def test_a_mesh_that_is_not_there_is_refused_with_the_names_of_the_shipped_ones(tmp_path):
    for said in (
        refusal(load_tool, tmp_path / "tool.stl"),
        refusal(checked_mesh, tmp_path / "tool.stl", "mesh.file"),
    ):
        assert "tool.stl' does not exist" in said
        assert all(
            name in said
            for name in ("abb_plate", "ellipsoid", "plate", "root_tip", "scoop", "sphere")
        )


def test_arrays_that_unpack_to_gigabytes_are_refused_before_they_are_unpacked(tmp_path):
    file = tmp_path / "ground.npz"
    np.savez_compressed(file, x=np.zeros(2**25 + 2**17))
    assert file.stat().st_size < 2**20
    assert "the limit is 256 MiB" in refusal(READERS[file.name], file)


@pytest.mark.parametrize(("kind", "count"), [("|V0", 2**40), ("|i1", 2**26)])
def test_arrays_of_more_numbers_than_their_bytes_tell_are_refused(tmp_path, kind, count):
    """A number of no bytes, or of one, becomes one of eight."""
    array = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        array, {"descr": kind, "fortran_order": False, "shape": (count,)}
    )
    array.write(bytes(count if kind == "|i1" else 0))
    file = tmp_path / "ground.npz"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x.npy", array.getvalue())
        for name in ("y", "h"):
            archive.writestr(f"{name}.npy", _array(np.zeros(3)))
    assert "of eight bytes has" in refusal(READERS[file.name], file)


def _array(values):
    stream = io.BytesIO()
    np.save(stream, values)
    return stream.getvalue()


def test_a_table_whose_grid_would_fill_the_memory_is_refused(tmp_path):
    file = tmp_path / "table.csv"
    rows = (f"{k / 1000},{k / 999},0.1\n" for k in range(100_000))
    file.write_text("beta,gamma,alpha_y\n" + "".join(rows))
    assert "100000 beta x 100000 gamma values" in refusal(read_alpha_y_table, str(file))


@pytest.mark.parametrize("in_arrays", [True, False])
def test_a_pickle_is_refused_without_advice_to_load_it(tmp_path, in_arrays):
    file = tmp_path / "ground.npz"
    if in_arrays:
        names = ("x", "y", "h")
        np.savez(file, **dict.fromkeys(names, np.array([{}], dtype=object)))
    else:
        file.write_bytes(pickle.dumps({"x": 1.0}))
    assert re.search(
        "is not a valid NPZ file with the arrays of numbers [a-z, ]*; write it again with numpy.savez$",
        refusal(READERS[file.name], file),
    )


def test_a_refusal_does_not_quote_the_mesh(tmp_path):
    (tmp_path / "mesh.stl").write_text("solid x\nvertex root:hunter2:19000 0 1\n")
    assert "hunter2" not in refusal(READERS["mesh.stl"], tmp_path / "mesh.stl")


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
    with (
        pytest.raises((KeyboardInterrupt, InputError)),
        whole_folder(file.parent, [file.name]) as folder,
    ):
        (folder / file.name).write_text("half")
        raise error
    assert (file.read_text(), [*file.parent.iterdir()]) == ("good", [file])
    with whole(file) as part:
        part.write_text("better")
    assert (file.read_text(), [*file.parent.iterdir()]) == ("better", [file])
    assert file.stat().st_mode & 0o777 == 0o640


def test_two_processes_that_fill_one_folder_do_not_take_each_others_files(tmp_path):
    """Also in two containers, where both may have the same pid."""
    with whole_folder(tmp_path, []) as slow:
        (slow / "half.csv").write_text("half")
        with whole_folder(tmp_path, []) as folder:
            (folder / "out.csv").write_text("good")
        assert sorted(tmp_path.iterdir()) == [slow, tmp_path / "out.csv"]


def test_a_loop_of_links_is_no_output_and_no_folder_of_one(tmp_path):
    loop = tmp_path / "loop"
    loop.symlink_to("loop")
    for file in (loop, loop / "out.csv"):
        with pytest.raises(InputError, match="links"), whole(file):
            pass
    assert loop.is_symlink()


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
    table = "beta,alpha_y\n0,0.1\n90,0.2\n"
    contents = {"states.csv": STATE, "cell.yaml": cell, "out/report.html": cell, "tool.stl": ""}
    contents |= {"table.csv": table, "fits.html": "", "estimates.csv": table}
    contents |= {"out/summary.json": "estimates: {min: 1}", "out/results.csv": STATE}
    contents["study.yaml"] = (
        "{tools: [{mesh: plate}], motions: [{states_file: out/results.csv}], media: [{zeta: 1.0}]}"
    )
    for name, content in contents.items():
        (tmp_path / name).write_text(content)
    (tmp_path / "link.html").symlink_to("states.csv")
    assert main(command.format(folder=tmp_path).split()) == 2
    assert "would overwrite the input" in capsys.readouterr().err
    assert {name: (tmp_path / name).read_text() for name in contents} == contents


@pytest.mark.parametrize(
    "value",
    [[1.0] * 10**6, "x" * 10**7, 10**5000, ["x" * 10**6] * 6],
    ids=["numbers", "text", "digits", "texts"],
)
@pytest.mark.parametrize(
    "name", ["sensor.bias", "medium.zeta", "law", "mesh.file", pytest.param("x" * 10**6, id="x")]
)
def test_huge_values_and_names_of_parameters_are_refused_with_a_sentence_that_can_be_read(
    name, value
):
    assert len(refusal(checked, name, value)) < 500
