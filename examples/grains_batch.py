"""256 environments with randomised grains, as for a robot that learns: python examples/grains_batch.py.

In each a sphere of its own mass falls into grains of its own strength and height; every half second a quarter of them
begins anew. Seeded: two runs print the same rest depths.
"""

import argparse
import time

import numpy as np

from rft_ros.rft import MEDIA, alpha_y_model, treers2021
from rft_ros.simulation import GrainsBatch, free_body
from rft_ros.tool import load_tool

BODIES = 256
STEP = 0.002  # s
GRAVITY = np.array([0.0, 0.0, -9.81, 0.0, 0.0, 0.0])


def main(arguments: list[str] | None = None) -> int:
    """Run the environments; print steps of environments a second, and where the bodies rest."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=2.0, help="time to simulate (default 2)")
    parser.add_argument("--threads", type=int, default=2, help="over environments (default 2)")
    given = parser.parse_args(arguments)

    rng = np.random.default_rng(1)
    medium = MEDIA["generic"]
    tool = load_tool("sphere", tolerance=0.025)
    law = treers2021(medium, alpha_y_model("linear", medium), mobilization_length=0.003)
    grains = GrainsBatch(tool, law, bodies=BODIES, threads=given.threads)
    masses = rng.uniform(0.05, 1.0, BODIES)
    radius = np.ptp(tool.corners[:, 2]) / 2.0
    inverse = np.array(
        [free_body(m, 0.4 * m * radius**2 * np.eye(3), [0, 0, 0, 1]) for m in masses]
    )
    states = np.zeros((BODIES, 13))
    heights = np.zeros(BODIES)

    def begin(which: np.ndarray) -> None:
        heights[which] = rng.uniform(-0.01, 0.01, len(which))
        grains.reset(
            which, strength=rng.uniform(0.2, 1.5, len(which)), surface_height=heights[which]
        )
        states[which] = 0.0
        states[which, 2] = heights[which] - tool.lowest_point(np.eye(3)) + 0.005
        states[which, 6] = 1.0  # qw: no rotation

    begin(np.arange(BODIES))
    steps = round(given.seconds / STEP)
    busy = 0.0
    for k in range(steps):
        if k % 250 == 249:
            begin(rng.choice(BODIES, BODIES // 4, replace=False))
        start = time.perf_counter()
        wrenches = grains.step(states, STEP, inverse_inertia=inverse, free_acceleration=GRAVITY)
        busy += time.perf_counter() - start
        states[:, 7:] += STEP * (GRAVITY + np.einsum("bij,bj->bi", inverse, wrenches))
        states[:, :3] += STEP * states[:, 7:10]  # spheres that do not spin keep their attitude
    depths = 1e3 * (heights - states[:, 2] - tool.lowest_point(np.eye(3)))
    rate = BODIES * steps / busy
    print(
        f"{len(tool.plates)} plates, {given.threads} threads: {rate:,.0f} steps of environments a second"
    )
    print(f"depths {depths.min():.2f} to {depths.max():.2f} mm, mean {depths.mean():.4f} mm")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
