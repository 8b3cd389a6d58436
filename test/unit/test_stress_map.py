"""A medium fitted to a measured stress map: coefficients, errors, what is not identifiable, doubts."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from refusals import assert_says

from rft_ros.parameters.stress_map import StressMap, fit_medium
from rft_ros.rft import MEDIA, Medium

BETA, GAMMA = (
    np.deg2rad(a).ravel()
    for a in np.meshgrid(np.arange(-75.0, 91.0, 15.0), np.arange(-75.0, 91.0, 15.0))
)


def map_of(medium, beta=BETA, gamma=GAMMA, *, noise=0.0, seed=0):
    alpha_x, alpha_z = medium.stresses(beta, gamma)
    scatter = noise * np.random.default_rng(seed).normal(size=(2, len(beta)))
    return StressMap(
        beta=beta, gamma=gamma, alpha_x=alpha_x + scatter[0], alpha_z=alpha_z + scatter[1]
    )


@pytest.mark.parametrize("medium", MEDIA.values(), ids=MEDIA)
def test_a_map_computed_from_coefficients_gives_them_back(medium):
    fit = fit_medium(map_of(medium), name="mine")
    assert fit.medium.coefficients == pytest.approx(medium.coefficients, abs=1e-12)
    assert fit.misfit < 1e-12
    assert (fit.medium.name, fit.medium.doubts, fit.remarks) == ("mine", (), [])


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), cells=st.integers(30, 120), noise=st.floats(0.001, 0.05))
def test_the_errors_cover_the_truth_on_random_angles_with_cells_missing(seed, cells, noise):
    random = np.random.default_rng(seed)
    medium = random.choice(list(MEDIA.values()))
    beta, gamma = random.uniform(-0.5 * np.pi, 0.5 * np.pi, size=(2, cells))
    measured = map_of(medium, beta, gamma, noise=noise, seed=seed)
    missing = random.random((2, cells)) < 0.2
    alpha_x, alpha_z = np.where(missing, np.nan, [measured.alpha_x, measured.alpha_z])
    fit = fit_medium(replace(measured, alpha_x=alpha_x, alpha_z=alpha_z), name="mine")
    off = [
        abs(fit.medium.coefficients[n] - medium.coefficients[n]) / fit.errors[n]
        for n in fit.errors
    ]
    assert max(off) < 6.0
    assert np.mean(np.less(off, 3.0)) >= 7 / 9


@pytest.mark.parametrize(
    ("kept", "names"),
    [
        (
            np.isclose(GAMMA, np.deg2rad(90.0)),
            "A00, A10, B11, B01, Bm11, C11, C01, Cm11, D10",
        ),
        (np.isclose(BETA % np.deg2rad(90.0), 0.0), "B11, Bm11, C11, Cm11, D10"),
        (np.isclose(BETA, 0.0), "A00, A10, B11, B01, Bm11, C11, C01, Cm11, D10"),
        (np.arange(len(BETA)) >= 0, ""),
    ],
    ids=["straight down only", "level and upright plates only", "level plates only", "all"],
)
def test_coefficients_that_the_angles_leave_open_are_named_and_filled_in(kept, names):
    half = Medium.of(
        "half", {name: 0.5 * value for name, value in MEDIA["generic"].coefficients.items()}
    )
    fit = fit_medium(map_of(half, BETA[kept], GAMMA[kept]), name="mine")
    assert fit.medium.coefficients == pytest.approx(half.coefficients, abs=1e-9)
    assert len(fit.remarks) == bool(names)
    for remark in fit.remarks:
        assert_says(remark, f"{names}: not identifiable", "generic medium times 0.5")
    is_open = {name: bool(np.isnan(error)) for name, error in fit.errors.items()}
    assert is_open == {name: name in names.split(", ") for name in fit.errors}
    assert all(error < 1e-12 for error in fit.errors.values() if not np.isnan(error))


@pytest.mark.parametrize(
    ("stress", "names"),
    [("alpha_x", "C11, C01, Cm11, D10"), ("alpha_z", "A00, A10, B11, B01, Bm11")],
)
def test_the_coefficients_of_a_stress_that_was_not_measured_are_filled_in(stress, names):
    half = Medium.of(
        "half", {name: 0.5 * value for name, value in MEDIA["generic"].coefficients.items()}
    )
    fit = fit_medium(replace(map_of(half), **{stress: np.full_like(BETA, np.nan)}), name="mine")
    assert fit.medium.coefficients == pytest.approx(half.coefficients, abs=1e-9)
    (missing, remark) = fit.remarks
    assert missing == f"no {stress} was measured"
    assert remark.startswith(f"{names}: not identifiable")


@pytest.mark.parametrize(
    ("factor", "doubtful"), [(20.0, True), (0.01, True), (1.0, False), (0.25, False), (3.0, False)]
)
def test_stresses_far_from_those_of_any_grains_are_doubted_for_their_unit(factor, doubtful):
    """20: a pressure in kPa at a depth of 2 cm."""
    medium = Medium.of(
        "scaled", {name: factor * value for name, value in MEDIA["generic"].coefficients.items()}
    )
    doubts = fit_medium(map_of(medium), name="mine").medium.doubts
    assert any("N/cm³" in doubt and f"{factor:g} times" in doubt for doubt in doubts) == doubtful


def test_stresses_along_the_motion_are_refused():
    measured = map_of(MEDIA["generic"])
    with pytest.raises(ValueError, match="along the motion"):
        fit_medium(
            replace(measured, alpha_x=-measured.alpha_x, alpha_z=-measured.alpha_z), name="mine"
        )
    with pytest.raises(ValueError, match="no cell has a stress"):
        fit_medium(replace(measured, alpha_x=0.0 * BETA, alpha_z=0.0 * BETA), name="mine")


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    noise=st.floats(0.0, 0.1),
    damage=st.sampled_from(["swap", "copy", "cell"]),
)
def test_swapped_columns_copied_cells_and_one_wrong_cell_raise_a_doubt_and_a_right_map_does_not(
    seed, noise, damage
):
    random = np.random.default_rng(seed)
    medium = random.choice(list(MEDIA.values()))
    right = map_of(medium, noise=noise * 0.3 * medium.strength, seed=seed)
    assert fit_medium(right, name="mine").medium.doubts == ()
    alpha_x, alpha_z, beta, gamma = (
        right.alpha_x.copy(),
        right.alpha_z.copy(),
        right.beta,
        right.gamma,
    )
    if damage == "swap":
        beta, gamma = gamma, beta
    elif damage == "copy":
        up, down = np.isclose(gamma, np.deg2rad(75.0)), np.isclose(gamma, np.deg2rad(-75.0))
        alpha_x[up], alpha_z[up] = alpha_x[down], alpha_z[down]
    else:
        wrong = random.integers(len(beta))
        alpha_z[wrong] += 2.0 * medium.strength
    wrong_map = StressMap(beta=beta, gamma=gamma, alpha_x=alpha_x, alpha_z=alpha_z)
    try:
        doubts = fit_medium(wrong_map, name="mine").medium.doubts
    except ValueError:
        return
    assert doubts
