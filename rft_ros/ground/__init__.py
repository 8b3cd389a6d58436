"""The ground as a height map, where it is known: from a file or from the points that a depth camera sees.

`HeightMap` holds heights of square cells in the world frame, and reads and writes files. `Support` finds the plane that
stands for the surface around a tool. `Ground` replaces the map as clouds of points come, at times that depend on stamps
only. Without a map the ground is the level plane at `surface_height`.
"""

from rft_ros.ground.ground import DELAY, Cloud, Ground, LocalSurface, Support
from rft_ros.ground.height_map import MOST_CELLS, HeightMap, ToolBox, read_height_map, write_height_map

__all__ = [
    "DELAY",
    "MOST_CELLS",
    "Cloud",
    "Ground",
    "HeightMap",
    "LocalSurface",
    "Support",
    "ToolBox",
    "read_height_map",
    "write_height_map",
]
