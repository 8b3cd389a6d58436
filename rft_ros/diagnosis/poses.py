"""Checks of the poses and the tool's size, which need no model of the grains."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rft_ros.diagnosis.evidence import ENOUGH, Evidence
from rft_ros.diagnosis.finding import Finding
from rft_ros.diagnosis.trial import Array, Indices
from rft_ros.estimator import FASTEST_M_S, NOISY, PoseNoise, PoseSample, sentence_on
from rft_ros.rft import POSITION, VELOCITY
from rft_ros.tool.check import missing_factor

MAX_EXTENT_M = 10.0
MAX_MEAN_SPEED_M_S = 1.0
"""No arm exceeds both this extent and this mean speed in grains."""
MIN_REST_S = 0.1
"""Time between two changes of the pose from which on the tool rests."""
MIN_ROUNDING_M = 5e-4
"""Resolution of positions from which on velocity and depth are too coarse."""
MIN_JUMP_M = 0.01
MIN_JUMP_FACTOR = 30.0
"""Least jump of a pose, and that over the steps of a moving tool."""
MIN_GAP_FACTOR = 5.0
"""Time between two poses over the usual one, after which the tool may be elsewhere."""
REPEATED = 1.5
"""Poses per new pose of a moving tool, from which on they are sent more often than measured."""


def unit_of_poses(e: Evidence) -> Iterator[Finding]:
    """Poses in millimetres: the tool moves too fast, or too far from the grains."""
    if len(e.poses) < ENOUGH:
        return
    place = e.poses[:, POSITION]
    seconds = np.diff(e.pose_time)
    with np.errstate(over="ignore"):  # an infinite step is implausible, too
        steps = np.linalg.norm(np.diff(place, axis=0), axis=1)
    moving = (steps > 0.0) & (seconds > 0.0)
    speed = float(np.median(steps[moving] / seconds[moving])) if moving.any() else 0.0
    extent = float(np.ptp(place, axis=0).max())
    mean = float(steps[moving].sum() / max(seconds[moving].sum(), 1e-12))
    twist, speed_beside_twist = _speeds_by_twists_and_poses(e)
    evidence = {"extent": extent, "mean": mean, "speed": speed_beside_twist, "twist": twist}
    far = [
        sentence_on(e.tool, depth=float(d), force=0.0)
        for d in (e.depth.max(initial=0.0), e.depth.min(initial=0.0))
    ]
    far = [sentence for sentence in far if "poses" in sentence]
    advice = "the poses' driver must give metres, and not millimetres (factor 0.001)"
    if extent > MAX_EXTENT_M and mean > MAX_MEAN_SPEED_M_S:
        said = f"the tool moves over {extent:.3g} m at {mean:.3g} m/s on average"
    elif speed > FASTEST_M_S or (twist > 0.0 and speed_beside_twist > 100.0 * twist):
        said = f"the tool moves at {max(speed, speed_beside_twist):.3g} m/s by the poses"
    elif far:
        said = far[0]
    elif twist > 100.0 * speed_beside_twist > 0.0:
        said = f"twists say {twist:.3g} m/s where the poses move at {speed_beside_twist:.3g} m/s"
        advice = "the twists' driver must give m/s, and not mm/s"
    else:
        return
    yield Finding(
        name="units",
        said=said,
        evidence=evidence,
        advice=advice,
        spoils_calibration=True,
    )


def _speeds_by_twists_and_poses(e: Evidence) -> tuple[float, float]:
    """Speed of the tool by its twists, and by its poses at the same moments [m/s]; 0 and 0 without twists.

    Only moments of fast motion count: at rest the noise of the poses is all that moves.
    """
    if e.config.inputs.twist_source != "topic" or len(e.time) < ENOUGH:
        return 0.0, 0.0
    given = np.linalg.norm(e.state[1:, VELOCITY], axis=1)
    is_fast = given >= 0.5 * np.quantile(given, 0.9)
    seconds = np.diff(e.time)[is_fast]
    distance = np.linalg.norm(np.diff(e.state[:, POSITION], axis=0), axis=1)[is_fast]
    total = max(float(seconds.sum()), 1e-9)
    return float(given[is_fast] @ seconds) / total, float(distance.sum()) / total


def size_of_tool(e: Evidence) -> Iterator[Finding]:
    """The tool's extents, which a wrong `mesh.scale` makes implausible."""
    extents = " x ".join(f"{1e3 * length:.3g}" for length in np.ptp(e.tool.vertices, axis=0))
    said = f"{e.tool.name}, {extents} mm"
    fault = e.tool.issues.get("size")
    if fault:
        factor = missing_factor(float(np.ptp(e.tool.vertices, axis=0).max()))
        remedy = {"mesh.scale": float(f"{e.tool.frame.scale * factor:.6g}")}
        yield Finding(name="mesh", said=f"{said}: {fault}", remedy=remedy, spoils_calibration=True)
        return
    deepest = 1e3 * e.depth.max(initial=0.0)
    if deepest > 0.0:
        said += f", at most {deepest:.4g} mm below the surface"
    yield Finding(name="mesh", ok=True, said=said)


def rounded_poses(e: Evidence) -> Iterator[Finding]:
    """Positions written with too few decimals: they lie on a grid, and repeat or jitter in its steps."""
    grid = resolution(e.poses[:, POSITION])
    if grid < MIN_ROUNDING_M:
        return
    *_, often = repeats(e.pose_time, e.poses)
    if often > REPEATED or noise_at_tip(e) > NOISY:
        millimetres = 1e3 * grid
        yield Finding(
            name="rounded poses",
            said=f"the positions are rounded to {millimetres:g} mm, too coarse for a velocity and a depth",
            evidence={"millimetres": millimetres},
            advice="write them with 5 decimals or more (0.01 mm), in the driver or the logger",
        )


