"""A six-axis arm under joint impedance presses a plate into grains, drags, turns, holds, lets go.

python examples/mujoco_press.py -o press.png

pip install '.[mujoco]' installs what it needs.
Prints the mean and the scatter of the force at each hold.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import mujoco
import numpy as np
from six_axis_arm import SixAxisArm

from rft_ros.simulation import MujocoGrains

SPEED = 0.02  # m/s
STAY = 1.5  # s at each waypoint
PLACE = np.array([0.45, 0.0, 0.0])
WAYPOINTS = (  # what, where the arm is commanded to [mm], turn about the vertical [degrees]
    ("start", (0, 0, 15), 0),
    ("press", (0, 0, -20), 0),
    ("drag", (20, 0, -20), 0),
    ("turn", (20, 0, -20), 20),
    ("back", (15, 0, -20), 20),
    ("let go", (15, 0, 15), 20),
)


def main(arguments: list[str] | None = None) -> int:
    """Run the arm; draw the path and the force."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("mujoco_press.png"), help="picture to write"
    )
    parser.add_argument(
        "--mesh", default="plate", help="shipped mesh, or a file in millimetres (default plate)"
    )
    parser.add_argument(
        "--stiffness", type=float, default=1.0, help="factor of the joints' stiffness (default 1)"
    )
    given = parser.parse_args(arguments)

    arm = SixAxisArm(given.mesh, stiffness=given.stiffness)
    grains = MujocoGrains(arm.model, body="tool", zeta=0.33, mobilization_length=0.003)
    times = [0.0]
    places = [PLACE + 1e-3 * np.array(WAYPOINTS[0][1])]
    turns = [0.0]
    holds = []
    for what, where, turn in WAYPOINTS[1:]:
        goal = PLACE + 1e-3 * np.array(where)
        path = np.linalg.norm(goal - places[-1]) + 0.03 * abs(np.radians(turn) - turns[-1])
        times += [times[-1] + path / SPEED, times[-1] + path / SPEED + STAY]
        places += [goal, goal]
        turns += [np.radians(turn)] * 2
        holds.append((what, times[-1] - 0.5 * STAY, times[-1]))

    arm.start(places[0])
    rows = []
    while arm.data.time < times[-1]:
        t = arm.data.time
        position = [np.interp(t, times, axis) for axis in np.transpose(places)]
        half = 0.5 * np.interp(t, times, turns)
        arm.data.ctrl[:] = arm.joints(position, [0.0, 0.0, np.sin(half), np.cos(half)])
        grains.apply(arm.data)
        mujoco.mj_step(arm.model, arm.data)
        rows.append([t, *(arm.data.xpos[arm.body] - PLACE), *grains.wrench])

    t, x, _, z, *wrench = np.array(rows).T
    for what, begin, end in holds:
        force = np.array(wrench[:3])[:, (t > begin) & (t < end)]
        mean = np.linalg.norm(force.mean(axis=1))
        scatter = np.linalg.norm(np.ptp(force, axis=1))
        print(f"hold after {what:7s} {mean:8.3f} N, scatter {scatter:.1e} N")
    figure, (upper, lower) = plt.subplots(2, 1, figsize=(8, 6), sharex=True, layout="constrained")
    for values, label in ((x, "x"), (z, "z")):
        upper.plot(t, 1e3 * values, label=label)
    for values, label in zip(wrench[:3], ("fx", "fy", "fz"), strict=True):
        lower.plot(t, values, label=label)
    for axes, label in ((upper, "Tool [mm]"), (lower, "Force on the tool [N]")):
        for what, begin, end in holds:
            axes.axvspan(begin, end, color="0.92")
            axes.annotate(what, (begin, 0.9), xycoords=("data", "axes fraction"), fontsize=8)
        axes.set_ylabel(label)
        axes.legend(loc="lower left")
    lower.set_xlabel("Time [s]")
    figure.savefig(given.output, dpi=100)
    print(f"-> {given.output}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
