"""~/markers: tool coloured by traction, forces as arrows, the surface. Drawn only while someone subscribes."""

import struct
from collections.abc import Iterable

import numpy as np
from geometry_msgs.msg import Point
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.serialization import serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from rft_ros.estimator import Estimate, Estimator, Measurement
from rft_ros.ground import HeightMap
from rft_ros.rft import plate_forces, rotation_matrix
from rft_ros.tool import Tool

_MOST_FACETS = 5000  # of a finer tool every k-th facet is drawn, so that drawing takes about 1 ms
_METRES_PER_NEWTON = 0.01
_SENTINEL = 0x5AFEC0DE
_PREDICTED, _MEASURED = (0.85, 0.1, 0.1), (0.1, 0.5, 0.1)
_SAND, _RISEN, _SUNK = np.array([0.76, 0.7, 0.5]), np.array([0.8, 0.1, 0.1]), np.array([0.1, 0.2, 0.8])


def _colours(traction: NDArray[np.float64]) -> NDArray[np.float32]:
    """RGBA of each corner, shape [3 n, 4]: light grey without traction, then yellow to red at the greatest."""
    greatest = traction.max()
    x = traction / greatest if greatest > 0.0 else traction
    rgba = np.ones((len(x), 4), dtype=np.float32)
    loaded = x > 0.0
    rgba[:, 0] = np.where(loaded, 0.95 - 0.15 * x, 0.8)
    rgba[:, 1] = np.where(loaded, 0.85 * (1.0 - x), 0.8)
    rgba[:, 2] = np.where(loaded, 0.1, 0.8)
    return np.repeat(rgba, 3, axis=0)


def _moved_colours(moved: NDArray[np.float64]) -> NDArray[np.float32]:
    """RGBA of cells, shape [n, 4], by how far they rose: blue at -20 mm, sand colour at 0, red at 20 mm."""
    x = np.clip(moved / 0.02, -1.0, 1.0)[:, None]
    rgb = _SAND + np.abs(x) * (np.where(x > 0.0, _RISEN, _SUNK) - _SAND)
    return np.column_stack([rgb, np.ones(len(x))]).astype(np.float32)


def _spliced(marker: Marker, corners: bytes, colours: NDArray[np.float32]) -> bytes:
    """The serialised MarkerArray of one marker, with points and colours inserted as bytes.

    rclpy takes 6 ms for the messages of 672 facets and 45 ms for those of 4,800, in which no pose is answered; this
    takes 0.2 and 0.5 ms. Points follow lifetime and frame_locked; all after them is aligned to 4 bytes at most, so
    nothing else moves.
    """
    marker.lifetime.sec = _SENTINEL
    template = serialize_message(MarkerArray(markers=[marker]))
    lifetime = template.index(struct.pack("<i", _SENTINEL))
    points = 4 + (lifetime - 4 + 8 + 1 + 3) // 4 * 4
    head = template[:lifetime] + b"\x00\x00\x00\x00" + template[lifetime + 4 : points]
    count = struct.pack("<I", len(colours))
    padding = b"\x00" * (-len(head) % 8)  # the doubles start at a multiple of 8 from byte 4, after a length of 4 bytes
    return head + count + padding + corners + count + colours.astype("<f4").tobytes() + template[points + 8 :]


class Markers:
    """Publishes markers of the last estimate, called by a timer between ticks. Each `estimated` replaces the last."""

    def __init__(self, node: Node, estimator: Estimator) -> None:
        self._estimator = estimator
        self._publisher = node.create_publisher(MarkerArray, "~/markers", 1)
        self._tool: Tool | None = None  # whose facets and corners are prepared
        self._facets, self._corners = np.arange(0), b""
        self._drawn_ground: tuple[HeightMap, bytes, NDArray[np.float32]] | None = None
        self._answer: Estimate | None = None
        self._state = estimator.state.copy()

    def estimated(self, answer: Estimate) -> None:
        """Keep an estimate with its state, model and settings: the estimator's own may change before `publish`."""
        e = self._estimator
        self._answer = answer
        self._state[:] = e.state
        self._model, self._settings, self._surface, self._ground = e.model, e.settings, e.surface, e.ground

    def publish(self, measurement: Measurement | None) -> None:
        """Draw the last estimate and measurement, if there is a subscriber and the estimate is new."""
        answer = self._answer
        if answer is None or not self._publisher.get_subscription_count():
            return
        self._answer = None
        self._publish_tool(answer.stamp)
        to_world = rotation_matrix(self._state[3:7]) @ rotation_matrix(self._settings.load_cell.quaternion)
        markers = [self._surface_around(answer.stamp)]
        measured = measurement.compensated if measurement else None
        for number, wrench, colour in ((1, answer.predicted, _PREDICTED), (2, measured, _MEASURED)):
            if wrench is not None:
                arrow = self._marker(answer.stamp, number, Marker.ARROW, (0.003, 0.006, 0.008), (*colour, 1.0))
                tip = self._state[:3] + _METRES_PER_NEWTON * (to_world @ np.array(wrench[:3]))
                arrow.points = [Point(x=x, y=y, z=z) for x, y, z in (self._state[:3].tolist(), tip.tolist())]
                markers.append(arrow)
        self._publisher.publish(MarkerArray(markers=markers))
        if self._ground is not None and self._model.ground is not None:
            self._publish_ground(answer.stamp, self._ground, self._model.ground)

    def _publish_tool(self, stamp: int) -> None:
        tool, plane = self._model.tool, self._surface
        if self._tool is not tool:
            count = len(tool.faces)
            self._tool, self._facets = tool, np.arange(0, count, 1 + (count - 1) // _MOST_FACETS)
            self._corners = np.ascontiguousarray(tool.vertices[tool.faces[self._facets]], dtype="<f8").tobytes()
        forces = plate_forces(
            tool.facets, self._model.law, self._state, surface_height=plane.height, slope=plane.slope
        )[self._facets]
        traction = np.linalg.norm(forces, axis=1) / tool.facets.packed[6, self._facets]
        marker = self._marker(stamp, 0, Marker.TRIANGLE_LIST, (1.0, 1.0, 1.0))
        p, q = marker.pose.position, marker.pose.orientation
        p.x, p.y, p.z, q.x, q.y, q.z, q.w = self._state[:7].tolist()
        self._publisher.publish(_spliced(marker, self._corners, _colours(traction)))

    def _publish_ground(self, stamp: int, ground: HeightMap, start: HeightMap) -> None:
        """The known cells, at most some thousand, coloured by how far they have moved since the start."""
        if self._drawn_ground is None or self._drawn_ground[0] is not ground:
            cells = ground.points(at_most=_MOST_FACETS)
            moved = np.nan_to_num(cells[:, 2] - start.heights_at(cells[:, 0], cells[:, 1]))
            corners = np.ascontiguousarray(cells, dtype="<f8").tobytes()
            self._drawn_ground = ground, corners, _moved_colours(moved)
        marker = self._marker(stamp, 4, Marker.CUBE_LIST, (ground.cell, ground.cell, 1e-4))
        self._publisher.publish(_spliced(marker, *self._drawn_ground[1:]))

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
