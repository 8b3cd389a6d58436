"""The ground over time: the map in force, and the clouds of points that will change it."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.ground.height_map import HeightMap, ToolBox

__all__ = ["DELAY", "Cloud", "Ground"]

Array = NDArray[np.float64]

DELAY = 500_000_000
"""A cloud changes the ground this long [ns] after its stamp, whenever it arrives until then. So the same stamps give
the same results live and in a replay, and a pose finds the map ready: it takes some hundredths of a second."""


class Cloud(NamedTuple):
    """Points of the ground, coordinates `x`, `y`, `z` [m], shape [n] each, in `frame`; stamp [ns]."""

    stamp: int
    frame: str
    x: NDArray[np.floating]
    y: NDArray[np.floating]
    z: NDArray[np.floating]


class Ground:
    """The map in force, `map`, and `start`, the one that `level` goes back to.

    `background`: with an executor of one thread, clouds become maps there; without one, at once.
    """

    def __init__(self, start: HeightMap, background: Executor | None = None) -> None:
        self.start = start
        self.map = start
        self._background = background
        self._newest = start  # of the thread that makes maps
        self._waiting: deque[tuple[int, Callable[[], HeightMap]]] = deque()  # when it is due, and what returns it

    def level(self) -> None:
        """Go back to the map at the start, and drop the clouds that are under way."""
        for _, made in self._waiting:
            made()  # the thread may be at it
        self._waiting.clear()
        self.map = self._newest = self.start

    def add(self, cloud: Cloud, tool: ToolBox, camera: tuple[Array, Array] | None = None) -> None:
        """Take a cloud; `tool`: where the tool was at its stamp.

        `camera`: position [m], shape [3], and rotation to world, shape [3, 3], of the cloud's frame; None: it is the
        world's.
        """

        def merged() -> HeightMap:
            x, y, z = cloud.x, cloud.y, cloud.z
            if camera is not None:
                position, rotation = camera
                u, v, w = np.array([x, y, z], dtype=np.float64)
                with np.errstate(invalid="ignore", over="ignore"):  # points that are not finite
                    x, y, z = (a * u + b * v + c * w + p for (a, b, c), p in zip(rotation, position, strict=True))
            self._newest = self._newest.with_points(x, y, z, tool)
            return self._newest

        if self._background is None:
            made = merged()  # not when it is due, which is on a pose's path
            self._waiting.append((cloud.stamp + DELAY, lambda: made))
        else:
            self._waiting.append((cloud.stamp + DELAY, self._background.submit(merged).result))

    def advance(self, stamp: int) -> None:
        """Bring into force what is due at a pose's stamp [ns]; waits for a map that a stalled process has not made."""
        while self._waiting and self._waiting[0][0] <= stamp:
            self.map = self._waiting.popleft()[1]()
