"""Checks of what was sent that need no model of the grains: poses that jump, and dead axes of the load cell."""

from collections.abc import Iterator

import numpy as np

from rft_ros.diagnosis.evidence import ENOUGH, Evidence
from rft_ros.diagnosis.finding import Finding
from rft_ros.rft import FORCE, POSITION

MIN_JUMP_M = 0.01
MIN_JUMP_FACTOR = 30.0
"""Least jump of a pose, and that over the steps of a moving tool."""
MIN_GAP_FACTOR = 5.0
"""Time between two poses over the usual one, after which the tool may be elsewhere."""
DEAD_SHARE = 1e-3
"""Of the changes of the other axes: those of a dead axis are smaller."""
MIN_TURN_SHARE = 0.25
"""Of the changes of a reading, the share that reverses the one before: two thirds with white noise, none without."""


def jumps(e: Evidence) -> Iterator[Finding]:
    """A pose that jumps, as if another TCP were chosen on the arm."""
    steps = np.linalg.norm(np.diff(e.poses[:, POSITION], axis=0), axis=1)
    seconds = np.diff(e.pose_time)
    if len(steps) < ENOUGH or not (steps > 0.0).any():
        return
    usual = float(np.quantile(steps[steps > 0.0], 0.9))
    row = int(steps.argmax())
    far = float(steps[row])
    # after a gap the tool is elsewhere
    is_gap = seconds[row] > MIN_GAP_FACTOR * np.median(seconds)
    if far > max(MIN_JUMP_M, MIN_JUMP_FACTOR * usual) and not is_gap:
        yield Finding(
            name="jump",
            said=f"a pose jumps by {1e3 * far:.0f} mm in {1e3 * seconds[row]:.3g} ms,"
            f" {e.pose_time[row + 1]:.1f} s after the first one: faster than a tool can move",
            evidence={"millimetres": 1e3 * far},
            advice="do not change the TCP within a recording, and take the parts with --start and --end",
        )


def dead_axes(e: Evidence) -> Iterator[Finding]:
    """An axis of the force that always reads the same while another has noise: without noise, symmetry does that."""
    force = e.raw[:, FORCE]
    if len(force) < ENOUGH:
        return
    changes = np.ptp(force, axis=0)
    dead = np.flatnonzero(changes <= DEAD_SHARE * changes.max())
    steps = np.diff(force[:, changes.argmax()])
    turn_share = float(np.mean(steps[1:] * steps[:-1] < 0.0))
    if turn_share > MIN_TURN_SHARE and len(dead):
        which = " and ".join("xyz"[axis] for axis in dead)
        yield Finding(
            name="dead axis",
            said=f"the force along {which} reads {force[0, dead[0]]:.3g} N throughout",
            advice="check the load cell's cable and its driver",
        )
