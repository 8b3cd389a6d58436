"""Bodies of 20 g to 5 kg fall into grains and lie still: python examples/mujoco_drop.py -o drop.png.

pip install '.[mujoco]' installs what it needs.
Prints how far each sank, and how it moved over the last seconds.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import mujoco
import numpy as np

from rft_ros.installation import share_directory
from rft_ros.simulation import MujocoGrains

MESHES = share_directory("rft_ros") / "meshes"
MASSES = 0.02, 0.1, 0.5, 2.0, 5.0  # kg
HEIGHT = 0.02  # of the lowest point above the grains [m]

BODY = """
<body name="{name}" pos="{x} 0 {z}" quat="0.99 0.12 0.08 0">
  <freejoint/> <geom type="mesh" mesh="{mesh}" mass="{mass}"/>
</body>"""
MODEL = """
<mujoco>
  <option timestep="{timestep}"/>
  <default> <mesh scale="0.001 0.001 0.001"/> <geom contype="0" conaffinity="0"/> </default>
  <asset> <mesh name="plate" file="{meshes}/plate.stl"/> <mesh name="ellipsoid" file="{meshes}/ellipsoid.stl"/> </asset>
  <worldbody> {bodies} </worldbody>
</mujoco>"""


def main(arguments: list[str] | None = None) -> int:
    """Run the bodies, all in one model; draw their depth and speed over time."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("mujoco_drop.png"), help="picture to write"
    )
    parser.add_argument("--seconds", type=float, default=5.0, help="time to simulate (default 5)")
    parser.add_argument(
        "--timestep", type=float, default=0.002, help="of MuJoCo [s] (default 0.002)"
    )
    given = parser.parse_args(arguments)

    names = [
        (f"{mesh}, {mass:g} kg", mesh, mass) for mesh in ("plate", "ellipsoid") for mass in MASSES
    ]
    bodies = "".join(
        BODY.format(name=name, x=0.2 * k, z=0.05, mesh=mesh, mass=mass)
        for k, (name, mesh, mass) in enumerate(names)
    )
    model = mujoco.MjModel.from_xml_string(
        MODEL.format(timestep=given.timestep, meshes=MESHES, bodies=bodies)
    )
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    grains = MujocoGrains(
        model, bodies=[name for name, _, _ in names], zeta=0.33, mobilization_length=0.003
    )
    for k, tool in enumerate(grains.tools):
        data.qpos[7 * k + 2] = HEIGHT - tool.lowest_point(data.xmat[k + 1].reshape(3, 3))

    rows = []
    start = data.qpos[2::7].copy()
    while data.time < given.seconds:
        grains.apply(data)
        mujoco.mj_step(model, data)
        speed = np.linalg.norm(data.qvel.reshape(-1, 6)[:, :3], axis=1)
        rows.append([data.time, *(start - HEIGHT - data.qpos[2::7]), *speed])

    t, *columns = np.array(rows).T
    depths = columns[: len(names)]
    speeds = columns[len(names) :]
    late = t > 0.6 * t[-1]
    figure, (upper, lower) = plt.subplots(2, 1, figsize=(8, 7), sharex=True, layout="constrained")
    for k, ((name, mesh, _), depth, speed) in enumerate(zip(names, depths, speeds, strict=True)):
        style = {
            "color": f"C{k % len(MASSES)}",
            "ls": "-" if mesh == "plate" else "--",
            "label": name,
        }
        upper.plot(t, 1e3 * depth, **style)
        lower.semilogy(t, 1e3 * np.maximum(speed, 1e-12), **style)
        moved = 1e3 * np.ptp(depth[late])
        print(
            f"{name:20s} sank {1e3 * depth[-1]:7.2f} mm, moved {moved:.5f} mm after {0.6 * t[-1]:.1f} s"
        )
    upper.set_ylabel("Depth of the lowest point [mm]")
    upper.legend(fontsize=8)
    lower.set_ylabel("Speed [mm/s]")
    lower.set_xlabel("Time [s]")
    figure.savefig(given.output, dpi=100)
    print(f"-> {given.output}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
