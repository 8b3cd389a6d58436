"""Grains around bodies of a MuJoCo model: they hold the wrenches of the implicit step over its steps."""

import logging
import math
from collections.abc import Container, Sequence
from dataclasses import replace
from os import PathLike
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.ground import HeightMap
from rft_ros.rft import MEDIA, Law, alpha_y_model, treers2021
from rft_ros.rft.arguments import number
from rft_ros.rft.kernel.compilation import compiled, machine_code
from rft_ros.simulation.grains import (
    Copied,
    GrainsBatch,
    GrainsState,
    check_state,
    copied,
)
from rft_ros.simulation.mechanism import Mechanism, import_mujoco
from rft_ros.simulation.rigid_ground import PlacedBody, find_rigid_ground, sentence_of
from rft_ros.simulation.shapes import check_size, geometry_of, ground_of_field, tool_of_body
from rft_ros.simulation.step import Joints, Trial, new_trial, search
from rft_ros.tool import Tool, load_tool

Array = NDArray[np.float64]
_Path = str | PathLike[str]

DEFAULT_LENGTH_M = 0.003
"""Mobilization length of the default law."""

MAX_RK4_STEP_S = 0.002
"""In longer steps of RK4 bodies may not come to rest."""

ROUNDING_SHARE = 1e-9
"""A force in xfrc_applied that differs by less from what was written there is that force."""

MAX_STEP_RATIO = 1.5
"""Time since the last call over its step: data that moved on by more was stepped without the grains."""

_log = logging.getLogger("rft_ros.simulation")


class _Call(NamedTuple):
    """The last call of `apply`: time of the data, and the step that began there [s]."""

    time: float
    step: float


