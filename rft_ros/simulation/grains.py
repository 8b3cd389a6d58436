"""Grains that a simulator steps: bodies' poses and twists in, the wrenches to hold over the step out."""

import logging
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cached_property, partial
from hashlib import sha256
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rft_ros.ground import LAST_SURFACE, HeightMap, Support
from rft_ros.rft import Law, checked_states
from rft_ros.rft.arguments import MOST, finite_numbers, number, numbers, whole_number
from rft_ros.rft.frames import rotation_matrix, unit_quaternion
from rft_ros.rft.kernel.compilation import machine_code
from rft_ros.rft.plates import BLOCK
from rft_ros.rft.traction import packed_law
from rft_ros.simulation.beds import (
    add_forces_on_plates,
    make_beds,
    set_law,
    stiffness_matrices,
)
from rft_ros.simulation.step import begin_step, find_indefinite, hold_each
from rft_ros.tool import Tool

if TYPE_CHECKING:
    from typing import Self  # of Python 3.11

Array = NDArray[np.float64]

MAX_PATH_M = 0.02
"""A body that slides or falls further in grains in one step stops too soon."""

MAX_DISPLACEMENT_M = 1e6
"""The wrenches of a longer step would overflow."""

GrainsState = dict[str, NDArray[Any]]
"""State of the grains around their bodies, arrays by name."""

_log = logging.getLogger("rft_ros.simulation")


class Copied:
    """Is copied and pickled by its arguments and its state: threads, machine code and views of arrays cannot be."""

    _arguments: tuple[Any, ...]
    _options: dict[str, Any]

    def __new__(cls, *arguments: Any, **options: Any) -> "Self":
        """The arguments are those of `__init__`."""
        copied_object = super().__new__(cls)
        copied_object._arguments = arguments
        copied_object._options = options
        return copied_object

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(type(self), **self._options), self._arguments, self.state()

    def state(self) -> GrainsState:
        """What a copy takes over."""
        raise NotImplementedError


