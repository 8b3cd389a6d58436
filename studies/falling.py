"""The animation of docs/in-the-loop.md: an ellipsoid falls into grains, its plates coloured by their tractions.

python -m studies.falling docs/images/falling.gif
"""

import io
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]
from PIL import Image

from rft_ros.installation import share_directory
from rft_ros.simulation import MujocoGrains
from rft_ros.simulation.mechanism import import_mujoco
from studies.paper import law
from studies.result import new_figure, picture

__all__ = ["draw_fall"]

_MESH = share_directory("rft_ros") / "meshes" / "ellipsoid.stl"
_SCENE = f'''<mujoco><option timestep="0.001"/><asset>
<mesh name="ellipsoid" file="{_MESH}" scale="0.001 0.001 0.001"/></asset>
<worldbody><body name="tool" quat="0.95 0.25 0.1 0"><freejoint/><geom type="mesh" mesh="ellipsoid" mass="0.05"/></body>
</worldbody></mujoco>'''
_CLEARANCE = 0.01  # m, of the lowest point before the fall


def draw_fall(path: Path) -> None:
    """Write the animation as a GIF."""
    mujoco = import_mujoco()
    model: Any = mujoco.MjModel.from_xml_string(_SCENE)
    data: Any = mujoco.MjData(model)
    grains = MujocoGrains(model, body="tool", law=law("linear", mobilization_length=0.003))
    mujoco.mj_kinematics(model, data)
    body, tool, pictures = data.body("tool"), grains.tool, []
    data.qpos[2] = _CLEARANCE - tool.lowest_point(body.xmat.reshape(3, 3))
    size = 1.1 * float(np.linalg.norm(tool.corners, axis=1).max())
    centers, normals = tool.plates.centroids.T, tool.plates.normals.T
    faces = tool.vertices[tool.faces]
    middle, out = (
        faces.mean(axis=1),
        np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]),
    )
    out /= np.linalg.norm(out, axis=1)[:, None]
    nearest = (((middle[:, None] - centers) / size) ** 2).sum(axis=2) + (
        (out[:, None] - normals) ** 2
    ).sum(axis=2)
    plate_of_face = nearest.argmin(axis=1)
    for k in range(360):
        grains.apply(data)
        mujoco.mj_step(model, data)
        if k % 10:
            continue
        pressure = np.linalg.norm(grains.tractions(), axis=1)[plate_of_face]
        figure = new_figure(3.6, 3.0)
        axes: Any = figure.add_subplot(projection="3d")
        placed = faces @ body.xmat.reshape(3, 3).T + body.xpos
        axes.add_collection3d(
            Poly3DCollection(placed, facecolors=colormaps["viridis"](pressure / 3e3))
        )
        edge = 1.6 * size
        bed = np.array([[-edge, -edge, 0], [edge, -edge, 0], [edge, edge, 0], [-edge, edge, 0]])
        axes.add_collection3d(Poly3DCollection([bed], facecolors="#C2A878", alpha=0.35))
        axes.set(xlim=(-edge, edge), ylim=(-edge, edge), zlim=(-edge, edge))
        axes.view_init(elev=8.0, azim=-60.0)
        axes.set_box_aspect((1.0, 1.0, 1.0), zoom=1.1)
        axes.set_axis_off()
        axes.set_title(f"{k:3d} ms   {grains.wrench[2]:5.2f} N up", fontsize=9)
        pictures.append(Image.open(io.BytesIO(picture(figure))).convert("RGB"))
    few = [one.quantize(48) for one in pictures]
    few[0].save(path, save_all=True, append_images=few[1:], duration=60, loop=0, optimize=True)


if __name__ == "__main__":
    draw_fall(Path(sys.argv[1]))
