"""Grains for a body of a MuJoCo model: the wrench goes to xfrc_applied, implicit in the body's inertia."""

import math
from dataclasses import replace
from functools import lru_cache
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.ground import HeightMap
from rft_ros.rft import MEDIA, Law, alpha_y_model, rotation_matrix, treers2021
from rft_ros.rft.arguments import number
from rft_ros.rft.compilation import machine_code
from rft_ros.simulation.coupling import held, measure, move, put
from rft_ros.simulation.grains import GrainsBatch, GrainsState
from rft_ros.tool import Tool, load_tool, tool_of_mesh

__all__ = ["MujocoBody", "MujocoGrains", "import_mujoco"]

_STRIDE = 1 / 30
"""Path of the body within a substep over the mobilization length: the depth at which bodies come to rest then depends
on the time step by less than 10 %."""

_MOST = 40  # substeps

Array = NDArray[np.float64]


def import_mujoco() -> Any:
    """The module, or InputError with the command that installs it."""
    try:
        import mujoco  # type: ignore[import-untyped]
    except ImportError as error:
        raise InputError(f"rft_ros.simulation needs MuJoCo here ({error}); run pip install mujoco") from None
    return mujoco


class MujocoBody:
    """A body of a model: its motion and inertia, and a wrench that it feels.

    `state`: shape [13], columns and units of `rft_ros.rft.STATE`. `inverse`: A of `held`, shape [6, 6]; `free`: its
    acceleration without the wrench, shape [6]; `wrench`: [N], [N m], shape [6], about its origin. All world axes.
    """

    def __init__(self, model: Any, body: int) -> None:
        self._mujoco, self.model, self.body, self.option = import_mujoco(), model, body, model.opt
        self._jacobian, self._solved = np.zeros((2, 6, int(model.nv)))
        self._linear, self._angular = self._jacobian[:3], self._jacobian[3:]
        self.state, self.inverse, self.free = np.zeros((1, 13)), np.zeros((6, 6)), np.zeros(6)
        self.twist, self.wrench, self.after = self.state[0, 7:], np.zeros(6), np.zeros(6)
        self._bind(self._mujoco.MjData(model))
        # numba's look-up of machine code by the arguments' types takes 1.7 us
        row, sums = np.zeros(19), np.zeros(10)
        step = row, sums, self.inverse, self.twist, self.free, 0.1, 0.1, self.wrench, self.after
        self._measure: Any = machine_code(measure, self._measured)
        self._held: Any = machine_code(held, step)
        self._put = machine_code(put, (self.wrench, *self._places))

    def __reduce__(self) -> tuple[Any, ...]:
        return MujocoBody, (self.model, self.body)

    def _bind(self, data: Any) -> None:
        """Take the arrays of `data`, which stay where they are."""
        if not isinstance(data, self._mujoco.MjData) or data.model.signature != self.model.signature:
            raise ValueError("data is not of the model of these grains; make it with mujoco.MjData(model)")
        self._data, b = data, self.body
        self._places = data.xpos[b], data.xipos[b], data.xfrc_applied[b]
        joints = self._jacobian, self._solved, data.qvel, data.qacc
        self._measured = data.xpos[b], data.xquat[b], *joints, self.state[0], self.inverse, self.free

    def measure(self, data: Any) -> None:
        """Take the motion and inertia now. Computes the forward dynamics without the wrench."""
        if data is not self._data:
            self._bind(data)
        self._places[2].fill(0.0)
        mujoco, model = self._mujoco, self.model
        mujoco.mj_forwardSkip(model, data, 0, 1)  # without the sensors
        mujoco.mj_jacBody(model, data, self._linear, self._angular, self.body)
        mujoco.mj_solveM(model, data, self._solved, self._jacobian)
        if not self._measure(*self._measured):
            raise ValueError("the data has a position, velocity or acceleration that is not finite; reset it")

    def hold(self, row: Array, sums: Array, h: float, reach: float) -> float:
        """Let it feel the wrench of `held` over the next h [s]; returns the longest path [m]."""
        path: float = self._held(row, sums, self.inverse, self.twist, self.free, h, reach, self.wrench, self.after)
        self._put(self.wrench, *self._places)
        return path

    def feel(self, wrench: Array) -> None:
        """Let it feel this wrench, shape [6]."""
        self.wrench[:] = wrench
        self._put(self.wrench, *self._places)


