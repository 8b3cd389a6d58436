"""~/markers: the tool coloured by traction, arrows of the forces, the surface. Drawn only if there is a subscriber."""

import struct
from collections.abc import Iterable

import numpy as np
from geometry_msgs.msg import Point
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.serialization import serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from rft_ros.estimator import Estimate, Estimator, Wrench
from rft_ros.ground import HeightMap
from rft_ros.rft import FORCE, POSE, plate_forces, rotation_matrix

Array = NDArray[np.float64]

_MOST_FACETS = 5000  # of a finer tool every k-th facet is drawn, so that drawing takes about 1 ms
_METRES_PER_NEWTON = 0.01
_SENTINEL = 0x5AFEC0DE
_PREDICTED, _MEASURED = (0.85, 0.1, 0.1), (0.1, 0.5, 0.1)
_SAND, _RISEN, _SUNK = np.array([0.76, 0.7, 0.5]), np.array([0.8, 0.1, 0.1]), np.array([0.1, 0.2, 0.8])
_YELLOW, _RED = np.array([0.95, 0.85, 0.1]), np.array([0.8, 0.0, 0.1])


def _spliced(marker: Marker, points: Array, rgb: Array) -> bytes:
    """The serialised MarkerArray of one marker, with points and opaque colours, shape [n, 3], inserted as bytes.

    No pose is answered while a message is serialised. rclpy takes 6 ms for 672 facets and 45 ms for 4,800; this takes
    0.2 and 0.5 ms. In the message, points follow after lifetime and frame_locked. The fields after the points are
    aligned to 4 bytes at most, so their padding does not change.
    """
    marker.lifetime.sec = _SENTINEL
    template = serialize_message(MarkerArray(markers=[marker]))
    lifetime = template.index(struct.pack("<i", _SENTINEL))
    end = 4 + (lifetime - 4 + 8 + 1 + 3) // 4 * 4
    head = template[:lifetime] + b"\x00\x00\x00\x00" + template[lifetime + 4 : end]
    count = struct.pack("<I", len(points))
    padding = b"\x00" * (-len(head) % 8)  # the doubles start at a multiple of 8 from byte 4, after a length of 4 bytes
    rgba = np.column_stack([rgb, np.ones(len(rgb))])
    numbers = points.astype("<f8").tobytes(), rgba.astype("<f4").tobytes()
    return b"".join([head, count, padding, numbers[0], count, numbers[1], template[end + 8 :]])


class Markers:
    """Publishes markers of the last estimate, when a timer calls it between ticks."""

    def __init__(self, node: Node, estimator: Estimator) -> None:
        self._estimator = estimator
        self._publisher = node.create_publisher(MarkerArray, "~/markers", 1)
        self._answer: Estimate | None = None
        self.measured: Wrench | None = None  # the last compensated wrench; None if there was no measurement
        self._drawn: tuple[HeightMap, Array] | None = None
        self._state = estimator.state.copy()

    def estimated(self, answer: Estimate) -> None:
        """Keep an estimate, with its state, model and settings, which may change in the estimator before `publish`."""
        e = self._estimator
        self._answer = answer
        self._state[:] = e.state
        self._model, self._settings, self._load_cell = e.model, e.settings, e.load_cell
        self._surface, self._ground = e.surface, e.ground

    def publish(self) -> None:
        """Draw the last estimate and measurement, if there is a subscriber and the estimate is new."""
        answer = self._answer
        if answer is None or not self._publisher.get_subscription_count():
            return
        self._answer = None
        self._publish_tool(answer.stamp)
        position, quaternion, _ = np.split(self._state, [3, 7])
        to_world = rotation_matrix(quaternion) @ rotation_matrix(self._load_cell.quaternion)
        markers = [self._surface_around(answer.stamp)]
        for number, wrench, colour in ((1, answer.predicted, _PREDICTED), (2, self.measured, _MEASURED)):
            if wrench is not None:
                arrow = self._marker(answer.stamp, number, Marker.ARROW, (0.003, 0.006, 0.008), (*colour, 1.0))
                tip = position + _METRES_PER_NEWTON * (to_world @ np.array(wrench[FORCE]))
                arrow.points = [Point(x=x, y=y, z=z) for x, y, z in (position.tolist(), tip.tolist())]
                markers.append(arrow)
        self._publisher.publish(MarkerArray(markers=markers))
        self._publish_ground(answer.stamp)

    def _publish_tool(self, stamp: int) -> None:
        tool, plane = self._model.tool, self._surface
        drawn = slice(None, None, 1 + (len(tool.faces) - 1) // _MOST_FACETS)
        forces = plate_forces(
            tool.facets, self._model.law, self._state, surface_height=plane.height, slope=plane.slope
        )[drawn]
        traction = np.linalg.norm(forces, axis=1) / tool.facets.areas[drawn]
        share = traction[:, None] / max(traction.max(), 1e-12)
        rgb = np.where(share > 0.0, _YELLOW + share * (_RED - _YELLOW), 0.8)  # light grey without traction
        marker = self._marker(stamp, 0, Marker.TRIANGLE_LIST, (1.0, 1.0, 1.0))
        p, q = marker.pose.position, marker.pose.orientation
        p.x, p.y, p.z, q.x, q.y, q.z, q.w = self._state[POSE].tolist()
        corners = tool.vertices[tool.faces[drawn]].reshape(-1, 3)
        self._publisher.publish(_spliced(marker, corners, np.repeat(rgb, 3, axis=0)))

    def _publish_ground(self, stamp: int) -> None:
        """Publish the known cells, at most some thousand: blue if they sank since the start, red if they rose.

        The colour is full at 20 mm.
        """
        ground, start = self._ground, self._model.ground
        if ground is None or start is None:
            return
        if self._drawn is None or self._drawn[0] is not ground:  # to find the cells of the largest maps takes 0.2 s
            self._drawn = ground, ground.points(at_most=_MOST_FACETS)
        cells = self._drawn[1]
        moved = np.nan_to_num(cells[:, 2] - start.heights_at(cells[:, 0], cells[:, 1]))[:, None]
        share = np.clip(moved / 0.02, -1.0, 1.0)
        rgb = _SAND + np.abs(share) * (np.where(share > 0.0, _RISEN, _SUNK) - _SAND)
        marker = self._marker(stamp, 4, Marker.CUBE_LIST, (ground.cell, ground.cell, 1e-4))
        self._publisher.publish(_spliced(marker, cells, rgb))

    def _surface_around(self, stamp: int) -> Marker:
        side = 10.0 * self._model.tool.plates.reach
        surface = self._marker(stamp, 3, Marker.CUBE, (side, side, 1e-4), (*_SAND.tolist(), 0.4))
        (x, y), (sx, sy) = self._state[:2].tolist(), self._surface.slope
        p = surface.pose.position
        p.x, p.y, p.z = x, y, self._surface.height + sx * x + sy * y
        return surface

    def _marker(
        self, stamp: int, number: int, kind: int, size: Iterable[float], colour: Iterable[float] = (0.0, 0.0, 0.0, 0.0)
    ) -> Marker:
        marker = Marker(ns="rft", id=number, type=kind, action=Marker.ADD)
        marker.header.frame_id = self._settings.world_frame
        marker.header.stamp.sec, marker.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
        marker.pose.orientation.w = 1.0
        s, c = marker.scale, marker.color
        (s.x, s.y, s.z), (c.r, c.g, c.b, c.a) = size, colour
        return marker
