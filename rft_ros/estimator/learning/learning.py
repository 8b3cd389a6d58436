"""Corrects predictions by a Kalman filter, which is updated with load-cell readings at least a lag of path behind."""

import math
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.learning.filter import reset
from rft_ros.estimator.learning.records import (
    AWAY,
    CAPACITY,
    FILTER_STATE,
    RECORD,
    STEP_LEAST,
    STEP_MOST,
    add_reading,
    predict,
)
from rft_ros.estimator.learning.surprise import ISSUES, JUDGE_FIELDS
from rft_ros.estimator.samples import ABSURD, Vector
from rft_ros.estimator.tare import AirReading
from rft_ros.parameters.settings import CALIBRATED_ERROR
from rft_ros.rft.frames import WIDTH
from rft_ros.rft.kernel.compilation import machine_code

__all__ = ["Belief", "Learning"]

Array = NDArray[np.float64]

_STRENGTHS = slice(0, 2)  # places of s_v and s_h in θ


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


class Learning:
    """The filter for one tool in one medium, fed by the predictions and the load cell's readings.

    At each pose call `predict`. When its compensated force is known, call `learn` with the pose's stamp, in the order
    of stamps. A prediction uses the measurements at least `lag` of path [m] behind, so no sample is part of its own.
    `strength_error`: relative standard error of ζ. `reach` of the tool's surface from the tool frame's origin [m].
    `air`: what the load cell reads in the air; its owner adds the readings.
    """

    def __init__(
        self,
        *,
        lag: float = 0.002,
        strength_error: float = CALIBRATED_ERROR,
        reach: float = 0.0,
        air: AirReading | None = None,
    ) -> None:
        self._strength_error, self._air = strength_error, air or AirReading()
        self._states, self._records = np.zeros(1, FILTER_STATE), np.zeros(CAPACITY, RECORD)
        self._state: Any = self._states[0]
        self._change, self._issues = self._states["change"], self._states["issues"]
        self._row, self._y, out = np.zeros(WIDTH), np.zeros(3), np.zeros(12)
        arrays = self._states, self._records
        self._predict = machine_code(predict, (*arrays, self._row, out, 0, 0.0, False, True))
        self._learn: Any = machine_code(add_reading, (*arrays, self._y, 0, False, 0.0, False))
        self.use(lag=lag, reach=reach)
        self.forget()

    def use(self, *, lag: float, reach: float) -> None:
        """Use another lag, or a tool of another reach."""
        self._state["lag"], self._state["reach"] = lag, reach

    @property
    def lag(self) -> float:
        """Path [m] between a prediction and the measurements that it uses."""
        return float(self._state["lag"])

    def forget(self) -> None:
        """Go back to the calibration."""
        lag, reach = self._state["lag"], self._state["reach"]
        self._states[:] = np.zeros(1, FILTER_STATE)
        self.use(lag=lag, reach=reach)
        reset(self._state, self._strength_error)

    def forget_place(self) -> None:
        """Keep the strength, and reset surface and turn: the tool moved elsewhere or is another one, or time jumped."""
        state = self._state
        latest, prior, of_push = state["latest"], state["prior"], state["of_push"]
        for name, *_ in JUDGE_FIELDS:
            if name != "doubts":
                state[name] = 0
        state["first"] = state["open"] = state["end"]
        state["path_learned"] = state["path_judged"] = state["path"]
        latest["theta"], latest["p"] = prior["theta"], prior["p"]
        latest["theta"][_STRENGTHS] = of_push["theta"][_STRENGTHS]
        latest["p"][_STRENGTHS, _STRENGTHS] = of_push["p"][_STRENGTHS, _STRENGTHS]
        state["stage"] = AWAY

    def predict(self, stamp: int, row: Array, *, step: float, passing: bool = False, apply: bool = True) -> Array:
        """Corrected wrench and its standard deviations at a pose, world axes.

        `stamp` [ns], increasing (after a jump back call `forget_place`). `row`, shape [19]: the model's result, finite:
        force F [N], torque [N m], submerged area [m²], dF/dh [N/m], and Σ r_j f_l [N m] row by row. `step`: path of the
        tool's fastest point since the pose before [m], 0 at rest. `passing`: the tool is withdrawn, or so fast that
        inertia matters; updates from here are dropped afterwards, and no surprise is reported. `apply`: whether the
        wrench is corrected. Returns shape [12]: force, torque about the tool frame's origin, deviation of each.
        """
        self._row[:], out = row, np.empty(12)
        path = min(float(step), STEP_MOST) if step > STEP_LEAST else 0.0
        self._predict(
            self._states, self._records, self._row, out, int(stamp), path, bool(passing), bool(apply)
        )  # fmt: skip
        return out

    def learn(self, stamp: int, force: Array | Vector, *, repeated: bool = False) -> None:
        """Add the compensated force [N] at a pose, world axes, shape [3]. A force that is not finite is ignored.

        `repeated`: the load cell's raw reading equals the one before, bit by bit.
        """
        if math.hypot(*force) < ABSURD:
            self._y[:], air = force, self._air
            self._learn(
                self._states, self._records, self._y, int(stamp), bool(repeated), air.load, air.is_offset
            )  # fmt: skip

    @property
    def theta(self) -> Array:
        """s_v, s_h, ρ, δ [m], shape [4]: a copy."""
        return np.array(self._state["latest"]["theta"])

    @property
    def covariance(self) -> Array:
        """Covariance of `theta`, shape [4, 4], in its units: a copy."""
        return np.array(self._state["latest"]["p"])

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
            path=float(state["path"]),
            surprise=float(state["surprise"]),
            excess=float(state["mean_error"] / state["mean_force"]) if state["mean_force"] > 0.0 else 0.0,
        )

    def strength(self) -> tuple[float, float] | None:
        """Strength of the bed over the model's at the last push, and its standard error; None if nothing was learned.

        It is the mean of s_v and s_h, weighted by the inverse of their variances.
        """
        of_push = self._state["of_push"]
        mean, covariance = of_push["theta"], of_push["p"][_STRENGTHS, _STRENGTHS]
        if np.array_equal(mean, self._state["prior"]["theta"]):
            return None
        weights = 1.0 / np.diag(covariance)
        weights /= weights.sum()
        return float(weights @ mean[_STRENGTHS]), math.sqrt(float(weights @ covariance @ weights))

    @property
    def change(self) -> Literal["", "harder", "softer"]:
        """How the grains at the last measurement differ from what the filter expected; "" within its deviation."""
        change = int(self._change[0])
        if change == 0:
            return ""
        return "harder" if change > 0 else "softer"

    def surprise_sentence(self) -> str:
        """A sentence: the grains are harder or softer than learned, and by how much; empty if they are as learned."""
        percent = 100.0 * self.belief().excess
        if not self.change:
            return ""
        by = f": force {percent:+.0f} %" if percent * self._change[0] >= 1.0 else ""  # not while its sign changes
        return f"grains {self.change} than learned{by}"

    @property
    def disagrees(self) -> bool:
        """Whether there are `issues`."""
        return self._air.is_offset or self._issues[0] != 0

    def issues(self) -> list[str]:
        """Sentences on an implausible load cell or model, from `ISSUES`."""
        return [*_sentences(self._state["issues"]), *self._air.issues()]

    def doubts(self) -> list[str]:
        """The issues that were present when readings in the grains were judged, since the calibration."""
        return _sentences(self._state["doubts"])


def _sentences(issues: int) -> list[str]:
    """Those of issues, a bitwise or of keys of `ISSUES`."""
    return [sentence for issue, sentence in ISSUES.items() if issues & issue]
