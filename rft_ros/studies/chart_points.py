"""Points of the chart: what one evaluation takes, and how far its force lies from the converged one."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from statistics import median

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import INTEGRATIONS, MEDIA, Law, Medium, Plates, wrenches
from rft_ros.studies.chart_scenes import Scene
from rft_ros.studies.paper import ALPHA_Y, ZETA, law
from rft_ros.tool.cubature import chosen_plates
from rft_ros.tool.merge import Merger

__all__ = ["Beside", "Point", "front", "median_seconds", "points"]

Array = NDArray[np.float64]

Beside = Callable[[Plates, Medium, float, Callable[[Array], Array | float], Array], Array]
"""Another implementation of the published rule: plates, medium, ζ, α_y [N/cm³] of β, state -> wrench, shape [6]."""

FULL, MERGED, CHOSEN, NUMPY = "full mesh", "merged, any motion", "chosen for the scene", "full mesh, NumPy"
"""How the plates of a point came about."""

_MERGED_TO, _CHOSEN = (30, 60, 120, 250, 500), (5, 10, 20, 40, 80, 160)
_TIMED = 40  # states
_BESIDE = 30  # states that another implementation is judged by
_CLEARLY = 0.05
_TURNS, _TURN = 15, 0.003  # the median of so many, each of about so many seconds


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """One way to compute one scene.

    `time`: of an evaluation [s]. `error`: at the 95th percentile of states, over the scene's greatest force.
    """

    scene: str
    integration: str
    alpha_y: str
    reduction: str
    plates: int
    time: float
    error: float

    @property
    def name(self) -> str:
        """Such as "refined, 320 plates, full mesh, α_y constant"."""
        return f"{self.integration}, {self.plates:,} plates, {self.reduction}, α_y {self.alpha_y}"


def points(scene: Scene, *, beside: Beside | None = None) -> list[Point]:
    """Every point of a scene. Plates are chosen on every other state, and errors measured on the rest."""
    states = np.ascontiguousarray(scene.states[1::2])
    one = [states[k : k + 1] for k in range(0, len(states), max(1, len(states) // _TIMED))]
    reference = scene.plates(scene.reference, "refined")
    converged = {name: wrenches(reference, law(name), states)[:, :3] for name in ALPHA_Y}
    found: list[tuple[Plates, str, str, Array]] = []  # plates, reduction, α_y model, errors
    calls: list[Callable[[], object]] = []
    for plates, reduction in _bodies(scene):
        for name in ALPHA_Y:
            off = wrenches(plates, law(name), states)[:, :3] - converged[name]
            found.append((plates, reduction, name, off))
            calls.append(partial(_one_by_one, plates, law(name), one))
        if beside and (plates.integration, reduction) == ("centroid", FULL):
            every = slice(None, None, max(1, len(states) // _BESIDE))
            off = np.array([_by(beside, plates, state)[:3] for state in states[every]])
            found.append((plates, NUMPY, "constant", off - converged["constant"][every]))
            calls.append(partial(_by, beside, plates, states[-1]))
    return [
        Point(
            scene=scene.name,
            integration=plates.integration,
            alpha_y=alpha_y,
            reduction=reduction,
            plates=len(plates),
            time=seconds / (1 if reduction == NUMPY else len(one)),
            error=float(np.percentile(np.linalg.norm(off, axis=1), 95.0) / greatest),
        )
        for (plates, reduction, alpha_y, off), seconds in zip(found, median_seconds(calls), strict=True)
        for greatest in [np.linalg.norm(converged[alpha_y], axis=1).max()]
    ]


def _bodies(scene: Scene) -> Iterator[tuple[Plates, str]]:
    """Plates of a scene's body, and how they came about."""
    for rule in INTEGRATIONS:
        for level in range(scene.levels):
            yield scene.plates(level, rule), FULL
        delivered = scene.plates(scene.delivered, rule)
        merger = Merger(delivered)
        for count in _MERGED_TO:
            if 2 * count < len(delivered):
                yield merger.merged(count), MERGED
        chosen: dict[int, Plates] = {}
        for plates in chosen_plates(delivered, scene.states[::2]) if scene.known else ():
            chosen[len(plates)] = plates
            if len(plates) >= _CHOSEN[-1]:
                break
        for count in _CHOSEN:
            if count in chosen:
                yield chosen[count], CHOSEN


def _one_by_one(plates: Plates, model: Law, states: Sequence[Array]) -> None:
    """Evaluations as a tick makes them: the public call, one core, one state."""
    out = np.empty((1, 7))
    for state in states:
        wrenches(plates, model, state, threads=1, out=out)


def _by(beside: Beside, plates: Plates, state: Array) -> Array:
    generic = MEDIA["generic"]
    return beside(plates, generic, ZETA, lambda _beta: generic.alpha_x_flat, state)


def median_seconds(calls: Sequence[Callable[[], object]]) -> list[float]:
    """Processor time of each call once warm [s], medians; they take turns, so that a busy machine slows all alike."""

    def seconds(call: Callable[[], object], times: int) -> float:
        began = time.thread_time()
        for _ in range(times):
            call()
        return (time.thread_time() - began) / times

    times = [max(1, int(_TURN / min(seconds(call, 1) for _ in range(2)))) for call in calls]
    turns = [[seconds(call, n) for call, n in zip(calls, times, strict=True)] for _ in range(_TURNS)]
    return [median(of_call) for of_call in zip(*turns, strict=True)]


def front(candidates: Sequence[Point]) -> list[Point]:
    """The points that no other beats in both time and error, by time; less than `_CLEARLY` is no gain."""
    best: list[Point] = []
    for candidate in sorted(candidates, key=lambda p: (p.time, p.error)):
        if not best or candidate.error < (1.0 - _CLEARLY) * best[-1].error:
            best.append(candidate)
    return best
