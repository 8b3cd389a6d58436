"""Grains for a body of a MuJoCo model: the wrench goes to xfrc_applied, implicit in the body's inertia."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.ground import HeightMap
from rft_ros.rft import Law, alpha_y_model, medium_named, treers2021
from rft_ros.rft.arguments import number
from rft_ros.rft.compilation import machine_code
from rft_ros.simulation.coupling import held, measure, move, put
from rft_ros.simulation.grains import GrainsBatch, GrainsState
from rft_ros.tool import Tool, load_tool, tool_of_mesh

__all__ = ["MujocoGrains", "import_mujoco"]

_STRIDE = 1 / 30
"""Path of the body within a substep over the mobilization length: the depth at which bodies come to rest then depends
on the time step by less than 10 %."""

_MOST = 40  # substeps


class MujocoGrains:
    """Grains around one body of a MuJoCo model.

    >>> import mujoco
    >>> corners = "0 0 0  0 0 .04  0 .04 0  0 .04 .04  .04 0 0  .04 0 .04  .04 .04 0  .04 .04 .04"
    >>> model = mujoco.MjModel.from_xml_string(f'''<mujoco>
    ...   <asset> <mesh name="cube" vertex="{corners}"/> </asset>
    ...   <worldbody> <body name="tool"> <freejoint/> <geom type="mesh" mesh="cube" mass=".2"/> </body> </worldbody>
    ... </mujoco>''')
    >>> data = mujoco.MjData(model)
    >>> grains = MujocoGrains(model, body="tool", zeta=0.33, mobilization_length=0.003)
    >>> while data.time < 1.0:
    ...     wrench = grains.apply(data)
    ...     mujoco.mj_step(model, data)
    >>> bool(abs(data.qvel).max() < 1e-5)  # it lies still
    True

    `body`: its name. Its shape: the body's mesh geoms, or `mesh`, a file as for `load_tool`, in the body frame, with
    `scale` in metres per unit; reduced to fewer plates within `tolerance` of the force (0: not reduced). The grains:
    `medium`, `zeta`, `alpha_y` (a model's name) or a `law` of your own; `mobilization_length` [m]; `surface_height` [m]
    where `ground` knows nothing. `implicit` False: hold the wrench of the step's begin, as from `Grains`.
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
        self._mujoco = import_mujoco()
        self._model = model
        self._body = int(self._mujoco.mj_name2id(model, self._mujoco.mjtObj.mjOBJ_BODY, body))
        if self._body < 1:
            raise InputError(f"body '{body}' is not in the model; it has {', '.join(_names(model))}")
        if mesh is None:
            self.tool = _tool_of_body(model, self._body, body, tolerance)
        else:
            self.tool = load_tool(mesh, scale=scale, tolerance=tolerance)
        if law is None:
            found = medium_named(medium)
            law = treers2021(found, alpha_y_model(alpha_y, found), zeta=zeta)
        self._options: dict[str, Any] = {
            "mobilization_length": mobilization_length,
            "surface_height": surface_height,
            "ground": ground,
        }
        self._grains = GrainsBatch(self.tool, law, bodies=1, **self._options)
        self._ahead = GrainsBatch(self.tool, law, bodies=1, **self._options)
        self._implicit, self._surface = implicit, self._grains.surface_height
        self._stride = _STRIDE * number("mobilization_length", mobilization_length)
        self._time = -math.inf
        self._late: NDArray[np.float64] | None = None
        nv = int(model.nv)
        self._jacobian, self._solved = np.zeros((6, nv)), np.zeros((6, nv))
        self._linear, self._angular = self._jacobian[:3], self._jacobian[3:]
        self._none = self._mujoco.mjtStage.mjSTAGE_NONE
        self._state, self._inverse, self._free = np.zeros((1, 13)), np.zeros((6, 6)), np.zeros(6)
        self._after = np.zeros(6)
        self.wrench = np.zeros(6)
        """Held over the current step: force [N], torque about the body frame's origin [N m], shape [6], world axes."""
        self._state[0, 6] = 1.0
        self._compile()
        self.reset()

    def _compile(self) -> None:
        """Machine code for the arrays of this object and of any data of the model: numba's dispatch takes 1.7 us."""
        data, b = self._mujoco.MjData(self._model), self._body
        place, row = data.xpos[b], self._grains.advance(self._state, 0.0)[0]
        joints = self._jacobian, self._solved, data.qvel, data.qacc
        self._measure: Any = machine_code(
            measure, (place, data.xquat[b], *joints, self._state[0], self._inverse, self._free)
        )
        twist, sums = self._state[0, 7:], self._grains.sums[0]
        self._held: Any = machine_code(
            held, (row, sums, self._inverse, twist, self._free, 0.1, 0.1, self.wrench, self._after)
        )
        self._put: Any = machine_code(put, (self.wrench, place, data.xipos[b], data.xfrc_applied[b]))

    def apply(self, data: Any) -> NDArray[np.float64]:
        """Write the grains' wrench for the next step to ``data.xfrc_applied[body]``.

        Returns `wrench`, in its units, shape [6].

        Call it before each `mj_step`, with any integrator. It computes the forward dynamics of `data` without the
        grains. Raises ValueError if they are not finite.
        """
        mujoco, model, body = self._mujoco, self._model, self._body
        applied, origin = data.xfrc_applied[body], data.xpos[body]
        applied.fill(0.0)
        mujoco.mj_forwardSkip(model, data, self._none, 1)
        mujoco.mj_jacBody(model, data, self._linear, self._angular, body)
        mujoco.mj_solveM(model, data, self._solved, self._jacobian)
        velocity = self._jacobian, self._solved, data.qvel, data.qacc
        if not self._measure(origin, data.xquat[body], *velocity, self._state[0], self._inverse, self._free):
            raise ValueError("the data has a position, velocity or acceleration that is not finite; reset it")
        now = data.time
        if now < self._time:
            self.reset()
        row = self._grains.advance(self._state, max(now - self._time, 0.0))[0]
        self._time = now
        if self._implicit:
            self._hold(row, model.opt.timestep)
        else:
            self.wrench[:] = row[:6]
        self._put(self.wrench, origin, data.xipos[body], applied)
        return self.wrench

    def _hold(self, row: NDArray[np.float64], dt: float) -> None:
        """The wrench to hold over dt [s], in substeps where the body moves far.

        In substeps the body's path counts: a step of MuJoCo's moves the body by dt times its twist at the end, which
        is therefore that of the step's middle, and the twist now lags by half a step.
        """
        twist, w, reach = self._state[0, 7:], self.wrench, self.tool.plates.reach
        path = self._held(row, self._grains.sums[0], self._inverse, twist, self._free, dt, reach, w, self._after)
        if self._late is None and (
            path <= self._stride or (row[6] == 0.0 and self._state[0, 2] - self._surface > reach + path)
        ):
            return
        late = 0.5 * row[:6] if self._late is None else self._late
        lag = 0.5 * dt * self._free + self._inverse @ (dt * late)
        path = max(path, dt * (np.linalg.norm(lag[:3]) + reach * np.linalg.norm(lag[3:])))
        if path <= self._stride:
            self._late = None
            return
        n = min(max(math.ceil(path / self._stride), 2), _MOST)
        ahead, h = self._ahead, dt / n
        ahead.copy_from(self._grains)
        state, here, twist = self._state.copy(), row.copy(), twist + lag
        total, self._late = late, np.zeros(6)
        for k in range(n):
            held(here, ahead.sums[0], self._inverse, twist, self._free, h, reach, w, self._after)
            twist = self._after.copy()
            total = total + (n - k - 0.5) / n**2 * w
            self._late += (k + 0.5) / n**2 * w
            move(state[0], twist, h)
            here = ahead.advance(state, h)[0]
        w[:] = total

    @property
    def stiffness(self) -> NDArray[np.float64]:
        """B of `GrainsBatch.stiffness` at the last step, in its units, shape [6, 6]."""
        return np.asarray(self._grains.stiffness[0])

    def reset(self) -> None:
        """A level bed that remembers nothing."""
        self._grains.reset()
        self._time, self._late = -math.inf, None

    def state(self) -> tuple[float, GrainsState]:
        """A copy of what the grains remember, and the time; picklable. For rollouts, beside `mj_getState`."""
        return self._time, self._grains.state()

    def restore(self, state: tuple[float, GrainsState]) -> None:
        """Go back to what `state` returned."""
        time, remembered = state
        self._grains.restore(remembered)
        self._time = time


def import_mujoco() -> Any:
    """The module, or InputError with the command that installs it."""
    try:
        import mujoco  # type: ignore[import-untyped]
    except ImportError as error:
        raise InputError(f"rft_ros.simulation needs MuJoCo here ({error}); run pip install mujoco") from None
    return mujoco


def _names(model: Any) -> list[str]:
    return [model.body(k).name for k in range(1, model.nbody)]


def _tool_of_body(model: Any, body: int, name: str, tolerance: float) -> Tool:
    """The body's mesh geoms in the body frame, as one tool."""
    import trimesh

    from rft_ros.rft import rotation_matrix

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
