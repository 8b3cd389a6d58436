"""Learning the medium: predictions corrected by what the load cell has told, at least a lag of path before.

Every pose in the grains leaves a record that waits for its measurement, and then until the tool is `lag` further. At
rest nothing changes, and speed does not matter.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.medium_filter import FILTER, GAUSSIAN, absorb, begin, begin_again, copy, correct, grow
from rft_ros.estimator.surprise import (
    FAULT,
    JUDGE,
    STUCK,
    BeliefIssue,
    Surprise,
    compare,
    feel_air,
    find_issues,
    judge,
    offset_in_air,
    watch_reading,
)
from rft_ros.rft.compilation import compiled, inlined, machine_code

__all__ = ["Belief", "BeliefIssue", "Learning", "Surprise"]

Array = NDArray[np.float64]

_RECORDS, _RECORDS_PER_LAG = 2048, 1024
_STEP_MOST = 1.0  # path [m] between two poses
_UNDONE = 0.01  # path [m] before a fault of which what was learned is undone; at most twice as much
_FORCE_MOST = 1e100  # [N]; squares of larger forces overflow

_RECORD = np.dtype(
    [
        ("stamp", np.int64),
        ("travel", float),  # path in air and grains
        ("path", float),  # path in the grains
        ("enters", int),  # 1: pushes again; 2: after a way through the air
        ("passing", np.bool_),
        ("measured", np.bool_),  # y holds a measurement
        ("repeated", np.bool_),  # which equals the one before: it teaches if the reading changes again
        ("fault", np.bool_),
        ("force", float, 3),  # of the model, F
        ("h", float, (6, 4)),  # H of force and torque
        ("predicted", float, 3),  # F' as it was predicted, and its covariance S
        ("s", float, (3, 3)),
        ("r", float),  # variance of the noise
        ("y", float, 3),  # measured force
    ],
    align=True,
)

_STATE = np.dtype(
    [
        *FILTER,
        *JUDGE,
        ("now", GAUSSIAN),  # at the pose that is predicted
        ("first", int),  # records are numbered without end; number n is at n modulo their count
        ("sound", int),  # records before it, as far as they are behind, were followed by another reading
        ("seen", int),  # the first that was not yet looked at for that
        ("open", int),  # the first record whose measurement is not final
        ("end", int),
        ("entry", int),  # of the kept records the last one that enters, and as what
        ("entry_kind", int),
        ("travel", float),
        ("path", float),
        ("pushing", np.bool_),  # in the grains, neither withdrawn nor fast
        ("aired", np.bool_),  # in the air since the last push
        ("older", GAUSSIAN),  # beliefs of pushes to go back to when a fault is found, and how far the tool was
        ("newer", GAUSSIAN),
        ("older_path", float),
        ("newer_path", float),
    ],
    align=True,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Belief:
    """What is believed of the grains after every sample that lies `lag` behind.

    Strengths of the vertical and the horizontal force, no unit. `turn` [rad] of the horizontal force about the
    vertical. `surface` [m] above `surface_height`. Then their standard errors. `path` [m] in the grains. `surprise`:
    measured minus predicted force along the predicted one, in standard deviations, mean over 0.5 mm of path. `excess`:
    the same over the predicted force.
    """

    vertical_strength: float
    horizontal_strength: float
    turn: float
    surface: float
    vertical_strength_error: float
    horizontal_strength_error: float
    turn_error: float
    surface_error: float
    path: float
    surprise: float
    excess: float


@inlined
def _take(state, record):  # type: ignore[no-untyped-def]
    """One record into the belief; one with a fault undoes what was learned shortly before."""
    if record.enters > 0:
        begin_again(state.latest, state.push, state.prior, record.enters > 1)
    if record.fault:
        for belief in (state.latest, state.push, state.newer):
            copy(belief, state.older)
        state.learned = state.newer_path = state.older_path
    elif record.measured and record.path > state.learned:
        if state.learned - state.newer_path > _UNDONE:
            copy(state.older, state.newer)
            copy(state.newer, state.push)
            state.older_path, state.newer_path = state.newer_path, state.learned
        absorb(state, record)


@inlined
def _move(state, step, wet, passing):  # type: ignore[no-untyped-def]
    """Advance the path; 0, or how the tool begins to push here, as `enters` of a record."""
    state.travel += step
    if not wet:
        state.pushing, state.aired = False, True
        return 0
    state.path += step
    if passing:
        state.pushing = False
    elif not state.pushing and step > 0.0:
        kind = 2 if state.aired else 1
        state.pushing, state.aired, state.entered = True, False, state.path
        return kind
    return 0


@compiled
def _predict(states, records, row, out, stamp, step, passing, apply, lag, reach):  # type: ignore[no-untyped-def]
    """Move, take the records that lie `lag` behind, predict with (L4), and keep a record for the measurement."""
    state, now = states[0], states[0].now
    wet, fx, fy, fz = row[6] > 0.0, row[0], row[1], row[2]
    passing = passing or fz < -0.5 * math.sqrt(fx * fx + fy * fy + fz * fz)  # only a withdrawn tool is pulled down
    enters = _move(state, step, wet, passing)

    # a repeated reading waits for another one: so no dead cell teaches, and a coarse one does
    while state.seen < state.open and records[state.seen % _RECORDS].travel <= state.travel - lag:
        state.seen += 1
        if not records[(state.seen - 1) % _RECORDS].repeated:
            state.sound = state.seen
    while state.first < state.sound:
        _take(state, records[state.first % _RECORDS])
        state.first += 1
    if state.end - state.first == _RECORDS:  # nothing came: the oldest will not teach
        records[state.first % _RECORDS].measured = False
        _take(state, records[state.first % _RECORDS])
        state.first += 1
        state.open, state.sound = max(state.open, state.first), max(state.sound, state.first)
        state.seen = max(state.seen, state.first)

    copy(now, state.latest)
    if enters > 0:
        state.entry, state.entry_kind = state.end, max(enters, state.entry_kind if state.entry >= state.first else 0)
    if state.entry >= state.first:  # it is not taken yet
        begin_again(now, state.push, state.prior, state.entry_kind > 1)
    grow(now, max(state.path - state.learned, 0.0))

    record = records[state.end % _RECORDS]
    correct(now, state.scale, record, row, out, reach, apply)
    last = records[(state.end - 1) % _RECORDS].travel
    close = state.end > state.first and state.travel - last < lag / _RECORDS_PER_LAG
    finite = math.isfinite(record.s[0, 0] + record.s[1, 1] + record.s[2, 2])
    if wet and step > 0.0 and finite and (enters > 0 or not close):
        record.stamp, record.travel, record.path = stamp, state.travel, state.path
        record.enters, record.passing = enters, passing
        record.measured, record.repeated, record.fault = False, True, False
        state.end += 1


@compiled
def _learn(states, records, y, stamp, usable, repeated, in_air):  # type: ignore[no-untyped-def]
    """Give the record of a stamp its measurement, and judge it."""
    state = states[0]
    while state.open < state.end and records[state.open % _RECORDS].stamp < stamp:
        state.open += 1
    record = records[state.open % _RECORDS]
    if in_air and usable:
        feel_air(state, y)
        find_issues(state, record, False)
    if state.open == state.end or record.stamp > stamp:
        return
    state.open += 1
    if not usable:
        return
    record.repeated = repeated
    step = min(record.path - state.judged, _STEP_MOST)
    state.judged = record.path
    watch_reading(state, record, y, step, repeated)
    compare(state, record, y, step)
    find_issues(state, record, True)
    state.doubts |= state.issues
    record.fault = state.issues & FAULT != 0
    record.measured = state.issues & STUCK == 0
    record.r += offset_in_air(state) ** 2
    for i in range(3):
        record.y[i] = y[i]
    if record.measured and not record.fault:
        judge(state, record, y, step)
    n = state.open - 1
    while state.issues & STUCK != 0 and n >= state.first and records[n % _RECORDS].repeated:
        records[n % _RECORDS].measured = False  # those that wait have told nothing
        n -= 1


class Learning:
    """What the load cell tells about the grains, for one tool in one medium.

    At each pose call `predict`. When its compensated force is known, call `learn` with the pose's stamp, in the order
    of stamps. A prediction uses the measurements whose path is at least `lag` behind, so no sample is part of its own
    prediction. The same calls give the same bytes.

    `lag`: path [m] between a sample and the first prediction that it may change. `strength_error`: relative standard
    error of ζ from the calibration; without a calibration keep the default. `reach`: largest distance [m] of the tool's
    surface from the tool frame's origin. Raises ValueError for values out of range.
    """

    def __init__(self, *, lag: float = 0.002, strength_error: float = 0.15, reach: float = 0.0) -> None:
        if not 1e-5 <= lag <= 1.0:
            raise ValueError(f"lag is {lag} m; it must lie in 0.00001 to 1")
        if not 0.0 <= strength_error <= 2.0:
            raise ValueError(f"strength_error is {strength_error}; it must lie in 0 to 2")
        self.lag, self._strength_error = lag, strength_error
        self._states = np.zeros(1, _STATE)
        self._state: Any = self._states[0]
        self._records = np.zeros(_RECORDS, _RECORD)
        self._row, self._y, out = np.zeros(19), np.zeros(3), np.zeros(12)
        self.reach = reach
        arrays = self._states, self._records
        self._predict = machine_code(_predict, (*arrays, self._row, out, 0, 0.0, False, True, 0.0, 0.0))
        self._learn: Any = machine_code(_learn, (*arrays, self._y, 0, True, False, False))
        self.forget()

    def forget(self) -> None:
        """Go back to the calibration."""
        self._states[:] = np.zeros(1, _STATE)
        begin(self._state, self._strength_error)
        self._state["older"] = self._state["newer"] = self._state["prior"]
        self._state["pushing"] = True
        self._state["entry"] = -1
        self._last = 0

    def leave(self) -> None:
        """Keep the strength, forget surface and turn: the tool is elsewhere or another one, or time has jumped."""
        state = self._state
        for number in ("first", "sound", "seen", "open"):
            state[number] = state["end"]
        state["entry"] = -1
        state["learned"] = state["judged"] = state["path"]
        latest, prior = state["latest"], state["prior"]
        latest["theta"][:2], latest["theta"][2:] = state["push"]["theta"][:2], prior["theta"][2:]
        latest["p"][:] = prior["p"]
        latest["p"][:2, :2] = state["push"]["p"][:2, :2]
        state["older"] = state["newer"] = state["push"]
        state["older_path"] = state["newer_path"] = state["path"]
        for name in (n for n, *_ in JUDGE if n not in ("judged", "doubts")):
            state[name] = 0
        state["pushing"], state["aired"] = False, True
        self._last = 0

    def forget_air(self) -> None:
        """Drop what was read in the air: the load cell was tared."""
        self._state["air_samples"] = 0.0

    def predict(self, stamp: int, row: Array, *, step: float, passing: bool = False, apply: bool = True) -> Array:
        """Corrected wrench and its standard deviations at a pose, world axes.

        `stamp` [ns], increasing (an earlier one calls `leave`). `row`, shape [19]: the model at the pose: force F [N],
        torque [N m], submerged area [m²], dF/dh [N/m], and Σ r_j f_l [N m] row by row; finite. `step`: path of the
        tool's fastest point since the pose before [m], 0 at rest. `passing`: the tool is withdrawn, or so fast that
        inertia matters; what is learned here is dropped afterwards, and nothing surprises. `apply` False leaves the
        wrench as the model has it. Returns shape [12]: force [N], torque about the tool frame's origin [N m], then the
        standard deviation of each.
        """
        if stamp <= self._last:
            self.leave()
        self._last = stamp
        self._row[:], out = row, np.empty(12)
        self._predict(
            self._states, self._records, self._row, out, int(stamp),
            min(float(step), _STEP_MOST) if step > 0.0 else 0.0, bool(passing), bool(apply),
            float(self.lag), float(self.reach),
        )  # fmt: skip
        return out

    def learn(self, stamp: int, force: Array | None, *, repeated: bool = False, in_air: bool = False) -> None:
        """Take the compensated force [N] at a pose, world axes, shape [3]; None if there is none.

        `repeated`: the load cell's raw reading equals the one before, bit by bit. `in_air`: the tool touched nothing.
        """
        self._y[:] = math.nan if force is None else force
        usable = math.hypot(*self._y.tolist()) < _FORCE_MOST
        self._learn(self._states, self._records, self._y, int(stamp), usable, bool(repeated), bool(in_air))

    @property
    def surprise(self) -> Surprise:
        """Whether the grains at the last measurement were harder or softer than believed."""
        return Surprise(int(self._state["surprise"]))

    def surprise_sentence(self) -> str:
        """A sentence: the grains are harder or softer than learned, and by how much; empty if they are as learned."""
        kind, percent = self.surprise, 100.0 * self.belief().excess
        if kind is Surprise.NONE:
            return ""
        by = f": force {percent:+.0f} %" if percent * kind >= 1.0 else ""  # it is held until the error has settled
        return f"grains {kind.name.lower()} than learned{by}"

    @property
    def theta(self) -> Array:
        """s_v, s_h, ρ, δ [m], shape [4]: a copy."""
        return np.array(self._state["latest"]["theta"])

    @property
    def covariance(self) -> Array:
        """Of `theta`, shape [4, 4], in its units: a copy."""
        return np.array(self._state["latest"]["p"])

    def belief(self) -> Belief:
        """θ in the user's terms."""
        state = self._state
        v, h, turn, surface = self.theta.tolist()
        dv, dh, dt, ds = np.sqrt(np.diag(self.covariance)).tolist()
        size = float(state["size"])
        return Belief(
            vertical_strength=v,
            horizontal_strength=h,
            turn=math.atan2(turn, h),
            surface=surface,
            vertical_strength_error=dv,
            horizontal_strength_error=dh,
            turn_error=dt / h,
            surface_error=ds,
            path=float(state["path"]),
            surprise=float(state["score"]),
            excess=float(state["excess"]) / size if size > 0.0 else 0.0,
        )

    def strength(self) -> tuple[float, float] | None:
        """Strength of the bed over the model's at the last push, and its standard error; None if nothing was learned.

        s_v and s_h by the inverse of their variances.
        """
        mean, covariance = self._state["push"]["theta"], self._state["push"]["p"][:2, :2]
        if np.array_equal(mean, (1.0, 1.0, 0.0, 0.0)):
            return None
        weights = 1.0 / np.diag(covariance)
        weights /= weights.sum()
        return float(weights @ mean[:2]), math.sqrt(float(weights @ covariance @ weights))

    @property
    def disagrees(self) -> bool:
        """Whether there are `issues`."""
        return bool(self._state["issues"])

    def issues(self) -> list[BeliefIssue]:
        """Why the load cell or the model cannot be right."""
        return _issues(self._state["issues"])

    def doubts(self) -> list[BeliefIssue]:
        """The issues under which something was measured in the grains since the calibration."""
        return _issues(self._state["doubts"])


def _issues(bits: int) -> list[BeliefIssue]:
    return [issue for k, issue in enumerate(BeliefIssue) if bits >> k & 1]
