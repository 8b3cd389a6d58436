"""Grains around bodies of a MuJoCo model, which hold the wrenches of the implicit step of `coupling` over its steps."""

import logging
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.ground import HeightMap
from rft_ros.rft import MEDIA, Law, alpha_y_model, treers2021
from rft_ros.rft.arguments import number
from rft_ros.rft.kernel.compilation import compiled, machine_code
from rft_ros.simulation.coupling import hold
from rft_ros.simulation.grains import GrainsBatch, GrainsState, each_flag
from rft_ros.simulation.mechanism import Mechanism, import_mujoco
from rft_ros.simulation.shapes import check_size, tool_of_body
from rft_ros.tool import load_tool

__all__ = ["MujocoGrains"]

Array = NDArray[np.float64]
_Path = str | PathLike[str]

_LENGTH = 0.003  # m

_ROUNDS, _SETTLED = 12, 1e-3
"""The grains and MuJoCo's constraints are solved in turn: for at most `_ROUNDS` rounds, or until the wrench changes by
a smaller share than `_SETTLED`."""

_HELD = 0.1
"""A body is held if the other forces take up a larger share of the grains' elastic energy."""

_LOADED, _RELEASED = 0.05, 0.02
"""Force of actuators and of the user's on a body that may hold it, and its decrease in a step, over the grains' push.
"""

_LONGEST_RK4 = 0.002  # s; in longer steps of RK4 bodies may not come to rest

_LEAST, _TINY = 0.05, 1e-290  # share of the change that a round takes; avoids 0 / 0

_log = logging.getLogger("rft_ros.simulation")


