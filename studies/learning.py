"""The medium learned from the measured force: simulated grains, a plate on a robot arm, round plates, repeated passes.

Every prediction uses what was learned at least `lag` of path before. The recordings lie outside of the project, in
``../shared/data``; without them the study has the simulated runs only.
"""

import io
from collections.abc import Callable, Mapping
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any

import numpy as np
import trimesh
import yaml
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rft_ros.bags.options import ReplayOptions, read_replay_options
from rft_ros.calibration.track import read_track
from rft_ros.cli import main
from rft_ros.estimator import is_withdrawn, predict_without_learning
from rft_ros.estimator.learning import Learning
from rft_ros.parameters import Config, Values, read_parameter_file
from rft_ros.parameters.config import CALIBRATED_ERROR
from rft_ros.rft import (
    ANGULAR_VELOCITY,
    TWIST,
    VELOCITY,
    Law,
    Memory,
    Plates,
    wrenches,
    wrenches_in_time,
)
from studies.choice import PUBLISHED, REMEMBERED, Choice
from studies.dem import RUNS, modelled, read_run, smoothed
from studies.result import (
    BLUE,
    GREY,
    ORANGE,
    VERMILION,
    StudyResult,
    TextTable,
    label_axes,
    new_figure,
)

__all__ = [
    "LAGS",
    "MODELS",
    "PASSES",
    "Learned",
    "Series",
    "bag_series",
    "dem_series",
    "followed_force",
]
__all__ += [
    "in_sigmas",
    "learned",
    "model_rows",
    "pass_errors",
    "passes_of",
    "series_of",
    "study",
    "unlearned",
]

Array = NDArray[np.float64]

LAGS = (0.002, 0.005)
"""Path [m] between the last sample that a prediction knows and the prediction."""

_ROOT = Path(__file__).resolve().parents[1]
_RECORDINGS = _ROOT.parent / "shared" / "data"
_ROUND_PLATES = {
    "cmu_plate_large_60mm_1": 60,
    "cmu_plate_large_80mm_7": 80,
    "cmu_plate_large_100mm_4": 100,
}
PASSES = "multipass_plate_b90_d15"
"""The run of four passes."""
_FRESH = ("drag_plate_b90_d15_y22", "fast_plate_b90_0p1mps_ref")
_BLOCK = "buried_block"
_INERTIAL = 0.2  # m/s, of the tool frame's origin
_Error = Callable[["Series", Array], float]


