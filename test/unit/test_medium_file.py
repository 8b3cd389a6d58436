"""A medium of one's own: the files that give it, where it is used, and the command that fits it."""

import numpy as np
import pytest
import yaml
from refusals import refusal

import rft_ros
from rft_ros.cli import main
from rft_ros.parameters import (
    Config,
    config_of_options,
    read_medium,
    read_parameter_file,
)
from rft_ros.parameters.medium_file import read_stress_map
from rft_ros.rft import MEDIA
from rft_ros.sweeps.design import read_design
from rft_ros.sweeps.run import RESULTS, rows_of

LOOSE = MEDIA["poppy_seeds_loose"]
DEGREES = [(float(b), float(g)) for b in range(-75, 91, 15) for g in range(-75, 91, 15)]


def cells(beta=1.0, gamma=1.0, stress=1.0):
    """Rows of beta, gamma, alpha_x, alpha_z of loose poppy seeds, each times a factor."""
    angles = np.deg2rad(DEGREES).T
    x, z = LOOSE.stresses(*angles)
    return [
        (b * beta, g * gamma, x * stress, z * stress)
        for (b, g), x, z in zip(DEGREES, x, z, strict=True)
    ]


def lines(rows, order=(0, 1, 2, 3), separator=","):
    return "".join(separator.join(f"{row[k]:.9g}" for k in order) + "\n" for row in rows)


@pytest.fixture
def write(tmp_path):
    def text_of(text, name="map.csv"):
        (tmp_path / name).write_text(text)
        return tmp_path / name

    return text_of


def test_a_map_is_read_by_the_names_and_units_of_its_header(write):
    in_degrees = write(
        "# a plate\nbeta_deg;gamma_deg;alpha_x;alpha_z\n"
        + lines(cells(), separator=";").replace(".", ",")
    )
    header = "alpha_z (Pa/m)\talpha_x [N/cm³]\tgamma_rad\tbeta\n"
    mixed = write(header + lines(MIXED, (3, 2, 1, 0), separator="\t"), "mixed.csv")
    for file in (in_degrees, mixed):
        medium = read_medium(str(file))
        assert medium.coefficients == pytest.approx(LOOSE.coefficients, abs=1e-6)
        assert (medium.name, medium.doubts) == (file.stem, ())


MIXED = [(beta, gamma * np.pi / 180, x, 1e6 * z) for beta, gamma, x, z in cells()]


HEADER = "beta_deg,gamma_deg,alpha_x,alpha_z\n"
BARE = "beta,gamma,alpha_x,alpha_z\n"


@pytest.mark.parametrize("header", [HEADER, "beta [°],gamma(deg),alpha_x,alpha_z\n"])
def test_small_angles_are_believed_where_the_header_says_that_they_are_degrees(write, header):
    few = [(b, g, x, z) for b, g, x, z in cells() if abs(b) < 31.0 and abs(g) < 31.0]
    small = lines([(0.1 * b, 0.1 * g, x, z) for b, g, x, z in few])
    measured = read_stress_map(write(header + small))
    assert measured.beta.max() == pytest.approx(np.deg2rad(3.0))
    assert "beta_deg" in refusal(read_stress_map, write(BARE + small))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("beta_deg,gamma_deg,alpha_x\n0,90,0\n", ("no column alpha_z", "N/cm3")),
        (
            "beta_deg,gamma_deg,alpha_x_Pa,alpha_z_Pa\n0,90,0,1000\n",
            ("no column alpha_x", "N/cm3", "'alpha_x_Pa'"),
        ),
        (HEADER + "0,inf,0.1,0.1\n", ("line 2", "gamma is inf", "finite")),
        (HEADER + "0,nan,0.1,0.1\n", ("line 2", "gamma is nan", "finite")),
        (HEADER + "0,90,0.1,inf\n", ("line 2", "alpha_z is inf", "finite")),
        (HEADER + lines(cells(stress=1e6)), ("N/cm³", "Pa/m")),
        (HEADER + lines(cells(stress=1e-5)), ("N/cm³", "Pa/m")),
        (BARE + lines(cells(np.pi / 180, np.pi / 180)), ("beta_rad", "beta_deg")),
        (
            BARE + lines(cells(np.pi / 180)),
            ("different beta, none beyond 1.57", "beta_rad", "beta_deg"),
        ),
        (BARE + lines(cells(gamma=np.pi / 180)), ("different gamma", "gamma_rad", "gamma_deg")),
        (HEADER.replace("deg", "rad") + lines(cells()), ("degrees", "beta_deg")),
        (HEADER + "0,90,,\n", ("up to 0 N/cm³",)),
        (HEADER + lines(cells(stress=-1.0)), ("along the motion",)),
    ],
)
def test_a_map_that_cannot_be_used_is_refused_by_file_and_place(write, text, words):
    file = write(text)
    sentence = refusal(read_medium, str(file))
    assert str(file) in sentence
    for word in words:
        assert word in sentence


