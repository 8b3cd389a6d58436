"""Grains resist: the power of the force on a leading plate, and the one fit that breaks this."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import LINEAR, directions, facing
from single_plate import traction_per_depth

from rft_ros.rft import (
    MEDIA,
    Agarwal2023,
    Table,
    alpha_y_model,
    treers2021,
    wrenches,
)
from rft_ros.rft.traction import MIN_RESISTANCE_SHARE

ZERO_OF_LINEAR = 0.2035 / 0.0015
"""β at which the paper's linear α_y passes through zero [deg]; at 180° it is -0.0665 N/cm³."""


DEPTH = 1.0  # m; large beside the plate


def plate_facing(beta, rule):
    """One plate at the origin whose outward normal lies β [rad] from straight down towards +x."""
    return facing(rule, [[0.0, 0.0, 0.0]], [[np.sin(beta), 0.0, -np.cos(beta)]])


def greatest_power(beta, *, intruding):
    """Greatest power of a plate that leads, by the published rule and the linear fit [N/cm³]; -inf: it never leads.

    Over all directions of motion, or those that do not rise (γ >= 0).
    """
    normal = np.array([np.sin(beta), 0.0, -np.cos(beta)])
    along = np.array([0.0, 1.0, 0.0])
    off, around = np.meshgrid(
        np.linspace(0.0, 0.499 * np.pi, 90), np.linspace(0.0, 2.0 * np.pi, 180)
    )
    aside = np.cos(around)[..., None] * along + np.sin(around)[..., None] * np.cross(normal, along)
    v = (np.cos(off)[..., None] * normal + np.sin(off)[..., None] * aside).reshape(-1, 3)
    v = v[v[:, 2] <= 0.0] if intruding else v
    states = np.zeros((len(v), 13))
    states[:, 2], states[:, 6], states[:, 7:10] = -DEPTH, 1.0, v
    plates = plate_facing(beta, "centroid")
    force = wrenches(plates, LINEAR, states)[:, :3]
    return (force * v).sum(axis=1).max(initial=-np.inf) / (1e6 * plates.area * DEPTH)


def power(law, rule, beta, v):
    """Of one plate, over area, depth and speed [N/cm³]."""
    plate = plate_facing(np.radians(beta), rule)
    state = np.array([[0, 0, -1.0, 0, 0, 0, 1, *v, 0, 0, 0]])
    return float(wrenches(plate, law, state)[0, :3] @ v / (1e6 * plate.area))


@pytest.mark.parametrize("model", ["constant", "linear"])
@given(medium=st.sampled_from(sorted(MEDIA)), beta=st.floats(0.0, 180.0), v=directions())
def test_as_published_a_leading_plate_is_pushed_on_only_by_alpha_y_linear_where_it_looks_up(
    model, medium, beta, v
):
    """In any direction, γ < 0 too: a fortiori in intrusion. The linear fit's push is bounded."""
    law = treers2021(MEDIA[medium], alpha_y_model(model, MEDIA[medium]))
    breaks = model == "linear" and beta > ZERO_OF_LINEAR
    assert power(law, "centroid", beta, v) <= (0.0015 * beta - 0.2035 if breaks else 0.0) + 1e-12


def test_as_published_the_push_of_the_linear_fit_is_reached():
    """About 0.06 N/cm³, a fifteenth of α_z(0, 90°), for a face that looks up and moves along itself."""
    assert 0.05 < greatest_power(np.radians(174.0), intruding=False) < 0.0665
    assert 0.03 < greatest_power(np.radians(165.0), intruding=True) < 0.0665
    assert greatest_power(np.radians(130.0), intruding=False) < 0.0
    assert greatest_power(np.radians(180.0), intruding=True) == -np.inf


TABLE = Table.sampled(
    np.radians([0.0, 60.0, 120.0, 180.0]),
    np.radians([-180.0, -60.0, 60.0, 180.0]),
    np.random.default_rng(5).uniform(-0.1, 0.3, (4, 4)),
)
ANY_LAW = [
    treers2021(MEDIA[name], alpha_y_model(model, MEDIA[name]))
    for name in MEDIA
    for model in ("constant", "linear")
]
ANY_LAW += [treers2021(MEDIA["generic"], TABLE), Agarwal2023()]


@given(law=st.sampled_from(ANY_LAW), n=directions(), v=directions())
def test_under_the_refined_rule_grains_neither_pull_a_leading_plate_nor_push_it_on(law, n, v):
    """Whatever the medium and the model of α_y, tables with negative values among them."""
    v = np.asarray(v) * np.sign(np.dot(n, v) or 1.0)  # it leads
    traction = np.array(traction_per_depth(law, *n, *v, refined=True))
    assert traction @ n <= 1e-9 * law.stiffness
    assert (
        traction @ v
        <= -0.99 * MIN_RESISTANCE_SHARE * np.linalg.norm(traction) + 1e-9 * law.stiffness
    )


@pytest.mark.parametrize(
    "law", [*ANY_LAW, Agarwal2023(surface_friction=1.0)], ids=lambda law: law.name
)
def test_grains_resist_in_every_one_of_half_a_million_directions(law):
    """β, γ and ψ on a grid, by the loop itself. agarwal2023 pushed faces that look up on, by up to 0.003 N/cm³."""
    azimuths, heights = np.meshgrid(np.linspace(0.0, np.pi, 91), np.linspace(-1.0, 1.0, 91))
    flat = np.sqrt(1.0 - heights**2)
    v = np.stack([flat * np.cos(azimuths), flat * np.sin(azimuths), heights], axis=-1).reshape(
        -1, 3
    )
    states = np.zeros((len(v), 13))
    states[:, 2], states[:, 6], states[:, 7:10] = -1.0, 1.0, v
    for beta in np.radians(np.arange(0.0, 181.0, 3.0)):
        n = np.array([np.sin(beta), 0.0, -np.cos(beta)])
        leads = v @ n > np.sin(0.02)
        force = wrenches(plate_facing(beta, "refined"), law, states[leads])[:, :3]
        power, size = (force * v[leads]).sum(axis=1), np.linalg.norm(force, axis=1)
        assert (power <= -0.99 * MIN_RESISTANCE_SHARE * size).all(), np.degrees(beta)
        assert (force @ n <= 1e-9 * law.stiffness).all(), np.degrees(beta)


@pytest.mark.parametrize(
    "law", [ANY_LAW[0], treers2021(MEDIA["generic"], TABLE)], ids=["constant", "table"]
)
def test_rounding_does_not_decide_the_force_on_a_plate_that_moves_along_itself(law):
    """At v23 = 0 γ is 0 or 180° by rounding, and in level motion backwards 180 or -180°."""
    drags = []
    for yaw in np.radians(np.arange(0.0, 360.0, 7.0)):
        n, along = (
            np.array([np.cos(yaw), np.sin(yaw), 0.0]),
            np.array([-np.sin(yaw), np.cos(yaw), 0.0]),
        )
        for push in (0.0, 1e-12, -1e-12):
            for sink in (0.0, 1e-12, -1e-12):
                v = along + push * n + [0.0, 0.0, sink]
                drags.append(np.dot(traction_per_depth(law, *n, *v, refined=True), along))
    assert np.ptp(drags) < 1e-6 * law.stiffness
    assert min(drags) < -1e-3 * law.stiffness
