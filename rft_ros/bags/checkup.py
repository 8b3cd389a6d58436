"""Check a cell's set-up by what its inputs say: a finding for each question, OK or what to do."""

from collections import Counter, deque
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.bags.playback import push_all
from rft_ros.estimator import Estimate, Estimator, PoseSample, Reason, Sample, Stamped, TwistSample, WrenchSample
from rft_ros.estimator.messages import Role
from rft_ros.ground import Cloud
from rft_ros.parameters import Model, Values, settings_of

__all__ = ["Checkup", "Finding"]

_ENOUGH = 20  # estimates in the grains, or in the air
_FELT = 0.2  # N: a smaller force decides nothing
_ALIKE = 0.5  # correlation of the measured and the predicted force along an axis
_CARRIES = 0.2  # of the strongest axis's force: an axis with less is not judged
_BEGUN = 0.05  # of the greatest force of a descent: the tool has touched the grains
_CONTACT = 0.005, 0.1  # m, and share of the descent: greatest error of surface_height
_STRENGTH = 0.5, 2.0  # measured over predicted: beds differ by less once they are calibrated
_UNITS = {0.102: "kgf", 0.225: "lbf"}  # what a driver may report in place of N
_RARE = 0.01  # share of poses
_START = 1_000_000_000  # ns in which the first transforms and twists may be missing
_EXPECTED = {Reason.AT_REST, Reason.POSE_HISTORY_SHORT, Reason.POSE_RATE_LIMITED, Reason.SURFACE_RATE_LIMITED}
_ROLES: dict[type, Role] = {PoseSample: "pose", TwistSample: "twist", WrenchSample: "wrench", Cloud: "surface"}
_ADVICE: dict[Role, str] = {
    "pose": "start the driver, remap ~/pose, or set pose_source: tf",
    "tf": "start the robot's state publisher, or set pose_source: topic",
    "twist": "set twist_source: pose_difference, or remap ~/twist",
    "wrench": "start the load cell's driver, or remap ~/wrench_measured",
    "surface": "the ground stays as at the start",
}
_TURNS = Rotation.create_group("O")  # the 24 turns by multiples of 90 degrees


class Finding(NamedTuple):
    """The answer to one question: whether all is well, and a sentence, which says what to do if not."""

    ok: bool
    text: str

    def __str__(self) -> str:
        return f"{'OK ' if self.ok else 'FIX'} {self.text}"


@dataclass(slots=True)
class _Heard:
    """Arrival [ns] and age at arrival [s] of one role's messages; how many have no stamp; their frames."""

    times: list[int] = field(default_factory=list)
    ages: list[float] = field(default_factory=list)
    unstamped: int = 0
    frames: Counter[str] = field(default_factory=Counter)


class _Forces(NamedTuple):
    """Rows of all comparisons: height of the tool above the surface [m], forces in sensor axes [N], shape [n, 3]."""

    height: NDArray[np.float64]
    wet: NDArray[np.bool_]
    rising: NDArray[np.bool_]
    predicted: NDArray[np.float64]
    measured: NDArray[np.float64]