def test_coefficients_are_read_from_yaml_under_their_names_or_lis(write):
    plain = write(yaml.safe_dump(LOOSE.coefficients), "poppy.yaml")
    lis = {name.replace("m11", "-11"): value for name, value in LOOSE.coefficients.items()}
    nested = write(yaml.safe_dump({"name": "poppy", "coefficients": lis}), "other.yml")
    assert read_medium(str(plain)) == read_medium(str(nested))
    assert read_medium(str(plain)).coefficients == LOOSE.coefficients


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"A00": None}, ("A00 is None", "all nine")),
        ({"B11": "0.2"}, ("B11 is '0.2'", "number")),
        ({"C01": float("nan")}, ("line 6", ".nan", "number")),
        ({"A10": 47000.0}, ("A10 is 47000", "N/cm³")),
        (
            {name: -value for name, value in LOOSE.coefficients.items()},
            ("along the motion", "signs"),
        ),
        ({name: 1e-6 * value for name, value in LOOSE.coefficients.items()}, ("N/cm³",)),
    ],
)
def test_coefficients_that_cannot_be_used_are_refused_by_file_and_name(write, change, words):
    file = write(yaml.safe_dump({**LOOSE.coefficients, **change}), "mine.yaml")
    sentence = refusal(read_medium, str(file))
    assert str(file) in sentence
    for word in words:
        assert word in sentence


def test_fit_medium_writes_coefficients_errors_misfit_and_a_picture_and_they_come_back(
    write, tmp_path, capsys
):
    rows = [f"{b},{g},{x},{z if b or g != 30 else ''}" for b, g, x, z in cells()]
    map_file, out, figure = (
        write(HEADER + "\n".join(rows)),
        tmp_path / "mine.yaml",
        tmp_path / "map.png",
    )
    assert main(["fit-medium", str(map_file), "-o", str(out), "--figure", str(figure)]) == 0
    said = capsys.readouterr()
    assert "144 cells" in said.out
    assert said.err == ""
    written = yaml.safe_load(out.read_text())
    assert written["coefficients"] == pytest.approx(LOOSE.coefficients, abs=1e-6)
    assert written["errors"].keys() == LOOSE.coefficients.keys()
    assert written["misfit"]["fitted"] < 1e-6 < written["misfit"]["generic_scaled"]
    assert figure.read_bytes()[:4] == b"\x89PNG"
    assert read_medium(str(out)) == read_medium(str(map_file)).of("mine", written["coefficients"])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["-o", "mine.txt"], ("mine.txt", ".yaml")),
        (["-o", "mine.yaml", "--figure", "map.gif"], ("map.gif", ".png")),
        (["-o", "mine.yaml", "--figure", "mine.yaml"], ("mine.yaml", ".png")),
    ],
)
def test_fit_medium_refuses_outputs_that_it_cannot_write(
    write, tmp_path, monkeypatch, capsys, arguments, words
):
    monkeypatch.chdir(tmp_path)
    assert main(["fit-medium", str(write(HEADER + lines(cells()))), *arguments]) == 2
    err = capsys.readouterr().err
    assert len(err.splitlines()) == 1
    for word in words:
        assert word in err