class MujocoGrains:
    """Grains around one body of a MuJoCo model.

    `body`: its name. Its shape: the body's mesh geoms, or `mesh`, a file as for `load_tool`, in the body frame, with
    `scale` in metres per unit; reduced to fewer plates within `tolerance` of the force (0: not reduced). The grains:
    `zeta`, `alpha_y` (a model's name) of the generic medium, or a `law` of your own; `mobilization_length` [m];
    `surface_height` [m] where `ground` knows nothing. One object serves one `MjData`. It starts anew when the data's
    time goes back, as after `mj_resetData`; call `reset` after other jumps. Raises ValueError or TypeError.
    """

    def __init__(
        self,
        model: Any,
        *,
        body: str,
        mobilization_length: float,
        zeta: float = 1.0,
        alpha_y: str = "linear",
        law: Law | None = None,
        surface_height: float = 0.0,
        ground: HeightMap | None = None,
        mesh: str | PathLike[str] | None = None,
        scale: float = 0.001,
        tolerance: float = 0.025,
    ) -> None:
        mujoco = import_mujoco()
        if not isinstance(model, mujoco.MjModel):
            raise TypeError(f"model is a {type(model).__name__}; load one with mujoco.MjModel.from_xml_path")
        # MuJoCo reads address 0 for a name that is None
        found = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body)) if isinstance(body, str) else 0
        if found < 1:
            names = ", ".join(model.body(k).name for k in range(1, model.nbody))
            raise InputError(f"body '{body}' is not in the model; it has {names}")
        if not model.body_dofnum[model.body_weldid[found]]:
            raise InputError(f"body '{body}' has no joint, so MuJoCo gives it no velocity; give it one")
        self._body = MujocoBody(model, found)
        if mesh is None:
            self.tool = _tool_of_body(model, found, body, tolerance)
        else:
            self.tool = load_tool(mesh, scale=scale, tolerance=tolerance)
        if alpha_y == "table":
            raise InputError("alpha_y is 'table', which has no file here; give law=treers2021(medium, table)")
        medium = MEDIA["generic"]
        law = treers2021(medium, alpha_y_model(alpha_y, medium), zeta=zeta) if law is None else law
        law = replace(law, mobilization_length=mobilization_length)
        bed: Any = {"surface_height": surface_height, "ground": ground}
        self._grains, self._ahead = (GrainsBatch(self.tool, law, bodies=1, **bed) for _ in range(2))
        heights = np.zeros(0) if ground is None else ground.points()[:, 2]
        self._highest, self._stride = heights.max(initial=surface_height), max(_STRIDE * mobilization_length, 1e-30)
        self._time = -math.inf
        self._late: Array | None = None  # of the wrench of the last step's substeps, what acts in the next step

    @property
    def wrench(self) -> Array:
        """Held over the current step: force [N], torque about the body frame's origin [N m], shape [6], world axes."""
        return self._body.wrench

    def apply(self, data: Any) -> Array:
        """Write the grains' wrench for the next step to ``data.xfrc_applied[body]``; returns `wrench`, shape [6].

        Call it before each `mj_step`, with any integrator. Raises ValueError for data that is not finite.
        """
        body = self._body
        body.measure(data)
        now = data.time
        if now < self._time:
            self.reset()
        self._time = now
        h, reach = number("model.opt.timestep", body.option.timestep, positive=True), self.tool.plates.reach
        row = self._grains.advance(body.state, h)[0]
        path = body.hold(row, self._grains.sums[0], h, reach)
        in_air = row[6] == 0.0 and body.state[0, 2] - self._highest > reach + path
        late, self._late = self._late, None
        if late is not None:  # the twist lags by what acts late, which must not stop the substeps
            lag = h * (0.5 * body.free + body.inverse @ late)
            path = max(path, h * (math.hypot(*lag[:3]) + reach * math.hypot(*lag[3:])))
        if path > self._stride and not in_air:
            self._substeps(row, 0.5 * row[:6] if late is None else late, h, math.ceil(min(path / self._stride, _MOST)))
        return self.wrench

    def _substeps(self, row: Array, late: Array, dt: float, n: int) -> None:
        """The wrench to hold over dt [s] where the body moves far, from n substeps.

        There the body's path counts: a step of MuJoCo's moves the body by dt times its twist at the end, which is
        therefore that of the step's middle. So the twist now lags by half a step, and the latter half of what the
        grains do in this step acts in the next one; `late`: that of the step before.
        """
        body, ahead, h, reach = self._body, self._ahead, dt / n, self.tool.plates.reach
        ahead.restore(self._grains.state())
        state, twist = body.state.copy(), body.twist + dt * (0.5 * body.free + body.inverse @ late)
        wrench, later = late, np.zeros(6)
        for k in range(n):
            held(row, ahead.sums[0], body.inverse, twist, body.free, h, reach, body.wrench, body.after)
            wrench += (n - k - 0.5) / n**2 * body.wrench
            later += (k + 0.5) / n**2 * body.wrench
            twist = body.after.copy()
            move(state[0], twist, h)
            row = ahead.advance(state, h)[0]
        body.feel(wrench)
        self._late = later if later.any() else None

    def reset(self) -> None:
        """A level bed that remembers nothing."""
        self._grains.reset()
        self._late = None

    def state(self) -> GrainsState:
        """A copy of what the grains remember; picklable. For rollouts, beside `mj_getState`."""
        return {**self._grains.state(), "late": np.zeros(6) if self._late is None else self._late.copy()}

    def restore(self, state: GrainsState) -> None:
        """Go back to what `state` returned."""
        if not isinstance(state, dict) or np.shape(state.get("late", ())) != (6,):
            raise ValueError("state is of other grains; restore what state() of grains like these returned")
        self._grains.restore({name: array for name, array in state.items() if name != "late"})
        late = np.array(state["late"], dtype=np.float64)
        self._late, self._time = late if late.any() else None, -math.inf


