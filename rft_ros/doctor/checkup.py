"""Checks a cell's set-up on its samples. For each question there is a finding: OK, or what to do."""

from collections import Counter
from collections.abc import Collection, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.bags.estimates import Rows, Run
from rft_ros.doctor.finding import Finding
from rft_ros.estimator import Estimator, PoseSample, Reason, Sample, Stamped, TwistSample, WrenchSample
from rft_ros.estimator.air_reading import is_offset
from rft_ros.estimator.samples import OF_TRANSFORMS, STAMP_ZERO
from rft_ros.ground import Cloud
from rft_ros.messages import Role
from rft_ros.parameters import Model, Values, settings_of
from rft_ros.rft import FORCE, STATE
from rft_ros.rft.placement import Placement

__all__ = ["Checkup", "delayed"]

_Array = NDArray[np.float64]

_ENOUGH = 20  # estimates in the grains, or in the air
_LEAST_FORCE = 0.2  # N: smaller forces are not judged
_ALIKE = 0.5  # least correlation of the measured and the predicted force along an axis
_CARRIES = 0.2  # of the strongest axis's force: an axis with less is not judged
_BEGUN = 0.05  # of the greatest force of a descent: a larger one shows that the tool has touched the grains
_CONTACT_ERROR, _CONTACT_SHARE = 0.005, 0.1  # m, and share of the depth: together the greatest error of surface_height
_WEAKEST, _STRONGEST = 0.5, 2.0  # measured over predicted: beds differ by less once they are calibrated
_RARE = 0.01  # share of poses: rarer reasons are not reported
_SOONEST = 0.02  # quantile of the ages at arrival: the age due to clocks and drivers alone, without delays on the way
_START = 1_000_000_000  # ns in which the first transforms and twists may be missing
_EXPECTED = {Reason.AT_REST, Reason.POSE_HISTORY_SHORT, Reason.POSE_RATE_LIMITED, Reason.SURFACE_RATE_LIMITED}
_ROLES: dict[type, Role] = {PoseSample: "pose", TwistSample: "twist", WrenchSample: "wrench", Cloud: "surface"}
_ADVICE: dict[Role, str] = {
    "pose": "start the driver, remap ~/pose, or set pose_source: tf",
    "tf": "start the robot's state publisher, or set pose_source: topic",
    "twist": "set twist_source: pose_difference, or remap ~/twist",
    "wrench": "start the load cell's driver, or remap ~/wrench_measured",
    "surface": "the ground remains the map at the start",
}
_TURNS = Rotation.create_group("O")  # the 24 turns by multiples of 90 degrees


class _Heard(NamedTuple):
    """A message that arrived at a time [ns], with its stamp [ns] and frame."""

    arrival: int
    stamp: int
    frame: str