class MujocoGrains:
    """Grains around bodies of a MuJoCo model.

    `body`: its name; or `bodies`: names of several, whose step is solved in common. Their shapes: the bodies' geoms
    (meshes, boxes, spheres, capsules, cylinders, ellipsoids; those that collide, if any do), or `mesh`, a file as for
    `load_tool`, in the body frame, with `scale` in metres per unit; for several bodies, a file, or None, for each.
    Reduced to fewer plates within `tolerance` of the force (0: not reduced). The grains: `zeta`, `alpha_y` (a model's
    name) of the generic medium and `mobilization_length` [m] (3 mm), or a `law` of your own; `surface_height` [m], or
    `ground`, as for `GrainsBatch`. `held`: True, or a sequence with True for each body that a controller of your own
    holds, whose stiffness MuJoCo does not know; see `limited`. One object serves one `MjData`. It starts anew when the
    data's time goes back, as after `mj_resetData`; call `reset` after other jumps. Raises ValueError or TypeError.
    """

    def __init__(
        self,
        model: Any,
        *,
        body: str | None = None,
        bodies: Sequence[str] | None = None,
        zeta: float = 1.0,
        alpha_y: str = "linear",
        mobilization_length: float | None = None,
        law: Law | None = None,
        surface_height: float = 0.0,
        ground: HeightMap | None = None,
        mesh: _Path | Sequence[_Path | None] | None = None,
        scale: float = 0.001,
        tolerance: float = 0.025,
        held: bool | Sequence[bool] = False,
    ) -> None:
        self._given = partial(
            MujocoGrains, body=body, bodies=bodies, zeta=zeta, alpha_y=alpha_y, mobilization_length=mobilization_length,
            law=law, surface_height=surface_height, ground=ground, mesh=mesh, scale=scale, tolerance=tolerance,
            held=held,
        )  # fmt: skip
        mujoco = import_mujoco()
        if not isinstance(model, mujoco.MjModel):
            raise TypeError(f"model is a {type(model).__name__}; load one with mujoco.MjModel.from_xml_path")
        if (bodies is None) == (body is None):
            raise InputError("give the body's name as body=, or several names as bodies=")
        names = [body] if bodies is None else [bodies] if isinstance(bodies, str) else list(bodies)
        self._ids = [_body_id(mujoco, model, name) for name in names]
        if not names or len(set(self._ids)) < len(names):
            raise InputError(f"bodies is {names}; name at least one body, and each of them once")
        if alpha_y == "table":
            raise InputError("alpha_y is 'table', which has no file here; give law=treers2021(medium, table)")
        if law is None:
            medium = MEDIA["generic"]
            law = treers2021(medium, alpha_y_model(alpha_y, medium), zeta=zeta, mobilization_length=_LENGTH)
        if mobilization_length is not None:
            length = number("mobilization_length", mobilization_length, positive=True)
            law = replace(law, mobilization_length=length)
        files = [mesh] * len(names) if mesh is None or isinstance(mesh, str | PathLike) else list(mesh)
        if len(files) != len(names):
            raise InputError(f"mesh has {len(files)} files; there are {len(names)} bodies")
        tools = []
        for k, file in zip(self._ids, files, strict=True):
            made = (
                tool_of_body(model, k, tolerance) if file is None else load_tool(file, scale=scale, tolerance=tolerance)
            )
            check_size(made, model, k, law.mobilization_length)
            tools.append(made)
        self.tools, self.tool = tools, tools[0]
        """The bodies' shapes, and that of the first."""
        self._grains = GrainsBatch(tools, law, bodies=len(tools), surface_height=surface_height, ground=ground)
        self._option, self._single, self._time = model.opt, bodies is None, -math.inf
        self._model, self._mechanism = model, Mechanism(model, self._ids)
        self._held = each_flag("held", held, len(tools))
        n = len(tools)
        self._wrench, self._before, self._after = np.zeros((3, 6 * n))
        self._own, self._written = np.zeros((2, n, 6))  # forces of the user's, and those with the grains'
        self._earlier: tuple[Array, Array] | None = None
        self._told = False  # that the steps are long for RK4
        self._bind(mujoco.MjData(model))
        self._hold: Any = machine_code(hold, self._arguments(0.1))
        self._add: Any = machine_code(_add, self._forces)

    def __reduce__(self) -> tuple[Any, ...]:
        # neither machine code nor views of the data's arrays can be copied or pickled
        return self._given, (self._model,), self.state()

    def _bind(self, data: Any) -> None:
        """Take the arrays of `data`, which stay where they are."""
        self._mechanism.bind(data)
        self._forces = (
            self._wrench,
            np.array(self._ids),
            data.xpos,
            data.xipos,
            self._own,
            self._written,
            data.xfrc_applied,
        )

    def _arguments(self, h: float) -> tuple[Any, ...]:
        m, g = self._mechanism, self._grains
        return g.beds, 0, g.coupled, m.states, g.rows, m.inverse, m.ahead, h, self._wrench, self._after

    def apply(self, data: Any) -> Array:
        """Add the wrenches of the grains for the next step to ``data.xfrc_applied``; returns `wrench`.

        Call it before each `mj_step`, with any integrator. Forces of your own on the bodies act beside it; set them
        there with ``=``. Raises ValueError for data that is not finite, or that moves without bound.
        """
        mechanism, wrench = self._mechanism, self._wrench
        if data is not mechanism.data:
            self._bind(data)
        h = number("model.opt.timestep", self._option.timestep, positive=True)
        if h > _LONGEST_RK4 and mechanism.holds_over_stages and not self._told:
            self._told = True
            _log.warning("RK4 in steps of %g s: bodies in grains may not lie still; take 0.002 s or Euler", h)
        if data.time < self._time:
            self.reset()
        self._time = data.time
        if self._earlier is not None and (data.xfrc_applied[self._ids] == self._earlier[1]).all():
            self._own[:], self._written[:] = self._earlier
        self._earlier = None
        mechanism.move()
        wrench[:] = self._grains.last.ravel()
        self._add(*self._forces)
        mechanism.accelerate()
        if not mechanism.measure(wrench, h):
            raise self._without_bound(data)
        self._grains.advance(mechanism.states, h)
        self._grains.coupled["held"] = self._held
        share, last = 1.0, None
        for _ in range(_ROUNDS):
            self._before[:] = wrench
            found, path, limited = self._hold(*self._arguments(h))
            if limited and self._find_held():
                found, path, limited = self._hold(*self._arguments(h))
            settled = not data.nefc
            if not settled:
                change = wrench - self._before
                settled = _size(change) <= _SETTLED * _size(wrench)
                if last is not None and not settled:  # Aitken's relaxation, for constraints that act by turns
                    turn = change - last
                    share = min(max(-share * float(last @ turn) / max(float(turn @ turn), _TINY), _LEAST), 1.0)
                    wrench[:] = self._before + share * change
                last = change
            self._add(*self._forces)
            if settled:
                break
            mechanism.accelerate()
            if not mechanism.measure(wrench, h):
                raise self._without_bound(data)
        self._grains.last[:] = wrench.reshape(-1, 6)
        self._grains.failed(0 if found and settled else 1, dt=h, path=path)
        if limited:
            self._tell_limits()
        return self.wrench

    def _limited_pushes(self) -> Iterator[tuple[int, Array]]:
        """Each body whose push-back is limited, and the grains' own wrench on it at the beginning of the step."""
        for b in np.flatnonzero(self._grains.coupled["limited"]).tolist():
            yield b, self._grains.rows[b, :6]

    def _find_held(self) -> bool:
        """Mark the bodies with a limit that something holds; returns whether there are any."""
        stiffness, found = self._grains.stiffness, False
        for b, push in self._limited_pushes():
            if self._mechanism.share_held(b, push, stiffness[b]) > _HELD:
                self._grains.coupled["held"][b] = found = True
        return found

    def _tell_limits(self) -> None:
        """Count the bodies whose push-back is limited while forces that may hold them decrease. Logs the first."""
        for b, push in self._limited_pushes():
            body = self._grains.coupled[b]
            load, decrease = self._mechanism.loaded(b, push, self._before, body["free"] - body["last_free"])
            if load > _LOADED and decrease > _RELEASED:
                if not self.limited:
                    _log.warning(
                        "body '%s' is pushed back more slowly than by the memory, at %g s, as nothing in the model "
                        "holds it; if a controller of your own does, pass held=True to MujocoGrains",
                        self._model.body(self._ids[b]).name,
                        self._time,
                    )
                self._grains.limited += 1

    def _without_bound(self, data: Any) -> ValueError:
        """Take the grains' wrench away; the error that says why."""
        data.xfrc_applied[self._ids] = self._own
        h, speed = self._option.timestep, float(np.abs(data.qvel).max(initial=0.0))
        where = f"at {data.time:g} s, in steps of {h:g} s, with speeds to {speed:g} in qvel"
        return ValueError(
            f"the bodies' motion or acceleration is not finite, or without bound, {where}; reset the data"
        )

    @property
    def wrench(self) -> Array:
        """Held over the current step: force [N], torque about the body frame's origin [N m], world axes.

        Shape [6] with `body`, [n, 6] with `bodies`, as `stiffness` [6, 6] or [n, 6, 6], and `energy`.
        """
        return np.asarray(self._one_or_all(self._grains.wrench))

    @property
    def stiffness(self) -> Array:
        """`GrainsBatch.stiffness` at the begin of the current step."""
        return np.asarray(self._one_or_all(self._grains.stiffness))

    @property
    def energy(self) -> Any:
        """Energy that the grains have taken from the bodies since the last reset [J]: a float or shape [n]."""
        return self._one_or_all(self._grains.energy)

    def _one_or_all(self, of_bodies: Array) -> Any:
        return of_bodies[0] if self._single else of_bodies

    def tractions(self, body: str | int = 0) -> Array:
        """`GrainsBatch.tractions` of a body, by its name or its place in `bodies`, at the begin of the current step."""
        if isinstance(body, str):
            k = _body_id(import_mujoco(), self._mechanism.model, body)
            if k not in self._ids:
                raise InputError(f"body '{body}' has no grains; name one of those given to MujocoGrains")
            return self._grains.tractions(self._ids.index(k))
        return self._grains.tractions(body)

    @property
    def failures(self) -> int:
        """Steps that did not converge; the first is logged."""
        return self._grains.failures

    @property
    def limited(self) -> int:
        """Steps in which the grains push a body back more slowly than by the memory, though something may hold it.

        The grains limit the push-back of bodies that nothing holds, so that none is thrown. They know the servos and
        constraints of the model, but not the stiffness of forces of your own (`qfrc_applied`, `xfrc_applied`, `ctrl` of
        motors). This counts the steps in which such forces decrease on a body whose push-back is limited; the first is
        logged.
        """
        return self._grains.limited

    def reset(self) -> None:
        """Start with level beds, without hysteresis."""
        self._grains.reset()

    def state(self) -> GrainsState:
        """A copy of the state of the grains, which can be pickled. For rollouts, beside `mj_getState`."""
        return {**self._grains.state(), "own": self._own.copy(), "written": self._written.copy()}

    def restore(self, state: GrainsState) -> None:
        """Go back to what `state` returned."""
        forces = [] if not isinstance(state, dict) else [np.shape(state.get(name, ())) for name in ("own", "written")]
        if forces != [self._own.shape] * 2:
            raise ValueError("state is of other grains; restore what state() of grains like these returned")
        self._grains.restore({name: array for name, array in state.items() if name not in ("own", "written")})
        # xfrc_applied is restored with the data, or it is as it is now
        self._earlier, self._time = (state["own"].copy(), state["written"].copy()), -math.inf

    __setstate__ = restore  # of a copy


