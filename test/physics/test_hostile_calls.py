"""Public functions of the core, called with any types, shapes and in any order.

A call either answers as the published rule does, whatever was called before, or raises one sentence that names the
argument. Reading past an array ends the test process by a signal.
"""

import math
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import product

import numpy as np
import published_rule as rule
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rft_ros import rft
from rft_ros.rft import (
    Constant,
    Linear,
    Memory,
    Plates,
    Table,
    plate_forces,
    wrenches,
    wrenches_in_time,
)

pytestmark = pytest.mark.filterwarnings("error")
many = settings(max_examples=150)
GENERIC = rft.MEDIA["generic"]
NORMAL = (0.6, 0.0, -0.8)
POINT = Plates.from_arrays([[0, 0, 0]], [NORMAL], [1])
CORNERS = np.array([[[0, 0, 0], [0.8, 0, 0.6], [0, 1, 0]]])
PLATES = {"centroid": POINT, "refined": Plates.from_triangles(CORNERS, [0.01])}
OTHERS = Plates.from_arrays(np.eye(3).repeat(7, 0), np.eye(3).repeat(7, 0), np.ones(21))
WHOLE = [0, 0, -1, 0, 0, 0, 1, 1, 1, -1, 0, 0, 0]
"""A state of integers: what numba would compile a kernel of integers for."""

# α_y [N/cm³] and models that have it at every attitude
MODELS = [
    (0.0, Linear(0, 0)),
    (0.5, Linear(0.5, 0)),
    (1.0, Constant(1)),
    (0.25, Constant(np.float32(0.25))),
    (2.0, Table.sampled([0, 1], [0], [[2], [2]])),
    (
        0.5,
        Table.sampled(
            np.float32([0, 1, 3]), [-1, 0.5], np.full((3, 2), Fraction(1, 2), dtype=float)
        ),
    ),
]
SAME = [
    lambda a: a,
    lambda a: a.tolist(),
    lambda a: a.astype(int),
    lambda a: a.astype(np.float32),
    lambda a: a.astype(">f8"),
    lambda a: np.asfortranarray(a),
    lambda a: np.repeat(a, 2, axis=0)[::2],
    lambda a: np.frombuffer(a.tobytes(), dtype=a.dtype).reshape(a.shape),  # read-only
    lambda a: np.asarray(a.tolist(), dtype=">i2"),
]
"""Other arrays of the same numbers."""

JUNK = [
    None,
    "states",
    1,
    1j,
    [[1j] * 13],
    [],
    [[]],
    math.nan,
    math.inf,
    object(),
    np.zeros(12),
    np.zeros((3, 7)),
    np.zeros((2, 2, 13)),
    np.zeros((1, 13), dtype=object),
    np.zeros((0, 12)),
    [[0.0] * 13, [0.0]],
    {"px": 0.0},
]


def refused(call):
    """Whether a call was refused, and with a sentence."""
    try:
        call()
    except (ValueError, TypeError) as error:
        assert str(error).strip(), "an error without a sentence"
        return True
    return False


def expected(alpha_y, zeta, depth):
    force = rule.plate_force(
        NORMAL, (1, 1, -1), depth, 1.0, "generic", zeta, lambda _beta, _gamma: alpha_y
    )
    return [*force, 0.0, 0.0, 0.0]


