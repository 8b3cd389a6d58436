"""In the loop: bodies in grains beside what else MuJoCo solves, at steps of 0.5 to 5 ms, and what a step costs."""

import io
import itertools
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from examples.six_axis_arm import SixAxisArm
from rft_ros.rft import wrenches
from rft_ros.simulation import Grains, GrainsBatch, MujocoGrains, free_body
from rft_ros.simulation.mechanism import import_mujoco
from rft_ros.tool import Tool, load_tool
from studies import loop_scenes as scenes
from studies.loop_scenes import Numbers, law
from studies.result import BLUE, GREEN, ORANGE, VERMILION, StudyResult, TextTable, label_axes, new_figure, picture

__all__ = ["draw_fall", "study"]

Array = NDArray[np.float64]

PUBLISHED, EXPLICIT, IMPLICIT = "published law", "elastic-plastic, explicit", "elastic-plastic, implicit"
STEPS = 0.0005, 0.001, 0.002, 0.005  # s


class _Published:
    """The published law as `Grains`."""

    def __init__(self, plates: Any, zeta: float) -> None:
        self._plates, self._law = plates, law(zeta)

    def step(self, position: Array, quaternion: Array, twist: Array, _dt: float) -> Array:
        return wrenches(self._plates, self._law, np.hstack([position, quaternion, twist])[None], threads=1)[0, :6]


def _alone(way: str, tool: Tool, zeta: float) -> Any:
    if way == PUBLISHED:
        return _Published(tool.plates, zeta)
    return Grains(tool, law(zeta))


def held(
    mass: float, stiffness: float, hold: float, way: str, *, zeta: float = 0.33, load: float = 0.0
) -> dict[str, float]:
    """A critically damped impedance arm presses 20 mm, drags 20 mm, goes back 10 mm, and stays at each for 1.5 s.

    Greatest scatter over the holds' last 0.4 s over the force; net work of the grains over what they took; with `load`
    [N] sideways at the first hold for 10 s: how far it yields in 0.2 s [m], the creep since [m], the speed then [m/s].
    """
    tool = load_tool("plate", tolerance=0.025)
    grains = _alone(way, tool, zeta)
    dt, depth = 0.001, -0.0184
    goals = np.array([[0, 0, 0.003], [0, 0, depth], [0.02, 0, depth], [0.01, 0, depth]])[: 2 if load else 4]
    rest = 11.0 if load else 1.5
    ways = np.linalg.norm(np.diff(goals, axis=0), axis=1) / 0.02
    times = np.cumsum([0.0, *(t for path in ways for t in (path, rest))])
    command = np.repeat(goals, [1] + [2] * (len(goals) - 1), axis=0)
    x, v, force, net, took = goals[0].copy(), np.zeros(3), np.zeros(3), 0.0, 0.0
    springs = np.full(3, stiffness)
    damping = 2.0 * np.sqrt(mass * stiffness)
    rows = []
    for k in range(int(times[-1] / dt)):
        goal = np.array([np.interp(k * dt, times, axis) for axis in command.T])
        push = np.array([load if k * dt > times[1] + 1.0 else 0.0, 0.0, 0.0])
        if k % round(hold / dt) == 0:
            known: Any = {}
            if way == IMPLICIT:  # as the arm's own spring and damper show it over the time for which the force is held
                one = 1.0 / (mass + hold * damping + hold * hold * stiffness)
                free = one * (springs * (goal - x - hold * v) - damping * v + push)
                known = {"inverse_inertia": np.diag([one] * 3 + [0.0] * 3), "free_acceleration": [*free, 0, 0, 0]}
            force = grains.step(x, np.array([0.0, 0, 0, 1]), np.array([*v, 0, 0, 0]), hold, **known)[:3]
        v = (v + dt / mass * (springs * (goal - x) + force + push)) / (
            1.0 + dt * damping / mass + dt * dt * springs / mass
        )
        x = x + dt * v
        work = float(force @ v) * dt
        net, took = net + work, took + max(-work, 0.0)
        rows.append([*force, *x])
    table = np.array(rows)
    scatters = []
    for end in times[2::2]:
        forces = table[int((end - 0.4) / dt) : int(end / dt), :3]
        mean = float(np.linalg.norm(forces.mean(axis=0)))
        scatters.append(float(np.linalg.norm(np.ptp(forces, axis=0))) / max(mean, 1e-9))
    before, after = (table[int((times[1] + wait) / dt), 3:] for wait in (1.0, 1.2)) if load else (x, x)
    yielded, creep, speed = (float(np.linalg.norm(v)) for v in (after - before, x - after, v))
    return {"scatter": float(max(scatters)), "net": net / took, "yielded": yielded, "creep": creep, "speed": speed}