def _body_id(mujoco: Any, model: Any, name: object) -> int:
    # MuJoCo reads address 0 for a name that is None
    found = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)) if isinstance(name, str) else 0
    if found < 1:
        names = ", ".join(model.body(k).name for k in range(1, model.nbody))
        raise InputError(f"body '{name}' is not in the model; it has {names}")
    if not model.body_dofnum[model.body_weldid[found]]:
        raise InputError(f"body '{name}' has no joint, so MuJoCo gives it no velocity; give it one")
    return found


def _size(wrench: Array) -> float:
    return float(np.abs(wrench).max())


@compiled
def _add(wrench, ids, origins, centers, own, written, applied):
    """Apply wrenches about the bodies' origins, beside the user's own forces, about the centres of mass.

    `written`: what was applied last; what has been set since is the user's.
    """
    for b in range(len(ids)):
        i = ids[b]
        for k in range(6):
            if applied[i, k] != written[b, k]:
                own[b, k] = applied[i, k]
        fx, fy, fz = wrench[6 * b], wrench[6 * b + 1], wrench[6 * b + 2]
        x, y, z = centers[i] - origins[i]
        written[b, 0], written[b, 1], written[b, 2] = fx, fy, fz
        written[b, 3] = wrench[6 * b + 3] - (y * fz - z * fy)
        written[b, 4] = wrench[6 * b + 4] - (z * fx - x * fz)
        written[b, 5] = wrench[6 * b + 5] - (x * fy - y * fx)
        written[b] += own[b]
        applied[i] = written[b]
