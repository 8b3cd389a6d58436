"""Hypotheses on the poses, the tool's size and the surface."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rft_ros.diagnosis.evidence import ENOUGH, LEAST_FORCE, Array, Evidence, Finding
from rft_ros.estimator.pose_noise import NOISY, PoseNoise
from rft_ros.estimator.quality import sentence_on
from rft_ros.estimator.samples import PoseSample
from rft_ros.rft import FORCE, POSITION

__all__ = [
    "REPEATED",
    "noise_of_poses",
    "repeated_poses",
    "repeats",
    "size_of_tool",
    "surface",
    "unit_of_poses",
    "unseen_surface",
]

_FASTEST = 5.0  # m/s: no arm moves a tool faster
_FAR, _FAST = 10.0, 1.0  # m, m/s: no arm exceeds both this extent and this mean speed in grains
_FARTHEST = 1000.0  # of the tool's sizes: no arm moves a tool so far
_APART = 0.1  # s between two changes of the pose; a longer time is a rest
REPEATED = 1.5
"""Poses per new pose of a moving tool, from which on they are sent more often than measured."""

_BEGUN = 0.05  # of the greatest force of a descent: a larger one shows that the tool has touched the grains
_CONTACT_ERROR, _CONTACT_SHARE = 0.005, 0.1  # m, and share of the depth: together the greatest error of surface_height


def unit_of_poses(e: Evidence) -> Iterator[Finding]:
    """Poses in millimetres: the tool moves too fast, or too far from the grains."""
    if len(e.poses) < ENOUGH:
        return
    place, seconds = e.poses[:, POSITION], np.diff(e.pose_time)
    steps = np.linalg.norm(np.diff(place, axis=0), axis=1)
    moving = (steps > 0.0) & (seconds > 0.0)
    speed = float(np.median(steps[moving] / seconds[moving])) if moving.any() else 0.0
    extent, mean = float(np.ptp(place, axis=0).max()), steps[moving].sum() / max(seconds[moving].sum(), 1e-12)
    given = np.linalg.norm(e.velocity, axis=1) if e.settings.twist_source == "topic" else np.zeros(0)
    twist = float(np.median(given[given > 0.0])) if (given > 0.0).any() else speed
    far = sentence_on(e.tool, depth=float(e.depth.max(initial=0.0)), force=0.0)
    high = sentence_on(e.tool, depth=float(e.depth.min(initial=0.0)), force=0.0)
    if extent > _FAR and mean > _FAST:
        said = f"the tool moves over {extent:.3g} m at {mean:.3g} m/s on average"
    elif speed > _FASTEST or (twist > 0.0 and speed > 100.0 * twist):
        said = f"the tool moves at {speed:.3g} m/s by the poses"
    elif "poses" in far + high:
        said = far if "poses" in far else high
    elif twist > 100.0 * speed > 0.0:
        said = f"twists say {twist:.3g} m/s where the poses move at {speed:.3g} m/s"
        yield Finding(False, f"units: {said}: the twists' driver must give m/s, and not mm/s")
        return
    else:
        return
    yield Finding(False, f"units: {said}: the poses' driver must give metres, and not millimetres (factor 0.001)")


def size_of_tool(e: Evidence) -> Iterator[Finding]:
    """The tool's extents, which a wrong `mesh.scale` makes implausible."""
    extents = " x ".join(f"{1e3 * length:.3g}" for length in np.ptp(e.tool.vertices, axis=0))
    said = e.tool.issues.get("size")
    if said:
        yield Finding(False, f"mesh {e.tool.name}: {extents} mm: {said}")
        return
    deepest = 1e3 * e.depth.max(initial=0.0)
    depth = f", at most {deepest:.4g} mm below the surface" if deepest > 0.0 else ""
    yield Finding(True, f"mesh {e.tool.name}: {extents} mm{depth}")


def noise_of_poses(e: Evidence) -> Iterator[Finding]:
    """Noise of the poses at which the model's memory no longer follows the motion."""
    follower, reach, gap = PoseNoise(), e.tool.plates.reach, round(1e9 * e.settings.max_input_age)
    found = list[float]()
    for seconds, (x, y, z, *quaternion) in zip(e.pose_time.tolist(), e.poses.tolist(), strict=True):
        stamp = 1 + round(1e9 * seconds)
        if follower.add(PoseSample(stamp, "", (x, y, z), tuple(quaternion)), gap=gap):
            found.append(follower.at_tip(reach))
    noise = float(np.median(found)) if found else 0.0
    if noise > NOISY:
        said = f"the poses have a noise of {1e3 * noise:.2g} mm at the tool's farthest point"
        advice = "smooth them in their driver, or take them from the arm's encoders"
        yield Finding(False, f"noise: {said}, over {1e3 * NOISY:g} mm, so forces follow the motion late; {advice}")


