"""Grains for a body of a MuJoCo model: the wrench goes to xfrc_applied, implicit in the body's inertia."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.ground import HeightMap
from rft_ros.rft import Law, alpha_y_model, medium_named, rotation_matrix, treers2021
from rft_ros.rft.compilation import machine_code
from rft_ros.simulation.coupling import held, measure, move, put
from rft_ros.simulation.grains import GrainsBatch, GrainsState
from rft_ros.tool import Tool, load_tool, tool_of_mesh

__all__ = ["MujocoBody", "MujocoGrains", "import_mujoco"]

_STRIDE = 1 / 30
"""Path of the body within a substep over the mobilization length: the depth at which bodies come to rest then depends
on the time step by less than 10 %."""

_MOST = 40  # substeps


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
        self._mujoco, self.model, self.body = import_mujoco(), model, body
        self.option = model.opt
        self._none = self._mujoco.mjtStage.mjSTAGE_NONE
        self._jacobian, self._solved = np.zeros((2, 6, int(model.nv)))
        self._linear, self._angular = self._jacobian[:3], self._jacobian[3:]
        self.state, self.inverse, self.free = np.zeros((1, 13)), np.zeros((6, 6)), np.zeros(6)
        self.twist, self.wrench, self.after = self.state[0, 7:], np.zeros(6), np.zeros(6)
        self._bind(self._mujoco.MjData(model))
        # numba's look-up of machine code by the arguments' types takes 1.7 us
        row, sums = np.zeros(19), np.zeros(10)
        self._measure: Any = machine_code(measure, self._measured)
        step = row, sums, self.inverse, self.twist, self.free, 0.1, 0.1, self.wrench, self.after
        self._held: Any = machine_code(held, step)
        self._put = machine_code(put, (self.wrench, *self._places))

    def _bind(self, data: Any) -> None:
        """Take the arrays of `data`, which stay where they are."""
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
        mujoco.mj_forwardSkip(model, data, self._none, 1)
        mujoco.mj_jacBody(model, data, self._linear, self._angular, self.body)
        mujoco.mj_solveM(model, data, self._solved, self._jacobian)
        if not self._measure(*self._measured):
            raise ValueError("the data has a position, velocity or acceleration that is not finite; reset it")

    def hold(self, row: NDArray[np.float64], sums: NDArray[np.float64], h: float, reach: float) -> float:
        """Let it feel the wrench of `held` over the next h [s]; returns the longest path [m]."""
        step = row, sums, self.inverse, self.twist, self.free, h, reach, self.wrench, self.after
        path: float = self._held(*step)
        self._put(self.wrench, *self._places)
        return path

    def feel(self, wrench: NDArray[np.float64]) -> None:
        """Let it feel this wrench, shape [6]."""
        self.wrench[:] = wrench
        self._put(self.wrench, *self._places)


class MujocoGrains:
    """Grains around one body of a MuJoCo model.

    `body`: its name. Its shape: the body's mesh geoms, or `mesh`, a file as for `load_tool`, in the body frame, with
    `scale` in metres per unit; reduced to fewer plates within `tolerance` of the force (0: not reduced). The grains:
    `medium`, `zeta`, `alpha_y` (a model's name) or a `law` of your own; `mobilization_length` [m]; `surface_height` [m]
    where `ground` knows nothing. `implicit` False: the wrench of `Grains`, which knows no inertia.
    One object serves one `MjData`. It starts anew when the data's time goes back, as after `mj_resetData`; call `reset`
    after other jumps. Raises InputError or ValueError that names the argument that cannot be used.
    """

    def __init__(
        self,
        model: Any,
        *,
        body: str,
        mobilization_length: float,
        zeta: float = 1.0,
        alpha_y: str = "linear",
        medium: str = "generic",
        law: Law | None = None,
        surface_height: float = 0.0,
        ground: HeightMap | None = None,
        mesh: str | None = None,
        scale: float = 0.001,
        tolerance: float = 0.025,
        implicit: bool = True,
    ) -> None:
        mujoco = import_mujoco()
        number = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, body))
        if number < 1:
            names = ", ".join(model.body(k).name for k in range(1, model.nbody))
            raise InputError(f"body '{body}' is not in the model; it has {names}")
        self._body = MujocoBody(model, number)
        if mesh is None:
            self.tool = _tool_of_body(model, number, body, tolerance)
        else:
            self.tool = load_tool(mesh, scale=scale, tolerance=tolerance)
        if law is None:
            found = medium_named(medium)
            law = treers2021(found, alpha_y_model(alpha_y, found), zeta=zeta)
        self._grains, self._ahead = (
            GrainsBatch(
                self.tool,
                law,
                bodies=1,
                mobilization_length=mobilization_length,
                surface_height=surface_height,
                ground=ground,
            )
            for _ in range(2)
        )
        self._implicit, self._surface, self._stride = implicit, float(surface_height), _STRIDE * mobilization_length
        self.wrench = self._body.wrench
        """Held over the current step: force [N], torque about the body frame's origin [N m], shape [6], world axes."""
        self._past = np.zeros(8)  # time; whether the last step had substeps; what of its wrench acts in the next one
        self.reset()

    def apply(self, data: Any) -> NDArray[np.float64]:
        """Write the grains' wrench for the next step to ``data.xfrc_applied[body]``.

        Returns `wrench`, in its units, shape [6].

        Call it before each `mj_step`, with any integrator. It computes the forward dynamics of `data` without the
        grains. Raises ValueError if they are not finite.
        """
        body, now = self._body, data.time
        body.measure(data)
        if now < self._past[0]:
            self.reset()
        self._past[0] = now
        h, reach, lagging = body.option.timestep, self.tool.plates.reach, self._past[1] > 0.0
        if not self._implicit:
            body.feel(self._grains.step(body.state, h)[0])
            return self.wrench
        row = self._grains.advance(body.state, h)[0]
        path = body.hold(row, self._grains.sums[0], h, reach)
        in_air = row[6] == 0.0 and body.state[0, 2] - self._surface > reach + path
        if lagging or (path > self._stride and not in_air):
            self._substeps(row, h, path, lagging)
        return self.wrench

    def _substeps(self, row: NDArray[np.float64], dt: float, path: float, lagging: bool) -> None:
        """The wrench to hold over dt [s] where the body moves far, from substeps.

        There the body's path counts: a step of MuJoCo's moves the body by dt times its twist at the end, which is
        therefore that of the step's middle, and the twist now lags by half a step.
        """
        body, ahead, reach = self._body, self._ahead, self.tool.plates.reach
        late = self._past[2:].copy() if lagging else 0.5 * row[:6]
        lag = 0.5 * dt * body.free + body.inverse @ (dt * late)
        path = max(path, dt * float(np.linalg.norm(lag[:3]) + reach * np.linalg.norm(lag[3:])))
        self._past[1] = path > self._stride
        if path <= self._stride:
            return
        n = min(max(math.ceil(path / self._stride), 2), _MOST)
        h = dt / n
        ahead.restore(self._grains.state())
        state, here, twist, total = body.state.copy(), row.copy(), body.twist + lag, late
        self._past[2:] = 0.0
        for k in range(n):
            held(here, ahead.sums[0], body.inverse, twist, body.free, h, reach, body.wrench, body.after)
            twist = body.after.copy()
            total = total + (n - k - 0.5) / n**2 * body.wrench
            self._past[2:] += (k + 0.5) / n**2 * body.wrench
            move(state[0], twist, h)
            here = ahead.advance(state, h)[0]
        body.feel(total)

    @property
    def stiffness(self) -> NDArray[np.float64]:
        """B of `GrainsBatch.stiffness` at the last step, in its units, shape [6, 6]."""
        return np.asarray(self._grains.stiffness[0])

    def reset(self) -> None:
        """A level bed that remembers nothing."""
        self._grains.reset()
        self._past[:] = 0.0
        self._past[0] = -math.inf

    def state(self) -> GrainsState:
        """A copy of what the grains remember; picklable. For rollouts, beside `mj_getState`."""
        return {**self._grains.state(), "past": self._past.copy()}

    def restore(self, state: GrainsState) -> None:
        """Go back to what `state` returned."""
        self._grains.restore({name: array for name, array in state.items() if name != "past"})
        self._past[:] = state["past"]


def _tool_of_body(model: Any, body: int, name: str, tolerance: float) -> Tool:
    """The body's mesh geoms in the body frame, as one tool."""
    import trimesh

    parts = []
    for geom in range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body]):
        mesh = model.geom_dataid[geom]
        if mesh < 0 or model.geom_type[geom] != import_mujoco().mjtGeom.mjGEOM_MESH:
            continue
        first, faces = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
        vertices = np.array(model.mesh_vert[first : first + model.mesh_vertnum[mesh]], dtype=np.float64)
        placed = vertices @ rotation_matrix(np.roll(model.geom_quat[geom], -1)).T + model.geom_pos[geom]
        parts.append(trimesh.Trimesh(placed, model.mesh_face[faces : faces + model.mesh_facenum[mesh]], process=False))
    if not parts:
        raise InputError(f"body '{name}' has no mesh geoms; give its shape as mesh=FILE")
    return tool_of_mesh(trimesh.util.concatenate(parts), name=name, tolerance=tolerance)
