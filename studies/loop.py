"""In the loop: what a simulator or an arm that feels the grains' force does with each way to compute it.

A plate of 51 x 51 x 3 mm, ζ 0.33 unless varied, λ 3 mm, α_y linear. Bodies fall 10 mm in MuJoCo, free in six
directions; an impedance arm of three axes holds the plate's orientation, and the force is held over each step.
"""

import time
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.installation import share_directory
from rft_ros.rft import MEDIA, Law, alpha_y_model, treers2021, wrenches
from rft_ros.simulation import Grains, GrainsBatch, MujocoGrains
from rft_ros.simulation.mujoco_grains import import_mujoco
from rft_ros.simulation.six_axis_arm import SixAxisArm
from rft_ros.tool import Tool, load_tool
from studies.result import BLUE, GREEN, VERMILION, StudyResult, TextTable, label_axes, new_figure

__all__ = ["study"]

Array = NDArray[np.float64]

LENGTH = 0.003
PUBLISHED, EXPLICIT, IMPLICIT = "published law", "elastic-plastic, explicit", "elastic-plastic, implicit"
WAYS = PUBLISHED, EXPLICIT, IMPLICIT
MASSES = 0.02, 0.1, 0.5, 2.0, 5.0  # kg
STEPS = 0.0005, 0.001, 0.002, 0.005, 0.01, 0.02  # s
ARMS = (2.0, 0.2), (2.0, 2.0), (2.0, 20.0), (0.2, 0.5)  # kg, kN/m
ZETAS = 0.2, 1.0, 3.0
STILL = 1e-5  # m in 1 s
_TILT = "0.99 0.12 0.08 0"


def law(zeta: float = 0.33) -> Law:
    """The grains of this study."""
    return treers2021(
        MEDIA["generic"], alpha_y_model("linear", MEDIA["generic"]), zeta=zeta, mobilization_length=LENGTH
    )


class _Published:
    """The published law as `Grains`."""

    def __init__(self, plates: Any, zeta: float) -> None:
        self._plates, self._law = plates, law(zeta)

    def step(self, position: Array, quaternion: Array, twist: Array, _dt: float) -> Array:
        return wrenches(self._plates, self._law, np.hstack([position, quaternion, twist])[None], threads=1)[0, :6]


def _alone(way: str, tool: Tool, zeta: float) -> Any:
    """Grains that know no inertia."""
    if way == PUBLISHED:
        return _Published(tool.plates, zeta)
    return Grains(tool, law(zeta))


def dropped(mass: float, step: float, way: str, *, zeta: float = 0.33, seconds: float = 2.5) -> dict[str, float]:
    """A tilted plate that fell: depth [m], creep over the last second [m], speed [m/s], energy given over taken."""
    mujoco = import_mujoco()

    mesh = share_directory("rft_ros") / "meshes" / "plate.stl"
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{step}"/><asset><mesh name="plate" file="{mesh}" scale=".001 .001 .001"/></asset>'
        f'<worldbody><body name="body" quat="{_TILT}"><freejoint/><geom type="mesh" mesh="plate" mass="{mass}"'
        ' contype="0" conaffinity="0"/></body></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    grains = MujocoGrains(model, body="body", zeta=zeta, mobilization_length=LENGTH)
    alone = _alone(way, grains.tool, zeta)
    mujoco.mj_kinematics(model, data)
    data.qpos[2] = start = 0.01 - grains.tool.lowest_point(data.xmat[1].reshape(3, 3))
    rows, took, gave = [], 0.0, 0.0
    for _ in range(round(seconds / step)):
        if way == IMPLICIT:
            wrench = grains.apply(data)
        else:
            mujoco.mj_kinematics(model, data)
            twist = np.concatenate([data.qvel[:3], data.xmat[1].reshape(3, 3) @ data.qvel[3:]])
            wrench = alone.step(data.xpos[1], np.roll(data.xquat[1], -1), twist, step)
            data.xfrc_applied[1] = wrench  # the plate's centre of mass is its origin
        mujoco.mj_step(model, data)
        work = step * (wrench @ np.concatenate([data.qvel[:3], data.xmat[1].reshape(3, 3) @ data.qvel[3:]]))
        took, gave = took + max(-work, 0.0), gave + max(work, 0.0)
        rows.append([*data.qpos[:3], np.linalg.norm(data.qvel[:3])])
        if not np.isfinite(data.qpos).all() or abs(data.qpos[2]) > 2.0:
            return {"depth": np.nan, "creep": np.nan, "speed": np.nan, "given": np.nan}
    late = np.array(rows)[-round(1.0 / step) :]
    return {
        "depth": start - 0.01 - late[-1, 2],
        "creep": float(np.linalg.norm(np.ptp(late[:, :3], axis=0))),
        "speed": float(late[:, 3].max()),
        "given": gave / max(took, 1e-12),
    }


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
        if k % round(hold / dt) == 0:
            force = grains.step(x, np.array([0.0, 0, 0, 1]), np.array([*v, 0, 0, 0]), hold)[:3]
        goal = np.array([np.interp(k * dt, times, axis) for axis in command.T])
        push = np.array([load if k * dt > times[1] + 1.0 else 0.0, 0.0, 0.0])
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


