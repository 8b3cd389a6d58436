"""~/markers: the tool coloured by traction, arrows of the forces, the surface. Drawn only if there is a subscriber."""

import struct
from functools import lru_cache, partial

import numpy as np
from geometry_msgs.msg import Point, Vector3
from numpy.typing import NDArray
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rclpy.time import Time
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from rft_ros.estimator import Estimate, Estimator
from rft_ros.ground import HeightMap
from rft_ros.rft import FORCE, POSITION, QUATERNION, plate_forces, rotation_matrix
from rft_ros.rft.frames import Wrench

Array = NDArray[np.float64]

_MOST_FACETS = 5000  # of a finer tool every k-th facet is drawn, so that drawing takes about 1 ms
_METRES_PER_NEWTON = 0.01
_PREDICTED = ColorRGBA(r=0.85, g=0.1, b=0.1, a=1.0)
_MEASURED = ColorRGBA(r=0.1, g=0.5, b=0.1, a=1.0)
_SURFACE = ColorRGBA(r=0.76, g=0.7, b=0.5, a=0.4)
_Scale = dict[float, tuple[float, float, float, float]]
_OF_TRACTION: _Scale = {
    0.0: (0.8, 0.8, 0.8, 1.0),
    1e-9: (0.95, 0.85, 0.1, 1.0),
    1.0: (0.8, 0.0, 0.1, 1.0),
}
"""The colour of a facet, red to alpha, by its traction over the greatest one: grey without any, yellow to red."""
_OF_CHANGE: _Scale = {
    -0.02: (0.1, 0.2, 0.8, 1.0),
    0.0: (0.76, 0.7, 0.5, 1.0),
    0.02: (0.8, 0.1, 0.1, 1.0),
}
"""The colour of a cell of the ground by its rise since the start [m]: blue if it sank, red if it rose."""
_PLACEHOLDER = -1.2345e67
_ONE = struct.pack("<I", 1)


def _coloured(values: Array, scale: _Scale) -> Array:
    """The colours of values on a scale, shape [n, 4]."""
    channels = zip(*scale.values(), strict=True)
    return np.column_stack([np.interp(values, [*scale], channel) for channel in channels])


def _spliced(marker: Marker, points: Array, colours: Array) -> bytes:
    """The serialised MarkerArray of one marker with points, shape [n, 3], and colours, shape [n, 4], put in as bytes.

    No pose is answered while a message is serialised. rclpy takes 6 ms for 672 facets and 45 ms for 4,800; this takes
    0.2 and 0.5 ms. They replace one point and one colour, each after a count: of 24 and 16 bytes, so that what follows
    is aligned as before.
    """
    marker.points = [Point(x=_PLACEHOLDER, y=_PLACEHOLDER, z=_PLACEHOLDER)]
    marker.colors = [ColorRGBA()]
    template = serialize_message(MarkerArray(markers=[marker]))
    head, tail = template.split(struct.pack("<3d", *3 * [_PLACEHOLDER]))
    of_points = head.index(_ONE, len(head) - 8)  # 4 bytes of padding may follow
    count = struct.pack("<I", len(points))
    parts = [
        head[:of_points],
        count,
        head[of_points + 4 :],
        points.astype("<f8").tobytes(),
        count,
        colours.astype("<f4").tobytes(),
        tail[4 + 16 :],
    ]
    return b"".join(parts)


def _point(place: Array) -> Point:
    x, y, z = place.tolist()
    return Point(x=x, y=y, z=z)


