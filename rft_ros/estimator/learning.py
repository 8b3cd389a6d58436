"""Learning the medium: predictions corrected by what the load cell has told, at least a lag of path before.

Every pose in the grains leaves a record that waits for its measurement, and then until the tool is `lag` further. At
rest nothing changes, and speed does not matter.
"""

import math
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.medium_filter import FILTER, absorb, begin, begin_again, copy, correct, grow
from rft_ros.estimator.samples import ABSURD, Vector
from rft_ros.estimator.surprise import ISSUES, JUDGE, feel, judge
from rft_ros.rft.compilation import compiled, inlined, machine_code

__all__ = ["Belief", "Learning"]

Array = NDArray[np.float64]

_RECORDS, _RECORDS_PER_LAG = 2048, 1024
_STEP_MOST = 1.0  # path [m] between two poses

_RECORD = np.dtype(
    [
        ("stamp", np.int64),
        ("travel", float),  # path in air and grains
        ("path", float),  # path in the grains
        ("passing", np.bool_),
        ("measured", np.bool_),  # y holds a measurement that teaches
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
        ("first", int),  # the first record that was not taken; number n, without end, is at n modulo their count
        ("open", int),  # the first record whose measurement may still come
        ("end", int),
        ("travel", float),
        ("path", float),
        ("pushing", np.bool_),  # in the grains, neither withdrawn nor fast
        ("aired", np.bool_),  # in the air since the last push
    ],
    align=True,
)