def _cpu(calls: int, call: Any) -> float:
    """CPU time of a call [us], the least of five runs."""
    found = []
    for _ in range(5):
        begin = time.process_time()
        for k in range(calls):
            call(k)
        found.append((time.process_time() - begin) / calls * 1e6)
    return min(found)


def costs() -> Iterator[tuple[str, str]]:
    """Microseconds of CPU of a step, for tools of 190 and 2,352 plates."""
    mujoco = import_mujoco()

    for tolerance in (0.025, 0.0):
        arm = SixAxisArm("ellipsoid")
        grains = MujocoGrains(arm.model, body="tool", zeta=0.33, mobilization_length=LENGTH, tolerance=tolerance)
        arm.start([0.45, 0.0, -0.02])

        def stepped(_k: int, arm: SixAxisArm = arm, grains: MujocoGrains = grains) -> None:
            grains.apply(arm.data)
            mujoco.mj_step(arm.model, arm.data)

        plates = f"{len(grains.tool.plates):,} plates"
        both, alone = _cpu(1000, stepped), _cpu(1000, lambda _k, arm=arm: mujoco.mj_step(arm.model, arm.data))
        batch = GrainsBatch(grains.tool, law(), bodies=256)
        states = np.tile([0, 0, -0.01, 0, 0, 0, 1, 0.001, 0, -0.001, 0, 0, 0], (256, 1))

        def together(k: int, batch: GrainsBatch = batch, states: Array = states) -> None:
            states[:, 2] = -0.01 - 1e-6 * k
            batch.step(states, 0.001)

        body = _cpu(20, together) / 256
        yield (
            f"{plates}: `mj_step` of a six-axis arm, the grains beside it, a body of 256; real-time factor at 1 kHz",
            f"{alone:.1f}, {both - alone:.1f}, {body:.1f} µs; {1000.0 / both:.0f}",
        )


