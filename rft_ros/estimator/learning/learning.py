"""Corrects predictions by a Kalman filter, which is updated with load-cell readings at least a lag of path behind.

Each pose in the grains has a record, which waits for its reading, and updates the filter once the tool moved on by the
lag. The path of the tool's fastest point takes the place of time: at rest nothing changes, and speed does not matter.
"""

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.learning.filter import (
    FILTER_FIELDS,
    copy,
    copy_place,
    correct,
    grow,
    start,
    update,
)
from rft_ros.estimator.learning.surprise import JUDGE_FIELDS, judge
from rft_ros.estimator.samples import ABSURD
from rft_ros.parameters.config import CALIBRATED_ERROR
from rft_ros.rft import SUBMERGED_AREA
from rft_ros.rft.frames import WIDTH, Vector
from rft_ros.rft.kernel.compilation import compiled, inlined, machine_code

Array = NDArray[np.float64]

_STRENGTHS = slice(0, 2)  # places of s_v and s_h in θ
_CHANGES = {0: "", 1: "harder", -1: "softer"}
_RECORD_COUNT = 2048
_PER_LAG_COUNT = 1024
_MIN_STEP_M = 1e-15
_MAX_STEP_M = 1.0
"""Limits of a path between two poses. A shorter one counts as rest: the noise of (L3) over it would be infinite."""

_RECORD = np.dtype(
    [
        ("stamp", np.int64),
        ("travel", float),  # path in air and grains
        ("path", float),  # path in the grains
        ("passing", np.bool_),
        ("measured", np.bool_),  # y holds a force that will update the filter
        ("fault", np.bool_),  # no θ explains the measured force
        ("force", float, 3),  # of the model, F
        ("h", float, (6, 4)),  # H: rows for force and torque
        ("predicted", float, 3),  # F' as it was predicted, and its covariance S
        ("s", float, (3, 3)),
        ("r", float),  # variance of the noise
        ("y", float, 3),  # measured force
    ],
    align=True,
)

_PUSH, _PAUSE, _AIR = range(3)
"""Stages of a push. The tool moves through the grains; it was withdrawn or fast since; it was in the air since."""

_STATE_FIELDS = np.dtype(
    [
        *FILTER_FIELDS,
        *JUDGE_FIELDS,
        # number of the first record that waits; record n is at index n modulo `_RECORD_COUNT`
        ("first", int),
        ("open", int),  # number of the first record whose measurement may still come
        ("end", int),  # number of the next record
        ("travel", float),
        ("path", float),
        ("stage", int),  # `_PUSH`, `_PAUSE` or `_AIR`
    ],
    align=True,
)
_STATE = np.dtype((np.record, _STATE_FIELDS))