def _least(calls: int, call: Callable[[], Any]) -> float:
    """Time of a call [us], the least of ten runs."""
    found = []
    for _ in range(10):
        begin = time.perf_counter()
        for _ in range(calls):
            call()
        found.append((time.perf_counter() - begin) / calls * 1e6)
    return min(found)


def _stepped(grains: MujocoGrains, arm: SixAxisArm) -> None:
    grains.apply(arm.data)
    import_mujoco().mj_step(arm.model, arm.data)


def _slide_on(scene: scenes.Scene, velocity: Array) -> None:
    """Take a step of free bodies that keep their depth, attitude and velocity, shape [6 n]."""
    places = scene.data.qpos.reshape(-1, 7)
    places[:, 2:], scene.data.qvel[:] = (-0.01, 1.0, 0.0, 0.0, 0.0), velocity
    scene.grains.apply(scene.data)
    scene.mujoco.mj_step(scene.model, scene.data)


def _batch(tool: Tool, bodies: int) -> Callable[[], None]:
    """A step of bodies that plough on, 0.1 mm each time."""
    batch, states = GrainsBatch(tool, law(), bodies=bodies), np.zeros((bodies, 13))
    states[:, 2], states[:, 6], states[:, 7] = -0.01, 1.0, 0.1
    inverse = free_body(0.3, 1e-4 * np.eye(3), [0, 0, 0, 1])

    def step() -> None:
        states[:, 0] += 1e-4
        batch.step(states, 0.001, inverse_inertia=inverse, free_acceleration=np.zeros(6))

    return step


def costs() -> Iterator[tuple[str, str]]:
    """Microseconds beside MuJoCo's own step, and real-time factors at 1 kHz."""
    mujoco = import_mujoco()
    for tolerance in (0.025, 0.0):
        arm = SixAxisArm("ellipsoid")
        grains = MujocoGrains(arm.model, body="tool", law=law(), tolerance=tolerance)
        arm.start([0.45, 0.0, -0.02])
        alone = _least(500, partial(mujoco.mj_step, arm.model, arm.data))
        beside = _least(500, partial(_stepped, grains, arm)) - alone
        body = _least(10, _batch(grains.tool, bodies=256)) / 256
        yield (
            f"{len(grains.tool.plates):,} plates: a six-axis arm's `mj_step`, grains beside it, one of 256 bodies",
            f"{alone:.1f}, {beside:.1f}, {body:.1f} µs; real-time factor {1000.0 / (alone + beside):.0f}",
        )
    for names, speed in itertools.product((["tool"], ["tool", "b", "c", "d"]), (0.1, 3.0)):
        more = "".join(
            scenes.free_tool("sphere", 0.3, name=name, position=f"{0.3 * k} 0 0") for k, name in enumerate(names)
        )
        scene = scenes.Scene(more, 0.001, "Euler", bodies=names)
        spent = _least(200, partial(_slide_on, scene, np.tile([speed, 0, 0, 0, 0, 0], len(names))))
        yield (
            f"{len(names)} free bodies of {len(scene.grains.tool.plates)} plates at {speed:g} m/s",
            f"{spent:.1f} µs a step; real-time factor {1000.0 / spent:.0f}",
        )