class Checkup:
    """Takes a cell's samples in the order of their arrival, and says what is wrong with the set-up.

    `values`: the node's parameters. `named`: the names of those that the user has set. `topics`: the topic of each role
    that is needed. `tare`: length of a replay's tare [s].
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
        # what is learned would hide a wrong sign or unit
        self._estimator = Estimator(settings_of({**values, "learning.mode": "off"}), model)
        self._heard: dict[Role, _Heard] = {role: _Heard() for role in topics}
        self._waiting: deque[tuple[float, ...]] = deque()
        self._rows: list[tuple[float, ...]] = []  # as `_Forces`
        self._poses = 0
        self._began = 0
        self._at_start: Counter[str] = Counter()  # reasons before the first estimate

    def push(self, sample: Sample, time: int) -> None:
        """Add a sample that arrived at `time` [ns]."""
        self._began = self._began or time
        role = _ROLES.get(type(sample), "tf")
        if role in self._heard:
            self._hear(self._heard[role], sample, time)
        e = self._estimator
        for _, answer in push_all(e, sample):
            self._poses += answer is not None
            if isinstance(answer, Estimate):
                if e.counts["estimates"] == 1 and time - self._began <= _START:
                    self._at_start = Counter(e.counts)
                rising = e.state[9] > 0.5 * answer.speed
                self._waiting.append((-e.depth(), answer.submerged_area, rising, *answer.predicted[:3]))
        self._compare()

    def _hear(self, heard: _Heard, sample: Sample, time: int) -> None:
        if isinstance(sample, Stamped):
            stamp = sample.stamp
            heard.frames[sample.frame] += 1
        elif all(transform.fixed for transform in sample):
            return
        else:
            stamp = max(transform.stamp for transform in sample)
        heard.times.append(time)
        if stamp > 0:
            heard.ages.append((time - stamp) * 1e-9)
        else:
            heard.unstamped += 1

    def _compare(self) -> None:
        for measurement in self._estimator.measurements():
            row = self._waiting.popleft()
            if measurement.compensated is not None:
                self._rows.append((*row, *measurement.compensated[:3]))

    def findings(self) -> list[Finding]:
        """The findings, after the last sample."""
        self._estimator.finish()
        self._compare()
        table = np.array(self._rows).reshape(-1, 9)
        forces = _Forces(table[:, 0], table[:, 1] > 0.0, table[:, 2] > 0.0, table[:, 3:6], table[:, 6:])
        mesh = self._of_tool(forces)
        error = _error_of_surface(forces) if mesh.ok else None
        surface = self._of_surface(error)
        found = [mesh, surface, *self._of_inputs(), *self._of_frames(), *self._of_mount()]
        if len(table) and mesh.ok and (error is None or surface.ok):  # else the forces are of another depth
            found += self._of_load_cell(forces)
        return [*found, *self._of_reasons()]

    def _of_tool(self, forces: _Forces) -> Finding:
        tool = self._estimator.model.tool
        extents = " x ".join(f"{1e3 * e:.3g}" for e in np.ptp(tool.vertices, axis=0))
        deepest = -1e3 * forces.height.min(initial=np.inf)
        sizes = [issue.message for issue in tool.issues if issue.kind == "size"]
        advice = (
            f": {sizes[0]}" if sizes else f", at most {deepest:.3g} mm below the surface" if len(forces.wet) else ""
        )
        return Finding(not sizes, f"mesh {tool.name}: {extents} mm{advice}")

    def _of_surface(self, error: "_SurfaceError | None") -> Finding:
        height = self._estimator.settings.surface_height
        if error is not None and abs(error.metres) > error.allowed:
            side = "above" if error.metres > 0.0 else "below"
            found = f"the measured force begins {1e3 * abs(error.metres):.0f} mm {side} where {height:g} m says"
            return Finding(False, f"surface_height: {found}; set it to about {height + error.metres:.3f}, or calibrate")
        if "surface_height" not in self._named and error is None:
            return Finding(False, "surface_height is not set and counts as 0.0: measure it, or run rft calibrate")
        seen = "" if error is None else f"; the measured force begins within {1e3 * error.allowed:.0f} mm of it"
        return Finding(True, f"surface_height: {height:g} m{seen}")

    def _of_inputs(self) -> Iterator[Finding]:
        limit = self._estimator.settings.max_input_age
        for role, topic in self._topics.items():
            heard = self._heard[role]
            if not heard.times:
                yield Finding(role == "surface", f"{role}: nothing on {topic}; {_ADVICE[role]}")
                continue
            if heard.unstamped:
                unstamped = f"{heard.unstamped} messages on {topic} have no stamp"
                yield Finding(False, f"{role}: {unstamped}; the driver must set it")
                continue
            seconds = (heard.times[-1] - heard.times[0]) * 1e-9
            rate = f"{(len(heard.times) - 1) / seconds:.0f} Hz" if seconds > 0.0 else "1 message"
            age = float(np.median(heard.ages))
            if abs(age) > limit and role != "surface":
                off = f"{abs(age):.3g} s {'old' if age > 0.0 else 'ahead'} when they arrive, over max_input_age"
                yield Finding(False, f"{role}: stamps on {topic} are {off} {limit:g} s: synchronise the clocks")
                continue
            frames = f", frame {' and '.join(sorted(heard.frames))}" if heard.frames else ""
            yield Finding(True, f"{role}: {rate} on {topic}{frames}, stamps {1e3 * age:.0f} ms old")

    def _of_frames(self) -> Iterator[Finding]:
        link = "publish the transform between the two"
        for reason, sentence in self._estimator.unknown_frames().items():
            if reason == Reason.TF_OUT_OF_ORDER.value:  # `_of_reasons` judges how many
                continue
            advice = f"set the parameter to it, or {link} on /tf_static"
            if reason in (Reason.TF_FRAME_UNKNOWN.value, Reason.SENSOR_FRAME_UNKNOWN.value):
                advice = f"set the parameter to one of them, or {link}"
            elif reason == Reason.SURFACE_FRAME_UNKNOWN.value:
                advice = f"{link} on /tf_static"
            elif reason.startswith("tf_"):
                advice = "stop or mend one of its publishers"
            yield Finding(False, f"frames: {sentence}; {advice}")
        if frames := self._estimator.transforms.frames():
            yield Finding(True, f"frames: {', '.join(frames)}")

    def _of_mount(self) -> Iterator[Finding]:
        """The sensor's place in the parameters and on /tf_static, if both have it."""
        s, cell = self._estimator.settings, self._estimator.settings.load_cell
        place = self._estimator.transforms.fixed(s.tool_frame, s.sensor_frame)
        if place is None or s.sensor_source == "tf" or s.tool_frame == s.sensor_frame:
            return
        turn = (Rotation.from_quat(cell.quaternion).inv() * Rotation.from_quat(place.quaternion)).magnitude()
        moved = float(np.linalg.norm(np.subtract(cell.position, place.position)))
        there = f"position {_listed(place.position)}, quaternion {_listed(place.quaternion)}"
        if turn < np.radians(1.0) and moved < 1e-3:
            yield Finding(True, f"sensor: the parameters and /tf_static agree: {there}")
            return
        off = f"the parameters are {np.degrees(turn):.0f} degrees and {1e3 * moved:.0f} mm off what /tf_static says"
        yield Finding(False, f"sensor: {off} ({there}); set sensor.frame_source: tf, or mend one of the two")

    def _of_load_cell(self, forces: _Forces) -> Iterator[Finding]:
        dry = forces.measured[~forces.wet]
        air = dry.mean(axis=0) if len(dry) >= _ENOUGH else np.zeros(3)
        load = float(np.linalg.norm(air))
        if self._tare:
            tares = f"a replay tares over its first {self._tare:g} s; for the node call ~/tare in the air"
            yield Finding(True, f"load cell: {load:.2f} N in the air; {tares}")
        elif len(dry) < _ENOUGH:
            yield Finding(False, "load cell: the tool was not seen in the air; lift it out of the grains and run again")
        elif load > _FELT:
            advice = "call ~/tare, replay with --tare, or calibrate sensor.bias and sensor.mass"
            yield Finding(False, f"load cell: it reads {load:.2f} N in the air; {advice}")
        else:
            yield Finding(True, f"load cell: {load:.2f} N in the air")
        pushed = forces.wet & ~forces.rising
        predicted, measured = forces.predicted[pushed], forces.measured[pushed] - air
        if len(predicted) < _ENOUGH or np.abs(predicted).max() < _FELT or np.abs(measured).max() < 0.1 * _FELT:
            yield Finding(False, "sign: no push was seen; push the tool down into the grains and run again")
            return
        direction = self._of_direction(predicted, measured)
        yield direction
        if direction.ok:
            yield self._of_strength(float((predicted * measured).sum() / (predicted**2).sum()))

    def _of_direction(self, predicted: NDArray[np.float64], measured: NDArray[np.float64]) -> Finding:
        """By axis; of what reverses or exchanges axes, what fits: another sign, or the cell turned by 90 or 180 deg."""
        carried = np.sqrt((predicted**2).mean(axis=0))
        axes = (carried >= _CARRIES * carried.max()) & (np.abs(predicted).max(axis=0) >= _FELT)
        alike = _alike(predicted, measured)
        shown = ", ".join(f"{name} {alike[k]:.2f}" for k, name in enumerate("xyz") if axes[k])
        if (alike >= _ALIKE)[axes].all():
            return Finding(True, f"sign: measured and predicted force agree along each axis (correlation {shown})")
        mount = Rotation.from_quat(self._estimator.settings.load_cell.quaternion)
        sign = self._estimator.settings.load_cell.sign
        opposite = (_alike(predicted, -measured) >= _ALIKE)[axes].all()
        turn = min(
            (t for t in _TURNS if (_alike(predicted, t.apply(measured)) >= _ALIKE)[axes].all()),
            key=lambda t: t.magnitude(),
            default=None,
        )
        turned = "" if turn is None else f"sensor.quaternion: {_listed((mount * turn).as_quat())}"
        off = f"measured and predicted force do not agree along each axis (correlation {shown})"
        if opposite and turn is None:
            return Finding(False, f"sign: {off}; set sensor.sign: {-sign:g}")
        if opposite:
            both = (
                f"set sensor.sign: {-sign:g}, or {turned} if the cell is mounted so; a drag along x and y tells which"
            )
            return Finding(False, f"sign or quaternion: {off}; {both}")
        if turn is not None:
            degrees = f"{np.degrees(turn.magnitude()):.0f} degrees"
            return Finding(False, f"quaternion: {off}, as if the cell were turned by {degrees}; such as {turned}")
        return Finding(False, f"sign: {off}; check sensor.quaternion, sensor.sign, mesh.origin and surface_height")

    def _of_strength(self, ratio: float) -> Finding:
        if _STRENGTH[0] <= ratio <= _STRENGTH[1]:
            return Finding(True, f"strength: measured over predicted force {ratio:.2f}")
        unit = next((f", here perhaps {unit}" for factor, unit in _UNITS.items() if 0.67 < ratio / factor < 1.5), "")
        advice = f"check mesh.scale and the driver's unit (N{unit}), or fit medium.zeta with rft calibrate"
        return Finding(False, f"strength: measured over predicted force {ratio:.3g}; {advice}")

    def _of_reasons(self) -> Iterator[Finding]:
        named = self._estimator.unknown_frames().keys() - {Reason.TF_OUT_OF_ORDER.value}
        for reason in Reason:
            count = self._estimator.counts[reason.value] - self._at_start[reason.value]
            told = reason in _EXPECTED or reason.value in named or reason.value.endswith("stamp_zero")
            if not told and count > _RARE * max(self._poses, 1):
                yield Finding(False, f"{reason}: {count} times at {self._poses} poses; docs/node.md, Reasons, says why")
        estimates = self._estimator.counts["estimates"]
        advice = "" if estimates else "; mend what stands above first"
        yield Finding(estimates > 0, f"estimates: {estimates} at {self._poses} poses{advice}")