class Checkup:
    """Finds what is wrong with a cell's set-up from its samples, which are pushed in the order of their arrival.

    `named`: the names of the parameters that the user has set. `topics`: the topic of each role that is needed. `tare`:
    length of a replay's tare [s].
    """

    def __init__(
        self,
        values: Values,
        model: Model,
        *,
        named: Collection[str],
        topics: dict[Role, str],
        tare: float | None = None,
    ) -> None:
        self._named, self._topics, self._tare = named, topics, tare
        # learning is off, since it would compensate a wrong sign or unit
        self._estimator = Estimator(settings_of({**values, "learning.mode": "off"}), model)
        self._run = Run(self._estimator)
        self._heard: dict[Role, list[_Heard]] = {role: [] for role in topics}
        self._began = 0
        self._at_start: Counter[Reason] = Counter()  # reasons before the first estimate

    def push(self, sample: Sample, time: int) -> None:
        """Add a sample that arrived at `time` [ns]."""
        self._began = self._began or time
        if isinstance(sample, Stamped):
            heard = [(_ROLES[type(sample)], sample.stamp, sample.frame)]
        else:
            heard = [("tf", transform.stamp, "") for transform in sample if not transform.fixed][-1:]
        for role, stamp, frame in heard:
            if role in self._heard:
                self._heard[role].append(_Heard(time, stamp, frame))
        e = self._estimator
        for _, answer in e.answers(sample):
            self._run.add(answer)
            if e.estimates == 1 and time - self._began <= _START:
                self._at_start = self._at_start or Counter(e.counts)

    def findings(self, *, complete: bool = True) -> list[Finding]:
        """The findings, after the last sample. A cause comes before its effects.

        `complete`: whether every message arrived.
        """
        rows = self._run.rows()
        poses, rows = len(rows), rows[~np.isnan(rows["compensated"][:, 0])]
        late = list(self._of_lateness())
        mesh = self._of_tool(rows)
        error = _error_of_surface(rows) if mesh.ok and len(rows) else None
        surface = self._of_surface(error)
        found = [*late, *self._of_inputs(), *self._of_frames(), mesh, surface, *self._of_mount()]
        if len(rows) and mesh.ok and (error is None or surface.ok):  # otherwise forces are predicted for a wrong depth
            found += self._of_load_cell(rows, complete=complete and not late)
        if complete and not late:  # otherwise the node may have received samples that are missing here
            found += self._of_reasons(poses)
        return [*found, self._of_estimates(poses)]

    def _ages(self, role: Role) -> _Array:
        """Ages of a role's stamped messages when they arrived [s], shape [n]."""
        return np.array([1e-9 * (m.arrival - m.stamp) for m in self._heard[role] if m.stamp > 0])

    def _of_lateness(self) -> Iterator[Finding]:
        limit = self._estimator.settings.max_input_age
        for role, topic in self._topics.items():
            ages = self._ages(role)
            if role != "surface" and delayed(ages, limit):
                least, most = 1e3 * ages.min(), 1e3 * ages.max()
                said = f"messages on {topic} arrive {least:.0f} to {most:.0f} ms after their stamps"
                busy = "this machine is too busy to judge, or the driver sends in bursts"
                yield Finding(False, f"machine: {said}: {busy}; end other work, and run again")

    def _of_tool(self, rows: Rows) -> Finding:
        tool = self._estimator.model.tool
        extents = " x ".join(f"{1e3 * e:.3g}" for e in np.ptp(tool.vertices, axis=0))
        said = tool.issues.get("size")
        if said:
            return Finding(False, f"mesh {tool.name}: {extents} mm: {said}")
        deepest = 1e3 * rows["depth"].max(initial=0.0)
        depth = f", at most {deepest:.4g} mm below the surface" if deepest > 0.0 else ""
        return Finding(True, f"mesh {tool.name}: {extents} mm{depth}")

    def _of_surface(self, error: tuple[float, float] | None) -> Finding:
        height = self._estimator.settings.surface_height
        if error is None:
            ok = "surface_height" in self._named
            advice = "" if ok else ", the default, since it is not set; measure it, or run rft calibrate"
            return Finding(ok, f"surface_height: {height:g} m{advice}")
        metres, allowed = error
        if abs(metres) <= allowed:
            return Finding(
                True, f"surface_height: {height:g} m; the measured force begins within {1e3 * allowed:.0f} mm of it"
            )
        side = "above" if metres > 0.0 else "below"
        found = f"the measured force begins {1e3 * abs(metres):.0f} mm {side} where it should with {height:g} m"
        return Finding(False, f"surface_height: {found}; set it to about {height + metres:.3f}, or calibrate")

    def _of_inputs(self) -> Iterator[Finding]:
        limit = self._estimator.settings.max_input_age
        for role, topic in self._topics.items():
            heard = self._heard[role]
            if not heard:
                yield Finding(role == "surface", f"{role}: nothing on {topic}; {_ADVICE[role]}")
                continue
            seconds, ages = (heard[-1].arrival - heard[0].arrival) * 1e-9, self._ages(role)
            # messages may be delayed on their way; the age of those that were not is the difference of the clocks
            age = float(np.quantile(ages, _SOONEST)) if len(ages) else 0.0
            unstamped = sum(1 for message in heard if message.stamp <= 0)
            if unstamped:
                yield Finding(False, f"{role}: {unstamped} messages on {topic} have no stamp; the driver must set it")
            elif abs(age) > limit and role != "surface":
                off = f"{abs(age):.3g} s {'old' if age > 0.0 else 'ahead'} when they arrive, over max_input_age"
                yield Finding(False, f"{role}: stamps on {topic} are {off} {limit:g} s: synchronise the clocks")
            else:
                rate = f"{(len(heard) - 1) / seconds:.0f} Hz" if seconds > 0.0 else "1 message"
                named = " and ".join(sorted({message.frame for message in heard}))
                frame = f", frame {named}" if named else ""
                yield Finding(True, f"{role}: {rate} on {topic}{frame}, stamps {1e3 * np.median(ages):.0f} ms old")

    def _of_frames(self) -> Iterator[Finding]:
        unknown = self._estimator.unknown_frames()
        world = self._estimator.settings.world_frame
        of_poses = {message.frame for message in self._heard.get("pose", ())}
        of_twists = {message.frame for message in self._heard.get("twist", ())}
        if unknown.keys() >= {Reason.POSE_FRAME_UNKNOWN, Reason.TWIST_FRAME_UNKNOWN} and of_poses == of_twists:
            del unknown[Reason.POSE_FRAME_UNKNOWN], unknown[Reason.TWIST_FRAME_UNKNOWN]
            named = " and ".join(map(repr, sorted(of_poses)))
            cause = f"poses and twists have frame_id {named}, which is not world_frame {world!r}"
            remedy = f"set world_frame: {min(of_poses)}, or publish the transform between the two on /tf_static"
            yield Finding(False, f"frames: {cause}; {remedy}")
        for reason, sentence in unknown.items():
            remedy = "set the parameter to an existing frame, or publish the transform between the two on /tf_static"
            if reason in OF_TRANSFORMS and reason is not Reason.TF_FRAME_UNKNOWN:
                remedy = "stop or correct one of its publishers"
            if reason in OF_TRANSFORMS and self._transforms_unstamped():
                continue  # the frames are unknown because their transforms have no stamps; another finding says so
            if reason is not Reason.TF_OUT_OF_ORDER:  # `_of_reasons` reports it if it is frequent
                yield Finding(False, f"frames: {sentence}; {remedy}")
        frames = self._estimator.transforms.frames()
        if frames:
            yield Finding(True, f"frames: {', '.join(frames)}")

    def _transforms_unstamped(self) -> bool:
        """Whether most transforms have no stamp, which the finding on their topic reports."""
        heard = self._heard.get("tf", ())
        return 2 * sum(1 for message in heard if message.stamp <= 0) > len(heard)

    def _of_mount(self) -> Iterator[Finding]:
        """Compare the sensor's place in the parameters with that on /tf_static, if both have it."""
        s, cell = self._estimator.settings, self._estimator.settings.load_cell
        place = self._estimator.transforms.fixed(s.tool_frame, s.sensor_frame)
        if place is None or s.sensor_source == "tf" or s.tool_frame == s.sensor_frame:
            return
        off = Placement(cell.position, cell.quaternion).inverse().of(place)
        turn, moved = Rotation.from_quat(off.quaternion).magnitude(), float(np.linalg.norm(off.position))
        if turn < np.radians(1.0) and moved < 1e-3:
            yield Finding(True, "sensor: the parameters and /tf_static agree")
            return
        differ = f"the parameters differ from /tf_static by {np.degrees(turn):.0f} degrees and {1e3 * moved:.0f} mm"
        there = f"on /tf_static: position {_listed(place.position)}, quaternion {_listed(place.quaternion)}"
        yield Finding(False, f"sensor: {differ} ({there}); set sensor.frame_source: tf, or correct one of the two")

    def _of_load_cell(self, rows: Rows, *, complete: bool) -> Iterator[Finding]:
        wet, predicted, measured = rows["depth"] > 0.0, rows["predicted"][:, FORCE], rows["compensated"][:, FORCE]
        seen = (~wet).sum() >= _ENOUGH
        air = measured[~wet].mean(axis=0) if seen else np.zeros(3)
        load = float(np.linalg.norm(air))
        ok, said = True, f"{load:.3g} N in the air"
        if self._tare:
            said += f"; a replay tares over its first {self._tare:g} s; for the node call ~/tare in the air"
        elif not seen and complete:
            ok, said = False, f"in the air at fewer than {_ENOUGH} poses; lift the tool out and run again"
        elif is_offset(load, greatest=0.0):  # whatever the forces in the grains: they may not have been seen
            ok, advice = False, "call ~/tare, replay with --tare, or calibrate sensor.bias and sensor.mass"
            said = f"it reads {said}; {advice}"
        yield Finding(ok, f"load cell: {said}")
        vertical_velocity = rows["state"][:, STATE.index("vz")]
        pushed = wet & (vertical_velocity <= 0.5 * rows["speed"])
        predicted, measured = predicted[pushed], measured[pushed] - air
        too_few = len(predicted) < _ENOUGH
        if too_few or np.abs(predicted).max() < _LEAST_FORCE or np.abs(measured).max() < 0.1 * _LEAST_FORCE:
            if complete:
                yield Finding(False, "sign: no push was seen; push the tool down into the grains and run again")
            return
        direction = self._of_direction(predicted, measured)
        yield direction
        if direction.ok:
            ratio = float((predicted * measured).sum() / (predicted**2).sum())
            ok = _WEAKEST <= ratio <= _STRONGEST
            advice = "" if ok else "; check mesh.scale and the driver's unit (N), or fit medium.zeta with rft calibrate"
            yield Finding(ok, f"strength: measured over predicted force {ratio:.3g}{advice}")

    def _of_direction(self, predicted: _Array, measured: _Array) -> Finding:
        """Whether measured and predicted force agree along each axis.

        If not, the remedies that would make them agree: another sign, or a turn of the cell by multiples of 90 degrees.
        """
        carried = np.sqrt((predicted**2).mean(axis=0))
        axes = (carried >= _CARRIES * carried.max()) & (np.abs(predicted).max(axis=0) >= _LEAST_FORCE)

        def alike(force: _Array) -> _Array:
            """Correlation about zero with the predicted force, along each of `axes`."""
            scale = np.sqrt((predicted**2).sum(axis=0) * (force**2).sum(axis=0))
            found: _Array = ((predicted * force).sum(axis=0) / np.maximum(scale, 1e-12))[axes]
            return found

        found, cell = alike(measured), self._estimator.load_cell
        to_set, to_check = self._of_place()
        shown = ", ".join(f"{name} {r:.2f}" for name, r in zip(np.array([*"xyz"])[axes], found, strict=True))
        if (found >= _ALIKE).all():
            return Finding(True, f"sign: measured and predicted force agree along each axis (correlation {shown})")
        advice = []
        if (alike(-measured) >= _ALIKE).all():
            advice.append(f"set sensor.sign: {-cell.sign:g}")
        turns = [turn for turn in _TURNS if (alike(turn.apply(measured)) >= _ALIKE).all()]
        if turns:
            turn = min(turns, key=lambda t: t.magnitude())
            turned = _listed((Rotation.from_quat(cell.quaternion) * turn).as_quat())
            by = f"as if the cell were turned by {np.degrees(turn.magnitude()):.0f} degrees"
            advice.append(f"{to_set}, such as {turned}, {by}")
        advice = advice or [f"check {to_check}, sensor.sign, mesh.origin, mesh.quaternion and surface_height"]
        which = "; a drag along x and y tells which" if len(advice) > 1 else ""
        off = f"measured and predicted force do not agree along each axis (correlation {shown})"
        return Finding(False, f"sign or quaternion: {off}; {', or '.join(advice)}{which}")

    def _of_place(self) -> tuple[str, str]:
        """What to set if the cell is turned, and what to check: `sensor.quaternion`, or transforms."""
        s = self._estimator.settings
        if s.sensor_source != "tf":
            return "set sensor.quaternion", "sensor.quaternion"
        links = ", ".join(self._estimator.transforms.links(s.tool_frame, s.sensor_frame))
        between = f"from tool_frame {s.tool_frame!r} to sensor_frame {s.sensor_frame!r} on /tf_static ({links})"
        return f"correct the transform {between} to a quaternion", f"the transform {between}"

    def _of_reasons(self, poses: int) -> Iterator[Finding]:
        named = self._estimator.unknown_frames().keys() - {Reason.TF_OUT_OF_ORDER}
        counts = self._estimator.counts
        for reason in Reason:
            told = reason in _EXPECTED or reason in named or reason in STAMP_ZERO
            told |= reason in OF_TRANSFORMS and self._transforms_unstamped()
            count = counts[reason] - self._at_start[reason]
            if not told and count > _RARE * max(poses, 1):
                yield Finding(False, f"{reason}: {count} times at {poses} poses; docs/node.md, Reasons, says why")

    def _of_estimates(self, poses: int) -> Finding:
        made = self._estimator.estimates
        advice = "" if made else "; fix the findings above first"
        return Finding(made > 0, f"estimates: {made} at {poses} poses{advice}")