def _tool_of_body(model: Any, body: int, name: str, tolerance: float) -> Tool:
    """The body's mesh geoms in the body frame, as one tool."""
    triangles = []
    for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
        mesh = model.geom_dataid[geom]
        if mesh < 0 or model.geom_type[geom] != import_mujoco().mjtGeom.mjGEOM_MESH:
            continue
        first, faces = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
        vertices = np.array(model.mesh_vert[first : first + model.mesh_vertnum[mesh]], dtype=np.float64)
        placed = vertices @ rotation_matrix(np.roll(model.geom_quat[geom], -1)).T + model.geom_pos[geom]
        triangles.append(placed[model.mesh_face[faces : faces + model.mesh_facenum[mesh]]])
    if not triangles:
        raise InputError(f"body '{name}' has no mesh geoms; give its shape as mesh=FILE")
    return _tool_of_triangles(np.concatenate(triangles).tobytes(), tolerance)


@lru_cache(maxsize=8)
def _tool_of_triangles(triangles: bytes, tolerance: float) -> Tool:
    """Bodies of one shape share a tool: to reduce it takes up to a second."""
    import trimesh

    corners = np.frombuffer(triangles).reshape(-1, 3)
    mesh = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3))  # which merges the corners
    return tool_of_mesh(mesh, name="body", tolerance=tolerance)
