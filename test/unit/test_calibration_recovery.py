"""Known parameters come back from noisy synthetic recordings: within three standard errors in 95 of 100 trials."""

from collections import Counter

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic_track import (
    HANGING,
    ORIENTATIONS,
    Path,
    dragged,
    grain_wrenches,
    hanging,
    known,
    law,
    read_by,
    track_of,
    unknown,
)

from rft_ros.calibration import Options, calibrate
from rft_ros.calibration.alpha_y_fit import fit_alpha_y
from rft_ros.calibration.mobilization import fit_turn, length_finding
from rft_ros.calibration.plate_runs import PlateRun
from rft_ros.calibration.sigmoids import fit_f1, fit_f23
from rft_ros.calibration.stretches import turns_in_grains
from rft_ros.rft.velocity_weights import A2, A3, B2, B3, exact_f1, exact_f23

TRIALS, ENOUGH = 100, 95
NOISE = (0.1, 0.002)
SURFACE, ZETA, LENGTH, REST = 0.0123, 0.8, 0.003, 2e-4


def count(trial, truth):
    """In how many of the seeded trials each number of `truth` lies within three standard errors of what was fitted."""
    hits: Counter[tuple[str, int]] = Counter()
    for seed in range(TRIALS):
        found = {f.name: f for f in trial(np.random.default_rng(seed))}
        for name, values in truth.items():
            if name in found:
                fit = found[name]
                for k, (value, error, true) in enumerate(zip(fit.values, fit.errors, values, strict=True)):
                    hits[name, k] += abs(value - true) <= 3.0 * error
    return {(name, k): hits[name, k] for name, values in truth.items() for k in range(len(values))}


@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_load_cell_surface_and_zeta(correlation):
    """From one recording: six poses in the air, a penetration, a dwell; the cell is turned and reports -1 times."""
    path = hanging(Path((0.0, 0.0, 0.06)), ORIENTATIONS).move((0.0, 0.0, -0.095), 0.01).wait(1.0)
    time, states = path.move((0.0, 0.0, 0.05), 0.02).states()
    grains = grain_wrenches(time, states, law(ZETA), surface=SURFACE)

    def trial(rng):
        readings = read_by(HANGING, states, grains, rng, noise=NOISE, memory=correlation)
        options = Options(parts=("sensor", "surface", "zeta"))
        return calibrate([track_of(time, states, readings)], unknown(), options).findings

    truth = {
        "sensor.bias": HANGING.bias,
        "sensor.mass": (HANGING.mass,),
        "sensor.center_of_mass": HANGING.center_of_mass,
        "surface_height": (SURFACE,),
        "medium.zeta": (ZETA,),
    }
    hits = count(trial, truth)
    assert min(hits.values()) >= ENOUGH, hits


@pytest.mark.parametrize(
    "path",
    [
        pytest.param(
            lambda: Path((0, 0, 0.03)).move((0, 0, -0.07), 0.02).wait(0.3).move((0, 0, 0.015), 0.01), id="reversal"
        ),
        pytest.param(
            lambda: Path((0, 0, -0.03), Rotation.from_euler("x", 90, degrees=True)).wait(1).move((0, 0.04, 0), 0.01),
            id="start from rest",
        ),
        pytest.param(
            lambda: Path((0, 0, 0.03)).move((0, 0, -0.06), 0.02).move((0.015, 0, -0.002), 0.01), id="turn to the side"
        ),
    ],
)
def test_mobilization_length(path):
    time, states = path().states()
    grains = grain_wrenches(time, states, law(ZETA), surface=0.0, length=LENGTH)

    def trial(rng):
        track = track_of(time, states, read_by(HANGING, states, grains, rng, noise=NOISE))
        turns = turns_in_grains(track, 0.0, REST)
        return [length_finding([fit_turn(track, t, HANGING, law(), surface=0.0, rest_speed=REST) for t in turns])]

    hits = count(trial, {"medium.mobilization_length": (LENGTH,)})
    assert min(hits.values()) >= ENOUGH, hits


@pytest.mark.parametrize(
    ("model", "truth"), [("constant", (0.12,)), ("linear", (0.2035, -0.0015))], ids=["constant", "linear"]
)
def test_alpha_y_from_plates_dragged_along_themselves(model, truth):
    time, states, grains = dragged((30.0, 50.0, 70.0, 90.0), lambda beta: truth[0] + sum(truth[1:]) * beta, zeta=ZETA)

    def trial(rng):
        track = track_of(time, states, read_by(HANGING, states, grains, rng, noise=NOISE))
        options = Options(parts=("alpha_y",), alpha_y=model)
        return calibrate([track], known(medium__zeta=ZETA), options).findings

    name = f"alpha_y ({model})"
    hits = count(trial, {name: truth})
    assert min(hits.values()) >= ENOUGH, hits


def run_at(psi, *, beta=90.0, along=0.0, across=0.0, error=0.02):
    return PlateRun(
        bag="synthetic",
        beta=beta,
        psi=psi,
        depth=0.05,
        load=7e-5,
        along=along,
        across=across,
        up=0.0,
        along_error=error,
        across_error=error,
        edges=(0.0, 0.0),
    )


def test_velocity_weights_from_level_runs():
    """Both curves from ten runs over ψ; forces of 8 and 18 N with 0.02 N of noise."""
    psi = np.linspace(0.0, 90.0, 10)
    top_along, top_across = 0.136, 0.3
    newton = ZETA * 7e-5 * 1e6
    f1 = np.array([exact_f1(u) for u in np.sin(np.deg2rad(psi))])
    f23 = np.array([exact_f23(w) for w in np.cos(np.deg2rad(psi))])

    def trial(rng):
        noise = 0.02 * rng.normal(size=(2, len(psi)))
        runs = [
            run_at(p, along=newton * top_along * a + n, across=newton * top_across * b + m)
            for p, a, b, n, m in zip(psi, f1, f23, *noise, strict=True)
        ]
        return fit_f1(runs, zeta=ZETA).finding(), fit_f23(runs, zeta=ZETA).finding()

    truth = {
        "f1 (A2, A3, stress at 1)": (A2, A3, top_along),
        "f23 (B2, B3, stress at 1)": (B2, B3, top_across),
    }
    hits = count(trial, truth)
    assert min(hits.values()) >= ENOUGH, hits


def test_an_alpha_y_table_holds_what_no_line_does():
    alpha = {30.0: 0.10, 60.0: 0.16, 90.0: 0.09}
    runs = [run_at(90.0, beta=b, along=ZETA * 7e-5 * 1e6 * a) for b, a in alpha.items() for _ in range(2)]
    fit = fit_alpha_y(runs, zeta=ZETA, model="table")
    assert dict(fit.rows) == pytest.approx(alpha)


def test_alpha_y_is_constant_unless_the_data_are_sure_of_a_slope():
    noise = np.random.default_rng(3).normal(size=4) * 0.02
    runs = [
        run_at(90.0, beta=b, along=ZETA * 70.0 * 0.12 + n) for b, n in zip((30.0, 50.0, 70.0, 90.0), noise, strict=True)
    ]
    assert fit_alpha_y(runs, zeta=ZETA).model == "constant"
    sloped = [run_at(90.0, beta=b, along=ZETA * 70.0 * (0.2 - 0.0015 * b)) for b in (30.0, 50.0, 70.0, 90.0)]
    assert fit_alpha_y(sloped, zeta=ZETA).model == "linear"
