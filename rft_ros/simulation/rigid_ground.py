"""Rigid ground of a MuJoCo scene that would carry a body in place of the grains.

A scene often has a floor at the height where grains are added. If it can collide with the body, the body stands on it
and never sinks in. Rigid geoms below the surface are a legitimate bottom, and walls beside the body are walls.
"""

import copy
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from rft_ros.simulation.mechanism import import_mujoco
from rft_ros.simulation.shapes import bodies_fixed_to
from rft_ros.tool import Tool

MAX_LAYER_SHARE = 0.01
"""Grains over a rigid geom that are thinner than this share of the body's size count as none: mesh and geom differ."""

MIN_LEVEL_COSINE = 1.0 - 1e-6
"""Least vertical part of the normal of a plane that is level."""


class Placed(NamedTuple):
    """A body in grains: its id, its shape, and the height of the grains' surface below its origin [m]."""

    body: int
    tool: Tool
    surface_height: float


class RigidGround(NamedTuple):
    """A geom on which a body would stand; `is_everywhere`: at any place of the bed, not only where the body starts."""

    geom: int
    body: int
    is_everywhere: bool


def find_rigid_ground(
    model: Any, data: Any, placed: Sequence[Placed], *, ground_geom: int | None, is_level: bool
) -> list[RigidGround]:
    """The fixed geoms on which a body stands where it would touch the grains, straight below or above its place.

    `data`: with the positions of the geoms. `ground_geom`: the geom whose heights the grains have, if they are those of
    a geom. `is_level`: whether the grains' surface is level.
    """
    mujoco = import_mujoco()
    disabled = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    if model.opt.disableflags & int(disabled):
        return []
    scratch = copy.copy(data)
    bodies = frozenset(one.body for one in placed)
    found = []
    for one in placed:
        rotation = data.xmat[one.body].reshape(3, 3)
        # the height of the body's origin at which its lowest point touches the grains
        touching = one.surface_height - one.tool.lowest_point(rotation)
        fixed_bodies = bodies_fixed_to(model, one.body, bodies)
        own_geoms = np.flatnonzero(np.isin(model.geom_bodyid, fixed_bodies)).tolist()
        scratch.geom_xpos[:] = data.geom_xpos
        scratch.geom_xpos[own_geoms, 2] += touching - data.xpos[one.body, 2]
        max_distance = MAX_LAYER_SHARE * one.tool.size
        for geom in _fixed_geoms(model):
            colliding = [own for own in own_geoms if _can_collide(model, geom, own)]
            if geom == ground_geom and colliding:
                found.append(RigidGround(geom, one.body, is_everywhere=True))
            elif any(
                mujoco.mj_geomDistance(model, scratch, geom, own, max_distance, None)
                < max_distance
                for own in colliding
            ):
                is_everywhere = is_level and _is_level_plane(model, data, geom)
                found.append(RigidGround(geom, one.body, is_everywhere))
    return found


def _fixed_geoms(model: Any) -> Iterator[int]:
    """The geoms that never move."""
    for geom, body in enumerate(model.geom_bodyid.tolist()):
        is_mocap = model.body_mocapid[model.body_rootid[body]] >= 0
        if model.body_weldid[body] == 0 and not is_mocap:
            yield geom


def _is_level_plane(model: Any, data: Any, geom: int) -> bool:
    kinds = import_mujoco().mjtGeom
    up = float(data.geom_xmat[geom, 8])
    return bool(model.geom_type[geom] == kinds.mjGEOM_PLANE and up > MIN_LEVEL_COSINE)


def _can_collide(model: Any, fixed: int, moving: int) -> bool:
    """Whether MuJoCo lets a geom of the world and one of a body that moves collide."""
    pairs = np.column_stack([model.pair_geom1, model.pair_geom2])
    if (np.sort(pairs, axis=1) == sorted((fixed, moving))).all(axis=1).any():
        return True
    first, second = sorted(int(model.geom_bodyid[geom]) for geom in (fixed, moving))
    if ((first << 16) + second) in model.exclude_signature:
        return False
    types = model.geom_contype
    affinities = model.geom_conaffinity
    return bool(types[fixed] & affinities[moving] or types[moving] & affinities[fixed])


def sentence_of(model: Any, found: RigidGround) -> str:
    """What the geom does to the body, and how to change it."""
    geom = model.geom(found.geom).name or found.geom
    body = model.body(found.body).name or found.body
    return (
        f"geom '{geom}' lies at or above the grains' surface and can collide with body '{body}', which stands on it "
        "and not in the grains; set the geom's contype and conaffinity to 0, <exclude> the body from it, or lower it"
    )
