"""Primitive solids: the volume of the shape, facets outward; and which points a surface surrounds."""

import numpy as np
import pytest
import trimesh

from rft_ros.tool import solids


def mesh_of(triangles):
    return trimesh.Trimesh(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))


@pytest.mark.parametrize(
    ("triangles", "extents", "volume"),
    [
        (solids.box((1.0, 2.0, 3.0)), (2.0, 4.0, 6.0), 48.0),
        (solids.ellipsoid((1.0, 2.0, 3.0)), (2.0, 4.0, 6.0), 8.0 * np.pi),
        (solids.cylinder(1.0, 3.0), (2.0, 2.0, 6.0), 6.0 * np.pi),
        (solids.capsule(1.0, 3.0), (2.0, 2.0, 8.0), (6.0 + 4.0 / 3.0) * np.pi),
    ],
)
def test_a_solid_is_closed_about_the_origin_with_the_volume_of_its_shape(
    triangles, extents, volume
):
    mesh = mesh_of(triangles)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert 0.9 * volume <= mesh.volume <= volume * (1.0 + 1e-9)
    np.testing.assert_allclose(
        mesh.bounds, [-0.5 * np.array(extents), 0.5 * np.array(extents)], atol=1e-9
    )


def test_points_in_a_solid_are_inside_and_those_outside_and_in_its_cavity_are_not():
    solid = np.concatenate(
        [solids.box((1.0, 1.0, 1.0)), solids.ellipsoid((0.5, 0.5, 0.5))[:, ::-1]]
    )
    points = np.stack(np.meshgrid(*[np.linspace(-1.3, 1.3, 11)] * 3), axis=-1).reshape(-1, 3)
    expected = (np.abs(points).max(axis=1) < 1.0) & (np.linalg.norm(points, axis=1) > 0.5)
    np.testing.assert_array_equal(solids.are_inside(points, solid), expected)
