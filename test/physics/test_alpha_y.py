"""Models of α_y, the stress per depth along e1, Eq. (7)."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rft_ros.rft import MEDIA, Constant, Linear, Table, alpha_y_model, medium_named, treers2021
from rft_ros.rft.alpha_y import MAX_STEP_COUNT, add_alpha_y
from rft_ros.rft.kernel.chunk import COS_B, COS_G, E1_FACTOR, E2_Y, SIN_B, SIN_G, SIZE, TRACTION

attack = st.floats(0.0, 180.0)

# β every 10°, γ every 60°: values with no symmetry, so that swapped axes or indices cannot hide
BETA_DEG = np.arange(0.0, 181.0, 10.0)
GAMMA_DEG = np.arange(-120.0, 121.0, 60.0)
UNEVEN = Table.sampled(
    np.deg2rad(BETA_DEG),
    np.deg2rad(GAMMA_DEG),
    0.05 + 0.001 * BETA_DEG[:, None] ** 1.3 + 1e-6 * GAMMA_DEG[None] ** 2,
)


def at(model, beta_deg: float, gamma_deg: float = 0.0) -> float:
    """What the law adds along e1 where its weight is 1."""
    b, g, chunk = math.radians(beta_deg), math.radians(gamma_deg), np.zeros(SIZE)
    chunk[SIN_B], chunk[COS_B], chunk[SIN_G], chunk[COS_G] = (
        math.sin(b),
        math.cos(b),
        math.sin(g),
        math.cos(g),
    )
    chunk[E1_FACTOR] = chunk[E2_Y] = 1.0
    add_alpha_y(treers2021(MEDIA["generic"], model).packed, chunk, 1, False)
    return float(chunk[TRACTION])


@given(beta=st.floats(0.0, 180.0), gamma=st.floats(-120.0, 120.0))
def test_a_table_is_bilinear_between_its_nodes(beta, gamma):
    in_gamma = [np.interp(gamma, GAMMA_DEG, row) for row in UNEVEN.values]
    assert at(UNEVEN, beta, gamma) == pytest.approx(
        float(np.interp(beta, BETA_DEG, in_gamma)), abs=1e-11
    )


@given(beta=st.floats(0.0, 180.0), beyond=st.floats(0.0, 59.9))
def test_a_table_is_held_beyond_its_edges(beta, beyond):
    assert at(UNEVEN, beta, 120.0 + beyond) == pytest.approx(at(UNEVEN, beta, 120.0), abs=1e-11)
    assert at(UNEVEN, beta, -120.0 - beyond) == pytest.approx(at(UNEVEN, beta, -120.0), abs=1e-11)
    narrow = Table.sampled(np.deg2rad([60.0, 120.0]), np.array([0.0]), np.array([[0.3], [0.1]]))
    expected = 0.3 - 0.2 * (min(max(beta, 60.0), 120.0) - 60.0) / 60.0
    assert at(narrow, beta, beyond) == pytest.approx(expected, abs=1e-11)


@given(
    knots=st.lists(
        st.floats(-89.0, 269.0), min_size=2, max_size=6, unique_by=lambda b: round(b, 1)
    ),
    seed=st.integers(0, 2**32 - 1),
    beta=attack,
)
def test_the_error_of_a_table_of_uneven_steps_is_bounded_by_its_change_of_slope(knots, seed, beta):
    """The greatest deviation that `Table.sampled` states, and none where the grid has a node at each value given."""
    knots = np.sort(knots)
    values = np.random.default_rng(seed).uniform(0.0, 0.3, len(knots))
    step = (knots[-1] - knots[0]) / MAX_STEP_COUNT
    slopes = np.concatenate([[0.0], np.diff(values) / np.diff(knots), [0.0]])
    bound = (
        0.25 * step * np.abs(np.diff(slopes)).max()
        if np.diff(knots).min() > step
        else np.ptp(values)
    )
    table = Table.sampled(np.deg2rad(knots), [0.0], values[:, None])
    assert at(table, beta) == pytest.approx(
        float(np.interp(beta, knots, values)), abs=bound + 1e-11
    )


def test_a_table_in_steps_that_the_grid_divides_is_exact():
    knots, values = (
        np.array([-90.0, -45.0, 0.0, 1.0, 37.5, 90.0, 270.0]),
        np.array([0.3, 0.1, 0.2, 0.05, 0.3, 0.0, 0.1]),
    )
    table = Table.sampled(np.deg2rad(knots), [0.0], values[:, None])
    for beta in np.linspace(-89.9, 269.9, 1001):
        assert at(table, beta) == pytest.approx(float(np.interp(beta, knots, values)), abs=1e-11)


def test_an_unknown_model_is_refused_with_a_sentence():
    with pytest.raises(
        ValueError, match=r"alpha_y\.model 'cubic' is none of constant, linear, table"
    ):
        alpha_y_model("cubic", MEDIA["generic"])


def test_an_unknown_medium_is_refused_with_the_names_there_are():
    with pytest.raises(
        ValueError, match=r"medium\.name 'mars' is none of generic, poppy_seeds_loose, poppy_seeds"
    ):
        medium_named("mars")


def test_an_array_in_place_of_a_number_and_words_in_place_of_numbers_are_refused():
    with pytest.raises(ValueError, match=r"alpha_y\.values of the law has values of type <U1"):
        treers2021(MEDIA["generic"], UNEVEN._replace(values=np.array([["1", "2"], ["3", "4"]])))
    with pytest.raises(ValueError, match=r"alpha_y\.value of the law is array"):
        treers2021(MEDIA["generic"], Constant(np.array([5.0, 6.0])))


@pytest.mark.parametrize("name", sorted(MEDIA))
def test_the_papers_line_is_the_same_for_every_medium_and_a_warning_where_the_medium_is_weaker(
    name,
):
    law = treers2021(MEDIA[name], alpha_y_model("linear", MEDIA[name]))
    assert law.alpha_y == Linear(0.2035, -0.0015)
    weaker = name != "generic"
    assert bool(law.doubts) == weaker
    assert not weaker or all(word in law.doubts[0] for word in ("alpha_y.model", name, "constant"))
    assert not treers2021(MEDIA[name], alpha_y_model("constant", MEDIA[name])).doubts


@pytest.mark.parametrize("value", [-0.05, 0.0])
def test_a_constant_that_pushes_a_plate_along_its_motion_is_doubted_and_other_models_are_not(
    value,
):
    flat = MEDIA["generic"].C01 + MEDIA["generic"].Cm11
    medium = replace(MEDIA["generic"], name="mine", C11=value - flat)
    (doubt,) = treers2021(medium, alpha_y_model("constant", medium)).doubts
    for word in ("alpha_y.model constant", "mine", "along its motion", "linear", "table"):
        assert word in doubt
    for model in (alpha_y_model("linear", medium), alpha_y_model("table", medium, UNEVEN)):
        doubts = treers2021(medium, model).doubts
        assert not [doubt for doubt in doubts if "along its motion" in doubt]