class GrainsBatch(Copied):
    """Many bodies, each in a bed of its own, as in a simulator's parallel environments.

    `tool`: the bodies' shape, in the body frame (`load_tool`), or a sequence of one tool for each of the `bodies`.
    `law`: of the grains (`Treers2021`, `Agarwal2023`), with its inertia and its memory. `strength`: factor of the law's
    stresses, and `surface_height` (0) [m]: one number, or one for each body. `ground`: a map of the ground's height, in
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
        surface_height: ArrayLike | None = None,
        ground: HeightMap | None = None,
        threads: int = 1,
    ) -> None:
        n = whole_number("bodies", bodies, most=MOST)
        workers = whole_number("threads", threads, most=MOST)
        self.tools = [tool] * n if isinstance(tool, Tool) else list(tool)
        for shape in self.tools:
            if not isinstance(shape, Tool):
                raise TypeError(
                    f"tool is a {type(shape).__name__}; load one with rft_ros.tool.load_tool"
                )
        if len(self.tools) != n:
            raise ValueError(f"tool has {len(self.tools)} tools; there are {n} bodies")
        if not isinstance(ground, HeightMap | None):
            raise TypeError(
                f"ground is a {type(ground).__name__}; read one with rft_ros.ground.read_height_map"
            )
        self.beds = make_beds([shape.plates for shape in self.tools], law)
        self._law = law
        self._strengths = np.ones(n)
        self._ground = None if ground is None else ground.filled()
        self._supports = {shape: Support(shape.corners) for shape in set(self.tools)}
        self._surfaces = np.zeros(n, LAST_SURFACE)
        self._fingerprints = {
            "tools": np.array([_fingerprint(*shape.plates.packed) for shape in self.tools]),
            "law": np.array([_fingerprint(*packed_law(law))]),
        }
        self.failures = 0
        """Number of steps of a body that did not converge, and of calls in which one moved over 20 mm in grains."""
        # Each thread takes the next part of the bodies when it has finished one.
        size = n if workers == 1 else -(-n // (2 * workers))
        self._parts = [slice(k, k + size) for k in range(0, n, size)]
        self._pool = ThreadPoolExecutor(workers)
        self._begin_step: Any = machine_code(begin_step, (self.beds, 0, np.zeros((n, 13)), 0.1))
        self.reset(strength=strength, surface_height=surface_height)

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
        n = len(self.tools)
        checked_rows = checked_states(states)
        if len(checked_rows) != n:
            raise ValueError(f"states has {len(checked_rows)} rows; there are {n} bodies")
        duration = number("dt", dt, positive=True)
        if inverse_inertia is None and free_acceleration is None:
            self.begin_step(checked_rows, duration)
            self.beds.motions["wrench"] = self.beds.motions["explicit"]
            return self.wrench
        if inverse_inertia is None or free_acceleration is None:
            raise ValueError(
                "inverse_inertia or free_acceleration is missing; the implicit step needs both"
            )
        inverse = _each("inverse_inertia", inverse_inertia, (n, 6, 6))
        free = _each("free_acceleration", free_acceleration, (n, 6))
        wrong = find_indefinite(inverse)
        if wrong >= 0:
            raise ValueError(
                f"inverse_inertia of body {wrong} is not positive semidefinite, as with a negative mass or inertia; "
                "make it with free_body, or as J M^-1 J^T"
            )
        _refuse_without_bound(duration, checked_rows[:, 7:], free, inverse)
        self.begin_step(checked_rows, duration)
        hold = self._hold
        results = self._in_parts(
            lambda part: hold(self.beds, part.start, inverse[part], free[part], duration)
        )
        failures, paths = zip(*results, strict=True)
        self.count_failures(sum(failures), dt=duration, path=max(paths))
        return self.wrench

    @cached_property
    def _hold(self) -> Any:
        """Compiled for the first implicit step."""
        return machine_code(hold_each, (self.beds, 0, np.zeros((1, 6, 6)), np.zeros((1, 6)), 0.1))

    def begin_step(self, states: Array, dt: float) -> NDArray[np.int64]:
        """Bring the bodies and their memory to checked states, at which a step of `dt` begins.

        Returns the indices of the bodies that may reach the grains in this step.
        """
        if self._ground is not None:
            self._find_surfaces(states, self._ground)
        self._in_parts(lambda part: self._begin_step(self.beds, part.start, states[part], dt))
        return np.flatnonzero(self.beds.motions["is_near"])

    def hold(self, bodies: NDArray[np.int64], wrenches: Array) -> None:
        """Hold these wrenches over the step that began, shape [len(bodies), 6], and none on the other bodies."""
        self.beds.motions["wrench"] = 0.0
        self.beds.motions["wrench"][bodies] = wrenches

    def _in_parts(self, work: Callable[[slice], Any]) -> list[Any]:
        """What `work` returns of each part of the bodies."""
        if len(self._parts) == 1:
            return [work(self._parts[0])]
        return list(self._pool.map(work, self._parts))

    def _find_surfaces(self, states: Array, ground: HeightMap) -> None:
        for k, (tool, state) in enumerate(zip(self.tools, states, strict=True)):
            level = ground.nearest(state[0], state[1])
            last_surface = self._surfaces[k : k + 1]
            surface = self._supports[tool].local_surface(
                ground, state, default_height=level, last=last_surface
            )
            motion = self.beds.motions[k]
            motion["height"] = surface.height
            motion["slope_x"], motion["slope_y"] = surface.slope

    def surface_heights(self, states: Array) -> Array:
        """The height of the beds' undisturbed surface below each body's origin [m], shape [n]."""
        if self._ground is None:
            return np.array(self.beds.motions["height"])
        return np.array([self._ground.nearest(state[0], state[1]) for state in states])

    def count_failures(self, times: int, *, dt: float, path: float) -> None:
        """Count the steps that did not converge, or in which a body moved too far [m]. Logs the first of them."""
        why = "does not converge"
        if path > MAX_PATH_M:
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
        return np.array(self.beds.motions["wrench"])

    @property
    def energy(self) -> Array:
        """Energy that the grains have taken from each body since the last reset [J], shape [n]."""
        return np.array(self.beds.motions["energy"])

    @property
    def stiffness(self) -> Array:
        """Stiffness B at the last step, shape [n, 6, 6]: a small displacement d of a body changes its wrench by -B d.

        d: displacement and rotation vector of the body frame, world axes; units of B: N/m, N and N m.
        """
        return stiffness_matrices(self.beds)

    def tractions(self, body: int = 0) -> Array:
        """Force per area on each plate of a body at the last step [Pa], shape [plates, 3], world axes.

        In the order of `Tool.plates`, whose `rows` give the plates' places and areas, to draw them.
        """
        indices = self._indices(body)
        if len(indices) != 1:
            raise ValueError(f"body is {body!r}; give the index of one body")
        k = int(indices[0])
        plates = self.tools[k].plates
        forces = np.zeros((plates.bounds.shape[1] * BLOCK, 3))
        add_forces_on_plates(self.beds, k, forces)
        ordered_forces = np.empty((len(plates), 3))
        ordered_forces[plates.order] = forces[: len(plates)]
        area = plates.areas[:, None]
        return np.divide(ordered_forces, area, out=np.zeros_like(ordered_forces), where=area > 0.0)

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
        if surface_height is not None and self._ground is not None:
            raise ValueError(
                "surface_height is of level beds, and these have the heights of ground; leave it out"
            )
        indices = self._indices(bodies)
        form = (len(indices),)
        factors = None if strength is None else _each("strength", strength, form, positive=True)
        if surface_height is None:
            surface_height = self.beds.motions["height"][indices]
        heights = _each("surface_height", surface_height, form)
        for array in (*self.beds.memories, self.beds.motions, self._surfaces):
            array[indices] = np.zeros((), array.dtype)
        self.beds.motions["height"][indices] = heights
        if factors is not None:
            self._set_strengths(indices, factors)

    def _set_strengths(self, indices: NDArray[np.int64], factors: Array) -> None:
        """Give the grains around these bodies new strengths."""
        self._strengths[indices] = factors
        for k, factor in zip(indices.tolist(), factors.tolist(), strict=True):
            set_law(self.beds, k, replace(self._law, zeta=self._law.zeta * factor))

    def _indices(self, bodies: ArrayLike | None) -> NDArray[np.int64]:
        all_indices = np.arange(len(self.tools))
        wanted_indices = all_indices if bodies is None else np.asarray(bodies)
        try:
            return np.atleast_1d(all_indices[wanted_indices if wanted_indices.size else []])
        except IndexError:
            raise ValueError(
                f"bodies is {bodies!r}; give indices of the {len(all_indices)} bodies, 0 to {len(all_indices) - 1}"
            ) from None

    def _arrays(self) -> GrainsState:
        """What a state has: what changes in time, and what says whose state it is."""
        memories = self.beds.memories
        return {
            **self._fingerprints,
            "strength": self._strengths,
            "motion": self.beds.motions,
            "memory": memories.blocks,
            "stiffness": memories.stiffness,
            "last": memories.last,
            "surfaces": self._surfaces,
        }

    def state(self) -> GrainsState:
        """A copy of the state of the grains, which can be pickled."""
        return copied(self._arrays())

    def restore(self, state: GrainsState) -> None:
        """Go back to a state of these grains, or of others of the same tools, law, ground and number of bodies."""
        arrays = self._arrays()
        check_state(state, arrays)
        for name, fingerprint in self._fingerprints.items():
            if not np.array_equal(state[name], fingerprint):
                what = "another law" if name == "law" else "other tools"
                raise ValueError(
                    f"state is of grains with {what}; restore what state() of grains like these returned"
                )
        if not (state["strength"] > 0.0).all():
            raise ValueError(
                f"state has the strength {state['strength'].min():g}; restore what state() returned"
            )
        changed_bodies = np.flatnonzero(state["strength"] != self._strengths)
        self._set_strengths(changed_bodies, state["strength"][changed_bodies])
        for name in arrays.keys() - self._fingerprints.keys():
            np.copyto(arrays[name], state[name])

    __setstate__ = restore  # of a copy


def copied(arrays: GrainsState) -> GrainsState:
    """Arrays that change without the given ones."""
    return {name: array.copy() for name, array in arrays.items()}


def check_state(state: object, arrays: GrainsState) -> None:
    """Refuse what is not a state of the same arrays, or not finite."""
    if not isinstance(state, dict) or _forms(state) != _forms(arrays):
        raise ValueError(
            "state is of other bodies; restore what state() of grains like these returned"
        )
    for name, array in state.items():
        names = array.dtype.names
        fields = [array[field] for field in names] if names else [array]
        if not all(np.isfinite(field).all() for field in fields):
            raise ValueError(
                f"state has values in '{name}' that are not finite; restore what state() returned"
            )


def _forms(state: GrainsState) -> dict[str, object]:
    return {name: (np.shape(array), np.asarray(array).dtype) for name, array in state.items()}


def _fingerprint(*parts: Any) -> np.uint64:
    """A number that differs for other arrays and numbers."""
    content = b"".join(np.asarray(part).tobytes() for part in parts)
    return np.uint64(int.from_bytes(sha256(content).digest()[:8], "little"))


def _each(name: str, values: ArrayLike, form: tuple[int, ...], *, positive: bool = False) -> Array:
    """Values for each body, shape `form`; without the first axis the same for all."""
    given_array = np.asarray(values)
    if given_array.dtype.kind not in "fiu" or given_array.shape not in (form, form[1:]):
        row_shape = list(form[1:]) or "one number"
        raise ValueError(
            f"{name} has shape {list(given_array.shape)} of type {given_array.dtype}; it must be {list(form)} or "
            f"{row_shape}"
        )
    array = np.array(np.broadcast_to(given_array, form), dtype=np.float64, order="C")
    bad = ~np.isfinite(array) | (positive & (array <= 0.0))
    if bad.any():
        raise ValueError(
            f"{name} has the value {array[bad][0]:g}; it must be {'positive' if positive else 'finite'}"
        )
    return array


def _refuse_without_bound(dt: float, twists: Array, free: Array, inverse: Array) -> None:
    """Refuse steps whose results would overflow."""
    displacements = {
        "twist": dt * twists,
        "free_acceleration": dt * dt * free,
        "inverse_inertia": inverse,
    }
    for name, values in displacements.items():
        size = np.abs(values).max()
        if not size < MAX_DISPLACEMENT_M:
            raise ValueError(
                f"{name} moves a body by {size:g} m in dt, {dt:g} s; it must be less than {MAX_DISPLACEMENT_M:g} m"
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
        parts = ("position", position, 3), ("quaternion", quaternion, 4), ("twist", twist, 6)
        state = np.concatenate([numbers(name, values, rows=n) for name, values, n in parts])
        wrenches = self._one.step(
            state, dt, inverse_inertia=inverse_inertia, free_acceleration=free_acceleration
        )
        return np.asarray(wrenches[0])

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
    body_quaternion = unit_quaternion(*finite_numbers("quaternion", quaternion, rows=4).tolist())
    if body_quaternion is None:
        raise ValueError(f"quaternion is {quaternion!r}; its norm must be 1")
    axes = rotation_matrix(body_quaternion)
    body_inertia = finite_numbers("inertia", inertia, (3,), rows=3)
    moments = np.linalg.eigvalsh(body_inertia)
    if not (
        moments[0] > 0.0 and np.allclose(body_inertia, body_inertia.T, atol=1e-6 * moments[2])
    ):
        raise ValueError(
            f"inertia is {body_inertia.tolist()}; it must be symmetric with positive principal moments"
        )
    turns = np.linalg.inv(axes @ body_inertia @ axes.T)
    x, y, z = axes @ finite_numbers("center", center, rows=3)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    moves = np.eye(3) / number("mass", mass, positive=True) - cross @ turns @ cross
    return np.block([[moves, cross @ turns], [-turns @ cross, turns]])
