"""A plate of 0.5 kg falls into grains, in a simulator of ten lines of NumPy: python examples/numpy_loop.py."""

import numpy as np

from rft_ros.rft import MEDIA, alpha_y_model, treers2021
from rft_ros.simulation import Grains, free_body
from rft_ros.tool import load_tool

MEDIUM = MEDIA["generic"]
MASS = 0.5  # kg
INERTIA = np.diag([1.1e-4, 1.1e-4, 2.2e-4])  # kg m²
STEP = 0.002  # s
GRAVITY = np.array([0.0, 0.0, -9.81, 0.0, 0.0, 0.0])


def main() -> int:
    """Let it fall for two seconds; print where it is."""
    law = treers2021(MEDIUM, alpha_y_model("linear", MEDIUM), zeta=0.33, mobilization_length=0.003)
    grains = Grains(load_tool("plate", tolerance=0.025), law)
    position = np.array([0.0, 0.0, 0.02])
    quaternion = np.array([0.06, 0.04, 0.0, 0.9974])
    twist = np.zeros(6)
    for k in range(1001):
        quaternion /= np.linalg.norm(quaternion)
        inverse = free_body(MASS, INERTIA, quaternion)
        wrench = grains.step(
            position, quaternion, twist, STEP, inverse_inertia=inverse, free_acceleration=GRAVITY
        )
        # a round body would need its gyroscopic torque too
        twist = twist + STEP * (GRAVITY + inverse @ wrench)
        position = position + STEP * twist[:3]
        a, b, c = 0.5 * STEP * twist[3:]
        x, y, z, w = quaternion
        turn = [
            a * w + b * z - c * y,
            b * w + c * x - a * z,
            c * w + a * y - b * x,
            -a * x - b * y - c * z,
        ]
        quaternion = quaternion + turn
        if k % 200 == 0:
            depth = -1e3 * position[2]
            speed = 1e3 * np.linalg.norm(twist[:3])
            print(
                f"{k * STEP:3.1f} s  depth {depth:7.3f} mm  speed {speed:8.3g} mm/s  force {wrench[2]:6.3f} N"
            )
    print(f"the grains took {grains.energy:.3f} J")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