def repeats(time: Array, poses: Array) -> tuple[NDArray[np.int64], NDArray[np.bool_], float]:
    """The rows at which the pose changes; between which of them the tool moves; and the poses per new pose there."""
    changed = np.flatnonzero((np.diff(poses, axis=0) != 0.0).any(axis=1)) + 1
    seconds = np.diff(time[changed])
    moving = (seconds > 0.0) & (seconds < _APART)
    return changed, moving, float(np.diff(changed)[moving].mean()) if moving.any() else 1.0


def repeated_poses(e: Evidence) -> Iterator[Finding]:
    """A driver that publishes faster than it measures: while the tool moves, most poses equal the one before."""
    changed, moving, often = repeats(e.pose_time, e.poses)
    if moving.sum() >= ENOUGH and often > REPEATED:
        rate = 1.0 / np.diff(e.pose_time[changed])[moving].mean()
        said = f"each pose is sent {often:.1f} times while the tool moves: they are measured at {rate:.0f} Hz"
        sent = f"and sent at {often * rate:.0f} Hz"
        advice = f"let the driver send each once, or set max_rate: {rate:.0f}; repeats are left out of the velocity"
        yield Finding(False, f"repeated poses: {said} {sent}; {advice}")


def surface(e: Evidence) -> Iterator[Finding]:
    """The height at which the measured force begins, against `surface_height`."""
    height, error = e.settings.surface_height, _error_of_surface(e)
    if error is None:
        return
    metres, allowed = error
    if abs(metres) <= allowed:
        near = f"the measured force begins within {1e3 * allowed:.0f} mm of it"
        yield Finding(True, f"surface_height: {height:g} m; {near}")
        return
    side = "above" if metres > 0.0 else "below"
    found = f"the measured force begins {1e3 * abs(metres):.0f} mm {side} where it should with {height:g} m"
    yield Finding(False, f"surface_height: {found}; set it to about {height + metres:.3f}, or calibrate")


def unseen_surface(e: Evidence) -> Iterator[Finding]:
    """Where no contact was measured, whether the user has set `surface_height`."""
    if _error_of_surface(e) is None:
        given = "surface_height" in e.named
        advice = "" if given else ", the default, since it is not set; measure it, or run rft calibrate"
        yield Finding(given, f"surface_height: {e.settings.surface_height:g} m{advice}")


def _error_of_surface(e: Evidence) -> tuple[float, float] | None:
    """How far above the expected surface the measured force begins on the longest descent, and the allowed error [m].

    None if it does not begin. Only magnitudes of forces are compared, which a wrong sign or mounting does not change.
    """
    if not len(e.time):
        return None
    deepest_later = np.maximum.accumulate(e.depth[::-1])[::-1]
    way = np.arange(int((deepest_later - e.depth).argmax()), len(e.depth))
    way = way[np.diff(np.maximum.accumulate(e.depth[way]), prepend=-np.inf) > 0.0]
    depth, measured = e.depth[way], e.force[way]
    noise = float(np.linalg.norm(np.std(measured[:ENOUGH], axis=0)))
    force = np.linalg.norm(measured - np.median(measured[:ENOUGH], axis=0), axis=1)
    share = max(LEAST_FORCE, _BEGUN * force.max(), 5.0 * noise) / max(force.max(), 1e-9)
    begins, expected = (_onset(f, share) for f in (force, np.linalg.norm(e.predicted[way][:, FORCE], axis=1)))
    if begins is None:
        return None
    metres = (0.0 if expected is None else float(depth[expected])) - float(depth[begins])
    return metres, _CONTACT_ERROR + _CONTACT_SHARE * float(depth[-1] - depth[begins])


def _onset(force: Array, share: float) -> int | None:
    """The row after which the force exceeds this share of its peak, with the fewest exceptions; None without one."""
    if share >= 0.5:
        return None
    loud = np.where(force > share * force.max(), 1, -1)
    row = int(np.argmax(np.append(loud[::-1].cumsum()[::-1], 0)))
    return row if ENOUGH // 2 <= row <= len(force) - ENOUGH // 2 else None
