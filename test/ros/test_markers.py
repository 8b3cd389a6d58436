"""~/markers: the tool, its forces and the surface, drawn from real estimates."""

import numpy as np
import pytest
from visualization_msgs.msg import Marker, MarkerArray

from rft_ros.tool import load_tool


def test_the_tool_is_drawn_where_it_is_coloured_where_it_is_loaded(rft):
    drawn: list[Marker] = []
    listener = rft.node.create_subscription(
        MarkerArray, f"{rft.name}/markers", lambda m: drawn.extend(m.markers), 10
    )
    stamp = rft.moment()
    rft.ask(stamp, z=-0.01, force=(0.0, 0.0, 4.0))
    rft.until(
        lambda: (
            rft.send(rft.moment(), force=(0.0, 0.0, 4.0)) or {m.id for m in drawn} >= {0, 1, 2, 3}
        )
    )
    rft.node.destroy_subscription(listener)
    by_id = {m.id: m for m in drawn}
    tool, mesh = by_id[0], load_tool("plate")
    corners = np.array([(p.x, p.y, p.z) for p in tool.points])
    in_tool = corners.reshape(-1, 3, 3) - (0.0, 0.0, -0.01)
    np.testing.assert_allclose(in_tool, mesh.vertices[mesh.faces], atol=1e-15)
    assert tool.lifetime.sec == 0
    colours = np.array([(c.r, c.g, c.b, c.a) for c in tool.colors])[::3]
    normal_z = mesh.facets.normals[2]  # moving down, the lower face leads, the upper one trails
    np.testing.assert_allclose(colours[normal_z < -0.5, 2], 0.1, atol=1e-6)
    np.testing.assert_allclose(colours[normal_z > 0.5, 2], 0.8, atol=1e-6)
    predicted, measured, surface = by_id[1], by_id[2], by_id[3]
    assert predicted.points[1].z - predicted.points[0].z > 0.0
    assert measured.points[1].z - measured.points[0].z == pytest.approx(0.04)
    assert surface.pose.position.z == 0.0


def test_a_tool_that_came_to_rest_is_drawn_at_its_last_estimate(rft):
    tools: list[Marker] = []
    listener = rft.node.create_subscription(
        MarkerArray,
        f"{rft.name}/markers",
        lambda m: tools.extend(t for t in m.markers if t.id == 0),
        10,
    )

    def move_and_rest():
        rft.send(rft.moment(), z=-0.01)
        rft.send(rft.moment(), z=-0.02, linear=(0.0, 0.0, 0.0))

    rft.until(lambda: move_and_rest() or len(tools) >= 5)
    rft.node.destroy_subscription(listener)
    lowest = [min(p.z for p in t.points) for t in tools[1:]]  # the first may be of a test before
    bottom = load_tool("plate").vertices[:, 2].min()
    assert lowest == pytest.approx([bottom - 0.01] * len(lowest), abs=1e-12)