class MujocoGrains(Copied):
    """Grains around bodies of a MuJoCo model.

    `body`: its name or id; or `bodies`: those of several, whose step is solved in common. Their shapes: the geoms of
    the body and of its jointless children (meshes, boxes, spheres, capsules, cylinders, ellipsoids; those that collide,
    if any do), or `mesh`, a file as for `load_tool`, in the body frame, with `scale` in metres per unit; for several
    bodies, a file, or None, for each.
    Reduced to fewer plates within `tolerance` of the force (0: not reduced). The grains: `zeta` (1) and `alpha_y` (a
    model's name, linear) of the generic medium with 3 mm of memory, or a `law` of your own; `mobilization_length` [m]
    replaces the law's. `surface_height` (0) [m], or `ground`, as for `GrainsBatch`, or the name of a geom of type
    hfield. One object serves one `MjData`. It starts anew when the data's time goes back to 0, as after `mj_resetData`;
    call `reset` or `restore` after other jumps. Shapes are read once. Raises ValueError or TypeError.
    """

    def __init__(
        self,
        model: Any,
        *,
        body: str | int | None = None,
        bodies: str | Sequence[str | int] | None = None,
        zeta: float | None = None,
        alpha_y: str | None = None,
        mobilization_length: float | None = None,
        law: Law | None = None,
        surface_height: float | None = None,
        ground: HeightMap | str | None = None,
        mesh: _Path | Sequence[_Path | None] | None = None,
        scale: float = 0.001,
        tolerance: float = 0.025,
    ) -> None:
        mujoco = import_mujoco()
        if not isinstance(model, mujoco.MjModel):
            raise TypeError(
                f"model is a {type(model).__name__}; load one with mujoco.MjModel.from_xml_path"
            )
        if (bodies is None) == (body is None):
            raise InputError("give the body's name as body=, or several names as bodies=")
        if bodies is None:
            names: list[Any] = [body]
        elif isinstance(bodies, str):
            names = [bodies]
        else:
            names = list(bodies)
        self._ids = [_body_id(model, name) for name in names]
        if not names or len(set(self._ids)) < len(names):
            raise InputError(f"bodies is {names}; name at least one body, and each of them once")
        if law is None:
            medium = MEDIA["generic"]
            law = treers2021(
                medium,
                alpha_y_model("linear" if alpha_y is None else alpha_y, medium),
                zeta=1.0 if zeta is None else zeta,
                mobilization_length=DEFAULT_LENGTH_M,
            )
        elif zeta is not None or alpha_y is not None:
            raise InputError("law has its own zeta and alpha_y; give law=, or zeta= and alpha_y=")
        if mobilization_length is not None:
            length = number("mobilization_length", mobilization_length, positive=True)
            law = replace(law, mobilization_length=length)
        files = (
            [mesh] * len(names) if mesh is None or isinstance(mesh, str | PathLike) else list(mesh)
        )
        if len(files) != len(names):
            raise InputError(f"mesh has {len(files)} files; there are {len(names)} bodies")
        self.tools: list[Tool] = []
        """The bodies' shapes."""
        for k, file in zip(self._ids, files, strict=True):
            if file is None:
                tool = tool_of_body(model, k, tolerance, frozenset(self._ids))
            else:
                tool = load_tool(file, scale=scale, tolerance=tolerance)
            check_size(tool, model, k, law.mobilization_length)
            self.tools.append(tool)
        self.tool = self.tools[0]
        """The shape of the first body."""
        self._ground_geom: int | None = None
        if isinstance(ground, str):
            name = ground
            ground = ground_of_field(model, name, self.tools)
            self._ground_geom = int(model.geom(name).id)
        self._is_level = ground is None
        self._grains = GrainsBatch(
            self.tools, law, bodies=len(names), surface_height=surface_height, ground=ground
        )
        self._model = model
        self._single = bodies is None
        self._of_geoms = [k for k, file in zip(self._ids, files, strict=True) if file is None]
        self._geometry = geometry_of(model, self._of_geoms)
        self._mechanism = Mechanism(model, self._ids)
        self._last: _Call | None = None
        self._applied: GrainsState = {
            "user_wrenches": np.zeros((len(names), 6)),
            "written_wrenches": np.zeros((len(names), 6)),  # those with the grains'
        }
        self._is_rk4_logged = False  # that the steps are long for RK4
        self._is_ground_checked = False
        joints = self._mechanism.joints(np.zeros(1, np.int64), 0.1)
        constraints = self._mechanism.unconstrained
        trial = new_trial(1, len(joints.force))
        self._search: Any = machine_code(
            search, (self._grains.beds, joints, constraints, 0.1, trial)
        )
        self._take_away: Any = machine_code(_take_away, self._forces())
        self._write: Any = machine_code(_write, self._wrenches())

    def _forces(self) -> tuple[Any, ...]:
        """What `_take_away` takes."""
        mechanism = self._mechanism
        return mechanism.ids, *self._applied.values(), mechanism.data.xfrc_applied

    def _wrenches(self) -> tuple[Any, ...]:
        """What `_write` takes."""
        data = self._mechanism.data
        return *self._forces(), self._grains.wrench, data.xpos, data.xipos

    def apply(self, data: Any) -> Array:
        """Add the wrenches of the grains for the next step to ``data.xfrc_applied``; returns `wrench`.

        Call it before each `mj_step`, with any integrator. Forces of your own on the bodies act beside it; set them
        there with ``=``. Raises ValueError for data that is not finite or that moves without bound, and InputError for
        data that was stepped without the grains or set back, and for shapes that have changed.
        """
        mechanism = self._mechanism
        grains = self._grains
        h = self._step_of(data)
        self._take_away(*self._forces())
        if not mechanism.move():
            raise self._without_bound(data, h)
        if not self._is_ground_checked:
            self._check_ground(data)
        bodies = grains.begin_step(mechanism.states, h)
        wrenches = np.zeros((0, 6))
        if len(bodies):
            trial = self._search_for(mechanism.joints(bodies, h), h)
            wrenches = trial.best
            if not math.isfinite(wrenches.sum()):
                raise self._without_bound(data, h)
            progress = trial.progress[0]
            grains.count_failures(0 if progress["has_ended"] else 1, dt=h, path=progress["path"])
        grains.hold(bodies, wrenches)
        self._write(*self._wrenches())
        self._last = _Call(data.time, h)
        return self.wrench

    def _step_of(self, data: Any) -> float:
        """The step that begins now [s]; starts anew if the time went back, and raises InputError for other jumps."""
        h = number("model.opt.timestep", self._model.opt.timestep, positive=True)
        if h > MAX_RK4_STEP_S and self._mechanism.holds_over_stages and not self._is_rk4_logged:
            self._is_rk4_logged = True
            _log.warning(
                "RK4 in steps of %g s: bodies in grains may not lie still; take 0.002 s or Euler",
                h,
            )
        self._check_course(data)
        if data is not self._mechanism.data:
            self._mechanism.take(data)
        if self._last is None:
            self._check_shapes()
        return h

    def _check_course(self, data: Any) -> None:
        """Start anew if the time is back at 0; raise InputError if `data` does not go on from the last call."""
        last_call = self._last
        if last_call is None:
            return
        if data.time < last_call.time:
            if data.time > 0.0:
                raise InputError(
                    f"the data's time went back from {last_call.time:g} to {data.time:g} s; call restore(state) with "
                    "what state() returned at that time, or reset() for new beds"
                )
            self.reset()
        elif data is not self._mechanism.data:
            raise InputError(
                "this MjData is not that of the last apply, and one MujocoGrains serves one MjData; make one for "
                "each, or call restore(state) or reset() before apply"
            )
        elif data.time > last_call.time + MAX_STEP_RATIO * last_call.step:
            raise InputError(
                f"the data moved on by {(data.time - last_call.time) / last_call.step:.3g} steps since the last apply; "
                "call apply before each mj_step (no nstep= or frame_skip), or reset() or restore(state) after a jump"
            )

    def _check_shapes(self) -> None:
        if not np.array_equal(geometry_of(self._model, self._of_geoms), self._geometry):
            raise InputError(
                "the geoms of a body in grains changed since MujocoGrains read its shape; make a new MujocoGrains"
            )

    def _check_ground(self, data: Any) -> None:
        """Raise InputError if rigid ground holds a body everywhere; log what holds one where it starts."""
        heights = self._grains.surface_heights(self._mechanism.states)
        placed_bodies = [
            PlacedBody(*one) for one in zip(self._ids, self.tools, heights, strict=True)
        ]
        for rigid_ground in find_rigid_ground(
            self._model,
            data,
            placed_bodies,
            ground_geom=self._ground_geom,
            is_level=self._is_level,
        ):
            sentence = sentence_of(self._model, rigid_ground)
            if rigid_ground.is_everywhere:
                raise InputError(sentence)
            _log.warning("%s", sentence)
        self._is_ground_checked = True

    def _search_for(self, joints: Joints, h: float) -> Trial:
        """Solve the step; the trial with which it ended."""
        mechanism = self._mechanism
        trial: Trial = new_trial(len(joints.bodies), len(joints.force))
        trial.acceleration[:] = mechanism.data.qacc_warmstart
        constraints = mechanism.unconstrained
        has_ended = False
        while not has_ended:
            if mechanism.data.nefc:
                constraints = mechanism.constraints(trial.acceleration)
            has_ended = self._search(self._grains.beds, joints, constraints, h, trial)
        return trial

    def _without_bound(self, data: Any, h: float) -> ValueError:
        fastest = np.abs(data.qvel).max(initial=0.0)
        where = f"at {data.time:g} s, in steps of {h:g} s, with speeds to {fastest:g} in qvel"
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

    def _one_or_all(self, values: Array) -> Any:
        return values[0] if self._single else values

    def tractions(self, body: str | int = 0) -> Array:
        """`GrainsBatch.tractions` of a body, by its name or its place in `bodies`, at the begin of the current step."""
        if isinstance(body, str):
            k = _body_id(self._model, body)
            if k not in self._ids:
                raise InputError(
                    f"body '{body}' has no grains; name one of those given to MujocoGrains"
                )
            body = self._ids.index(k)
        return self._grains.tractions(body)

    @property
    def failures(self) -> int:
        """Steps that did not converge, or in which a body moved too far; the first is logged."""
        return self._grains.failures

    def reset(self) -> None:
        """Start with level beds, without hysteresis. Raises InputError if the shape of a body has changed."""
        self._check_shapes()
        self._grains.reset()
        self._last = None

    def state(self) -> GrainsState:
        """A copy of the state of the grains, which can be pickled. For rollouts, beside `mj_getState`."""
        return {**self._grains.state(), **copied(self._applied)}

    def restore(self, state: GrainsState) -> None:
        """Go back to what `state` returned; before or after `mj_setState`."""
        applied_state, grains_state = _split(state, self._applied)
        check_state(applied_state, self._applied)
        self._take_away(*self._forces())  # or the wrenches there would be taken for the user's
        self._grains.restore(grains_state)
        for name, array in self._applied.items():
            np.copyto(array, applied_state[name])
        self._last = None

    __setstate__ = restore  # of a copy