def delayed(ages: _Array, limit: float) -> bool:
    """Whether messages were delayed on their way by more than a limit [s]. `ages`: at arrival [s], shape [n].

    A wrong clock or a slow driver makes all messages old. A busy machine delays only some of them.
    """
    return len(ages) > 0 and float(np.median(ages) - np.quantile(ages, _SOONEST)) > limit


def _error_of_surface(rows: Rows) -> tuple[float, float] | None:
    """How far above the expected surface the measured force begins on the longest descent, and the allowed error [m].

    None if it does not begin. Only magnitudes of forces are compared, which a wrong sign or mounting does not change.
    """
    deepest_later = np.maximum.accumulate(rows["depth"][::-1])[::-1]
    way = rows[int((deepest_later - rows["depth"]).argmax()) :]
    way = way[np.diff(np.maximum.accumulate(way["depth"]), prepend=-np.inf) > 0.0]
    depth, measured = way["depth"], way["compensated"][:, FORCE]
    noise = float(np.linalg.norm(np.std(measured[:_ENOUGH], axis=0)))
    force = np.linalg.norm(measured - np.median(measured[:_ENOUGH], axis=0), axis=1)
    share = max(_LEAST_FORCE, _BEGUN * force.max(), 5.0 * noise) / max(force.max(), 1e-9)
    begins, expected = (_onset(f, share) for f in (force, np.linalg.norm(way["predicted"][:, FORCE], axis=1)))
    if begins is None:
        return None
    metres = (0.0 if expected is None else float(depth[expected])) - float(depth[begins])
    return metres, _CONTACT_ERROR + _CONTACT_SHARE * float(depth[-1] - depth[begins])


def _onset(force: _Array, share: float) -> int | None:
    """The row after which the force exceeds this share of its peak, with the fewest exceptions; None without one."""
    if share >= 0.5:
        return None
    loud = np.where(force > share * force.max(), 1, -1)
    row = int(np.argmax(np.append(loud[::-1].cumsum()[::-1], 0)))
    return row if _ENOUGH // 2 <= row <= len(force) - _ENOUGH // 2 else None


def _listed(numbers: Collection[float]) -> str:
    return "[" + ", ".join(f"{round(n, 4) + 0.0:g}" for n in numbers) + "]"
