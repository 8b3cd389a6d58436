"""~/markers: the tool coloured by traction, arrows of the forces, the surface. Drawn only if there is a subscriber."""

import struct

import numpy as np
from geometry_msgs.msg import Point, Quaternion, Vector3
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rclpy.time import Time
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from rft_ros.estimator import Estimate, Estimator
from rft_ros.ground import HeightMap
from rft_ros.rft import FORCE, POSITION, QUATERNION, plate_forces, rotation_matrix
from rft_ros.rft.frames import Wrench

Array = NDArray[np.float64]

_MOST_FACETS = 5000  # of a finer tool every k-th facet is drawn, so that drawing takes about 1 ms
_METRES_PER_NEWTON = 0.01
_SENTINEL = 0x5AFEC0DE
_PREDICTED = ColorRGBA(r=0.85, g=0.1, b=0.1, a=1.0)
_MEASURED = ColorRGBA(r=0.1, g=0.5, b=0.1, a=1.0)
_SURFACE = ColorRGBA(r=0.76, g=0.7, b=0.5, a=0.4)
_SAND = np.array([0.76, 0.7, 0.5])
_RISEN = np.array([0.8, 0.1, 0.1])
_SUNK = np.array([0.1, 0.2, 0.8])
_YELLOW = np.array([0.95, 0.85, 0.1])
_RED = np.array([0.8, 0.0, 0.1])


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
    # the doubles start at a multiple of 8 from byte 4, after a length of 4 bytes
    padding = b"\x00" * (-len(head) % 8)
    rgba = np.column_stack([rgb, np.ones(len(rgb))])
    places = points.astype("<f8").tobytes()
    colours = rgba.astype("<f4").tobytes()
    return b"".join([head, count, padding, places, count, colours, template[end + 8 :]])


def _point(place: Array) -> Point:
    x, y, z = place.tolist()
    return Point(x=x, y=y, z=z)


class Markers:
    """Publishes markers of the last estimate, when a timer calls it between ticks."""

    def __init__(self, node: Node, estimator: Estimator) -> None:
        self._estimator = estimator
        self._publisher = node.create_publisher(MarkerArray, "~/markers", 1)
        self._answer: Estimate | None = None
        # the last compensated wrench; None if there was no measurement
        self.measured: Wrench | None = None
        self._drawn: tuple[HeightMap, Array] | None = None
        self._state = estimator.state.copy()

    def estimated(self, answer: Estimate) -> None:
        """Keep an estimate, with its state, model and settings, which may change in the estimator before `publish`."""
        e = self._estimator
        self._answer = answer
        self._state[:] = e.state
        self._model = e.model
        self._settings = e.settings
        self._load_cell = e.load_cell
        self._surface = e.surface
        self._ground = e.ground

    def publish(self) -> None:
        """Draw the last estimate and measurement, if there is a subscriber and the estimate is new."""
        answer = self._answer
        if answer is None or not self._publisher.get_subscription_count():
            return
        self._answer = None
        self._publish_tool(answer.stamp)
        markers = [
            self._surface_around(answer.stamp),
            self._arrow(answer.stamp, 1, answer.predicted, _PREDICTED),
        ]
        if self.measured is not None:
            markers.append(self._arrow(answer.stamp, 2, self.measured, _MEASURED))
        self._publisher.publish(MarkerArray(markers=markers))
        self._publish_ground(answer.stamp)

    def _publish_tool(self, stamp: int) -> None:
        tool = self._model.tool
        plane = self._surface
        drawn = slice(None, None, 1 + (len(tool.faces) - 1) // _MOST_FACETS)
        law = self._model.law
        forces = plate_forces(
            tool.facets, law, self._state, surface_height=plane.height, slope=plane.slope
        )
        traction = np.linalg.norm(forces[drawn], axis=1) / tool.facets.areas[drawn]
        share = traction[:, None] / max(traction.max(), 1e-12)
        # light grey without traction
        rgb = np.where(share > 0.0, _YELLOW + share * (_RED - _YELLOW), 0.8)
        marker = self._marker(stamp, 0, Marker.TRIANGLE_LIST, Vector3(x=1.0, y=1.0, z=1.0))
        qx, qy, qz, qw = self._state[QUATERNION].tolist()
        marker.pose.position = _point(self._state[POSITION])
        marker.pose.orientation = Quaternion(x=qx, y=qy, z=qz, w=qw)
        corners = tool.vertices[tool.faces[drawn]].reshape(-1, 3)
        self._publisher.publish(_spliced(marker, corners, np.repeat(rgb, 3, axis=0)))

    def _publish_ground(self, stamp: int) -> None:
        """Publish the known cells, at most some thousand: blue if they sank since the start, red if they rose.

        The colour is full at 20 mm.
        """
        ground = self._ground
        start = self._model.ground
        if ground is None or start is None:
            return
        if (
            self._drawn is None or self._drawn[0] is not ground
        ):  # to find the cells of the largest maps takes 0.2 s
            self._drawn = ground, ground.points(at_most=_MOST_FACETS)
        cells = self._drawn[1]
        moved = np.nan_to_num(cells[:, 2] - start.heights_at(cells[:, 0], cells[:, 1]))[:, None]
        share = np.clip(moved / 0.02, -1.0, 1.0)
        rgb = _SAND + np.abs(share) * (np.where(share > 0.0, _RISEN, _SUNK) - _SAND)
        marker = self._marker(
            stamp, 4, Marker.CUBE_LIST, Vector3(x=ground.cell, y=ground.cell, z=1e-4)
        )
        self._publisher.publish(_spliced(marker, cells, rgb))

    def _surface_around(self, stamp: int) -> Marker:
        side = 10.0 * self._model.tool.plates.reach
        surface = self._marker(stamp, 3, Marker.CUBE, Vector3(x=side, y=side, z=1e-4))
        surface.color = _SURFACE
        x, y, _ = self._state[POSITION].tolist()
        sx, sy = self._surface.slope
        surface.pose.position = Point(x=x, y=y, z=self._surface.height + sx * x + sy * y)
        return surface

    def _arrow(self, stamp: int, number: int, wrench: Wrench, colour: ColorRGBA) -> Marker:
        """An arrow from the tool frame's origin along the force of a wrench, which has the sensor's axes."""
        position = self._state[POSITION]
        to_world = rotation_matrix(self._state[QUATERNION]) @ rotation_matrix(
            self._load_cell.quaternion
        )
        force = to_world @ np.array(wrench[FORCE])
        arrow = self._marker(stamp, number, Marker.ARROW, Vector3(x=0.003, y=0.006, z=0.008))
        arrow.color = colour
        arrow.points = [_point(position), _point(position + _METRES_PER_NEWTON * force)]
        return arrow

    def _marker(self, stamp: int, number: int, kind: int, scale: Vector3) -> Marker:
        marker = Marker(ns="rft", id=number, type=kind, action=Marker.ADD, scale=scale)
        marker.header.frame_id = self._settings.world_frame
        marker.header.stamp = Time(nanoseconds=stamp).to_msg()
        marker.pose.orientation.w = 1.0
        return marker