def _split(state: GrainsState, names: Container[str]) -> tuple[GrainsState, GrainsState]:
    """The arrays of a state with these names, and the others; what is no state stays what it is."""
    if not isinstance(state, dict):
        return state, state
    named_arrays = {name: array for name, array in state.items() if name in names}
    return named_arrays, {name: array for name, array in state.items() if name not in names}


def _body_id(model: Any, name_or_id: object) -> int:
    body = 0  # the world, which is none
    if isinstance(name_or_id, str):
        mujoco = import_mujoco()
        body = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name_or_id))
    elif isinstance(name_or_id, int | np.integer) and 0 < name_or_id < model.nbody:
        body = int(name_or_id)
    if body < 1:
        names = ", ".join(model.body(k).name or str(k) for k in range(1, model.nbody))
        raise InputError(f"body '{name_or_id}' is not in the model; it has {names}")
    if not model.body_dofnum[model.body_weldid[body]]:
        raise InputError(
            f"body '{name_or_id}' has no joint, so MuJoCo gives it no velocity; give it one"
        )
    return body


@compiled
def _take_away(ids, user_forces, written_forces, applied_forces):
    """Restore the user's forces: an entry that we wrote gets the user's old value, any other is their new value."""
    for b in range(len(ids)):
        for k in range(6):
            if not abs(applied_forces[ids[b], k] - written_forces[b, k]) <= ROUNDING_SHARE * abs(
                written_forces[b, k]
            ):
                user_forces[b, k] = applied_forces[ids[b], k]
            applied_forces[ids[b], k] = user_forces[b, k]


@compiled
def _write(ids, user_forces, written_forces, applied_forces, wrenches, origins, centers):
    """Apply wrenches about the bodies' origins, beside the user's own forces, about the centres of mass."""
    for b in range(len(ids)):
        i = ids[b]
        x, y, z = centers[i] - origins[i]
        fx, fy, fz = wrenches[b, :3]
        moments = 0.0, 0.0, 0.0, y * fz - z * fy, z * fx - x * fz, x * fy - y * fx
        for k in range(6):
            written_forces[b, k] = user_forces[b, k] + wrenches[b, k] - moments[k]
            applied_forces[i, k] = written_forces[b, k]
