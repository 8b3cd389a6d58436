"""Simulated runs in glass beads (discrete elements): reading them, fitting ζ to one, the error of a prediction.

The folder `dem` of the reference data, which is not part of this project; its README says how the runs were made and
defines the error measure.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError, reason_of
from rft_ros.rft import STATE, Law, Memory, checked_states, wrenches, wrenches_in_time
from rft_ros.tool import Tool, load_tool

__all__ = ["CALIBRATION", "RUNS", "DemRun", "fitted_zeta", "median_error", "read_run", "smoothed"]

Array = NDArray[np.float64]

CALIBRATION = "pen_plate_seedA"
"""The run that ζ is fitted to; no other."""

RUNS = {
    CALIBRATION: "flat plate, straight down",
    "plate_b30_psi30_phi60": "plate β 30° ψ 30° φ 60°",
    "plate_b60_psi0_phi30": "plate β 60° ψ 0° φ 30°",
    "plate_b60_psi30_phi30": "plate β 60° ψ 30° φ 30°",
    "plate_b90_psi0_phi0": "plate β 90° ψ 0° φ 0°",
    "plate_b90_psi30_phi0": "plate β 90° ψ 30° φ 0°",
    "plate_b90_psi90_phi0": "plate β 90° ψ 90° φ 0° (moves along itself: neither face leads)",
    "ellipsoid_straight": "ellipsoid, straight down",
    "ellipsoid_osc9deg_5Hz": "ellipsoid, ±9° of pitch at 5 Hz",
    "root_insert_tilt10": "root tip, pushed in at 10°",
    "root_helix_P40_tilt10": "root tip, helix of 40 mm pitch",
}
"""The runs, and what they are."""

_MESHES = {"pen": "plate", "plate": "plate", "ellipsoid": "ellipsoid", "root": "paraboloid"}
_HEADER = ("t_s", *STATE, "fx", "fy", "fz", "tx", "ty", "tz")

_WINDOW = 9  # samples of the centred mean; the grains' own noise is faster
_FIRST, _LAST = 5, -8  # samples that this mean lacks neighbours for, or nearly
_STRONG = 0.2  # of the peak: below it, noise decides the relative error


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DemRun:
    """One run, rows with the tool at rest dropped.

    `times` [s], shape [n]. `states`: shape [n, 13], columns `rft_ros.rft.STATE`. `forces`: on the tool by the grains
    [N], shape [n, 3], world axes.
    """

    name: str
    tool: Tool
    times: Array
    states: Array
    forces: Array

    def predicted(self, law: Law, *, mobilization_length: float = 0.0, threads: int | None = None) -> Array:
        """The model's force at each state [N], shape [n, 3]; of plates that remember, over a length [m]."""
        plates = self.tool.plates
        if mobilization_length == 0.0:
            return wrenches(plates, law, self.states, threads=threads)[:, :3]
        return wrenches_in_time(
            plates,
            law,
            self.states,
            np.diff(self.times, prepend=self.times[0]),
            Memory.of(plates),
            mobilization_length=mobilization_length,
        )[:, :3]


def read_run(data: Path, name: str) -> DemRun:
    """A run of the reference data in the folder `data`. Raises InputError that names the file."""
    file = data / "dem" / f"{name}.csv"
    try:
        with file.open(encoding="utf-8") as lines:
            header = tuple(next(lines, "").strip().split(","))
            if header != _HEADER:
                raise InputError(f"'{file}' has the header {','.join(header)}; it must be {','.join(_HEADER)}")
            rows = np.loadtxt(lines, delimiter=",", ndmin=2)
        states = checked_states(rows[:, 1:14])
    except InputError:
        raise
    except (OSError, ValueError) as error:
        raise InputError(f"'{file}' is no run of the reference data: {reason_of(error)}") from None
    moving = np.any(states[:, 7:13] != 0.0, axis=1)
    mesh = data / "dem" / "meshes" / f"{_MESHES[name.split('_')[0]]}.stl"
    return DemRun(
        name=name,
        tool=load_tool(str(mesh), scale=1.0),
        times=rows[moving, 0],
        states=states[moving],
        forces=rows[moving, 14:17],
    )


def fitted_zeta(run: DemRun, law_at_one: Law) -> float:
    """ζ by least squares of the force vectors, where the vertical force is above a fifth of its greatest."""
    model = run.predicted(law_at_one)
    strong = run.forces[:, 2] > _STRONG * run.forces[:, 2].max()
    return float((run.forces[strong] * model[strong]).sum() / (model[strong] ** 2).sum())


def smoothed(forces: Array) -> Array:
    """The centred mean of nine samples, shape as given; at the ends it runs out of neighbours."""
    return np.apply_along_axis(np.convolve, 0, forces, np.full(_WINDOW, 1.0 / _WINDOW), "same")


def median_error(measured: Array, model: Array) -> float:
    """Median of abs(model - measured) / abs(measured) of force vectors, shape [n, 3].

    Of those above 20 % of the peak; the measured force is smoothed first, and its ends are dropped.
    """
    smooth = smoothed(measured)[_FIRST:_LAST]
    size = np.linalg.norm(smooth, axis=1)
    used = size > _STRONG * size.max()
    return float(np.median(np.linalg.norm(model[_FIRST:_LAST] - smooth, axis=1)[used] / size[used]))
