"""`rft calibrate` on synthetic bags: exit status, files written, and that the node can read them unchanged."""

import json

import numpy as np
import pytest
import yaml
from recordings import plunge, write_ros2, write_run
from synthetic_track import (
    LOAD_CELL,
    Path,
    grain_wrenches,
    in_the_air,
    law,
    parameters,
    read_by,
    unknown,
)

from rft_ros.bags.options import read_replay_options
from rft_ros.calibration.calibrated_file import rounded
from rft_ros.calibration.track import read_track
from rft_ros.cli import main
from rft_ros.errors import InputError
from rft_ros.parameters import Config, read_parameter_file
from rft_ros.tool import locate_mesh


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """A folder with a parameter file, a bag of poses in the air and a penetration, and one of a drag."""
    folder = tmp_path_factory.mktemp("cell")
    down = (0.0, 0.0, -0.095)
    paths = {
        "pressed": in_the_air().move(down, 0.01).wait(1.0).move((0.0, 0.0, 0.09), 0.02),
        "dragged": Path((0.0, 0.0, 0.06))
        .wait(1.0)
        .move(down, 0.01)
        .move((0.05, 0.0, 0.0), 0.01)
        .move((0, 0, 0.09), 0.02),
    }
    for name, path in paths.items():
        time, states = path.states(1000.0)
        force = grain_wrenches(time, states, law(0.8), surface=0.0, length=0.003)
        some = slice(None, None, 10)
        time, states, grains = time[some], states[some], force[some]
        readings = read_by(LOAD_CELL, states, grains, np.random.default_rng(1), noise=(0.1, 0.002))
        write_run(folder / name, time, states, readings)
    given = {
        n: list(v) if isinstance(v, tuple) else v
        for n, v in unknown().items()
        if v != Config().values[n]
    }
    tree = {
        "/**": {"ros__parameters": given},
        "other_node": {"ros__parameters": {"kept": 1}},
        "rft_replay": {"ros__parameters": {"tare": 0.5, "end": 1e7}},
    }
    (folder / "cell.yaml").write_text(yaml.safe_dump(tree))
    return folder


def calibrate(cell, bags, out, *more):
    return main(
        [
            "calibrate",
            *(str(cell / b) for b in bags),
            "--params",
            str(cell / "cell.yaml"),
            "-o",
            str(out),
            *more,
        ]
    )


def record(file):
    return yaml.safe_load(file.read_text())["rft_calibration"]["ros__parameters"]


@pytest.fixture(scope="module")
def calibrated(cell):
    out = cell / "out" / "calibrated.yaml"
    assert calibrate(cell, ("pressed", "dragged"), out) == 0
    return out


def test_the_node_and_the_replay_take_the_file_as_it_is(calibrated, cell, tmp_path):
    values = read_parameter_file(calibrated).values
    assert values["sensor.bias"] == pytest.approx(LOAD_CELL.bias, abs=0.1)
    assert values["sensor.mass"] == pytest.approx(LOAD_CELL.mass, abs=0.01)
    assert values["sensor.center_of_mass"] == pytest.approx(LOAD_CELL.center_of_mass, abs=0.002)
    assert values["medium.zeta"] == pytest.approx(0.8, abs=0.005)
    assert values["medium.zeta_error"] == 0.1  # another bed differs, however good the fit
    assert values["surface_height"] == pytest.approx(0.0, abs=2e-4)
    assert values["medium.mobilization_length"] == pytest.approx(0.003, abs=1e-4)
    assert values["medium.calibrated_depth"] == pytest.approx(0.038, abs=5e-4)
    assert values["sensor.quaternion"] == pytest.approx(LOAD_CELL.quaternion)
    assert (
        main(
            [
                "replay",
                str(cell / "pressed"),
                "--params",
                str(calibrated),
                "-o",
                str(tmp_path / "out"),
            ]
        )
        == 0
    )
    assert (
        json.loads((tmp_path / "out" / "summary.json").read_text())["quality_flags"]["deep"] == 0
    )


def test_a_replay_says_once_that_its_motion_is_of_a_kind_that_was_not_calibrated(
    calibrated, cell, tmp_path
):
    assert (
        read_parameter_file(calibrated).values["medium.calibrated_motions"]
        == "press, drag, withdrawal"
    )
    of_press = tmp_path / "of_press.yaml"
    assert calibrate(cell, ("pressed",), of_press) == 0
    assert read_parameter_file(of_press).values["medium.calibrated_motions"] == "press, withdrawal"
    for bag, file, times in (
        ("pressed", of_press, 0),
        ("dragged", calibrated, 0),
        ("dragged", of_press, 1),
    ):
        out = tmp_path / f"{bag}_{file.stem}"
        assert main(["replay", str(cell / bag), "--params", str(file), "-o", str(out)]) == 0
        warnings = json.loads((out / "summary.json").read_text())["warnings"]
        told = [warning for warning in warnings if "medium.calibrated_motions" in warning]
        assert len(told) == times
        assert all("drag" in warning for warning in told)


