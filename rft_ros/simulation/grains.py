"""Grains that a simulator steps: a body's pose and twist in, the wrench to hold over the step out."""

import itertools
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rft_ros.ground import KEPT, HeightMap, Support
from rft_ros.rft import Law, Memory, checked_states
from rft_ros.rft.arguments import number, numbers
from rft_ros.rft.wrench import prepared
from rft_ros.simulation.coupling import ANSWER, calm, stiffness_matrix
from rft_ros.tool import Tool

__all__ = ["Grains", "GrainsBatch", "GrainsState"]

Array = NDArray[np.float64]

_Part = tuple[slice, Callable[..., None]]  # bodies, and their step

GrainsState = dict[str, NDArray[Any]]
"""What grains remember of their bodies, by name."""


class GrainsBatch:
    """Many bodies of one shape, each in a bed of its own, as in a simulator's parallel environments.

    `tool`: the shape, in the body frame (`load_tool`). `law`: of the grains (`treers2021`, `agarwal2023`); with its
    inertia and its memory. `surface_height` [m]: where `ground`, a map of the ground's
    height, knows nothing. `threads`: over bodies; a result does not depend on it. Raises ValueError or TypeError.
    """

    def __init__(
        self,
        tool: Tool,
        law: Law,
        *,
        bodies: int,
        surface_height: float = 0.0,
        ground: HeightMap | None = None,
        threads: int = 1,
    ) -> None:
        if not isinstance(tool, Tool):
            raise TypeError(f"tool is a {type(tool).__name__}; load one with rft_ros.tool.load_tool")
        if not isinstance(ground, HeightMap | None):
            raise TypeError(f"ground is a {type(ground).__name__}; read one with rft_ros.ground.read_height_map")
        for name, value in ("bodies", number("bodies", bodies)), ("threads", number("threads", threads)):
            if value < 1.0 or value % 1.0:
                raise ValueError(f"{name} is {value:g}; it must be a whole number of at least 1")
        n, self._threads = int(bodies), int(threads)
        bed: Any = {"surface_height": surface_height, "ground": ground}
        self._new = partial(type(self), tool, law, bodies=n, threads=threads, **bed)
        self._reach, self._ground, self._support = tool.plates.reach, ground, Support(tool.corners)
        self._surface = number("surface_height", surface_height)
        memory, self._answers = Memory(tool.plates, bodies=n), np.zeros(n, ANSWER)
        self._kept = np.zeros((n, KEPT))
        self._remembered: GrainsState = {"memory": memory.numbers, "answers": self._answers, "surfaces": self._kept}
        self._durations, self._rows, self._wrenches = np.zeros(n), np.zeros((n, 19)), np.zeros((n, 6))
        self.sums = memory.stiffness
        """`Memory.stiffness` of each body at the last step, in its units, shape [n, 10]."""
        # Threads take parts as they get ready. With a map each body has a surface of its own, so it is a part.
        parts = n if ground is not None else 1 if threads == 1 else min(n, 2 * self._threads)
        edges = np.linspace(0, n, parts + 1).astype(int)
        slices = [slice(a, b) for a, b in itertools.pairwise(edges)]
        self._parts: list[_Part] = [(s, prepared(tool.plates, law, memory, bodies=s)) for s in slices]
        self._pool = ThreadPoolExecutor(self._threads)
        self.step(np.tile([*np.zeros(6), 1.0, *np.zeros(6)], (n, 1)), 1.0)  # compiles
        self.reset()

    def __reduce__(self) -> tuple[Any, ...]:
        # threads and views of the arrays can be neither copied nor pickled
        return self._new, (), self.state()

    def step(self, states: ArrayLike, dt: float) -> Array:
        """The wrench on each body to hold over the next `dt` [s]: force [N], torque [N m], shape [n, 6], world axes.

        `states`: shape [n, 13], columns `rft_ros.rft.STATE`: pose of the body frame and twist of its origin now.
        Torques are about the body frames' origins. The grains remember the poses of the last call. A body that chatters
        under held wrenches is calmed. Raises ValueError, and forgets nothing, for states that cannot be used.
        """
        given = checked_states(states)
        if len(given) != len(self._rows):
            raise ValueError(f"states has {len(given)} rows; there are {len(self._rows)} bodies")
        duration = number("dt", dt, positive=True)
        rows = self.advance(given, duration)
        calm(rows, self.sums, given, duration, self._reach, self._answers, self._wrenches)
        return self._wrenches.copy()

    def advance(self, states: Array, dt: float) -> Array:
        """Rows of `wrenches_in_time` for checked states, in its units, shape [n, 19], not copied."""
        self._durations.fill(dt)
        parts = iter(self._parts)
        jobs = [self._pool.submit(self._run, parts, states) for _ in range(self._threads - 1)]
        self._run(parts, states)
        for job in jobs:
            job.result()
        return self._rows

    def _run(self, parts: Iterator[_Part], states: Array) -> None:
        for part, step in parts:
            here, kept = states[part], self._kept[part.start]
            height, slope, *_ = self._support.local_surface(self._ground, here[0], level=self._surface, kept=kept)
            step(here, self._durations[part], height, slope, self._rows[part])

    @property
    def stiffness(self) -> Array:
        """B at the last step, shape [n, 6, 6]: a body that moves a little feels its wrench change by -B times that.

        Displacement and rotation vector of the body frame, world axes; units N/m, N and N m.
        """
        out: Array = np.empty((len(self._rows), 6, 6))
        for sums, matrix in zip(self.sums, out, strict=True):
            stiffness_matrix(sums, matrix)
        return out

    def reset(self, bodies: ArrayLike | None = None) -> None:
        """Level beds that remember nothing: those of all bodies, or of these indices."""
        for array in self._remembered.values():
            array[slice(None) if bodies is None else np.asarray(bodies) if np.size(bodies) else []] = 0.0

    def state(self) -> GrainsState:
        """A copy of what the grains remember, a row for each body; picklable."""
        return {name: array.copy() for name, array in self._remembered.items()}

    def restore(self, state: GrainsState) -> None:
        """Go back to a state of these grains, or of others of the same tool, ground and number of bodies."""
        if not isinstance(state, dict) or _forms(state) != _forms(self._remembered):
            raise ValueError("state is of other bodies; restore what state() of grains like these returned")
        for name, array in state.items():
            np.copyto(self._remembered[name], array)

    __setstate__ = restore  # of a copy


