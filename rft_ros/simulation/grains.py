"""Grains that a simulator steps: bodies' poses and twists in, the wrenches to hold over the step out."""

import itertools
import logging
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rft_ros.ground import LAST_SURFACE, HeightMap, Support
from rft_ros.rft import Law, checked_states
from rft_ros.rft.arguments import number, numbers, whole_number
from rft_ros.rft.frames import rotation_matrix
from rft_ros.rft.kernel.compilation import machine_code
from rft_ros.rft.memory import MOST_BODIES
from rft_ros.rft.plates import BLOCK
from rft_ros.rft.traction import packed_law
from rft_ros.simulation.beds import forces_on_plates, laws_of, make_beds, stiffness_matrix
from rft_ros.simulation.step import BODY, advance, hold_each, no_constraints
from rft_ros.tool import Tool

Array = NDArray[np.float64]

_LONGEST = 0.02  # m; a body that slides or falls further in one step stops too soon
_FREE = no_constraints(6)
_FARTHEST = 1e6  # m or rad; the wrenches of a longer step would overflow

GrainsState = dict[str, NDArray[Any]]
"""State of the grains around their bodies, arrays by name."""

_log = logging.getLogger("rft_ros.simulation")


class GrainsBatch:
    """Many bodies, each in a bed of its own, as in a simulator's parallel environments.

    `tool`: the bodies' shape, in the body frame (`load_tool`), or a sequence of one tool for each of the `bodies`.
    `law`: of the grains (`treers2021`, `agarwal2023`), with its inertia and its memory. `strength`: factor of the law's
    stresses, and `surface_height` [m]: one number, or one for each body. `ground`: a map of the ground's height, in
    place of `surface_height`; outside of the map, and where its height is unknown, the nearest known cell is used.
    `threads`: number of threads; results do not depend on it. Raises ValueError or TypeError.
    """

    def __init__(
        self,
        tool: Tool | Sequence[Tool],
        law: Law,
        *,
        bodies: int,
        strength: ArrayLike = 1.0,
        surface_height: ArrayLike = 0.0,
        ground: HeightMap | None = None,
        threads: int = 1,
    ) -> None:
        n = whole_number("bodies", bodies, most=MOST_BODIES)
        self._threads = whole_number("threads", threads, most=MOST_BODIES)
        self.tools = [tool] * n if isinstance(tool, Tool) else list(tool)
        for one in self.tools:
            if not isinstance(one, Tool):
                raise TypeError(
                    f"tool is a {type(one).__name__}; load one with rft_ros.tool.load_tool"
                )
        if len(self.tools) != n:
            raise ValueError(f"tool has {len(self.tools)} tools; there are {n} bodies")
        if not isinstance(ground, HeightMap | None):
            raise TypeError(
                f"ground is a {type(ground).__name__}; read one with rft_ros.ground.read_height_map"
            )
        self._new = partial(type(self), tool, law, bodies=n, ground=ground, threads=threads)
        self.beds = make_beds([one.plates for one in self.tools], law)
        self._law = law
        self._ground = None if ground is None else ground.filled()
        self._supports = {id(one): Support(one.corners) for one in self.tools}
        self._bodies = np.zeros(n, BODY)
        self._surfaces = np.zeros(n, LAST_SURFACE)
        self._durations = np.zeros(2)
        self.states = np.zeros((n, 13))
        """Those of the last step."""
        self._of_bodies: GrainsState = {
            "memory": self.beds.memory,
            "stiffness": self.beds.stiffness,
            "bodies": self._bodies,
            "surfaces": self._surfaces,
            "states": self.states,
        }
        self.remembered: GrainsState = {
            **self._of_bodies,
            "beds": self.beds.bodies,
            "laws": laws_of(self.beds),
            "durations": self._durations,
        }
        self.rows = np.zeros((n, 19))
        """Rows of `wrenches_in_time` at these states."""
        self.near = np.zeros(n, np.bool_)
        """Whether each body may reach the surface in the step."""
        self.last = self._bodies["wrench"]
        """The wrenches of the last step, as it returned them, shape [n, 6]."""
        self.failures = 0
        """Number of steps of a body in which Newton's method did not converge."""
        # Each thread takes the next part of the bodies when it has finished one.
        parts = 1 if threads == 1 else min(n, 2 * self._threads)
        self._parts = [
            slice(a, b)
            for a, b in itertools.pairwise(np.linspace(0, n, parts + 1).astype(int).tolist())
        ]
        self._pool = ThreadPoolExecutor(self._threads)
        self._advance: Any = machine_code(advance, self._advanced(slice(0, n), self.states))
        self._hold: Any = None  # compiled for the first implicit step
        self.reset(strength=strength, surface_height=surface_height)

    def __reduce__(self) -> tuple[Any, ...]:
        # threads and views of the arrays can be neither copied nor pickled
        return self._new, (), self.state()

    def step(
        self,
        states: ArrayLike,
        dt: float,
        *,
        inverse_inertia: ArrayLike | None = None,
        free_acceleration: ArrayLike | None = None,
    ) -> Array:
        """The wrench on each body to hold over the next `dt` [s]: force [N], torque [N m], shape [n, 6], world axes.

        `states`: shape [n, 13], columns `rft_ros.rft.STATE`: pose of the body frame and twist of its origin now.
        Torques are about the body frames' origins. The state of the grains includes the poses of the last call.
        `inverse_inertia`: A, shape [n, 6, 6] or [6, 6] for all: how a wrench accelerates a body, in the same axes and
        about the same point (`free_body`). `free_acceleration` [m/s², rad/s²]: of the body frame without the grains,
        shape [n, 6] or [6]. With both the step is implicit, for a simulator that adds `dt` times the acceleration to
        the twist and moves the body by `dt` times the new twist: the wrench is that where the body is then. Without
        both it is the grains' own at `states`. Raises ValueError, and forgets nothing, for values that cannot be used.
        """
        n = len(self.rows)
        given = checked_states(states)
        if len(given) != n:
            raise ValueError(f"states has {len(given)} rows; there are {n} bodies")
        duration = number("dt", dt, positive=True)
        if (inverse_inertia is None) != (free_acceleration is None):
            missing = "inverse_inertia" if inverse_inertia is None else "free_acceleration"
            raise ValueError(
                f"{missing} is missing; the implicit step needs inverse_inertia and free_acceleration"
            )
        if inverse_inertia is None or free_acceleration is None:
            self.advance(given, duration)
            self.last[:] = self.rows[:, :6]
            return self.wrench
        inverse = _each("inverse_inertia", inverse_inertia, (n, 6, 6))
        free = _each("free_acceleration", free_acceleration, (n, 6))
        _refuse_without_bound(duration, given[:, 7:], free, inverse)
        self.advance(given, duration)
        wrenches = np.empty((n, 6))

        def hold(part: slice) -> tuple[int, float]:
            failed, path = self._hold(*self._held(part, inverse, free, duration, wrenches))
            return int(failed), float(path)

        if self._hold is None:
            self._hold = machine_code(
                hold_each, self._held(slice(0, n), inverse, free, 0.1, wrenches)
            )
        failed, paths = zip(*self._in_parts(hold), strict=True)
        self.failed(sum(failed), dt=duration, path=max(paths))
        self.last[:] = wrenches
        return wrenches

    def _held(
        self, part: slice, inverse: Array, free: Array, dt: float, wrenches: Array
    ) -> tuple[Any, ...]:
        given = self._bodies[part], self.near[part], self.states, inverse[part], free[part], _FREE
        return self.beds, part.start, *given, dt, wrenches[part]

    def advance(self, states: Array, dt: float) -> None:
        """Bring the memory, `rows` and the energy to checked states, after which a step of `dt` begins."""
        if self._ground is not None:
            self._find_surfaces(states, self._ground)
        self._durations[:] = self._durations[1], dt
        self._in_parts(lambda part: self._advance(*self._advanced(part, states)))

    def _advanced(self, part: slice, states: Array) -> tuple[Any, ...]:
        written = self.states[part], self.rows[part], self.near[part]
        return self.beds, part.start, self._bodies[part], self._durations, states[part], *written

    def _in_parts(self, work: Callable[[slice], Any]) -> list[Any]:
        """What `work` returns of each part of the bodies."""
        if len(self._parts) == 1:
            return [work(self._parts[0])]
        return list(self._pool.map(work, self._parts))

    def _find_surfaces(self, states: Array, ground: HeightMap) -> None:
        for k, (tool, state) in enumerate(zip(self.tools, states, strict=True)):
            support = self._supports[id(tool)]
            level = ground.nearest(state[0], state[1])
            height, slope, *_ = support.local_surface(
                ground, state, level=level, last=self._surfaces[k : k + 1]
            )
            body = self.beds.bodies[k]
            body["height"] = height
            body["slope_x"], body["slope_y"] = slope

    def failed(self, times: int, *, dt: float, path: float) -> None:
        """Count the steps that did not converge, or in which a body moved too far [m]. Logs the first of them."""
        why = "does not converge"
        if path > _LONGEST:
            times += 1
            why = "moves a body too far in grains"
        if times and not self.failures:
            _log.warning(
                "a step of %g s %s (%.2g m), so the wrench is a guess; take shorter steps",
                dt,
                why,
                path,
            )
        self.failures += times

    @property
    def wrench(self) -> Array:
        """The wrenches of the last step, as it returned them, shape [n, 6]."""
        last: Array = np.array(self.last)
        return last

    @property
    def energy(self) -> Array:
        """Energy that the grains have taken from each body since the last reset [J], shape [n]."""
        return np.array(self._bodies["energy"])

    @property
    def stiffness(self) -> Array:
        """Stiffness B at the last step, shape [n, 6, 6]: a small displacement d of a body changes its wrench by -B d.

        d: displacement and rotation vector of the body frame, world axes; units of B: N/m, N and N m.
        """
        out: Array = np.empty((len(self.rows), 6, 6))
        for sums, matrix in zip(self.beds.stiffness, out, strict=True):
            stiffness_matrix(sums, matrix)
        return out

    def tractions(self, body: int = 0) -> Array:
        """Force per area on each plate of a body at the last step [Pa], shape [plates, 3], world axes.

        In the order of `Tool.plates`, whose `rows` give the plates' places and areas, to draw them.
        """
        k = int(self._indices(body)[0])
        plates = self.tools[k].plates
        forces = np.zeros((plates.bounds.shape[1] * BLOCK, 3))
        forces_on_plates(self.beds, k, self.states[k : k + 1], forces)
        ordered = np.empty((len(plates), 3))
        ordered[plates.order] = forces[: len(plates)]
        area = plates.areas[:, None]
        return np.divide(ordered, area, out=np.zeros_like(ordered), where=area > 0.0)

    def reset(
        self,
        bodies: ArrayLike | None = None,
        *,
        strength: ArrayLike | None = None,
        surface_height: ArrayLike | None = None,
    ) -> None:
        """Start with new beds, without hysteresis: those of all bodies, or of these indices.

        `strength`, `surface_height` [m]: of the new beds, one number or one for each of these bodies; None: as before.
        """
        which = self._indices(bodies)
        form = (len(which),)
        factors = None if strength is None else _each("strength", strength, form, positive=True)
        heights = None if surface_height is None else _each("surface_height", surface_height, form)
        for array in self._of_bodies.values():
            array[which] = np.zeros((), array.dtype)
        if factors is not None:
            laws = (
                replace(self._law, zeta=self._law.zeta * factor) for factor in factors.tolist()
            )
            laws_of(self.beds)[which] = np.concatenate([packed_law(law).numbers for law in laws])
        if heights is not None:
            self.beds.bodies["height"][which] = heights

    def _indices(self, bodies: ArrayLike | None) -> NDArray[np.int64]:
        every = np.arange(len(self._bodies))
        given = every if bodies is None else np.asarray(bodies)
        try:
            return np.atleast_1d(every[given if given.size else []])
        except IndexError:
            raise ValueError(
                f"bodies is {bodies!r}; give indices of the {len(every)} bodies, 0 to {len(every) - 1}"
            ) from None

    def state(self) -> GrainsState:
        """A copy of the state of the grains, which can be pickled."""
        return {name: array.copy() for name, array in self.remembered.items()}

    def restore(self, state: GrainsState) -> None:
        """Go back to a state of these grains, or of others of the same tools, law, ground and number of bodies."""
        if not isinstance(state, dict) or _forms(state) != _forms(self.remembered):
            raise ValueError(
                "state is of other bodies; restore what state() of grains like these returned"
            )
        for name, array in state.items():
            fields = (
                [array[field] for field in array.dtype.names] if array.dtype.names else [array]
            )
            if not all(np.isfinite(field).all() for field in fields):
                raise ValueError(
                    f"state has values in '{name}' that are not finite; restore what state() returned"
                )
        for name, array in state.items():
            np.copyto(self.remembered[name], array)

    __setstate__ = restore  # of a copy


