"""Scenes for bodies in grains beside what else MuJoCo solves: contacts, welds, limits, servos, lifts, slides, gaits.

The tool is a plate of 51 x 51 x 3 mm with 0.3 kg unless said, ζ 0.33, λ 3 mm. Each scene returns numbers by name.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.installation import share_directory
from rft_ros.rft import MEDIA, Law, alpha_y_model, treers2021
from rft_ros.simulation import Grains, MujocoGrains
from rft_ros.simulation.mechanism import import_mujoco

__all__ = [
    "KINDS",
    "Numbers",
    "Scene",
    "block",
    "free_tool",
    "gait",
    "law",
    "lifted",
    "pressed",
    "presses",
    "released",
    "slid",
]

Array = NDArray[np.float64]
Numbers = dict[str, float]

KINDS = "weld", "limit", "friction loss", "joint equality", "servo"
"""What else bears on the tool in `pressed`."""

_NO_CONTACT = 'contype="0" conaffinity="0"'
_PRESS = 99.0  # N
_PUSH = 30.0  # N
_HIPS = (0.2, 0.1), (0.2, -0.1), (-0.2, 0.1), (-0.2, -0.1)  # m


def law(zeta: float = 0.33, length: float = 0.003) -> Law:
    """The grains of these scenes."""
    medium = MEDIA["generic"]
    return treers2021(
        medium, alpha_y_model("linear", medium), zeta=zeta, mobilization_length=length
    )


class Scene:
    """A model with the tool's body ``tool``, its data and grains; `bodies`: of several, with grains in common."""

    def __init__(
        self,
        tree: str,
        step: float,
        integrator: str,
        *,
        more: str = "",
        option: str = "",
        bodies: list[str] | None = None,
    ) -> None:
        self.mujoco, folder = import_mujoco(), share_directory("rft_ros") / "meshes"
        meshes = "".join(
            f'<mesh name="{name}" file="{folder}/{name}.stl" scale="0.001 0.001 0.001"/>'
            for name in ("plate", "ellipsoid", "sphere", "root_tip")
        )
        self.model: Any = self.mujoco.MjModel.from_xml_string(
            f'<mujoco><option timestep="{step}" integrator="{integrator}" {option}/><asset>{meshes}</asset>'
            f"<worldbody>{tree}</worldbody>{more}</mujoco>"
        )
        self.data: Any = self.mujoco.MjData(self.model)
        self.body, self.step = int(self.model.body("tool").id), step
        names: Any = {"body": "tool"} if bodies is None else {"bodies": bodies}
        self.grains = MujocoGrains(self.model, **names, law=law())
        self._memory = Grains(self.grains.tool, law())

    def twist(self) -> Array:
        """Of the tool: linear [m/s] and angular [rad/s], world axes."""
        linear, angular = np.zeros((2, 3, self.model.nv))
        self.mujoco.mj_jacBody(self.model, self.data, linear, angular, self.body)
        return np.concatenate([linear @ self.data.qvel, angular @ self.data.qvel])

    def remembered(self) -> Array:
        """The wrench of the memory at this pose, after those before; call it at each step, before `mj_step`."""
        data, b = self.data, self.body
        return self._memory.step(data.xpos[b], np.roll(data.xquat[b], -1), self.twist(), self.step)

    def lay(self, height: float) -> None:
        """Bring the lowest point of the tool, a free body, to a height [m]."""
        self.mujoco.mj_kinematics(self.model, self.data)
        self.data.qpos[2] = height - self.grains.tool.lowest_point(
            self.data.xmat[self.body].reshape(3, 3)
        )

    def advance(self, *, remember: bool = False) -> float:
        """Take a step; returns the work of the grains on the tool [J]. `remember`: follow the memory alone too."""
        wrench = self.grains.apply(self.data)
        if remember:
            self.memory = self.remembered()
        self.mujoco.mj_step(self.model, self.data)
        return self.step * float(wrench @ self.twist())


def _tool(
    joints: str, *, mesh: str = "plate", mass: float = 0.3, position: str = "0 0 0", more: str = ""
) -> str:
    geom = f'<geom type="mesh" mesh="{mesh}" mass="{mass}" {more or _NO_CONTACT}/>'
    return f'<body name="tool" pos="{position}">{joints}{geom}</body>'


def free_tool(mesh: str, mass: float, *, name: str = "tool", position: str = "0 0 0") -> str:
    """A free body that meets nothing but grains."""
    body = _tool("<freejoint/>", mesh=mesh, mass=mass, position=position)
    return body.replace('name="tool"', f'name="{name}"')


