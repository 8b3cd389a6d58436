"""The ground as a height map, from a file or from the point clouds of a depth camera.

Without a map the ground is the level plane at `surface_height`.
"""

from rft_ros.ground.height_map import MAX_CELL_COUNT, HeightMap, read_height_map, write_height_map
from rft_ros.ground.mapper import CLOUD_DELAY_NS, Cloud, GroundMapper, ToolPlace
from rft_ros.ground.support import LAST_SURFACE, Footing, LocalSurface, Support

__all__ = [
    "CLOUD_DELAY_NS",
    "LAST_SURFACE",
    "MAX_CELL_COUNT",
    "Cloud",
    "Footing",
    "GroundMapper",
    "HeightMap",
    "LocalSurface",
    "Support",
    "ToolPlace",
    "read_height_map",
    "write_height_map",
]
