"""Whether an exponent of depth earns its place: RMS residuals on penetrations that it was not fitted to.

Run from the project's root, with the reference data beside it: python bench/depth_exponent.py [../shared/data]
"""

import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import trimesh

from rft_ros.bags.playback import read_replay_options
from rft_ros.calibration import Options, calibrate, read_track
from rft_ros.calibration.depth_exponent import PowerOfDepth, fit_exponent
from rft_ros.calibration.penetration import Penetration, penetration_of
from rft_ros.estimator.parameters import defaults, read_parameter_file
from rft_ros.rft import MEDIA, Law, alpha_y_model, checked_states, rotation_matrix, treers2021
from rft_ros.tool import load_tool

LAW: Law = treers2021(MEDIA["generic"], alpha_y_model("constant", MEDIA["generic"]), zeta=1.0)
CMU = {60: "60mm_1", 80: "80mm_7", 100: "100mm_4"}
DEM = {
    "pen_plate_seedA": "plate",
    "plate_b30_psi30_phi60": "plate",
    "plate_b60_psi0_phi30": "plate",
    "plate_b60_psi30_phi30": "plate",
    "ellipsoid_straight": "ellipsoid",
    "root_insert_tilt10": "paraboloid",
}


def round_plate(folder: Path, diameter: int) -> str:
    """The mesh of a round plate 10 mm thick [mm], its lower face at z = 0 up to 10: the recordings' z points down."""
    file = folder / f"disc_{diameter}mm.stl"
    trimesh.creation.cylinder(radius=0.5 * diameter, height=10.0, sections=96).export(file)
    return str(file)


def abb(data: Path) -> list[Penetration]:
    """Both trials, each with its own surface and tare."""
    file = Path(__file__).parents[1] / "config" / "abb_plate.yaml"
    values, options = read_parameter_file(file), read_replay_options(file)
    found: list[Penetration] = []
    for trial in (2, 3):
        track = read_track(data / "abb_plate" / f"abb_plate_{trial}", values, remap=options.remap)
        fit = calibrate([track], values, Options(parts=("sensor", "surface", "zeta"))).zeta
        found += fit.penetrations if fit else ()
    return found


def cmu(data: Path) -> list[Penetration]:
    """The three round plates, each with its own surface and tare."""
    found: list[Penetration] = []
    with TemporaryDirectory() as folder:
        for diameter, name in CMU.items():
            values = {
                **defaults(),
                "mesh.file": round_plate(Path(folder), diameter),
                "mesh.scale": 0.001,
                "mesh.origin": (0.0, 0.0, 5.0),
                "tolerance": 0.0,
                "twist_source": "pose_difference",
            }
            rules = ["~/pose:=/tool_pose", "~/wrench_measured:=/ft_sensor/wrench"]
            track = read_track(data / "cmu_plate" / f"cmu_plate_large_{name}", values, remap=rules)
            fit = calibrate([track], values, Options(parts=("sensor", "surface", "zeta"))).zeta
            found += fit.penetrations if fit else ()
    return found


def dem(data: Path) -> list[Penetration]:
    """Simulated runs that go deeper as they go, vertical force smoothed over 9 samples."""
    found: list[Penetration] = []
    for name, mesh in DEM.items():
        rows = np.loadtxt(data / "dem" / f"{name}.csv", delimiter=",", skiprows=1)
        rows = rows[np.any(rows[:, 8:14] != 0.0, axis=1)]
        tool = load_tool(str(data / "dem" / "meshes" / f"{mesh}.stl"), scale=1.0)
        states = checked_states(rows[:, 1:14])
        force = np.convolve(rows[:, 16], np.full(9, 1.0 / 9.0), "same")
        depth = -np.array([s[2] + tool.lowest_point(rotation_matrix(s[3:7])) for s in states])
        used = np.flatnonzero(depth > 0.0)[5:-8]
        found.append(penetration_of(name, tool.plates, states[used], depth[used], force[used], law=LAW, surface=0.0))
    return found


def held_out(test: Penetration, fitted: Sequence[Penetration]) -> tuple[float, float, float]:
    """Exponent from the `fitted`, and RMS over the peak that p = 1 and that exponent leave on `test`."""
    powers = [PowerOfDepth(p, LAW) for p in fitted]
    exponent = float(np.mean([fit_exponent(p, LAW).value for p in fitted]))
    target = PowerOfDepth(test, LAW)
    rest = [target.misfit(float(np.mean([p.zeta(e) for p in powers])), e) for e in (1.0, exponent)]
    return exponent, rest[0], rest[1]


def main() -> None:
    """Print the table of docs/calibrate.md."""
    data = Path(sys.argv[1] if len(sys.argv) > 1 else "../shared/data")
    sets: dict[str, Callable[[Path], list[Penetration]]] = {"abb": abb, "cmu": cmu, "dem": dem}
    print("| predicted | own p | fitted to | p fitted | RMS, p = 1 | RMS, p fitted |\n|---|---|---|---|---|---|")
    for label, read in sets.items():
        runs = read(data)
        rests = []
        for k, run in enumerate(runs):
            others = [r for i, r in enumerate(runs) if i != k] if label != "dem" else runs[:1]
            if label == "dem" and k == 0:
                continue
            own = fit_exponent(run, LAW)
            exponent, one, fitted = held_out(run, others)
            rests.append((one, fitted))
            names = others[0].bag if len(others) == 1 else "the others"
            print(f"| {run.bag} | {own.value:.2f} | {names} | {exponent:.2f} | {one:.1%} | {fitted:.1%} |")
        one, fitted = np.mean(rests, axis=0)
        print(f"| **{label}, mean** | | | | **{one:.1%}** | **{fitted:.1%}** |")


if __name__ == "__main__":
    main()
