"""~/markers for RViz and Foxglove: the tool coloured by traction, the forces and the surface.

A reduced tool is drawn with its full mesh, coloured by the tractions on the mesh's own facets.

Python messages with thousands of points and colours take 50 ms. The tool's marker is therefore assembled as CDR bytes:
its points and colours are inserted into a serialised marker without any.
"""

import struct
from typing import Any

import numpy as np
from geometry_msgs.msg import Point
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.serialization import serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from rft_ros.estimator import Estimate, Estimator, Measurement, Wrench
from rft_ros.ground import HeightMap
from rft_ros.rft import plate_forces, rotation_matrix
from rft_ros.tool import Tool

_MOST_FACETS = 5000  # of a finer tool every k-th facet is drawn, so that drawing takes about 1 ms
_METRES_PER_NEWTON = 0.01
_SENTINEL = 0x5AFEC0DE
_PREDICTED, _MEASURED = (0.85, 0.1, 0.1), (0.1, 0.5, 0.1)


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
    sand, up, down = np.array([[0.76, 0.7, 0.5]]), np.array([[0.8, 0.1, 0.1]]), np.array([[0.1, 0.2, 0.8]])
    rgb = sand + np.abs(x) * (np.where(x > 0.0, up, down) - sand)
    return np.column_stack([rgb, np.ones(len(x))]).astype(np.float32)


def _splice(marker: Marker, corners: bytes, colours: NDArray[np.float32]) -> bytes:
    """The serialised MarkerArray of one marker, with points and colours inserted.

    Points follow lifetime and frame_locked; all after them is aligned to 4 bytes at most, so nothing else moves.
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
        self._answer: Estimate | None = None
        self._state = estimator.state.copy()
        self._model, self._settings = estimator.model, estimator.settings
        self._surface, self._ground = estimator.surface, estimator.ground
        self._drawn_ground: tuple[HeightMap, bytes, NDArray[np.float32]] | None = None

    def estimated(self, answer: Estimate) -> None:
        """Keep an estimate with its state, model and settings: the estimator's own may change before `publish`."""
        self._answer = answer
        self._state[:] = self._estimator.state
        self._model, self._settings = self._estimator.model, self._estimator.settings
        self._surface, self._ground = self._estimator.surface, self._estimator.ground

    def publish(self, measurement: Measurement | None) -> None:
        """Draw the last estimate and measurement, if there is a subscriber and the estimate is new."""
        answer, state, model = self._answer, self._state, self._model
        if answer is None or not self._publisher.get_subscription_count():
            return
        self._answer = None
        if self._tool is not model.tool:
            self._prepare(model.tool)
        plane = self._surface
        forces = plate_forces(model.tool.facets, model.law, state, surface_height=plane.height, slope=plane.slope)
        facets = self._facets
        traction = np.linalg.norm(forces[facets], axis=1) / model.tool.facets.packed[6, facets]
        tool = self._marker(answer.stamp, 0, Marker.TRIANGLE_LIST)
        p, q = tool.pose.position, tool.pose.orientation
        p.x, p.y, p.z, q.x, q.y, q.z, q.w = state[:7].tolist()
        tool.scale.x = tool.scale.y = tool.scale.z = 1.0
        self._publisher.publish(_splice(tool, self._corners, _colours(traction)))
        measured = measurement.compensated if measurement else None
        self._publisher.publish(MarkerArray(markers=self._small(answer, measured, state)))
        if self._ground is not None and model.ground is not None:
            self._publish_ground(answer.stamp, self._ground, model.ground)

    def _publish_ground(self, stamp: int, ground: HeightMap, start: HeightMap) -> None:
        """The known cells, at most some thousand, coloured by how far they have moved since the start."""
        if self._drawn_ground is None or self._drawn_ground[0] is not ground:
            cells = ground.points(at_most=_MOST_FACETS)
            moved = cells[:, 2] - start.heights_at(cells[:, 0], cells[:, 1])
            corners = np.ascontiguousarray(cells, dtype="<f8").tobytes()
            self._drawn_ground = ground, corners, _moved_colours(np.nan_to_num(moved))
        _, corners, colours = self._drawn_ground
        marker = self._marker(stamp, 4, Marker.CUBE_LIST)
        marker.pose.orientation.w = 1.0
        marker.scale.x = marker.scale.y = ground.cell
        marker.scale.z = 1e-4
        self._publisher.publish(_splice(marker, corners, colours))

    def _prepare(self, tool: Tool) -> None:
        """Choose the facets that are drawn, and serialise their corners in the tool frame."""
        self._tool, count = tool, len(tool.faces)
        self._facets = np.arange(0, count, 1 + (count - 1) // _MOST_FACETS)
        self._corners = np.ascontiguousarray(tool.vertices[tool.faces[self._facets]], dtype="<f8").tobytes()

    def _small(self, answer: Estimate, measured: Wrench | None, state: NDArray[np.float64]) -> list[Marker]:
        """Arrows for the forces, from the tool frame's origin, and the surface around the tool."""
        cell = self._settings.load_cell
        to_world = rotation_matrix(state[3:7]) @ rotation_matrix(cell.quaternion)
        markers = []
        for number, wrench, colour in ((1, answer.predicted, _PREDICTED), (2, measured, _MEASURED)):
            if wrench is None:
                continue
            arrow = self._marker(answer.stamp, number, Marker.ARROW)
            tip = state[:3] + _METRES_PER_NEWTON * (to_world @ np.array(wrench[:3]))
            arrow.points = [_point(state[:3]), _point(tip)]
            arrow.scale.x, arrow.scale.y, arrow.scale.z = 0.003, 0.006, 0.008
            arrow.color.r, arrow.color.g, arrow.color.b = colour
            arrow.color.a = 1.0
            markers.append(arrow)
        surface = self._marker(answer.stamp, 3, Marker.CUBE)
        surface.pose.position.x, surface.pose.position.y = state[0].item(), state[1].item()
        (sx, sy), x, y = self._surface.slope, surface.pose.position.x, surface.pose.position.y
        surface.pose.position.z = self._surface.height + sx * x + sy * y
        surface.scale.x = surface.scale.y = 10.0 * self._model.tool.plates.reach
        surface.scale.z = 1e-4
        surface.color.r, surface.color.g, surface.color.b, surface.color.a = 0.76, 0.7, 0.5, 0.4
        markers.append(surface)
        return markers

    def _marker(self, stamp: int, number: int, kind: int) -> Marker:
        marker = Marker(ns="rft", id=number, type=kind, action=Marker.ADD)
        marker.header.frame_id = self._settings.world_frame
        marker.header.stamp.sec, marker.header.stamp.nanosec = divmod(stamp, 1_000_000_000)
        return marker


def _point(x: Any) -> Point:
    return Point(x=float(x[0]), y=float(x[1]), z=float(x[2]))