def test_a_map_with_wrong_cells_is_warned_of_by_every_command_that_uses_it(
    write, tmp_path, capsys
):
    rows = cells()
    rows[70] = (*rows[70][:3], 2.0)
    wrong = write(HEADER + lines(rows))
    states = write(
        "t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz\n0,0,0,-0.02,0,0,0,1,0,0,-0.01,0,0,0\n",
        "states.csv",
    )
    for command in (
        ["fit-medium", str(wrong), "-o", str(tmp_path / "wrong.yaml")],
        [
            "predict",
            str(states),
            "--mesh",
            "plate",
            "--medium",
            str(wrong),
            "-o",
            str(tmp_path / "out.csv"),
        ],
    ):
        assert main(command) == 0
        assert (
            f"furthest from the cells beta {rows[70][0]:g}, gamma {rows[70][1]:g} "
            in capsys.readouterr().err
        )


def test_a_parameter_file_names_a_medium_beside_it_in_place_of_medium_name(write, tmp_path):
    write(yaml.safe_dump(LOOSE.coefficients), "poppy.yaml")
    file = write("/**:\n  ros__parameters:\n    medium.file: poppy.yaml\n", "cell.yaml")
    values = read_parameter_file(file).values
    assert values["medium.file"] == str(tmp_path / "poppy.yaml")
    law = Config.of(values).model().law
    assert (law.medium.name, law.stresses["medium"], law.medium.coefficients) == (
        "poppy",
        "poppy",
        LOOSE.coefficients,
    )
    assert "medium.file '/no/where.yaml' does not exist" in refusal(
        lambda given: Config.of(given).model(),
        {**Config().values, "medium.file": "/no/where.yaml"},
    )


def test_predict_and_sweep_take_a_file_where_they_take_the_name_of_a_medium(write, tmp_path):
    own = write(yaml.safe_dump(LOOSE.coefficients), "poppy.yaml")
    states = write(
        "t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz\n0,0,0,-0.02,0,0,0,1,0,0,-0.01,0,0,0\n",
        "states.csv",
    )
    forces = []
    for medium in ("poppy_seeds_loose", str(own)):
        out = tmp_path / "out.csv"
        assert (
            main(["predict", str(states), "--mesh", "plate", "--medium", medium, "-o", str(out)])
            == 0
        )
        forces.append(out.read_text())
    assert forces[0] == forces[1]
    assert (
        main(
            [
                "predict",
                str(states),
                "--mesh",
                "plate",
                "--medium",
                "mars",
                "-o",
                str(tmp_path / "out.csv"),
            ]
        )
        == 2
    )
    assert config_of_options({"medium": "poppy_seeds_loose"}).medium.file == ""

    study = "tools: [{mesh: plate}]\nmotions: [{family: straight, travel: 0.02, samples: 9}]\n"
    design = read_design(
        write(f"{study}media: [{{medium: [poppy_seeds_loose, {own}]}}]\n", "study.yaml")
    )
    before = design.fingerprint()
    named, of_file = rows_of(design.variants, RESULTS, design.contents())
    assert named == of_file
    own.write_text(yaml.safe_dump(MEDIA["generic"].coefficients))
    assert design.fingerprint() != before
    peak = RESULTS.index("peak_fz")
    stronger = rows_of(design.variants[1:], RESULTS, design.contents())[0][peak]
    assert float(stronger) > 2.0 * float(named[peak])


def test_a_medium_is_read_from_python_by_the_name_of_the_package(write):
    file = write(HEADER + lines(cells()))
    assert rft_ros.read_medium(str(file)) == read_medium(str(file))