def study() -> StudyResult:
    """Drops, holds and times; the table of docs/in-the-loop.md."""
    drops = {(w, m, s): dropped(m, s, w) for w in WAYS for m in MASSES for s in STEPS}
    by_zeta = {(w, z): dropped(0.5, 0.002, w, zeta=z) for w in WAYS for z in (0.2, 3.0)}
    rows: list[tuple[str, ...]] = []

    def add(what: str, value: Any) -> None:
        rows.append((what, *(value(way) for way in WAYS)))

    add("steps [ms] at which plates of 20 g to 5 kg lie still (0.01 mm in 1 s)", lambda w: _still(drops, w))
    for what, name in (("creep in 1 s [mm]", "creep"), ("speed then [mm/s]", "speed")):
        add(
            f"0.02, 0.5, 5 kg, 2 ms: {what}",
            lambda w, n=name: _thousandths(drops[w, m, 0.002][n] for m in (0.02, 0.5, 5.0)),
        )
    add("0.5 kg, 2 ms, ζ 0.2, 3: creep in 1 s [mm]", lambda w: _thousandths(by_zeta[w, z]["creep"] for z in (0.2, 3.0)))
    add("greatest energy given back over taken, steps to 5 ms", lambda w: _given(drops, w))
    for mass in (0.02, 0.5, 5.0):
        add(f"{mass:g} kg: rest depth at 0.5, 1, 2, 5 ms", lambda w, m=mass: _depths(drops, w, m))
    ways = PUBLISHED, EXPLICIT
    for hold in (1, 8):
        arms = {(w, z, a): held(a[0], 1e3 * a[1], 1e-3 * hold, w, zeta=z) for w in ways for z in ZETAS for a in ARMS}
        for z in ZETAS:
            add(
                f"four arms, force held over {hold} ms, ζ {z:g}: scatter at holds [%]",
                lambda w, z=z, arms=arms: (
                    ", ".join(f"{100.0 * arms[w, z, a]['scatter']:.2g}" for a in ARMS) if w in ways else "–"
                ),
            )
        add(
            f"greatest net work on these arms at {hold} ms, over what the grains take [%]",
            lambda w, arms=arms: (
                f"{100.0 * max(arms[w, z, a]['net'] for z in ZETAS for a in ARMS):.0f}" if w in ways else "–"
            ),
        )
    side = {w: held(2.0, 2e3, 1e-3, w, load=1.2)["creep"] for w in (PUBLISHED, EXPLICIT)}
    add(
        "2 kg on 2 kN/m, 1 ms: creep in 10 s under half the drag",
        lambda w: f"{1e3 * side[w]:.3f} mm" if w in side else "–",
    )
    rows += [(what, "–", "–", value) for what, value in costs()]
    figure = new_figure(11.0, 4.8)
    left, right = figure.subplots(1, 2)
    for way, colour in zip(WAYS, (VERMILION, BLUE, GREEN), strict=True):
        for mass, style in ((0.02, ":"), (0.5, "-"), (5.0, "--")):
            found = [drops[way, mass, s] for s in STEPS]
            label = f"{way}, {mass:g} kg"
            left.loglog(
                1e3 * np.array(STEPS),
                [max(1e3 * f["creep"], 1e-9) for f in found],
                style,
                color=colour,
                marker="o",
                ms=3,
            )
            right.semilogx(
                1e3 * np.array(STEPS),
                [1e3 * f["depth"] for f in found],
                style,
                color=colour,
                marker="o",
                ms=3,
                label=label,
            )
    label_axes(left, x="Step [ms]", y="Creep in 1 s [mm]", title="A plate that fell in, 1.5 to 2.5 s later")
    right.set_ylim(0.0, 200.0)
    label_axes(right, x="Step [ms]", y="Rest depth [mm]", title="Where it rests")
    figure.legend(loc="outside lower center", ncols=3, fontsize=8)
    keys = list(drops)
    return StudyResult(
        name="loop",
        title="In the loop: grains that can be leaned on",
        figure=figure,
        numbers={
            "loop": {
                "way": [k[0] for k in keys],
                "mass_kg": [k[1] for k in keys],
                "step_s": [k[2] for k in keys],
                **{name: [drops[k][name] for k in keys] for name in ("depth", "creep", "speed", "given")},
            }
        },
        table=TextTable(header=("", *WAYS), rows=tuple(rows)),
    )


def _still(drops: Any, way: str) -> str:
    still = [step for step in STEPS if all(drops[way, mass, step]["creep"] < STILL for mass in MASSES)]
    return ", ".join(f"{1e3 * step:g}" for step in still) or "none"


def _thousandths(values: Iterable[float]) -> str:
    return ", ".join("lost" if np.isnan(value) else f"{1e3 * value:.2g}" for value in values)


def _given(drops: Any, way: str) -> str:
    given = [drops[way, m, s]["given"] for m in MASSES for s in STEPS if s <= 0.005]
    return "net work" if np.isnan(given).any() else f"{100.0 * max(given):.2g} %"


def _depths(drops: Any, way: str, mass: float) -> str:
    depths = [1e3 * drops[way, mass, s]["depth"] for s in (0.0005, 0.001, 0.002, 0.005)]
    return ", ".join("lost" if np.isnan(d) else f"{d:.1f}" for d in depths) + " mm"