class _SurfaceError(NamedTuple):
    """How far above the expected surface the measured force begins, and how much of that is allowed [m]."""

    metres: float
    allowed: float


def _error_of_surface(forces: _Forces) -> _SurfaceError | None:
    """Compare where the measured force begins on the longest way down; None if it does not."""
    if len(forces.height) < 2 * _ENOUGH:
        return None
    lowest_later = np.minimum.accumulate(forces.height[::-1])[::-1]
    top = int((forces.height - lowest_later).argmax())  # of the longest way down
    lowest = np.minimum.accumulate(forces.height[top:])
    sinking = top + 1 + np.flatnonzero(np.diff(lowest) < 0.0)
    if len(sinking) < 2 * _ENOUGH:
        return None
    height = forces.height[sinking]
    measured = forces.measured[sinking]
    base = np.median(measured[:_ENOUGH], axis=0)
    noise = float(np.linalg.norm(np.std(measured[:_ENOUGH], axis=0)))
    force = np.linalg.norm(measured - base, axis=1)
    share = max(_FELT, _BEGUN * force.max(), 5.0 * noise) / max(force.max(), 1e-9)
    begins = _onset(force, share)
    if begins is None:
        return None
    wet = forces.wet[sinking]
    expected = 0.0
    if wet.any() and not wet[0]:
        modelled = _onset(np.linalg.norm(forces.predicted[sinking], axis=1), share)
        expected = float(height[modelled]) if modelled is not None else 0.0
    metres = float(height[begins]) - expected
    return _SurfaceError(metres, _CONTACT[0] + _CONTACT[1] * float(height[begins] - height[-1]))


def _onset(force: NDArray[np.float64], share: float) -> int | None:
    """The row from which on the force exceeds this share of its peak, with the fewest exceptions; None: it does not."""
    if share >= 0.5:
        return None
    loud = np.where(force > share * force.max(), 1, -1)
    row = int(np.argmax(np.append(loud[::-1].cumsum()[::-1], 0)))
    return row if _ENOUGH // 2 <= row <= len(force) - _ENOUGH // 2 else None


def _alike(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Correlation about zero of two forces, shape [n, 3], by axis."""
    scale = np.sqrt((a**2).sum(axis=0) * (b**2).sum(axis=0))
    return np.asarray((a * b).sum(axis=0) / np.maximum(scale, 1e-12))


def _listed(numbers: Collection[float]) -> str:
    return "[" + ", ".join(f"{round(n, 4) + 0.0:g}" for n in numbers) + "]"
