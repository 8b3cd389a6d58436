"""The ground over time: the map in force, the clouds of points that will change it, and the surface under a tool."""

import math
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.ground.height_map import HeightMap, ToolBox
from rft_ros.ground.support import LocalSurface, Support
from rft_ros.rft import LEVEL, rotation_matrix

__all__ = ["DELAY", "Cloud", "Ground"]

Array = NDArray[np.float64]

DELAY = 500_000_000
"""A cloud changes the ground this long [ns] after its stamp, whenever it arrives until then. So the same stamps give
the same results live and in a replay, and a pose finds the map ready: it takes some hundredths of a second."""

_CLOUDS = 16
_PLACES = 2048  # poses kept to find the tool's place at the stamp of a cloud: `DELAY` at 1,000 Hz, four times


class Cloud(NamedTuple):
    """Points of the ground, coordinates `x`, `y`, `z` [m], shape [n] each, in `frame`; stamp [ns]."""

    stamp: int
    frame: str
    x: NDArray[np.floating]
    y: NDArray[np.floating]
    z: NDArray[np.floating]


class _Place(NamedTuple):
    stamp: int
    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]


class Ground:
    """The map in force, `map`, which `level` sets to `start`; None: a level plane.

    `corners` of the tool's convex hull, tool frame [m], shape [k, 3]. `background`: with an executor of one thread,
    clouds become maps there; without one, at once. `last_cloud`, `newest`: stamps of the last cloud and pose [ns].
    """

    def __init__(self, start: HeightMap | None, corners: Array, background: Executor | None = None) -> None:
        self.map = start
        self.last_cloud = self.newest = 0
        self._start = start
        self._background = background
        self._merged = start  # of the thread that makes maps
        self._clouds: deque[tuple[Cloud, tuple[Array, Array] | None]] = deque(maxlen=_CLOUDS)
        self._places: deque[_Place] = deque(maxlen=_PLACES)
        self._waiting: deque[tuple[int, Callable[[], HeightMap]]] = deque()  # when it is due, and what returns it
        self._flat = LocalSurface(0.0, LEVEL, 0.0, math.nan)
        self.use(corners)

    def use(self, corners: Array) -> None:
        """Take another tool, by the corners of its hull [m], shape [k, 3]."""
        self._corners = corners
        self._support = Support(corners) if self._start is not None else None

    def level(self) -> None:
        """Go back to the map at the start, and drop the clouds that are under way."""
        for _, made in self._waiting:
            made()  # the thread may be at it
        self._waiting.clear()
        self._clouds.clear()
        self.map = self._merged = self._start

    def begin_again(self) -> None:
        """Go back to the start in a new run, or in new axes."""
        self.level()
        self._places.clear()
        self.last_cloud = self.newest = 0

    def add(self, cloud: Cloud, camera: tuple[Array, Array] | None = None) -> None:
        """Take a cloud; it waits for the first pose at or after its stamp, which says where the tool was.

        `camera`: position [m], shape [3], and rotation to world, shape [3, 3], of the cloud's frame; None: it is the
        world's.
        """
        if cloud.stamp < self.last_cloud:
            self._clouds.clear()  # of the run before, or of a stamp in the future
        self.last_cloud = cloud.stamp
        self._clouds.append((cloud, camera))
        self._merge()

    def see(
        self, stamp: int, position: tuple[float, float, float], quaternion: tuple[float, float, float, float]
    ) -> None:
        """Take the tool's pose, and bring into force what is due at its stamp [ns].

        Waits for a map that a stalled process has not made.
        """
        if self._start is None:
            return
        self.newest = stamp
        self._places.append(_Place(stamp, position, quaternion))
        if self._clouds:
            self._merge()
        while self._waiting and self._waiting[0][0] <= stamp:
            self.map = self._waiting.popleft()[1]()

    def under(self, state: Array, level: float) -> LocalSurface:
        """The surface around the tool at a state, shape [13], columns `STATE`; `level` [m] where nothing is known."""
        if self.map is not None and self._support is not None:
            return self._support.local_surface(self.map, state, level=level)
        return self.flat(level)

    def flat(self, level: float) -> LocalSurface:
        """A level surface [m]."""
        if level != self._flat.height:
            self._flat = LocalSurface(level, LEVEL, 0.0, math.nan)
        return self._flat

    def _merge(self) -> None:
        while self._clouds and self._clouds[0][0].stamp <= self.newest:
            cloud, camera = self._clouds.popleft()
            place = next(place for place in self._places if place.stamp >= cloud.stamp)
            low, high = self._corners.min(axis=0), self._corners.max(axis=0)
            rotation = rotation_matrix(place.quaternion)
            tool = ToolBox(position=np.array(place.position), rotation=rotation, low=low, high=high)
            make = partial(self._with, cloud, camera, tool)
            # without a thread at once: when it is due is on a pose's path
            made = self._background.submit(make).result if self._background else partial(_itself, make())
            self._waiting.append((cloud.stamp + DELAY, made))

    def _with(self, cloud: Cloud, camera: tuple[Array, Array] | None, tool: ToolBox) -> HeightMap:
        x, y, z = cloud.x, cloud.y, cloud.z
        if camera is not None:
            position, axes = camera
            u, v, w = np.array([x, y, z], dtype=np.float64)
            with np.errstate(invalid="ignore", over="ignore"):  # points that are not finite
                x, y, z = (a * u + b * v + c * w + p for (a, b, c), p in zip(axes, position, strict=True))
        assert self._merged is not None
        self._merged = self._merged.with_points(x, y, z, tool)
        return self._merged


def _itself(made: HeightMap) -> HeightMap:
    return made