@many
@given(
    model=st.sampled_from(MODELS),
    zeta=st.sampled_from([1, 2, np.int64(1), np.float32(0.5), True]),
    raw=st.booleans(),
    height=st.sampled_from([0, 1, -0.5, np.int32(1), np.float32(0.5), True]),
    form=st.sampled_from(SAME),
    n=st.integers(1, 3),
    threads=st.sampled_from([None, 1, 2, 64]),
)
def test_the_answer_is_the_rules_whatever_the_types_and_whatever_came_before(
    model, zeta, raw, height, form, n, threads
):
    alpha_y, made = model
    law = rft.treers2021(GENERIC, made, zeta=zeta)
    if raw:  # fields as a caller may set them
        law = replace(law, zeta=1, alpha_y=made)
        zeta = 1
    states = form(np.array([WHOLE] * n, dtype=float))
    rows = wrenches(POINT, law, states, surface_height=height, threads=threads)
    want = expected(alpha_y, float(zeta), 1.0 + float(height))
    assert np.allclose(rows[:, :6], want, rtol=1e-6, atol=1e-3), (rows, want)
    forces = plate_forces(POINT, law, np.asarray(states)[0], surface_height=height)
    assert np.allclose(forces, want[:3], rtol=1e-9, atol=1e-6)
    assert np.isfinite(wrenches(PLATES["refined"], law, states, surface_height=height)).all()


@many
@given(
    model=st.sampled_from(MODELS),
    length=st.sampled_from([1, 2, 0.5, np.int8(3), True]),
    form=st.sampled_from(SAME),
)
def test_memory_answers_by_its_equation_whatever_the_types_and_whatever_came_before(
    model, length, form
):
    alpha_y, made = model
    law = rft.treers2021(GENERIC, made, mobilization_length=length)
    memory = Memory(POINT)
    moved = [WHOLE[k] + WHOLE[7 + k] for k in range(3)]
    states = form(np.array([WHOLE, [*moved, *WHOLE[3:]]], dtype=float))
    force = wrenches_in_time(POINT, law, states, memory)[1, :3]
    # λ grows down to 45 mm
    grown = 1.0 - math.exp(-math.sqrt(3.0) / (float(length) * (0.045 / 0.03) ** 2))
    assert np.allclose(
        force, grown * np.array(expected(alpha_y, 1.0, 2.0)[:3]), rtol=1e-6, atol=1e-6
    ), force


@many
@given(
    name=st.sampled_from(
        ["plates", "law", "states", "height", "memory", "length", "threads", "slope"]
    ),
    junk=st.sampled_from(JUNK),
    integration=st.sampled_from(["centroid", "refined"]),
    wide=st.booleans(),
)
def test_junk_is_refused_with_a_sentence_or_harmless(name, junk, integration, wide):
    plates = PLATES[integration]
    law = rft.treers2021(GENERIC, Constant(0.1))
    memory = Memory(plates)
    use = {"plates": plates, "law": law, "states": [WHOLE], "height": 0.0, "memory": memory}
    use |= {"length": 0.003, "threads": None, "slope": (0.1, 0), name: junk}
    keywords = {"surface_height": use["height"], "sensitivities": wide, "slope": use["slope"]}
    one = refused(
        lambda: wrenches(
            use["plates"], use["law"], use["states"], threads=use["threads"], **keywords
        )
    )
    scene = use["states"], use["memory"]
    grains = lambda: replace(use["law"], mobilization_length=use["length"])  # noqa: E731
    in_time = refused(lambda: wrenches_in_time(use["plates"], grains(), *scene, **keywords))
    refused(
        lambda: plate_forces(
            use["plates"], use["law"], use["states"], surface_height=use["height"]
        )
    )
    moved = {"displacements": junk}
    refused(
        lambda: wrenches_in_time(
            plates, replace(law, mobilization_length=0.003), [WHOLE], memory, **moved
        )
    )
    refused(lambda: rft.treers2021(GENERIC, junk))
    refused(lambda: rft.treers2021(GENERIC, Constant(junk)))
    refused(lambda: rft.treers2021(GENERIC, Constant(0.1), density=junk, inertia=junk))
    refused(lambda: rft.Agarwal2023(zeta=junk, surface_friction=junk))
    refused(lambda: rft.law_named(junk, GENERIC, Constant(0.1)))
    refused(lambda: Table.sampled(junk, junk, junk))
    refused(lambda: rft.rotation_matrix(junk))
    refused(lambda: rft.rotation_matrices(junk))
    refused(lambda: rft.rotate_vectors(junk, junk))
    refused(lambda: rft.quaternion_products(junk, junk))
    if name in ("plates", "law"):
        assert one and in_time
    if name == "memory":
        assert in_time