def resolution(positions: Array) -> float:
    """The largest of 10, 1, 0.1 and 0.01 mm of which all positions are multiples [m]; 0 if they are finer.

    `positions`: shape [n, 3] [m].
    """
    for grid in (1e-2, 1e-3, 1e-4, 1e-5):
        steps = positions[np.isfinite(positions).all(axis=1)] / grid
        if np.abs(steps - np.round(steps)).max(initial=0.0) < 1e-3:
            return grid
    return 0.0


def noise_at_tip(e: Evidence) -> float:
    """Noise of the poses at the tool's farthest point [m], by the median of the estimator's; 0 if it is not known."""
    follower = PoseNoise()
    reach = e.tool.plates.reach
    gap = e.config.inputs.max_age
    found = list[float]()
    for seconds, (x, y, z, *quaternion) in zip(
        e.pose_time.tolist(), e.poses.tolist(), strict=True
    ):
        stamp = 1 + round(1e9 * seconds)
        if follower.add(PoseSample(stamp, "", (x, y, z), tuple(quaternion)), gap=gap):
            found.append(follower.at_tip(reach))
    return float(np.median(found)) if found else 0.0


def noise_of_poses(e: Evidence) -> Iterator[Finding]:
    """Noise of the poses at which the model's memory no longer follows the motion."""
    noise = noise_at_tip(e)
    if noise > NOISY:
        millimetres = 1e3 * noise
        said = f"the poses have a noise of {millimetres:.2g} mm at the tool's farthest point"
        yield Finding(
            name="noise",
            said=f"{said}, over {1e3 * NOISY:g} mm, so forces follow the motion late",
            evidence={"millimetres": millimetres},
            advice="smooth them in their driver, or take them from the arm's encoders",
        )


def repeats(time: Array, poses: Array) -> tuple[Indices, NDArray[np.bool_], float]:
    """The rows at which the pose changes; between which of them the tool moves; and the poses per new pose there."""
    changed = np.flatnonzero((np.diff(poses, axis=0) != 0.0).any(axis=1)) + 1
    seconds = np.diff(time[changed])
    moving = (seconds > 0.0) & (seconds < MIN_REST_S)
    return changed, moving, float(np.diff(changed)[moving].mean()) if moving.any() else 1.0


def repeated_poses(e: Evidence) -> Iterator[Finding]:
    """A driver that publishes faster than it measures: while the tool moves, most poses equal the one before."""
    changed, moving, often = repeats(e.pose_time, e.poses)
    if moving.sum() < ENOUGH or often <= REPEATED or _is_step_of_grid(e.poses[changed]):
        return
    rate = float(1.0 / np.diff(e.pose_time[changed])[moving].mean())
    said = f"each pose is sent {often:.1f} times while the tool moves: they are measured at {rate:.0f} Hz"
    yield Finding(
        name="repeated poses",
        said=f"{said} and sent at {often * rate:.0f} Hz, and repeats are left out of the velocity",
        evidence={"rate": rate},
        advice="let the driver send each once",
    )


def _is_step_of_grid(poses: Array) -> bool:
    """Whether poses that differ lie one step of their resolution apart, as those of a slow tool that are rounded."""
    grid = resolution(poses[:, POSITION])
    steps = np.abs(np.diff(poses[:, POSITION], axis=0)).max(axis=1)
    return grid > 0.0 and float(np.median(steps)) < 1.5 * grid


def rows_of_new_poses(time: Array, poses: Array) -> Indices:
    """The rows of a tool at rest, and those of a moving one that differ from the row before.

    A driver that publishes faster than it measures repeats poses: those readings belong to poses that nobody measured.
    The last repeats of a rest are left out, too: the tool may have started after they were measured.
    """
    changed, _, often = repeats(time, poses)
    rows = np.arange(len(time))
    if often <= REPEATED:
        return rows
    next_change = np.append(changed, np.iinfo(np.int64).max)[np.searchsorted(changed, rows)]
    waits = next_change - rows
    return np.flatnonzero((waits == 0) | (waits >= often))


def jumps(e: Evidence) -> Iterator[Finding]:
    """A pose farther from the one before than the tool can move, as after a reset or if another TCP is chosen."""
    steps = np.linalg.norm(np.diff(e.poses[:, POSITION], axis=0), axis=1)
    seconds = np.diff(e.pose_time)
    if len(steps) < ENOUGH or not (steps > 0.0).any():
        return
    usual = float(np.quantile(steps[steps > 0.0], 0.9))
    # after a gap the tool is elsewhere
    is_gap = seconds > MIN_GAP_FACTOR * np.median(seconds)
    is_far = (steps > MIN_JUMP_FACTOR * usual) & ~is_gap
    is_jump = (steps > MIN_JUMP_M) & (is_far | (steps > FASTEST_M_S * seconds))
    if is_jump.any():
        row = int(np.where(is_jump, steps, 0.0).argmax())
        millimetres = 1e3 * float(steps[row])
        yield Finding(
            name="jump",
            said=f"a pose jumps by {millimetres:.0f} mm in {1e3 * seconds[row]:.3g} ms,"
            f" {e.pose_time[row + 1]:.1f} s after the first one: faster than a tool can move",
            evidence={"millimetres": millimetres},
            advice="do not change the TCP within a recording, look for a reset of the poses' origin or lost messages,"
            " and take the parts with --start and --end",
            spoils_calibration=True,
        )