def _forms(state: GrainsState) -> dict[str, object]:
    return {name: (np.shape(array), np.asarray(array).dtype) for name, array in state.items()}


class Grains:
    """One body in one bed; arguments as for `GrainsBatch`."""

    def __init__(self, tool: Tool, law: Law, **options: Any) -> None:
        self._one = GrainsBatch(tool, law, bodies=1, **options)
        self.reset, self.state, self.restore = self._one.reset, self._one.state, self._one.restore

    def step(self, position: ArrayLike, quaternion: ArrayLike, twist: ArrayLike, dt: float) -> Array:
        """The wrench to hold over the next `dt` [s]: force [N] and torque [N m], shape [6], world axes.

        Pose of the body frame [m], quaternion xyzw, and twist of its origin now, shape [6]: linear [m/s] and angular
        [rad/s], world axes. The torque is about the origin. Else as `GrainsBatch.step`.
        """
        given = ("position", position, 3), ("quaternion", quaternion, 4), ("twist", twist, 6)
        return np.asarray(self._one.step(np.concatenate([numbers(name, v, rows=n) for name, v, n in given]), dt)[0])

    @property
    def stiffness(self) -> Array:
        """`GrainsBatch.stiffness` of the one body, in its units, shape [6, 6]."""
        return np.asarray(self._one.stiffness[0])
