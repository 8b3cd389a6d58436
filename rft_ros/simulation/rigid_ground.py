"""Rigid ground of a MuJoCo scene that would carry a body in place of the grains.

A scene often has a floor at the height where grains are added. If it can collide with the body, the body stands on it
and never sinks in. Rigid geoms below the surface are a legitimate bottom, and walls beside the body are walls.
"""

import copy
import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from rft_ros.simulation.mechanism import import_mujoco
from rft_ros.simulation.shapes import bodies_fixed_to
from rft_ros.tool import Tool

MAX_LAYER_SHARE = 0.01
"""Grains over a rigid geom that are thinner than this share of the body's size count as none: mesh and geom differ."""

MAX_TILT_DEG = 0.1
"""Greatest tilt of a plane that is level."""


class PlacedBody(NamedTuple):
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
    model: Any,
    data: Any,
    placed_bodies: Sequence[PlacedBody],
    *,
    ground_geom: int | None,
    is_level: bool,
) -> list[RigidGround]:
    """The fixed geoms on which a body stands where it would touch the grains, straight below or above its place.

    `data`: with the positions of the geoms. `ground_geom`: the geom whose heights the grains have, if they are those of
    a geom. `is_level`: whether the grains' surface is level.
    """
    mujoco = import_mujoco()
    contact_flags = mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    if model.opt.disableflags & int(contact_flags):
        return []
    scratch = copy.copy(data)
    bodies = frozenset(placed_body.body for placed_body in placed_bodies)
    rigid_grounds = []
    for placed_body in placed_bodies:
        rotation = data.xmat[placed_body.body].reshape(3, 3)
        # the height of the body's origin at which its lowest point touches the grains
        touching = placed_body.surface_height - placed_body.tool.lowest_point(rotation)
        fixed_bodies = bodies_fixed_to(model, placed_body.body, bodies)
        own_geoms = np.flatnonzero(np.isin(model.geom_bodyid, fixed_bodies)).tolist()
        scratch.geom_xpos[:] = data.geom_xpos
        scratch.geom_xpos[own_geoms, 2] += touching - data.xpos[placed_body.body, 2]
        max_distance = MAX_LAYER_SHARE * placed_body.tool.size
        for geom in _fixed_geoms(model):
            colliding = [own_geom for own_geom in own_geoms if _can_collide(model, geom, own_geom)]
            if geom == ground_geom and colliding:
                rigid_grounds.append(RigidGround(geom, placed_body.body, is_everywhere=True))
            elif any(
                mujoco.mj_geomDistance(model, scratch, geom, own_geom, max_distance, None)
                < max_distance
                for own_geom in colliding
            ):
                is_everywhere = is_level and _is_level_plane(model, data, geom)
                rigid_grounds.append(RigidGround(geom, placed_body.body, is_everywhere))
    return rigid_grounds


def _fixed_geoms(model: Any) -> Iterator[int]:
    """The geoms that never move."""
    for geom, body in enumerate(model.geom_bodyid.tolist()):
        is_mocap = model.body_mocapid[model.body_rootid[body]] >= 0
        if model.body_weldid[body] == 0 and not is_mocap:
            yield geom


def _is_level_plane(model: Any, data: Any, geom: int) -> bool:
    kinds = import_mujoco().mjtGeom
    up = float(data.geom_xmat[geom, 8])
    return bool(
        model.geom_type[geom] == kinds.mjGEOM_PLANE and up > math.cos(math.radians(MAX_TILT_DEG))
    )


def _can_collide(model: Any, fixed_geom: int, moving_geom: int) -> bool:
    """Whether MuJoCo lets a geom of the world and one of a body that moves collide."""
    pairs = np.column_stack([model.pair_geom1, model.pair_geom2])
    if (np.sort(pairs, axis=1) == sorted((fixed_geom, moving_geom))).all(axis=1).any():
        return True
    low_body, high_body = sorted(
        int(model.geom_bodyid[geom]) for geom in (fixed_geom, moving_geom)
    )
    if ((low_body << 16) + high_body) in model.exclude_signature:
        return False
    types = model.geom_contype
    affinities = model.geom_conaffinity
    return bool(
        types[fixed_geom] & affinities[moving_geom] or types[moving_geom] & affinities[fixed_geom]
    )


def sentence_of(model: Any, rigid_ground: RigidGround) -> str:
    """What the geom does to the body, and how to change it."""
    geom = model.geom(rigid_ground.geom).name or rigid_ground.geom
    body = model.body(rigid_ground.body).name or rigid_ground.body
    return (
        f"geom '{geom}' lies at or above the grains' surface and can collide with body '{body}', which stands on it "
        "and not in the grains; set the geom's contype and conaffinity to 0, <exclude> the body from it, or lower it"
    )