def _rows() -> Iterator[tuple[str, Callable[[float], Numbers], Callable[[Numbers], str]]]:
    """Each row's name, its scene at a step, and what it shows of the numbers."""

    def depth_and_creep(found: Numbers) -> str:
        return f"{found['depth']:.2f} mm, {found['creep']:.1g} mm"

    yield "0.6 kg as one body: depth, creep in 1 s", lambda h: scenes.block(h, as_one=True), depth_and_creep
    yield "0.3 kg block by contact on 0.3 kg plate", lambda h: scenes.block(h), depth_and_creep
    for kind in scenes.KINDS:
        yield (
            f"{kind}: felt over memory, scatter",
            lambda h, kind=kind: scenes.pressed(kind, h),  # type: ignore[misc]
            lambda found: f"{found['felt over memory']:.4f}, {found['scatter']:.1g}",
        )
    for speed, by, stiffness in ((0.01, "servo", 2e4), (0.05, "servo", 2e5), (0.2, "servo", 2e6), (0.2, "weld", 2e5)):
        lift = partial(scenes.lifted, speed, stiffness, integrator="implicitfast", by=by)
        yield (
            f"lifted at {1e3 * speed:g} mm/s by a {by} of {1e-3 * stiffness:g} kN/m: error, pull, memory's pull, over "
            "the press",
            lambda h, lift=lift: lift(step=h),  # type: ignore[misc]
            lambda found: f"{found['error']:.3f}, {found['pull']:.3f}, {found['memory' + chr(39) + 's pull']:.3f}",
        )
    for mass in (0.005, 0.1, 0.5):
        yield (
            f"{mass:g} kg released from 30 N: rise, work back",
            lambda h, mass=mass: scenes.released(mass, h),  # type: ignore[misc]
            lambda found: f"{found['rise']:.2f} mm, {found['back']:.2g} %",
        )
    yield "plate slides from 3 m/s: way", lambda h: scenes.slid(h), lambda found: f"{found['way']:.1f} mm"
    for mesh, mass in (("ellipsoid", 0.05), ("plate", 0.3), ("plate", 5.0)):
        yield (
            f"{mesh} of {mass:g} kg falls 10 mm: depth, creep, energy back",
            lambda h, mesh=mesh, mass=mass: scenes.drop(mesh, mass, h),  # type: ignore[misc]
            lambda found: f"{depth_and_creep(found)}, {found['back']:.2g} %",
        )
    yield (
        "sphere of 0.3 kg from 1 m/s: depth",
        lambda h: scenes.drop("sphere", 0.3, h, quaternion="1 0 0 0", speed=1.0),
        lambda found: f"{found['depth']:.1f} mm",
    )
    yield (
        "quadruped stands: creep in 1 s",
        lambda h: scenes.gait(h, "implicitfast"),
        lambda found: f"{found['creep']:.1g} mm",
    )
    yield (
        "quadruped trots for 20 s: energy back within stances, and by whole stances",
        lambda h: scenes.gait(h, "implicitfast", trots=20.0),
        lambda found: f"{found['back']:.2g} %, {found['net back']:.1g} %",
    )


def _cell(scene: Callable[[float], Numbers], shown: Callable[[Numbers], str], step: float) -> str:
    try:
        found = scene(step)
    except ValueError:  # MuJoCo's own step is unstable there, as without grains
        return "unstable"
    return "unstable servo" if np.isnan(found["failures"]) else shown(found)