def _forms(state: GrainsState) -> dict[str, object]:
    return {name: (np.shape(array), np.asarray(array).dtype) for name, array in state.items()}


def _each(name: str, values: ArrayLike, form: tuple[int, ...], *, positive: bool = False) -> Array:
    """Values for each body, shape `form`; without the first axis the same for all."""
    given = np.asarray(values)
    if given.dtype.kind not in "fiu" or given.shape not in (form, form[1:]):
        wanted = (
            f"{list(form)} or {list(form[1:])}" if len(form) > 1 else f"{list(form)} or one number"
        )
        raise ValueError(
            f"{name} has shape {list(given.shape)} of type {given.dtype}; it must be {wanted}"
        )
    array = np.array(np.broadcast_to(given, form), dtype=np.float64, order="C")
    bad = ~np.isfinite(array) | (positive & (array <= 0.0))
    if bad.any():
        raise ValueError(
            f"{name} has the value {array[bad][0]:g}; it must be {'positive' if positive else 'finite'}"
        )
    return array


def _refuse_without_bound(dt: float, twists: Array, free: Array, inverse: Array) -> None:
    """Refuse steps whose results would overflow."""
    for name, largest in (
        ("twist", twists),
        ("free_acceleration", dt * free),
        ("inverse_inertia", inverse),
    ):
        size = float(np.abs(largest).max(initial=0.0)) * (1.0 if name == "inverse_inertia" else dt)
        if not size < _FARTHEST:
            raise ValueError(
                f"{name} moves a body by {size:g} m in dt, {dt:g} s; it must be less than {_FARTHEST:g} m"
            )