@many
@given(rows=st.integers(0, 4), columns=st.integers(1, 20), in_time=st.booleans())
def test_states_of_other_shapes_are_refused(rows, columns, in_time):
    law = rft.treers2021(GENERIC, Constant(0.1), mobilization_length=0.1)
    states, memory = np.zeros((rows, columns)), Memory(POINT)
    call = (
        (lambda: wrenches_in_time(POINT, law, states, memory))
        if in_time
        else lambda: wrenches(POINT, law, states)
    )
    assert refused(call) == (columns != 13)


@many
@given(
    st.lists(
        st.sampled_from([math.nan, math.inf, -math.inf, 0.0, 1.0, -1.0, 1e300, 5e-324]),
        min_size=13,
        max_size=13,
    ),
    st.sampled_from([model for _, model in MODELS]),
)
def test_states_that_were_not_checked_stay_within_the_arrays(values, model):
    laws = (
        rft.treers2021(GENERIC, model),
        rft.treers2021(GENERIC, model, density=1e3),
        rft.Agarwal2023(),
    )
    laws = tuple(replace(law, mobilization_length=0.003) for law in laws)
    for law, plates in product(laws, (*PLATES.values(), OTHERS)):
        memory = Memory(plates)
        assert wrenches(plates, law, [values]).shape == (1, 7)
        in_time = partial(wrenches_in_time, plates, law, [values] * 2, memory, sensitivities=True)
        assert refused(in_time) != all(map(math.isfinite, values))
        assert plate_forces(plates, law, values).shape == (len(plates), 3)


@pytest.mark.parametrize("slack", [-1.0, math.nan, math.inf, "a", None])
def test_a_dead_band_that_is_none_is_refused_by_name(slack):
    with pytest.raises(ValueError, match="dead_band is "):
        rft.displacements_followed(np.zeros((1, 13)), reach=0.1, dead_band=slack)


def test_threads_and_tables_that_cannot_be_used_are_refused_by_name():
    with pytest.raises(ValueError, match=r"threads is 2\.7; it must be a whole number"):
        wrenches(POINT, rft.Agarwal2023(), [WHOLE], threads=2.7)
    with pytest.raises(ValueError, match=r"alpha_y\.values of the law has rows of different"):
        rft.treers2021(GENERIC, Table(0, 1, 0, 1, [[1, 2], [3]]))


def test_a_quaternion_beyond_all_numbers_is_refused_without_a_warning():
    with pytest.raises(ValueError, match="norm inf"):
        rft.checked_states(np.full((1, 13), 1e300))


@pytest.mark.parametrize("column", [0, 2, 4, 6, 8, 12])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_pose_that_is_not_finite_is_refused_and_leaves_the_memory_as_it_was(column, value):
    plates = PLATES["refined"]
    memory = Memory(plates)
    path = rft.checked_states([[0, 0, -0.01 * k, 0, 0, 0, 1, 0, 0, -1, 0, 0, 0] for k in range(4)])
    law = rft.treers2021(GENERIC, Constant(1), mobilization_length=0.003)
    wrenches_in_time(plates, law, path, memory)
    before = [array.tobytes() for array in (memory.blocks, memory.last)]
    path[2, column] = value
    with pytest.raises(ValueError, match=rf"states has the value -?(nan|inf) at \[2, {column}\]"):
        wrenches_in_time(plates, law, path, memory)
    moved = np.zeros((4, 12))
    moved[1, column % 12] = value
    path[2, column] = 0.0
    with pytest.raises(ValueError, match="displacements has the value"):
        wrenches_in_time(plates, law, path, memory, displacements=moved)
    assert before == [array.tobytes() for array in (memory.blocks, memory.last)]