MODELS = (PUBLISHED, REMEMBERED)
"""The models with which learning is judged."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Series:
    """The model and the measured force along one run of n samples.

    `plates`, `law`: of the model. `states`: shape [n, 13], columns `rft_ros.rft.STATE`; `stamps` [ns]; `speeds` of the
    tool's fastest point [m/s];
    `passing`: withdrawn, or so fast that inertia matters; `rows`: the model, shape [n, 19], columns of `wrenches` with
    sensitivities; `forces`: measured, world axes [N], shape [n, 3]; `judged`: the samples that count; `expected`: what
    they are compared with [N], shape [n, 3]. `strength_error`: relative standard error of ζ.
    """

    name: str
    plates: Plates
    law: Law
    states: Array
    stamps: NDArray[np.int64]
    speeds: Array
    passing: NDArray[np.bool_]
    rows: Array
    forces: Array
    judged: NDArray[np.int64]
    expected: Array
    strength_error: float = CALIBRATED_ERROR

    @property
    def reach(self) -> float:
        """Greatest distance of the tool's surface from the tool frame's origin [m]."""
        return self.plates.reach

    @property
    def steps(self) -> Array:
        """Path of the fastest point since the sample before [m], shape [n]."""
        return np.concatenate(
            [[0.0], 0.5 * (self.speeds[1:] + self.speeds[:-1]) * np.diff(self.stamps) * 1e-9]
        )

    @property
    def path(self) -> Array:
        """Path of the fastest point in the grains [m], shape [n]."""
        wet = self.rows[:, 6] > 0.0
        wet[0] = False
        return np.cumsum(self.steps * wet)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Learned:
    """Predictions and standard deviations, shape [n, 12]; surprise at each sample, shape [n]; the filter at the end."""

    out: Array
    surprise: NDArray[np.str_]
    learning: Learning

    def reports(self) -> NDArray[np.int64]:
        """Samples at which a surprise begins."""
        return np.flatnonzero((self.surprise != "") & (self.surprise != ["", *self.surprise[:-1]]))


def learned(series: Series, *, lag: float, forces: Array | None = None) -> Learned:
    """A series through the filter, with its own measured forces [N] or others, shape [n, 3]."""
    learning = Learning(lag=lag, reach=series.reach, strength_error=series.strength_error)
    measured = series.forces if forces is None else forces
    out, surprise = np.empty((len(series.stamps), 12)), np.full(len(series.stamps), "", "U6")
    steps = series.steps
    for k, stamp in enumerate(series.stamps.tolist()):
        row, step, passing = series.rows[k], float(steps[k]), bool(series.passing[k])
        out[k] = learning.predict(stamp, row, step=step, passing=passing)
        learning.learn(stamp, measured[k])
        surprise[k] = learning.change
    return Learned(out=out, surprise=surprise, learning=learning)


def model_rows(plates: Plates, law: Law, states: Array, *, surface: float = 0.0) -> Array:
    """What the filter needs of the model at each state, shape [n, 19]."""
    if not law.has_memory:
        return wrenches(plates, law, states, surface_height=surface, sensitivities=True, threads=1)
    return wrenches_in_time(
        plates, law, states, Memory(plates), surface_height=surface, sensitivities=True
    )


def series_of(
    name: str,
    plates: Plates,
    law: Law,
    states: Array,
    times: Array,
    forces: Array,
    *,
    rest: float,
    surface: float = 0.0,
) -> Series:
    """A series in which every sample counts, as measured; below the speed `rest` [m/s] the tool is at rest."""
    linear, angular = states[:, VELOCITY], states[:, ANGULAR_VELOCITY]
    speeds = np.linalg.norm(linear, axis=1) + plates.reach * np.linalg.norm(angular, axis=1)
    states, at_rest = states.copy(), speeds < rest
    states[at_rest, TWIST], speeds[at_rest] = 0.0, 0.0
    rows, velocities = model_rows(plates, law, states, surface=surface), states[:, VELOCITY]
    motions = zip(velocities[:, 2].tolist(), speeds.tolist(), rows[:, :3].tolist(), strict=True)
    withdrawn = np.array(
        [is_withdrawn(up, speed, (fx, fy, fz)) for up, speed, (fx, fy, fz) in motions]
    )
    passing = withdrawn | (np.linalg.norm(velocities, axis=1) > _INERTIAL)
    return Series(
        name=name,
        plates=plates,
        law=law,
        states=states,
        stamps=(1e9 + np.round((times - times[0]) * 1e9)).astype(np.int64),
        speeds=speeds,
        passing=passing,
        rows=rows,
        forces=forces,
        judged=np.arange(len(times)),
        expected=forces,
    )


@cache
def dem_series(name: str, choice: Choice) -> Series:
    """A simulated run with ζ from the calibration run; the samples that count are those of the data's README."""
    run, law = read_run(name, choice, rests=True), choice.made(modelled(choice)[1])
    series = series_of(name, run.tool.plates, law, run.states, run.times, run.forces, rest=1e-9)
    moving = np.flatnonzero(np.any(run.states[:, TWIST] != 0.0, axis=1))
    smooth = np.zeros_like(run.forces)
    smooth[moving] = smoothed(run.forces[moving])
    inner = moving[5:-8]
    size = np.linalg.norm(smooth[inner], axis=1)
    return replace(series, judged=inner[size > 0.2 * size.max()], expected=smooth)