class Belief(NamedTuple):
    """What is believed of the grains after every sample that lies `lag` behind.

    Strengths of the vertical and the horizontal force over the model's; `turn` [rad] of the horizontal force about the
    vertical; `surface` [m] above `surface_height`; their standard errors; `path` [m] in the grains. `surprise`: error
    along the predicted force in standard deviations, mean over 0.5 mm of path; `excess`: the same over that force.
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
def _move(state, step, wet, passing):
    """Advance the path. Where the tool begins to push, the belief of the last push counts."""
    state.travel += step
    if not wet:
        state.pushing, state.aired = False, True
        return
    state.path += step
    if passing:
        state.pushing = False
    elif not state.pushing and step > 0.0:
        begin_again(state.latest, state.push, state.prior, state.aired)
        state.pushing, state.aired, state.entered = True, False, state.path


@compiled
def _predict(states, records, row, out, stamp, step, passing, apply, lag, reach):
    """Move, take the records that lie `lag` behind, predict with (L4), and keep a record for the measurement."""
    state = states[0]
    wet = row[6] > 0.0
    _move(state, step, wet, passing)
    while state.first < state.open and records[state.first % _RECORDS].travel <= state.travel - lag:
        oldest = records[state.first % _RECORDS]
        if oldest.fault:  # what taught until it was found may have been wrong as well
            copy(state.latest, state.prior)
            copy(state.push, state.prior)
        elif oldest.measured and oldest.path > max(state.learned, state.entered if oldest.passing else 0.0):
            absorb(state, oldest)
        state.first += 1
    if state.end - state.first == _RECORDS:  # nothing came: the oldest will not teach
        state.first += 1
        state.open = max(state.open, state.first)
    copy(state.now, state.latest)
    grow(state.now, max(state.path - state.learned, 0.0))

    record = records[state.end % _RECORDS]
    correct(state.now, state.scale, record, row, out, reach, apply)
    last = records[(state.end - 1) % _RECORDS].travel
    close = state.end > state.first and state.travel - last < lag / _RECORDS_PER_LAG
    if wet and step > 0.0 and not close:
        record.stamp, record.travel, record.path = stamp, state.travel, state.path
        record.passing, record.measured, record.fault = passing, False, False
        state.end += 1


@compiled
def _learn(states, records, y, stamp, repeated, in_air):
    """Give the record of a stamp its measurement, and judge it."""
    state = states[0]
    if in_air:
        feel(state, y)
    while state.open < state.end and records[state.open % _RECORDS].stamp < stamp:
        state.open += 1
    record = records[state.open % _RECORDS]
    if state.open < state.end and record.stamp == stamp:
        state.open += 1
        judge(state, record, y, min(record.path - state.judged, _STEP_MOST), repeated)
        for i in range(3):
            record.y[i] = y[i]


class Learning:
    """What the load cell tells about the grains, for one tool in one medium.

    At each pose call `predict`. When its compensated force is known, call `learn` with the pose's stamp, in the order
    of stamps. A prediction uses the measurements at least `lag` of path [m] behind, so no sample is part of its own.
    `strength_error`: relative standard error of ζ. `reach` of the tool's surface from the tool frame's origin [m].
    """

    def __init__(self, *, lag: float = 0.002, strength_error: float = 0.15, reach: float = 0.0) -> None:
        self.lag, self.reach, self._strength_error = lag, reach, strength_error
        self._states, self._records = np.zeros(1, _STATE), np.zeros(_RECORDS, _RECORD)
        self._state: Any = self._states[0]
        self._surprise, self._issues = self._states["surprise"], self._states["issues"]
        self._row, self._y, out = np.zeros(19), np.zeros(3), np.zeros(12)
        arrays = self._states, self._records
        self._predict = machine_code(_predict, (*arrays, self._row, out, 0, 0.0, False, True, 0.0, 0.0))
        self._learn: Any = machine_code(_learn, (*arrays, self._y, 0, False, False))
        self.forget()

    def forget(self) -> None:
        """Go back to the calibration."""
        self._states[:] = np.zeros(1, _STATE)
        begin(self._state, self._strength_error)
        self._state["pushing"] = True

    def leave(self) -> None:
        """Keep the strength, forget surface and turn: the tool is elsewhere or another one, or time has jumped."""
        state, latest, prior, push = (self._state, *(self._state[name] for name in ("latest", "prior", "push")))
        for name in (n for n, *_ in JUDGE if n != "doubts"):
            state[name] = 0
        state["first"] = state["open"] = state["end"]
        state["learned"] = state["judged"] = state["path"]
        latest["theta"], latest["p"] = prior["theta"], prior["p"]
        latest["theta"][:2], latest["p"][:2, :2] = push["theta"][:2], push["p"][:2, :2]
        state["pushing"], state["aired"] = False, True

    def forget_air(self) -> None:
        """Drop what was read in the air: the load cell was tared."""
        self._state["air_samples"] = 0.0

    def predict(self, stamp: int, row: Array, *, step: float, passing: bool = False, apply: bool = True) -> Array:
        """Corrected wrench and its standard deviations at a pose, world axes.

        `stamp` [ns], increasing (after a jump back call `leave`). `row`, shape [19]: the model there: force F [N],
        torque [N m], submerged area [m²], dF/dh [N/m], and Σ r_j f_l [N m] row by row; finite. `step`: path of the
        tool's fastest point since the pose before [m], 0 at rest. `passing`: the tool is withdrawn, or so fast that
        inertia matters; what is learned here is dropped afterwards, and nothing surprises. `apply` False leaves the
        wrench as the model has it. Returns shape [12]: force, torque about the tool frame's origin, deviation of each.
        """
        self._row[:], out = row, np.empty(12)
        path = min(float(step), _STEP_MOST) if step > 0.0 else 0.0
        self._predict(
            self._states, self._records, self._row, out, int(stamp), path, bool(passing), bool(apply),
            float(self.lag), float(self.reach),
        )  # fmt: skip
        return out

    def learn(self, stamp: int, force: Array | Vector, *, repeated: bool = False, in_air: bool = False) -> None:
        """Take the compensated force [N] at a pose, world axes, shape [3]; one that is not finite does not count.

        `repeated`: the load cell's raw reading equals the one before, bit by bit. `in_air`: the tool touched nothing.
        """
        if math.hypot(*force) < ABSURD:
            self._y[:] = force
            self._learn(self._states, self._records, self._y, int(stamp), bool(repeated), bool(in_air))

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
        mean, errors, state = self.theta, np.sqrt(np.diag(self.covariance)), self._state
        mean[2], errors[2] = math.atan2(mean[2], mean[1]), errors[2] / mean[1]
        excess = float(state["excess"] / state["size"]) if state["size"] > 0.0 else 0.0
        return Belief(*(*mean.tolist(), *errors.tolist(), float(state["path"]), float(state["score"]), excess))

    def strength(self) -> tuple[float, float] | None:
        """Strength of the bed over the model's at the last push, and its standard error; None if nothing was learned.

        s_v and s_h by the inverse of their variances.
        """
        mean, covariance = self._state["push"]["theta"], self._state["push"]["p"][:2, :2]
        if np.array_equal(mean, self._state["prior"]["theta"]):
            return None
        weights = 1.0 / np.diag(covariance)
        weights /= weights.sum()
        return float(weights @ mean[:2]), math.sqrt(float(weights @ covariance @ weights))

    @property
    def surprise(self) -> Literal["", "harder", "softer"]:
        """Whether the grains at the last measurement were harder or softer than believed."""
        return ("", "harder", "softer")[self._surprise[0]]

    def surprise_sentence(self) -> str:
        """A sentence: the grains are harder or softer than learned, and by how much; empty if they are as learned."""
        percent = 100.0 * self.belief().excess
        by = f": force {percent:+.0f} %" if percent * self._surprise[0] >= 1.0 else ""  # held until the error settles
        return f"grains {self.surprise} than learned{by}" if self.surprise else ""

    @property
    def disagrees(self) -> bool:
        """Whether there are `issues`."""
        return bool(self._issues[0])

    def issues(self) -> list[str]:
        """Why the load cell or the model cannot be right, of `ISSUES`."""
        return [sentence for issue, sentence in ISSUES.items() if self._state["issues"] & issue]

    def doubts(self) -> list[str]:
        """The issues under which something was measured in the grains since the calibration."""
        return [sentence for issue, sentence in ISSUES.items() if self._state["doubts"] & issue]