class Markers:
    """Publishes markers of the last estimate, when a timer calls it between ticks.

    `measured`: the last compensated wrench; None if there was no measurement.
    """

    def __init__(self, node: Node, estimator: Estimator) -> None:
        self._estimator = estimator
        self._publisher = node.create_publisher(MarkerArray, "~/markers", 1)
        self._answer: Estimate | None = None
        self.measured: Wrench | None = None
        # to find the cells of the largest maps takes 0.2 s
        self._cells_of = lru_cache(maxsize=1)(partial(HeightMap.points, at_most=_MOST_FACETS))

    def estimated(self, answer: Estimate) -> None:
        """Keep an estimate with its state and surface: a later pose without an estimate changes the estimator's."""
        self._answer = answer
        self._state = self._estimator.state
        self._surface = self._estimator.surface

    def forget(self) -> None:
        """Do not draw the last estimate, because its model or its frames are no longer in use."""
        self._answer = None

    def publish(self) -> None:
        """Draw the last estimate and measurement, if there is a subscriber and the estimate is new."""
        answer = self._answer
        if answer is None or not self._publisher.get_subscription_count():
            return
        self._answer = None
        stamp = Time(nanoseconds=answer.stamp).to_msg()
        self._header = Header(stamp=stamp, frame_id=self._estimator.config.frames.world)
        self._to_world = rotation_matrix(self._state[QUATERNION])
        markers = [self._surface_around(), self._arrow(1, answer.predicted, _PREDICTED)]
        if self.measured is not None:
            markers.append(self._arrow(2, self.measured, _MEASURED))
        self._publisher.publish(self._tool())
        self._publisher.publish(MarkerArray(markers=markers))
        self._publish_ground()

    def _tool(self) -> bytes:
        model = self._estimator.model
        tool = model.tool
        height, slope, *_ = self._surface
        forces = plate_forces(
            tool.facets, model.law, self._state, surface_height=height, slope=slope
        )
        drawn = slice(None, None, 1 + (len(tool.faces) - 1) // _MOST_FACETS)
        traction = np.linalg.norm(forces[drawn], axis=1) / tool.facets.areas[drawn]
        colours = _coloured(traction / max(traction.max(), 1e-12), _OF_TRACTION)
        corners = tool.vertices[tool.faces[drawn]].reshape(-1, 3)
        places = self._state[POSITION] + corners @ self._to_world.T
        marker = self._marker(0, Marker.TRIANGLE_LIST, (1.0, 1.0, 1.0))
        return _spliced(marker, places, np.repeat(colours, 3, axis=0))

    def _publish_ground(self) -> None:
        """Publish the known cells, at most some thousand."""
        ground = self._estimator.ground
        start = self._estimator.model.ground
        if ground is None or start is None:
            return
        cells = self._cells_of(ground)
        x, y, height = cells.T
        rise = np.nan_to_num(height - start.heights_at(x, y))
        marker = self._marker(4, Marker.CUBE_LIST, (ground.cell, ground.cell, 1e-4))
        self._publisher.publish(_spliced(marker, cells, _coloured(rise, _OF_CHANGE)))

    def _surface_around(self) -> Marker:
        side = 10.0 * self._estimator.model.tool.plates.reach
        x, y, _ = self._state[POSITION].tolist()
        height, (sx, sy), *_ = self._surface
        marker = self._marker(3, Marker.CUBE, (side, side, 1e-4))
        marker.color = _SURFACE
        marker.pose.position = Point(x=x, y=y, z=height + sx * x + sy * y)
        return marker

    def _arrow(self, number: int, wrench: Wrench, colour: ColorRGBA) -> Marker:
        """An arrow from the tool frame's origin along the force of a wrench, which has the sensor's axes."""
        position = self._state[POSITION]
        in_tool = rotation_matrix(self._estimator.load_cell.quaternion) @ wrench[FORCE]
        end = position + _METRES_PER_NEWTON * (self._to_world @ in_tool)
        marker = self._marker(number, Marker.ARROW, (0.003, 0.006, 0.008))
        marker.color = colour
        marker.points = [_point(position), _point(end)]
        return marker

    def _marker(self, number: int, kind: int, scale: tuple[float, float, float]) -> Marker:
        x, y, z = scale
        marker = Marker(header=self._header, ns="rft", id=number, type=kind)
        marker.scale = Vector3(x=x, y=y, z=z)
        marker.pose.orientation.w = 1.0
        return marker