def block(
    step: float, integrator: str = "Euler", *, option: str = "", as_one: bool = False
) -> Numbers:
    """A block of 0.3 kg lies on the plate by contact, or as one body with it: depth and creep in the last second [mm].

    And the wrench that the plate feels over that of the memory.
    """
    bodies = _tool(
        "<freejoint/>", mass=0.6 if as_one else 0.3, position="0 0 0.002", more='condim="3"'
    )
    if not as_one:
        geom = '<geom type="box" size="0.02 0.02 0.0105" mass="0.3"/>'
        bodies += f'<body pos="0 0 0.0141"><freejoint/>{geom}</body>'
    scene = Scene(bodies, step, integrator, option=option)
    heights, felt, remembered = [], 0.0, 1.0
    for _ in range(round(2.0 / step)):
        scene.advance(remember=True)
        felt, remembered = scene.grains.wrench[2], scene.memory[2]
        heights.append(1e3 * scene.data.qpos[2])
    return {
        "depth": 1.5 - heights[-1],
        "creep": float(np.ptp(heights[-round(1.0 / step) :])),
        "felt over memory": float(felt / remembered),
        "failures": scene.grains.failures,
    }


def pressed(kind: str, step: float, integrator: str = "Euler", *, option: str = "") -> Numbers:
    """The tool is pressed down beside one of `KINDS`: what it feels [N], and its scatter."""
    joint = '<joint name="z" type="slide" axis="0 0 1" {}/>'
    slide = '<joint name="y" type="slide" axis="0 0 1"/>'
    other = f'<body pos="0.3 0 0">{slide}<geom size="0.02" mass="0.5" {_NO_CONTACT}/></body>'
    bodies, more, mass = {
        "weld": (
            '<body name="hand" mocap="true" pos="0 0 0.01"/>',
            '<weld body1="hand" body2="tool"/>',
            0.3,
        ),
        "limit": ("", "", 0.3),
        "friction loss": ("", "", 0.3),
        "joint equality": (other, '<joint joint1="z" joint2="y"/>', 0.3),
        "servo": ("", "", 2.0),
    }[kind]
    joints = {"weld": "<freejoint/>", "limit": joint.format('limited="true" range="-0.012 1"')}
    joints["friction loss"] = joint.format('frictionloss="15"')
    tool = _tool(joints.get(kind, joint.format("")), mass=mass, position="0 0 0.01")
    servo = (
        '<actuator><position joint="z" kp="20000" kv="400"/></actuator>' if kind == "servo" else ""
    )
    scene = Scene(
        bodies + tool, step, integrator, more=f"<equality>{more}</equality>{servo}", option=option
    )
    data = scene.data
    push: dict[str, Callable[[float], None]] = {
        "weld": lambda ramp: data.mocap_pos.__setitem__((0, 2), 0.01 - 0.03 * ramp),
        "limit": lambda ramp: data.qfrc_applied.__setitem__(0, -80.0 * ramp),
        "friction loss": lambda ramp: data.qfrc_applied.__setitem__(
            0, -40.0 * ramp if data.time < 1.0 else -20.0
        ),
        "joint equality": lambda ramp: data.qfrc_applied.__setitem__(1, -20.0 * ramp),
        "servo": lambda ramp: data.ctrl.__setitem__(0, -0.03 * ramp),
    }
    felt = []
    for _ in range(round(2.0 / step)):
        push[kind](min(data.time, 1.0))
        scene.advance(remember=True)
        felt.append(scene.grains.wrench[2])
    late = felt[-round(0.5 / step) :]
    return {
        "felt": float(felt[-1]),
        "felt over memory": float(felt[-1] / scene.memory[2]),
        "scatter": float(np.ptp(late) / abs(felt[-1])),
    }