@cache  # several studies use them
def bag_series(group: str, choice: Choice) -> list[Series]:
    """The recordings of a group, `abb` or `cmu`, calibrated together; the samples that count are those on the way in.

    `wheel`: wheels pressed into the sand of `cmu`, with what was fitted to its round plates. [] where the recordings
    are absent.
    """
    if not _RECORDINGS.is_dir():
        return []
    fitted = replace(choice, name="fitted", tolerance=0.0, lag=0.0)
    file = calibrated("cmu" if group == "wheel" else group, fitted)
    values, options = read_parameter_file(file).values, read_replay_options(file)
    with TemporaryDirectory() as folder:
        bags, meshes = _recordings(group, Path(folder))
        return [
            _recorded(bag, {**values, **meshes.get(bag.name, {})}, options, choice) for bag in bags
        ]


@cache
def _folder_of_this_process() -> TemporaryDirectory[str]:
    return TemporaryDirectory()


@cache
def calibrated(group: str, choice: Choice) -> Path:
    """The parameter file that `rft calibrate` writes for the recordings of a group."""
    return calibrate(group, choice, Path(mkdtemp(dir=_folder_of_this_process().name)))


def calibrate(group: str, choice: Choice, folder: Path) -> Path:
    """Calibrate the recordings of a group in a folder; returns the parameter file there."""
    bags, meshes = _recordings(group, folder)
    first = next(iter(meshes.values()), {})
    given = {
        "law": choice.law,
        "integration": choice.integration,
        "alpha_y.model": choice.alpha_y,
        **first,
    }
    file, out = folder / "given.yaml", folder / "calibrated.yaml"
    file.write_text(_parameters(group, given))
    rules = [
        word for name, mesh in meshes.items() for word in ("--mesh", f"{name}={mesh['mesh.file']}")
    ]
    with redirect_stdout(io.StringIO()):
        main(["calibrate", *map(str, bags), "--params", str(file), *rules, "-o", str(out)])
    return out


def _recorded(bag: Path, values: Values, options: ReplayOptions, choice: Choice) -> Series:
    """A recording as a series, with these parameters and the choice's memory."""
    fitted = values["medium.mobilization_length"] or choice.mobilization_length
    length = fitted if choice.mobilization_length else 0.0
    own = {**values, "medium.mobilization_length": length, "tolerance": choice.tolerance}
    track = read_track(bag, own, options)
    config = Config.of(own)
    model = config.model()
    plates, law = model.tool.plates, model.law
    rest = config.inputs.rest_speed
    surface = config.surface_height
    series = series_of(
        bag.name, plates, law, track.states, track.time, track.forces, rest=rest, surface=surface
    )
    sinking = np.convolve(series.states[:, 9], np.full(21, 1.0 / 21.0), "same") < -rest
    deep = surface - track.heights > 0.0
    inward = np.flatnonzero(sinking & deep & (series.rows[:, 2] > 0.0) & (series.speeds > 0.0))
    return replace(
        series, judged=inward, strength_error=config.medium.zeta_error or CALIBRATED_ERROR
    )


def _recordings(group: str, folder: Path) -> tuple[list[Path], dict[str, dict[str, Any]]]:
    """The bags of a group, and the mesh's parameters of each that has one of its own."""
    if group == "abb":
        return [_RECORDINGS / "abb_plate" / f"abb_plate_{trial}" for trial in (2, 3)], {}
    if group == "wheel":
        wheel = {
            "mesh.file": str(_RECORDINGS / "cmu_wheel" / "smooth.stl"),
            "mesh.origin": (30.0, 0.0, 62.5),
        }
        bags = [_RECORDINGS / "cmu_wheel_press" / f"old_smooth_{trial}" for trial in (6, 7, 8)]
        return bags, {bag.name: wheel for bag in bags}
    meshes: dict[str, dict[str, Any]] = {}
    for name, diameter in _ROUND_PLATES.items():
        file = folder / f"{name}.stl"
        trimesh.creation.cylinder(radius=0.5 * diameter, height=10.0, sections=96).export(file)
        meshes[name] = {"mesh.file": str(file), "mesh.origin": (0.0, 0.0, 5.0)}
    return [_RECORDINGS / "cmu_plate" / name for name in meshes], meshes