def study() -> StudyResult:
    """The table of docs/in-the-loop.md, and the rest depths of bodies that fell in over the step."""
    rows = [(name, *(_cell(scene, shown, h) for h in STEPS)) for name, scene, shown in _rows()]
    slides = [f"{scenes.slid(h, explicit=True)['way']:.1f}" for h in (0.00002, 0.0001)]
    rows += [("the same slide, explicit steps of 0.02 and 0.1 ms: way", "", f"{slides[0]} and {slides[1]} mm", "", "")]
    rows += [(what, "", value, "", "") for what, value in costs()]
    figure = new_figure(8.0, 4.2)
    axes = figure.subplots()
    for (mesh, mass), colour in zip(
        (("ellipsoid", 0.05), ("sphere", 0.3), ("plate", 0.3), ("plate", 2.0)),
        (BLUE, ORANGE, GREEN, VERMILION),
        strict=True,
    ):
        fine = scenes.drop(mesh, mass, 0.0001, explicit=True)["depth"]
        depths = [scenes.drop(mesh, mass, h)["depth"] for h in (*STEPS, 0.01)]
        steps = 1e3 * np.array([*STEPS, 0.01])
        axes.semilogx(steps, np.array(depths) / fine, color=colour, marker="o", ms=4, label=f"{mesh}, {mass:g} kg")
    axes.axhspan(0.95, 1.05, color="0.93", zorder=0)
    axes.set_ylim(0.8, 1.1)
    axes.set_xticks(steps, [f"{h:g}" for h in steps], minor=False)
    axes.minorticks_off()
    label_axes(axes, x="Step [ms]", y="Rest depth over that of explicit steps of 0.1 ms", title="")
    axes.legend(fontsize=8)
    return StudyResult(
        name="loop",
        title="Does the rest depth of a body that fell in depend on the step?",
        figure=figure,
        table=TextTable(header=("", *(f"{1e3 * h:g} ms" for h in STEPS)), rows=tuple(rows)),
    )


def draw_fall(path: Path) -> None:
    """Write an animation of an ellipsoid that falls into grains, its plates coloured by their tractions."""
    from matplotlib import colormaps
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]
    from PIL import Image

    scene = scenes.Scene(scenes.free_tool("ellipsoid", 0.05), 0.001, "Euler")
    scene.data.qpos[3:7] = np.array([0.95, 0.25, 0.1, 0.0]) / np.linalg.norm([0.95, 0.25, 0.1])
    scene.lay(0.01)
    tool, pictures = scene.grains.tool, []
    size = 1.1 * float(np.linalg.norm(tool.corners, axis=1).max())
    centers, normals = tool.plates.centroids.T, tool.plates.normals.T
    faces = tool.vertices[tool.faces]
    middle, out = faces.mean(axis=1), np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    out /= np.linalg.norm(out, axis=1)[:, None]
    nearest = (((middle[:, None] - centers) / size) ** 2).sum(axis=2) + ((out[:, None] - normals) ** 2).sum(axis=2)
    plate_of_face = nearest.argmin(axis=1)
    for k in range(360):
        scene.advance()
        if k % 10:
            continue
        pressure = np.linalg.norm(scene.grains.tractions(), axis=1)[plate_of_face]
        figure = new_figure(3.6, 3.0)
        axes: Any = figure.add_subplot(projection="3d")
        placed = faces @ scene.data.xmat[scene.body].reshape(3, 3).T + scene.data.xpos[scene.body]
        axes.add_collection3d(Poly3DCollection(placed, facecolors=colormaps["viridis"](pressure / 3e3)))
        edge = 1.6 * size
        bed = np.array([[-edge, -edge, 0], [edge, -edge, 0], [edge, edge, 0], [-edge, edge, 0]])
        axes.add_collection3d(Poly3DCollection([bed], facecolors="#C2A878", alpha=0.35))
        axes.set(xlim=(-edge, edge), ylim=(-edge, edge), zlim=(-edge, edge))
        axes.view_init(elev=8.0, azim=-60.0)
        axes.set_box_aspect((1.0, 1.0, 1.0), zoom=1.1)
        axes.set_axis_off()
        axes.set_title(f"{k:3d} ms   {scene.grains.wrench[2]:5.2f} N up", fontsize=9)
        pictures.append(Image.open(io.BytesIO(picture(figure))).convert("RGB"))
    few = [one.quantize(48) for one in pictures]
    few[0].save(path, save_all=True, append_images=few[1:], duration=60, loop=0, optimize=True)