def lifted(
    speed: float,
    stiffness: float,
    step: float,
    integrator: str = "Euler",
    *,
    by: str = "servo",
    mass: float = 2.0,
) -> Numbers:
    """A tool is pressed with 99 N and lifted at a speed [m/s] with a stiffness [N/m].

    `by`: a position actuator (``servo``), a ``weld`` to a mocap body, or a controller in `qfrc_applied` (``force``).

    In shares of the press: ``error``, the greatest distance of the wrench from the memory's at the end of the step, and
    the greatest pulls.
    """
    damping = 2.0 * np.sqrt(stiffness * mass)
    slide = '<joint name="z" type="slide" axis="0 0 1"/>'
    tree, more = _tool(slide, mass=mass), ""
    if by == "servo":
        more = f'<actuator><position joint="z" kp="{stiffness}" kv="{damping}"/></actuator>'
    elif by == "weld":
        tree = '<body name="hand" mocap="true"/>' + _tool("<freejoint/>", mass=mass)
        # solref: stiffness and damping over the mass, in MuJoCo's sign; solimp: the same at every distance
        reference = f"{-stiffness / mass} {-damping / mass}"
        more = f'<equality><weld body1="hand" body2="tool" solref="{reference}" solimp="0.9 0.9 0.001"/></equality>'
    scene = Scene(tree, step, integrator, more=more)
    data, command, lifts, rows = scene.data, 0.003, np.inf, []
    height = data.xpos[scene.body]
    data.qpos[-1 if by != "weld" else 2] = command
    while (height[2] < 0.004 or lifts == np.inf) and data.time < 20.0:
        if lifts == np.inf:
            command -= 0.02 * step
            lifts = data.time + 0.5 if scene.grains.wrench[2] >= _PRESS else np.inf
        elif data.time >= lifts:
            command += speed * step
        if by == "servo":
            data.ctrl[0] = command
        elif by == "weld":
            data.mocap_pos[0, 2] = command
        else:
            data.qfrc_applied[0] = stiffness * (command - data.qpos[0]) - damping * data.qvel[0]
        wrench = scene.grains.apply(data)[2]
        rows.append((data.time, wrench, scene.remembered()[2]))
        scene.mujoco.mj_step(scene.model, data)
    time, wrenches, memory = np.array(rows).T
    after = (time >= lifts)[:-1]
    if not after.any():  # the servo is unstable by itself
        return dict.fromkeys(("press", "error", "pull", "memory's pull", "failures"), np.nan)
    press = wrenches[:-1][~after][-1]
    return {
        "press": float(press),
        "error": float(np.abs(wrenches[:-1] - memory[1:])[after].max() / press),
        "pull": float(-wrenches[:-1][after].min() / press),
        "memory's pull": float(-memory[1:][after].min() / press),
        "failures": scene.grains.failures,
    }


def released(
    mass: float, step: float, integrator: str = "Euler", *, mesh: str = "plate"
) -> Numbers:
    """A free body is pushed down with 30 N and released: its rise [mm], and what of the work it gets back [%]."""
    scene = Scene(_tool("<freejoint/>", mass=mass, mesh=mesh), step, integrator)
    scene.lay(0.0005)
    data, low, top, took, gave = scene.data, 0.0, 0.0, 1e-12, 0.0
    for k in range(round(1.6 / step)):
        pushes = k * step < 1.2
        data.xfrc_applied[scene.body, 2] = -_PUSH * min(k * step, 1.0) if pushes else 0.0
        work = scene.advance()
        took, gave = took + max(-work, 0.0) * pushes, gave + max(work, 0.0) * (not pushes)
        low, top = (data.qpos[2],) * 2 if pushes else (low, max(top, data.qpos[2]))
    return {
        "rise": 1e3 * float(top - low),
        "back": 100.0 * gave / took,
        "failures": scene.grains.failures,
    }


def slid(
    step: float, integrator: str = "Euler", *, speed: float = 3.0, explicit: bool = False
) -> Numbers:
    """The plate slides over the grains at a speed [m/s] until it stops: its way [mm].

    `explicit`: under the memory's own wrench at the begin of each step.
    """
    scene = Scene(_tool("<freejoint/>"), step, integrator)
    scene.lay(0.0)
    data = scene.data
    data.qvel[0] = speed
    while data.time < 6.0 and not (data.time > 0.3 and np.abs(data.qvel).max() < 1e-3):
        if explicit:
            scene.mujoco.mj_fwdPosition(scene.model, data)
            # the plate's centre of mass is its origin
            data.xfrc_applied[scene.body] = scene.remembered()
            scene.mujoco.mj_step(scene.model, data)
        else:
            scene.advance()
    return {"way": 1e3 * float(data.qpos[0]), "failures": scene.grains.failures}


