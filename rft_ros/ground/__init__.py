"""The ground as a height map, from a file or from the point clouds of a depth camera.

Without a map the ground is the level plane at `surface_height`.
"""

from rft_ros.ground.ground import DELAY, LAST_SURFACE, Cloud, GroundMapper, LocalSurface, Support
from rft_ros.ground.height_map import MOST_CELLS, HeightMap, read_height_map, write_height_map

__all__ = ["DELAY", "LAST_SURFACE", "MOST_CELLS", "Cloud", "GroundMapper", "HeightMap", "LocalSurface", "Support"]
__all__ += ["read_height_map", "write_height_map"]
