"""Keeps the map of the ground, and updates it from clouds of points in a thread of its own."""

from collections import deque
from concurrent.futures import Future, ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.ground.height_map import HeightMap
from rft_ros.ground.support import LAST_SURFACE, LocalSurface, Support
from rft_ros.rft import rotation_matrix
from rft_ros.rft.frames import Placement

__all__ = ["DELAY", "Cloud", "GroundMapper"]

Array = NDArray[np.float64]

DELAY = 500_000_000
"""A cloud changes the map only for poses stamped at least this much later [ns], whenever it arrived.

Live and in a replay the same stamps then give the same results. No pose has to wait for the map, which takes some
hundredths of a second to compute.
"""

_CLOUDS = 16  # that wait for a pose
_PLACES = 2048  # poses kept to look up the tool's place at the stamp of a cloud: 2 s at 1 kHz, four times `DELAY`


class Cloud(NamedTuple):
    """Points of the ground, coordinates `x`, `y`, `z` [m], shape [n] each, in `frame`; stamp [ns]."""

    stamp: int
    frame: str
    x: NDArray[np.floating]
    y: NDArray[np.floating]
    z: NDArray[np.floating]


class GroundMapper:
    """Keeps the current `map` of the ground, and updates it from clouds.

    `start`: the map before the first cloud. `corners`: of the tool's convex hull [m], shape [k, 3]. `cloud_stamp` and
    `pose_stamp`: stamps of the last cloud and of the last pose [ns].
    """

    def __init__(self, start: HeightMap, corners: Array) -> None:
        self._start = start
        # A thread computes the maps. numba's loops release the GIL, so that a tick does not wait for them.
        self._thread = ThreadPoolExecutor(1)
        self._clouds: deque[tuple[Cloud, Placement | None]] = deque(maxlen=_CLOUDS)
        self._places: deque[tuple[int, tuple[float, ...], tuple[float, ...]]] = deque(maxlen=_PLACES)
        self._waiting: deque[tuple[int, Future[HeightMap]]] = deque()  # the stamp at which a map is due, and the map
        self.use_tool(corners)
        self.start_run()

    def use_tool(self, corners: Array) -> None:
        """Continue with another tool. `corners`: of its convex hull [m], shape [k, 3]."""
        self._corners, self._support, self._last = corners, Support(corners), np.zeros(1, LAST_SURFACE)

    def reset(self) -> None:
        """Go back to the map at the start, and drop the clouds that are under way."""
        for _, made in self._waiting:
            made.result()  # the thread may still compute it, and would change `_merged`
        self._waiting.clear()
        self._clouds.clear()
        self.map = self._merged = self._start  # the thread alone uses `_merged` while clouds are under way
        self._last[:] = 0

    def start_run(self) -> None:
        """Start a new run, or a run in new axes, with the map at the start."""
        self.reset()
        self._places.clear()
        self.cloud_stamp = self.pose_stamp = 0

    def add(self, cloud: Cloud, camera: Placement | None = None) -> None:
        """Add a cloud. It waits for the first pose at or after its stamp, since points on the tool are left out.

        `camera`: placement of the cloud's frame in the world; None: the cloud is in world axes.
        """
        if cloud.stamp < self.cloud_stamp:
            self._clouds.clear()  # they belong to the run before, or had stamps in the future
        self.cloud_stamp = cloud.stamp
        self._clouds.append((cloud, camera))
        self._merge()

    def add_pose(self, stamp: int, position: tuple[float, ...], quaternion: tuple[float, ...]) -> None:
        """Add the tool's pose, and use the maps that are due at its stamp [ns]. Waits for a map that is late."""
        self.pose_stamp = stamp
        self._places.append((stamp, position, quaternion))
        if self._clouds:
            self._merge()
        while self._waiting and self._waiting[0][0] <= stamp:
            self.map = self._waiting.popleft()[1].result()
            self._last[:] = 0

    def surface_at(self, state: Array, level: float) -> LocalSurface:
        """The surface around the tool at a state, shape [13], columns `STATE`; `level` [m] where nothing is known."""
        return self._support.local_surface(self.map, state, level=level, last=self._last)

    def _merge(self) -> None:
        while self._clouds and self._clouds[0][0].stamp <= self.pose_stamp:
            cloud, camera = self._clouds.popleft()
            _, position, quaternion = next(place for place in self._places if place[0] >= cloud.stamp)
            tool = np.array(position), rotation_matrix(quaternion), self._corners
            self._waiting.append((cloud.stamp + DELAY, self._thread.submit(self._with, cloud, camera, tool)))

    def _with(self, cloud: Cloud, camera: Placement | None, tool: tuple[Array, Array, Array]) -> HeightMap:
        x, y, z = cloud.x, cloud.y, cloud.z
        if camera is not None:
            axes = rotation_matrix(camera.quaternion)
            u, v, w = np.array([x, y, z], dtype=np.float64)
            with np.errstate(invalid="ignore", over="ignore"):  # points that are not finite
                x, y, z = (a * u + b * v + c * w + p for (a, b, c), p in zip(axes, camera.position, strict=True))
        self._merged = self._merged.with_points(x, y, z, tool)
        return self._merged