def presses(step: float, times: int = 200) -> Numbers:
    """A servo presses and lifts the tool at one place many times: first and last press [N], and how they drift."""
    tool = _tool('<joint name="z" type="slide" axis="0 0 1"/>', mass=2.0)
    scene = Scene(
        tool, step, "Euler", more='<actuator><position joint="z" kp="20000" kv="400"/></actuator>'
    )
    data, peaks = scene.data, []
    data.qpos[0] = 0.01
    for _ in range(times):
        peak = 0.0
        for k in range(round(0.3 / step)):
            data.ctrl[0] = 0.005 + 0.015 * np.cos(2.0 * np.pi * k * step / 0.3) - 0.01
            scene.advance()
            peak = max(peak, float(scene.grains.wrench[2]))
        peaks.append(peak)
    half = peaks[times // 2 :]
    return {
        "second": peaks[1],
        "last": peaks[-1],
        "drift": float(np.ptp(half)),
        "failures": scene.grains.failures,
    }


def gait(
    step: float, integrator: str = "Euler", *, trots: float = 0.0, stands: float = 3.0
) -> Numbers:
    """A quadruped of 8 kg stands and trots [s] on stiff knees: height, creep when it stands [mm], tilt [degrees].

    ``back``: the work that the grains return to the feet, over what they take [%]. ``net back``: the energy that they
    give over stances, each from a foot's first touch to when it leaves the grains.
    """
    mujoco, legs, servos = import_mujoco(), "", ""
    for k, (x, y) in enumerate(_HIPS):
        foot = f'<geom type="sphere" size="0.035" mass="0.08" {_NO_CONTACT}/>'
        rod = f'<geom type="capsule" fromto="0 0 0 {{}} 0 -0.15" size="0.01" mass="{{}}" {_NO_CONTACT}/>'
        shank = f'<joint name="knee{k}" axis="0 1 0"/>{rod.format(0.1, 0.2)}'
        thigh = f'<joint name="hip{k}" axis="0 1 0"/>{rod.format(-0.1, 0.4)}'
        lower = f'<body pos="-0.1 0 -0.15">{shank}<body name="foot{k}" pos="0.1 0 -0.15">{foot}</body></body>'
        legs += f'<body pos="{x} {y} 0">{thigh}{lower}</body>'
        for joint in ("hip", "knee"):
            servos += f'<position joint="{joint}{k}" kp="800" kv="8"/>'
    model: Any = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{step}" integrator="{integrator}"/><worldbody><body name="trunk" pos="0 0 0.33">'
        f'<freejoint/><geom type="box" size="0.22 0.08 0.04" mass="5.3" {_NO_CONTACT}/>{legs}</body></worldbody>'
        f"<default><joint damping='0.2' armature='0.02'/></default><actuator>{servos}</actuator></mujoco>"
    )
    data: Any = mujoco.MjData(model)
    grains = MujocoGrains(model, bodies=[f"foot{k}" for k in range(4)], law=law(1.0))
    ids, took, gave, poses = [int(model.body(f"foot{k}").id) for k in range(4)], 1e-12, 0.0, []
    trunk, tilt = int(model.body("trunk").id), 0.0
    linear, angular = np.zeros((2, 3, model.nv))
    net, given = (
        np.zeros(4),
        np.zeros(4),
    )  # energy that each foot gave in its stance [J], and got by stances
    for _ in range(round((stands + trots) / step)):
        walks = max(data.time - stands, 0.0)
        for k in range(4):
            longer = 0.0
            if walks:  # two legs stretch in turn, and those over which the trunk is low: else the robot falls over
                high = float(data.xmat[trunk, 6:8] @ _HIPS[k])
                longer = (
                    max(np.sin(2.0 * np.pi * (walks / 0.4 + 0.5 * (k in (0, 3)))), 0.0)
                    - 15.0 * high
                )
            data.ctrl[2 * k : 2 * k + 2] = -0.1 * longer, 0.2 * longer
        wrenches = grains.apply(data)
        mujoco.mj_step(model, data)
        for k, (wrench, body) in enumerate(zip(wrenches, ids, strict=True)):
            mujoco.mj_jacBody(model, data, linear, angular, body)
            work = step * float(wrench[:3] @ linear @ data.qvel + wrench[3:] @ angular @ data.qvel)
            took, gave = took + max(-work, 0.0), gave + max(work, 0.0)
            if not wrench.any():  # in the air: a stance ends
                given[k], net[k] = given[k] + max(-net[k], 0.0), 0.0
            net[k] -= work
        tilt = max(tilt, float(np.degrees(np.arccos(min(data.xmat[trunk, 8], 1.0)))))
        poses.append(1e3 * data.qpos[:3])
    still = poses[round((stands - 1.0) / step) : round(stands / step)]
    return {
        "height": float(poses[-1][2]),
        "creep": float(np.linalg.norm(np.ptp(still, axis=0))),
        "back": 100.0 * gave / took,
        "net back": 100.0 * float((given + np.maximum(-net, 0.0)).sum()) / took,
        "tilt": tilt,
        "failures": grains.failures,
    }