class Grains:
    """One body in one bed; arguments as for `GrainsBatch`."""

    def __init__(self, tool: Tool, law: Law, **options: Any) -> None:
        self._one = GrainsBatch(tool, law, bodies=1, **options)
        self.reset = self._one.reset
        self.state = self._one.state
        self.restore = self._one.restore
        self.tractions = self._one.tractions

    def step(
        self,
        position: ArrayLike,
        quaternion: ArrayLike,
        twist: ArrayLike,
        dt: float,
        *,
        inverse_inertia: ArrayLike | None = None,
        free_acceleration: ArrayLike | None = None,
    ) -> Array:
        """The wrench to hold over the next `dt` [s]: force [N] and torque [N m], shape [6], world axes.

        Pose of the body frame [m], quaternion xyzw, and twist of its origin now, shape [6]: linear [m/s] and angular
        [rad/s], world axes. The torque is about the origin. Else as `GrainsBatch.step`.
        """
        given = ("position", position, 3), ("quaternion", quaternion, 4), ("twist", twist, 6)
        state = np.concatenate([numbers(name, v, rows=n) for name, v, n in given])
        response: Any = {
            "inverse_inertia": inverse_inertia,
            "free_acceleration": free_acceleration,
        }
        return np.asarray(self._one.step(state, dt, **response)[0])

    @property
    def wrench(self) -> Array:
        """The wrench that the last step returned, shape [6]."""
        return np.asarray(self._one.wrench[0])

    @property
    def energy(self) -> float:
        """Energy that the grains have taken from the body since the last reset [J]."""
        return float(self._one.energy[0])

    @property
    def stiffness(self) -> Array:
        """`GrainsBatch.stiffness` of the one body, in its units, shape [6, 6]."""
        return np.asarray(self._one.stiffness[0])


def free_body(
    mass: float, inertia: ArrayLike, quaternion: ArrayLike, center: ArrayLike = (0.0, 0.0, 0.0)
) -> Array:
    """The inverse inertia A of a body that is free to move, shape [6, 6], world axes, about the body frame's origin.

    `mass` [kg]; `inertia` about the centre of mass in the body's axes [kg m²], shape [3, 3]; `quaternion` xyzw of the
    body; `center`: the centre of mass in the body frame [m]. Raises ValueError for what cannot be used.
    """
    axes = rotation_matrix(quaternion)
    turns = np.linalg.inv(axes @ numbers("inertia", inertia, (3,), rows=3) @ axes.T)
    x, y, z = axes @ numbers("center", center, rows=3)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    moves = np.eye(3) / number("mass", mass, positive=True) - cross @ turns @ cross
    return np.block([[moves, cross @ turns], [-turns @ cross, turns]])
