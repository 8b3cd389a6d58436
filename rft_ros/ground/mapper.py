"""Keeps the map of the ground, and updates it from clouds of points in a thread of its own."""

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.ground.height_map import HeightMap
from rft_ros.rft import rotation_matrix
from rft_ros.rft.frames import Placement, Quaternion, Vector

Array = NDArray[np.float64]

CLOUD_DELAY_NS = 500_000_000
"""A cloud changes the map only for poses stamped at least this much later [ns], whenever it arrived.

Live and in a replay the same stamps then give the same results. No pose has to wait for the map, which takes some
hundredths of a second to compute.
"""

_MAX_CLOUD_COUNT = 16  # that wait for a pose
# poses kept to look up the tool's place at the stamp of a cloud: 2 s at 1 kHz, four times `CLOUD_DELAY_NS`
_MAX_PLACE_COUNT = 2048


class Cloud(NamedTuple):
    """Points of the ground, coordinates `x`, `y`, `z` [m], shape [n] each, in `frame`; stamp [ns]."""

    stamp: int
    frame: str
    x: NDArray[np.floating]
    y: NDArray[np.floating]
    z: NDArray[np.floating]


class ToolPlace(NamedTuple):
    """Where a tool was at a stamp [ns]: pose of its frame, and `corners` of its convex hull in it [m], shape [k, 3]."""

    stamp: int
    position: Vector
    quaternion: Quaternion
    corners: Array


class GroundMapper:
    """Keeps the current `map` of the ground, and updates it from clouds.

    `start`: the map before the first cloud. `cloud_stamp` and `pose_stamp`: stamps of the last cloud and of the last
    pose [ns]. Poses and clouds are in the axes of one world frame, and belong to one run.
    """

    def __init__(self, start: HeightMap) -> None:
        self.map = start
        self._merged = start  # with all clouds that were given to the thread, which alone uses it
        # A thread computes the maps. numba's loops release the GIL, so that a tick does not wait for them.
        self._thread = ThreadPoolExecutor(1)
        self._clouds: deque[tuple[Cloud, Placement | None]] = deque(maxlen=_MAX_CLOUD_COUNT)
        self._places: deque[ToolPlace] = deque(maxlen=_MAX_PLACE_COUNT)
        # the stamp at which a map is due, and the map
        self._waiting: deque[tuple[int, Future[HeightMap]]] = deque()
        self.cloud_stamp = 0
        self.pose_stamp = 0

    def add(self, cloud: Cloud, camera: Placement | None = None) -> None:
        """Add a cloud. It waits for the first pose at or after its stamp, since points on the tool are left out.

        `camera`: placement of the cloud's frame in the world; None: the cloud is in world axes.
        """
        if cloud.stamp < self.cloud_stamp:
            self._clouds.clear()  # they belong to the run before, or had stamps in the future
        self.cloud_stamp = cloud.stamp
        self._clouds.append((cloud, camera))
        self._merge()

    def add_place(self, place: ToolPlace) -> None:
        """Add the tool's place, and use the maps that are due at its stamp. Waits for a map that is late."""
        self.pose_stamp = place.stamp
        self._places.append(place)
        if self._clouds:
            self._merge()
        while self._waiting and self._waiting[0][0] <= place.stamp:
            _, due = self._waiting.popleft()
            self.map = due.result()

    def _merge(self) -> None:
        while self._clouds and self._clouds[0][0].stamp <= self.pose_stamp:
            cloud, camera = self._clouds.popleft()
            place = next(place for place in self._places if place.stamp >= cloud.stamp)
            tool = np.array(place.position), rotation_matrix(place.quaternion), place.corners
            self._waiting.append(
                (
                    cloud.stamp + CLOUD_DELAY_NS,
                    self._thread.submit(self._with, cloud, camera, tool),
                )
            )

    def _with(
        self, cloud: Cloud, camera: Placement | None, tool: tuple[Array, Array, Array]
    ) -> HeightMap:
        points = np.array([cloud.x, cloud.y, cloud.z], dtype=np.float64)
        if camera is not None:
            with np.errstate(invalid="ignore", over="ignore"):  # points that are not finite
                points = np.einsum("ij,jn", rotation_matrix(camera.quaternion), points)
                points += np.array(camera.position)[:, None]
        self._merged = self._merged.with_points(points[0], points[1], points[2], tool)
        return self._merged