def _parameters(group: str, given: Mapping[str, object]) -> str:
    """The text of the parameter file before the calibration."""
    plain = {
        name: list(value) if isinstance(value, tuple) else value for name, value in given.items()
    }
    if group == "abb":
        content = yaml.safe_load((_ROOT / "config" / "abb_plate.yaml").read_text())
        own = content["/**"]["ros__parameters"]
        own.pop("tolerance", None)
        return yaml.safe_dump({**content, "/**": {"ros__parameters": {**own, **plain}}})
    remap = {"remap": ["~/pose:=/tool_pose", "~/wrench_measured:=/ft_sensor/wrench"]}
    own = {"twist_source": "pose_difference", **plain}
    return yaml.safe_dump(
        {n: {"ros__parameters": p} for n, p in (("/**", own), ("rft_replay", remap))}
    )


def vector_error(series: Series, predicted: Array) -> float:
    """Median of abs(predicted - expected) / abs(expected) over the samples that count."""
    rows = series.judged
    size = np.linalg.norm(series.expected[rows], axis=1)
    return float(
        np.median(np.linalg.norm(predicted[rows, :3] - series.expected[rows], axis=1) / size)
    )


def peak_error(series: Series, predicted: Array) -> float:
    """RMS of the vertical residual over the greatest measured force."""
    rows = series.judged
    residual = predicted[rows, 2] - series.forces[rows, 2]
    return float(np.sqrt(np.mean(residual**2)) / np.abs(series.forces[:, 2]).max())


def pass_errors(series: Series, predicted: Array) -> list[float]:
    """`vector_error` of each level drag, less three samples at each end."""
    expected = smoothed(series.forces)
    return [
        vector_error(replace(series, judged=run[3:-3], expected=expected), predicted)
        for run in passes_of(series)
    ]


def passes_of(series: Series) -> list[NDArray[np.int64]]:
    """The samples of each level drag."""
    velocities = series.states[:, VELOCITY]
    moving = np.flatnonzero((velocities[:, 0] > 0.05) & (np.abs(velocities[:, 2]) < 1e-9))
    return [
        run for run in np.split(moving, np.flatnonzero(np.diff(moving) > 1) + 1) if len(run) > 50
    ]


def in_sigmas(series: Series, out: Array) -> Array:
    """Errors of the force components, as measured, over their standard deviations, shape [n, 3]."""
    rows = series.judged
    return np.asarray(np.abs(series.forces[rows] - out[rows, :3]) / out[rows, 6:9])


def unlearned(series: Series) -> Array:
    """The model's wrench and its standard deviations without learning, shape [n, 12]."""
    answers = np.empty((len(series.rows), 12))
    for row, answer in zip(series.rows, answers, strict=True):
        predict_without_learning(row, series.strength_error, series.reach, answer)
    return answers


def with_layer(series: Series, at: float, factor: float) -> Array:
    """The measured forces [N] with grains `factor` times as strong from `at` [m] of path, within 2 mm."""
    ramp = 1.0 + (factor - 1.0) * np.clip((series.path - at) / 0.002, 0.0, 1.0)
    return series.forces * ramp[:, None]


