"""A bucket digs and lifts, and a wheel drives up a slope, in MuJoCo without ROS: python examples/dig.py -o dig.png.

pip install '.[mujoco]' installs what it needs. Draws both from the side, with the force of the grains on each.
"""

import argparse

import matplotlib.pyplot as plt
import mujoco
import numpy as np

from rft_ros.ground import HeightMap
from rft_ros.simulation import MujocoGrains

SCENE = """<mujoco>
  <option timestep="0.004" integrator="implicitfast"/>
  <worldbody>
    <body name="bucket" pos="0 0 0.24">
      <joint name="boom" axis="0 -1 0"/>
      <geom type="box" pos="-0.03 0 -0.24" size="0.003 0.05 0.05"/>
      <geom type="box" pos="0.01 0 -0.19" size="0.04 0.05 0.003"/>
      <geom type="box" pos="0.01 0 -0.29" size="0.04 0.05 0.003"/>
      <geom type="box" pos="0.01 -0.047 -0.24" size="0.04 0.003 0.05"/>
      <geom type="box" pos="0.01 0.047 -0.24" size="0.04 0.003 0.05"/>
    </body>
    <body name="wheel" pos="0.5 0 0.085">
      <joint type="slide" axis="1 0 0"/> <joint type="slide" axis="0 0 1"/> <joint name="axle" axis="0 1 0"/>
      <geom type="cylinder" size="0.1 0.04" euler="90 0 0" mass="3"/>
    </body>
  </worldbody>
  <actuator> <position joint="boom" kp="500" kv="20"/> <velocity joint="axle" kv="10"/> </actuator>
</mujoco>"""
OUTLINE = np.array(
    [[0, 0, 0.05, -0.03, -0.03, 0.05], [0, -0.19, -0.19, -0.19, -0.29, -0.29]]
)  # x, z of the bucket


def slope(x: np.ndarray) -> np.ndarray:
    """The height of the grains: level, then 8 degrees [m]."""
    return 0.14 * (x - 0.7).clip(0.0)


def main(arguments: list[str] | None = None) -> int:
    """Run both for 8 s and draw what the grains do to them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", default="dig.png", help="picture to write")
    given = parser.parse_args(arguments)

    x, y = (0.02 * np.mgrid[-30:70, -10:10] + 0.01).reshape(
        2, -1
    )  # the middles of the map's cells
    bed = HeightMap.unknown(0.02).with_points(x, y, slope(x))
    model = mujoco.MjModel.from_xml_string(SCENE)
    data = mujoco.MjData(model)
    data.joint("boom").qpos = -1.2
    grains = MujocoGrains(model, bodies=["bucket", "wheel"], zeta=0.6, ground=bed)

    figure, (side, over_time) = plt.subplots(
        2, 1, figsize=(9, 6), layout="constrained", height_ratios=[2, 3]
    )
    side.plot(x, slope(x), color="tan")
    forces = []
    while data.time < 8.0:
        data.ctrl[:] = (
            min(0.4 * data.time, 2.4) - 1.2,
            1.0,
        )  # angle of the boom [rad], speed of the axle [rad/s]
        bucket, wheel = grains.apply(data)[:, [0, 2]]
        mujoco.mj_step(model, data)
        forces.append([*bucket, *wheel])
        if len(forces) % 250 == 125:
            turn = data.body("bucket").xmat.reshape(3, 3)[np.ix_([0, 2], [0, 2])]
            outline = data.body("bucket").xpos[[0, 2], None] + turn @ OUTLINE
            center = data.body("wheel").xpos[[0, 2]]
            side.plot(*outline, color="C0")
            side.add_patch(plt.Circle(center, 0.1, fill=False, color="C1"))
            for place, force in ((outline[:, -2], bucket), (center, wheel)):
                side.quiver(
                    *place, *force, angles="xy", scale_units="xy", scale=300.0, width=0.003
                )
    side.set(
        aspect="equal",
        xlabel="x [m]",
        ylabel="z [m]",
        title="Every second; 0.1 m of arrow is 30 N",
    )
    labels = ["bucket, forwards", "bucket, upwards", "wheel, forwards", "wheel, upwards"]
    for label, force in zip(labels, np.transpose(forces), strict=True):
        style = {
            "color": "C0" if "bucket" in label else "C1",
            "ls": "-" if "up" in label else "--",
        }
        over_time.plot(model.opt.timestep * np.arange(len(force)), force, label=label, **style)
    over_time.set(xlabel="Time [s]", ylabel="Force by the grains [N]")
    over_time.legend()
    figure.savefig(given.output, dpi=100)
    largest = np.linalg.norm(np.array(forces)[:, :2], axis=1).max()
    print(
        f"largest force on the bucket: {largest:.1f} N; the wheel drove to x = {center[0]:.3f} m"
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