def test_files_that_are_kept_are_found_from_the_new_file(cell, tmp_path):
    tree = yaml.safe_load((cell / "cell.yaml").read_text())
    (tmp_path / "tool.stl").write_bytes(locate_mesh("plate").read_bytes())
    tree["/**"]["ros__parameters"] |= {
        "alpha_y": {"table": "tables/mine.csv"},
        "mesh.file": "tool.stl",
    }
    source = tmp_path / "source.yaml"
    source.write_text(yaml.safe_dump(tree))
    out = tmp_path / "out" / "deep" / "calibrated.yaml"
    given = ["calibrate", str(cell / "pressed"), "--params", str(source), "-o", str(out)]
    assert main([*given, "--fit", "surface"]) == 0
    assert (
        yaml.safe_load(out.read_text())["/**"]["ros__parameters"]["alpha_y.table"]
        == "../../tables/mine.csv"
    )
    assert (tmp_path / "tool.stl").samefile(read_parameter_file(out).mesh.file)


def test_a_fitted_bias_replaces_the_tare(cell, calibrated, tmp_path):
    """Else a recording that begins in the grains is refused with the file that was calibrated for it."""
    assert read_replay_options(calibrated).tare is None
    assert read_replay_options(calibrated).end == 1e7
    unfitted = tmp_path / "unfitted.yaml"
    assert calibrate(cell, ("pressed",), unfitted, "--fit", "surface") == 0
    assert read_replay_options(unfitted).tare == 0.5


def test_a_wrong_frame_is_named(cell, tmp_path, capsys):
    wrong = yaml.safe_load((cell / "cell.yaml").read_text())
    wrong["/**"]["ros__parameters"] |= {"world_frame": "base", "sensor_frame": "tool0"}
    (tmp_path / "wrong.yaml").write_text(yaml.safe_dump(wrong))
    given = [
        str(cell / "pressed"),
        "--params",
        str(tmp_path / "wrong.yaml"),
        "-o",
        str(tmp_path / "out.yaml"),
    ]
    assert main(["calibrate", *given]) == 2
    (sentence,) = capsys.readouterr().err.splitlines()
    assert "pose frame_id 'world' is not world_frame 'base'" in sentence
    assert "twist frame_id 'world' is neither world_frame 'base' nor tool_frame 'tool'" in sentence
    assert "wrench frame_id 'ft_sensor' is not sensor_frame 'tool0'" in sentence


def test_other_nodes_stay_and_the_record_names_bags_dates_and_errors(calibrated, cell, tmp_path):
    assert yaml.safe_load(calibrated.read_text())["other_node"] == {"ros__parameters": {"kept": 1}}
    found = record(calibrated)
    assert found["bags"] == ["pressed (2020-09-13T12:26:40Z)", "dragged (2020-09-13T12:26:40Z)"]
    assert set(found["fitted"]["sensor_mass"]) == {
        "value",
        "standard_error",
        "unit",
        "goodness",
        "source",
    }
    assert 0.0 < found["fitted"]["medium_zeta"]["standard_error"][0] < 0.01
    assert set(found["motions"]) == {"press", "drag", "withdrawal", "rest"}
    assert found["motions"]["drag"]["zeta"] == pytest.approx(0.8, abs=0.03)
    again = tmp_path / "calibrated.yaml"
    assert calibrate(cell, ("pressed", "dragged"), again) == 0
    assert again.read_bytes() == calibrated.read_bytes()


def test_what_is_asked_for_and_not_identifiable_is_a_failure(cell, tmp_path, capsys):
    out = tmp_path / "out.yaml"
    assert calibrate(cell, ("pressed",), out, "--fit", "zeta") == 2
    assert "cell.yaml': no fit uses its tare of 0.5 s; add --fit sensor" in capsys.readouterr().err
    untared = tmp_path / "untared.yaml"
    untared.write_text((cell / "cell.yaml").read_text().replace("tare: 0.5", "tare: 0"))
    given = (
        "calibrate",
        str(cell / "pressed"),
        "--params",
        str(untared),
        "-o",
        str(out),
        "--end",
        "6",
    )  # in the air
    assert main([*given, "--fit", "zeta"]) == 1
    assert not out.exists()  # nothing is identifiable
    assert main([*given, "--fit", "zeta", "--fit", "sensor"]) == 1
    assert "sensor.bias" in out.read_text()
    assert any(
        line.startswith("medium.zeta: no vertical") for line in record(out)["not_identifiable"]
    )


def test_a_calibration_that_a_fault_would_spoil_writes_no_file(cell, tmp_path, capsys):
    """A wrong sign gave exit status 2, and a surface 100 mm off 0 and a file."""
    text = (cell / "cell.yaml").read_text()
    wrong = tmp_path / "wrong.yaml"
    out = tmp_path / "out.yaml"
    given = ["calibrate", str(cell / "pressed"), "--params", str(wrong), "-o", str(out)]
    for line in ("sensor.sign: 1.0", "surface_height: 0.1"):
        name, value = line.split(": ")
        tree = yaml.safe_load(text)
        tree["/**"]["ros__parameters"][name] = float(value)
        wrong.write_text(yaml.safe_dump(tree))
        assert main(given) == 1
        said = capsys.readouterr()
        assert name in said.err
        assert "no file was written" in said.out
        assert not out.exists()