def study() -> tuple[StudyResult, StudyResult]:
    """Errors without and with learning; and what is reported as a surprise."""
    errors: list[tuple[str, ...]] = []
    reports: list[tuple[str, ...]] = []
    for choice in MODELS:
        dem = [dem_series(name, choice) for name in RUNS]
        groups: dict[str, tuple[list[Series], _Error]] = {
            "simulated grains, 11 runs": (dem, vector_error)
        }
        for group, title in (
            ("abb", "ABB plate, penetration"),
            ("cmu", "CMU round plates, penetration"),
        ):
            groups[title] = (bag_series(group, choice), peak_error)
        for title, (runs, error) in groups.items():
            if runs:
                each = [np.mean([error(run, run.rows[:, :3]) for run in runs])]
                each += [
                    np.mean([error(run, learned(run, lag=lag).out) for run in runs])
                    for lag in LAGS
                ]
                errors.append((f"{title}; {choice.name}", *(f"{100.0 * e:.1f} %" for e in each)))
        passes = dem_series(PASSES, choice)
        by_pass = [pass_errors(passes, passes.rows[:, :3])]
        by_pass += [pass_errors(passes, learned(passes, lag=lag).out) for lag in LAGS]
        cells = (", ".join(f"{100 * e:.0f}" for e in one) + " %" for one in by_pass)
        errors.append((f"four passes in one trench; {choice.name}", *cells))
        real = [
            run
            for title, (runs, _) in groups.items()
            if not title.startswith("simulated")
            for run in runs
        ]
        reports.append(
            _surprise_row(choice, [*dem, *(dem_series(name, choice) for name in _FRESH)], real)
        )
    lags = tuple(f"learning, lag {1e3 * lag:g} mm" for lag in LAGS)
    return (
        _result(
            "learning",
            "The medium learned from the measured force",
            ("data; model", "fixed model", *lags),
            errors,
            figure=followed_force(),
        ),
        _result(
            "surprise",
            "What is reported as a surprise",
            (
                "model",
                "false reports on uniform grains",
                "layers reported within 3 mm",
                "path to the buried ball",
            ),
            reports,
            figure=None,
        ),
    )


def _result(
    name: str,
    title: str,
    header: tuple[str, ...],
    rows: list[tuple[str, ...]],
    *,
    figure: Figure | None,
) -> StudyResult:
    return StudyResult(
        name=name,
        title=title,
        figure=figure,
        table=TextTable(header=header, rows=tuple(rows)),
    )


def followed_force() -> Figure:
    """Upward force over path in three runs: how soon the learned prediction follows the grains."""
    figure = new_figure(12.0, 3.6)
    names = {
        "ellipsoid_straight": "Ellipsoid, pushed down",
        _FRESH[0]: "Upright plate, pushed down and dragged",
    }
    names[_BLOCK] = "Plate, pushed down on a buried ball"
    for axes, (name, title) in zip(figure.subplots(1, 3), names.items(), strict=True):
        run = dem_series(name, MODELS[-1])
        result = learned(run, lag=LAGS[0])
        path, up, sigma = 1e3 * run.path, result.out[:, 2], result.out[:, 8]
        axes.plot(path, run.forces[:, 2], color=BLUE, lw=0.8, label="measured (simulated grains)")
        axes.plot(path, run.rows[:, 2], color=VERMILION, ls="--", label="fixed model")
        axes.plot(path, up, color=ORANGE, label="learning, lag 2 mm, ± σ")
        axes.fill_between(path, up - sigma, up + sigma, color=ORANGE, alpha=0.3, lw=0)
        for k in result.reports():
            axes.axvline(path[k], color=GREY, lw=0.8, ls=":", label="surprise reported")
        label_axes(axes, x="Path in the grains [mm]", y="Force, upwards [N]", title=title)
    axes.legend(fontsize=8)
    return figure


def _surprise_row(choice: Choice, dem: list[Series], recordings: list[Series]) -> tuple[str, ...]:
    """False reports on fresh ground, layers found within 3 mm, and where the buried ball is reported."""
    fresh = dem + recordings
    results = [learned(run, lag=LAGS[0]) for run in fresh]
    false = sum(len(result.reports()) for result in results)
    length = sum(run.path[-1] for run in fresh)
    found = tried = 0
    for run in dem:
        for at in np.arange(0.010, run.path[-1] - 0.004, 0.008):
            result = learned(run, lag=LAGS[0], forces=with_layer(run, at, 2.0))
            near = (run.path > at) & (run.path <= at + 0.003)
            tried += 1
            found += bool((result.surprise[near] == "harder").any())
    block = dem_series(_BLOCK, choice)
    reports = learned(block, lag=LAGS[0]).reports()
    end = (
        f"{1e3 * block.path[reports[0]]:.1f} of {1e3 * block.path[-1]:.1f} mm"
        if len(reports)
        else "never"
    )
    return (
        choice.name,
        f"{false} in {length:.2f} m",
        f"{found} of {tried}",
        f"reported at {end}",
    )