class Belief(NamedTuple):
    """State of the filter after the readings that lie at least `lag` behind.

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


@cache
def _predict_code() -> Callable[..., None]:
    """The compiled code of `_predict`. To find it by its types takes 0.1 ms: too long for a tick."""
    arrays = np.zeros(1, _STATE), np.zeros(_RECORD_COUNT, _RECORD), np.zeros(WIDTH), np.zeros(12)
    return machine_code(_predict, (*arrays, 0, 0.0, False, True, 0.0, 0.0))


@cache
def _learn_code() -> Callable[..., None]:
    """The compiled code of `_add_reading`, found once, as that of `_predict`."""
    arrays = np.zeros(1, _STATE), np.zeros(_RECORD_COUNT, _RECORD), np.zeros(3)
    return machine_code(_add_reading, (*arrays, 0, False, 0.0))


class Learning:
    """The filter for one tool in one medium, fed by the predictions and the load cell's readings.

    At each pose call `predict`. When its compensated force is known, call `learn` with the pose's stamp, in the order
    of stamps. A prediction uses the measurements at least `lag` of path [m] behind, so no sample is part of its own.
    `strength_error`: relative standard error of ζ. `reach` of the tool's surface from the tool frame's origin [m]. Lag
    and reach may change.
    """

    def __init__(
        self, *, lag: float = 0.002, strength_error: float = CALIBRATED_ERROR, reach: float = 0.0
    ) -> None:
        self.lag = lag
        self.reach = reach
        self._states = np.zeros(1, _STATE)
        self._state: Any = self._states[0]
        self._records = np.zeros(_RECORD_COUNT, _RECORD)
        self._row = np.zeros(WIDTH)
        self._y = np.zeros(3)
        self._predict = _predict_code()
        self._learn = _learn_code()
        start(self._state, strength_error)

    def use(self, *, lag: float, reach: float) -> None:
        """Use another lag or reach from the next pose on."""
        self.lag = lag
        self.reach = reach

    def forget_place(self) -> None:
        """Keep the strength, and reset surface and turn: the tool moved elsewhere or is another one, or time jumped."""
        state = self._state
        for name, *_ in JUDGE_FIELDS:
            state[name] = 0
        state.first = state.end
        state.open = state.end
        state.path_learned = state.path
        state.path_judged = state.path
        copy(state.latest, state.prior)
        state.latest.theta[_STRENGTHS] = state.of_push.theta[_STRENGTHS]
        state.latest.p[_STRENGTHS, _STRENGTHS] = state.of_push.p[_STRENGTHS, _STRENGTHS]
        state.stage = _AIR

    def predict(
        self, stamp: int, row: Array, *, step: float, passing: bool = False, apply: bool = True
    ) -> Array:
        """Corrected wrench and its standard deviations at a pose, world axes.

        `stamp` [ns], increasing (after a jump back call `forget_place`). `row`, shape [19]: the model's result, finite:
        force F [N], torque [N m], submerged area [m²], dF/dh [N/m], and Σ r_j f_l [N m] row by row. `step`: path of the
        tool's fastest point since the pose before [m], 0 at rest. `passing`: the tool is withdrawn, or so fast that
        inertia matters; updates from here are dropped afterwards, and no surprise is reported. `apply`: whether the
        wrench is corrected. Returns shape [12]: force, torque about the tool frame's origin, deviation of each.
        """
        self._row[:] = row
        out = np.empty(12)
        path = min(float(step), _MAX_STEP_M) if step > _MIN_STEP_M else 0.0
        self._predict(
            self._states, self._records, self._row, out, int(stamp), path, bool(passing), bool(apply),
            self.lag, self.reach,
        )  # fmt: skip
        return out

    def learn(
        self,
        stamp: int,
        force: Array | Vector,
        *,
        is_repeated: bool = False,
        air_load: float = 0.0,
    ) -> None:
        """Add the compensated force [N] at a pose, world axes, shape [3]. A force that is not finite is ignored.

        `is_repeated`: the load cell's raw reading equals the one before, bit by bit. `air_load`: mean force that it
        reads in the air [N].
        """
        if math.hypot(*force) < ABSURD:
            self._y[:] = force
            self._learn(
                self._states,
                self._records,
                self._y,
                int(stamp),
                bool(is_repeated),
                float(air_load),
            )

    @property
    def theta(self) -> Array:
        """s_v, s_h, ρ, δ [m], shape [4]: a copy."""
        return np.array(self._state.latest.theta)

    @property
    def covariance(self) -> Array:
        """Covariance of `theta`, shape [4, 4], in its units: a copy."""
        return np.array(self._state.latest.p)

    def belief(self) -> Belief:
        """θ in the terms of users, with standard errors."""
        state = self._state
        vertical, horizontal, sideways, surface = self.theta.tolist()
        errors: list[float] = np.sqrt(np.diag(self.covariance)).tolist()
        vertical_error, horizontal_error, sideways_error, surface_error = errors
        return Belief(
            vertical_strength=vertical,
            horizontal_strength=horizontal,
            turn=math.atan2(sideways, horizontal),
            surface=surface,
            vertical_strength_error=vertical_error,
            horizontal_strength_error=horizontal_error,
            turn_error=sideways_error / horizontal,
            surface_error=surface_error,
            path=float(state.path),
            surprise=float(state.surprise),
            excess=float(state.mean_error / state.mean_force) if state.mean_force > 0.0 else 0.0,
        )

    def strength(self) -> tuple[float, float] | None:
        """Strength of the bed over the model's at the last push, and its standard error; None if nothing was learned.

        It is the mean of s_v and s_h, weighted by the inverse of their variances.
        """
        state = self._state
        mean = state.of_push.theta
        covariance = state.of_push.p[_STRENGTHS, _STRENGTHS]
        if np.array_equal(mean, state.prior.theta):
            return None
        weights = 1.0 / np.diag(covariance)
        weights /= weights.sum()
        return float(weights @ mean[_STRENGTHS]), math.sqrt(float(weights @ covariance @ weights))

    @property
    def change(self) -> str:
        """How the grains at the last measurement differ from what the filter expected: harder, softer, or "" if not."""
        return _CHANGES[int(self._state.change)]

    def surprise_sentence(self) -> str:
        """A sentence: the grains are harder or softer than learned, and by how much; empty if they are as learned."""
        percent = 100.0 * self.belief().excess
        change = self._state.change
        if change == 0:
            return ""
        # not while its sign changes
        amount = f": force {percent:+.0f} %" if percent * change >= 1.0 else ""
        return f"grains {self.change} than learned{amount}"

    @property
    def excludes_readings(self) -> bool:
        """Whether no strength of the grains explains the last readings, which therefore update nothing."""
        return bool(self._state.unexplained)


@inlined
def _move(state, step, wet, passing):
    """Advance the path. When the tool pushes again, the filter resumes with its state at the last push.

    After a time in the air, turn and surface begin with the prior.
    """
    state.travel += step
    if not wet:
        state.stage = _AIR
        return
    state.path += step
    if passing:
        if state.stage == _PUSH:
            state.stage = _PAUSE
    elif state.stage != _PUSH and step > 0.0:
        copy(state.latest, state.of_push)
        if state.stage == _AIR:
            copy_place(state.latest, state.prior)
        state.stage = _PUSH
        state.path_push_began = state.path


@inlined
def _update_with_due(state, records, lag):
    """Update the filter with the records that the tool has passed by the lag."""
    while (
        state.first < state.open
        and records[state.first % _RECORD_COUNT].travel <= state.travel - lag
    ):
        oldest = records[state.first % _RECORD_COUNT]
        if oldest.fault:  # earlier updates may have been wrong as well
            copy(state.latest, state.prior)
            copy(state.of_push, state.prior)
        elif oldest.measured and oldest.path > max(
            state.path_learned, state.path_push_began if oldest.passing else 0.0
        ):
            update(state, oldest)
        state.first += 1
    if state.end - state.first == _RECORD_COUNT:  # no reading came for the oldest record: drop it
        state.first += 1
        state.open = max(state.open, state.first)


@compiled
def _predict(states, records, row, out, stamp, step, passing, apply, lag, reach):
    """Advance, update the filter with the records `lag` behind, predict with (L4), and add a record of this pose."""
    state = states[0]
    wet = row[SUBMERGED_AREA] > 0.0
    _move(state, step, wet, passing)
    _update_with_due(state, records, lag)
    copy(state.now, state.latest)
    grow(state.now, max(state.path - state.path_learned, 0.0))

    record = records[state.end % _RECORD_COUNT]
    correct(state, record, row, out, apply, lag, reach)
    last = records[(state.end - 1) % _RECORD_COUNT].travel
    close = state.end > state.first and state.travel - last < lag / _PER_LAG_COUNT
    if wet and step > 0.0 and not close:
        record.stamp = stamp
        record.travel = state.travel
        record.path = state.path
        record.passing = passing
        record.measured = False
        record.fault = False
        state.end += 1


@compiled
def _add_reading(states, records, y, stamp, is_repeated, air_load):
    """Add the measurement at a stamp to the record of that stamp, and judge it.

    `air_load`: mean force that the load cell reads in the air [N].
    """
    state = states[0]
    while state.open < state.end and records[state.open % _RECORD_COUNT].stamp < stamp:
        state.open += 1
    record = records[state.open % _RECORD_COUNT]
    if state.open < state.end and record.stamp == stamp:
        state.open += 1
        record.r += air_load**2
        judge(state, record, y, min(record.path - state.path_judged, _MAX_STEP_M), is_repeated)
        for i in range(3):
            record.y[i] = y[i]