def test_a_recording_that_identifies_the_bias_alone_is_a_failure_that_says_what_to_record(
    cell, tmp_path, capsys
):
    """Such as of a tool that only hangs in the air: the exit status was 0."""
    time, states = (
        Path((0.0, 0.0, 0.05)).wait(2.0).move((0.0, 0.0, -0.02), 0.01).wait(1.0).states()
    )
    readings = read_by(
        LOAD_CELL, states, np.zeros((len(time), 6)), np.random.default_rng(1), noise=(0.1, 0.002)
    )
    write_run(tmp_path / "in_the_air", time, states, readings)
    out = tmp_path / "out.yaml"
    given = [
        "calibrate",
        str(tmp_path / "in_the_air"),
        "--params",
        str(cell / "cell.yaml"),
        "-o",
        str(out),
    ]
    assert main(given) == 1
    assert "push the tool straight down into the grains" in capsys.readouterr().out
    assert set(record(out)["fitted"]) == {"sensor_bias"}
    assert main([*given, "--fit", "sensor"]) == 1  # the mass was asked for, too


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (
            ("--mesh", "elsewhere=plate"),
            "--mesh 'elsewhere=plate' is not BAG=FILE with one of the bags ",
        ),
        (("--start", "1e6"), "pressed"),
    ],
)
def test_wrong_options_are_a_sentence(cell, tmp_path, capsys, more, sentence):
    assert calibrate(cell, ("pressed",), tmp_path / "out.yaml", *more) == 2
    error = capsys.readouterr().err
    assert sentence in error
    assert "Traceback" not in error


def test_bags_of_one_name_have_meshes_of_their_own_by_path(cell, tmp_path, monkeypatch):
    def stopped(bag, config, _):
        meshes[bag.parent.name] = config.mesh.file
        if len(meshes) == 3:
            raise InputError("enough")

    meshes = {}
    monkeypatch.setattr("rft_ros.commands.calibrate.read_track", stopped)
    monkeypatch.setattr("rft_ros.commands.calibrate.check_recordings", lambda *_, **__: None)
    bags = [str(tmp_path / folder / "rec") for folder in "abc"]
    given = ("--mesh", "rec=sphere", "--mesh", f"{bags[1]}=scoop")
    command = ["calibrate", *bags, "--params", str(cell / "cell.yaml"), *given]
    assert main([*command, "-o", str(tmp_path / "out.yaml")]) == 2
    assert meshes == {"a": "sphere", "b": "scoop", "c": "sphere"}


def test_samples_that_repeat_a_stamp_are_left_out(tmp_path):
    """A bag played and recorded in a loop."""
    once = list(plunge())
    again = [(role, time + 10**10, stamp, values) for role, time, stamp, values in once]
    single, looped = (
        read_track(write_ros2(tmp_path / n, rows), parameters())
        for n, rows in (("a", once), ("b", once + again))
    )
    np.testing.assert_array_equal(looped.time, single.time)
    np.testing.assert_allclose(looped.smooth, single.smooth)


@pytest.mark.parametrize(
    ("value", "error", "kept"),
    [(1.23456789, 0.1, 1.235), (1.23456789, 0.0, 1.23456789), (123.456, 20.0, 123.5)],
)
def test_digits_end_at_a_hundredth_of_the_error(value, error, kept):
    assert rounded(value, error) == kept


def test_a_doubt_of_the_fit_is_said_and_stays_in_the_file(cell, tmp_path, capsys):
    """A load cell in another place than it has."""
    tree = yaml.safe_load((cell / "cell.yaml").read_text())
    tree["/**"]["ros__parameters"]["sensor.position"] = [0.1, -0.02, -0.1]
    wrong, out = tmp_path / "wrong.yaml", tmp_path / "out.yaml"
    wrong.write_text(yaml.safe_dump(tree))
    given = ["calibrate", str(cell / "pressed"), "--params", str(wrong), "-o", str(out)]
    assert main([*given, "--fit", "sensor", "--fit", "zeta"]) == 0
    kept = record(out)["warnings"]
    assert any("sensor.position" in sentence for sentence in kept)
    said = capsys.readouterr().err
    assert all(sentence in said for sentence in kept)


def test_a_delay_that_is_not_identifiable_is_no_failure(cell, tmp_path):
    """It needs a turn in the grains, and the load cell's other values do not."""
    out = tmp_path / "out.yaml"
    assert calibrate(cell, ("pressed",), out, "--fit", "sensor", "--end", "7.5") == 0
    assert any(line.startswith("sensor.delay:") for line in record(out)["not_identifiable"])
    assert "sensor_mass" in record(out)["fitted"]
