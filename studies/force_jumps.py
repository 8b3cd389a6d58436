"""Where the force of the published rule jumps or rises steeply: sweeps through each place, with a figure each.

Nearly level plates, plates that move in their own plane, facets parallel to the motion, withdrawal, turning, the
surface, and reversal. `docs/where-it-fails.md` explains them.
"""

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from rft_ros.rft import INTEGRATIONS, Integration, Memory, Plates, traction_per_depth, wrenches, wrenches_in_time
from rft_ros.rft.traction import FLAT, FLAT_BLEND, NEVER_FLAT
from rft_ros.tool.refine import FLAT_HALF_ANGLE
from studies.paper import ALPHA_Y, law
from studies.parameter_sweep import (
    ANGLE_STEP,
    DEGREES,
    LENGTH_STEP,
    MILLIMETRES,
    RULE_COLOUR,
    Array,
    BothRules,
    Sweep,
    Unit,
    both_rules,
    by_rule_result,
    draw_lines,
    evenly,
    jump_result,
    measured,
    scene_states,
    shipped,
)
from studies.result import BLACK, GREEN, GREY, PURPLE, StudyResult, label_axes, new_figure

__all__ = ["LIMIT"]
__all__ += ["along_itself", "direction_sweeps", "greatest_power", "height_sweeps", "knife_edge", "level"]
__all__ += ["level_sweeps", "overview", "plate_facing", "reversal", "reversal_sweep", "surface", "turning"]
__all__ += ["turning_sweep", "wheel_sweep", "withdrawal", "yaw_sweeps"]

_DEM_ZETA = 0.24  # of the simulated beads, from their vertical penetration (docs/accuracy.md)

_DEM_FORCES = {0.0: 2.87, 30.0: 2.71, 90.0: 1.04}
"""Mean force [N] over the last 25 mm of simulated drags of an upright 30 x 30 x 3 mm plate, centre 35 mm deep, by ψ."""

_DRAWS = 200  # of noise


def level_sweeps() -> tuple[Sweep, ...]:
    """β through 0 (moving forwards and down) and through 180° (forwards and up), for yaw 0 to 90°."""
    plate = shipped("plate")
    tilts = evenly(np.radians(-8.0), np.radians(8.0), ANGLE_STEP)
    sweeps = []
    for name, turn, rise in (("β through 0", 0.0, -0.3), ("β through 180°", np.pi, 0.3)):
        for yaw in (0.0, 30.0, 60.0, 90.0):

            def states(tilt: Array, yaw: float = yaw, turn: float = turn, rise: float = rise) -> Array:
                about = Rotation.from_euler("z", yaw, degrees=True) * Rotation.from_euler("y", (turn - tilt)[:, None])
                return scene_states(about, velocity=(0.01, 0.0, 0.01 * rise))

            sweeps.append(Sweep(name=f"{name}, yaw {yaw:.0f}°", tool=plate, values=tilts, states=states))
    return tuple(sweeps)


def level() -> StudyResult:
    """Nearly level plates: e2 comes from the normal, the velocity, or a blend of both."""
    by_name = {sweep.name: measured(sweep) for sweep in level_sweeps()}
    figure = new_figure(8.4, 3.8)
    edge = np.degrees(np.arccos(FLAT))
    for axes, name in zip(figure.subplots(1, 2), ("β through 0, yaw 30°", "β through 180°, yaw 90°"), strict=True):
        draw_lines(axes, by_name[name], DEGREES)
        for limit, style in ((edge, ":"), (FLAT_BLEND, "-.")):
            for side in (-limit, limit):
                axes.axvline(side, color=GREY, lw=0.8, ls=style)
        below = name.startswith("β through 0")
        if below:
            axes.plot(0.0, _by_the_papers_text(), "x", color=BLACK, ms=8, label="the paper's text, at exactly 0")
        label_axes(axes, x="β [°]" if below else "β - 180° [°]", y="Force on the plate [N]")
        axes.set_title(f"{name}, moving forwards and {'down' if below else 'up'}", fontsize=10)
    figure.axes[0].legend(fontsize=7)
    figure.suptitle(f"centroid jumps at {edge:.1f}° (dotted), refined blends up to {FLAT_BLEND:.0f}°", fontsize=9)
    lines_of_all = [line for lines in by_name.values() for line in lines]
    return jump_result("fails_level_plate", "A plate that lies nearly level", figure, lines_of_all, DEGREES)


def _by_the_papers_text() -> float:
    """Force [N] of the shipped plate's lower face with e1 along the horizontal velocity, α_y constant."""
    plates = shipped("plate")["centroid"].centroid_rows
    below = plates[5] < -0.5
    load = float((plates[6] * (0.05 - plates[2]))[below].sum())
    traction = traction_per_depth(law("constant", zeta=1.0), 0.0, 1e-9, -1.0, 1.0, 0.0, -0.3, NEVER_FLAT)
    return load * float(np.linalg.norm(traction))


def along_itself() -> StudyResult:
    """An upright plate yawed through motion in its own plane, where neither face leads."""

    def states(psi: Array) -> Array:
        about = Rotation.from_euler("z", psi[:, None]) * Rotation.from_euler("y", -90.0, degrees=True)
        # slightly downwards: otherwise rounding decides whether the lower edge leads (`knife_edge`)
        return scene_states(about, velocity=(0.1, 0.0, -0.001), height=-0.035)

    sweep = Sweep(
        name="ψ through 90°",
        tool=both_rules(trimesh.creation.box((0.03, 0.03, 0.003))),
        values=evenly(0.0, np.radians(120.0), ANGLE_STEP),
        states=states,
        zeta=_DEM_ZETA,
    )
    lines = measured(sweep)
    figure = new_figure(8.4, 3.6)
    wide, near = figure.subplots(1, 2)
    exactly = scene_states(Rotation.from_quat([0.5, -0.5, 0.5, 0.5]), velocity=(0.1, 0.0, 0.0), height=-0.035)
    for axes in (wide, near):
        draw_lines(axes, lines, DEGREES)
        axes.plot(
            list(_DEM_FORCES), list(_DEM_FORCES.values()), "o", color=BLACK, mfc="white", label="simulated grains"
        )
        for rule, plates in sweep.tool.items():
            force = wrenches(plates, law("linear", zeta=_DEM_ZETA), exactly)[:, :3]
            style = {"color": RULE_COLOUR[rule], "label": f"{rule}, linear, level motion"}
            axes.plot(90.0, np.linalg.norm(force), "x" if rule == "centroid" else "+", ms=9, mew=2, ls="", **style)
    wide.axvspan(70.0, 110.0, color="0.93")
    near.set_xlim(85.0, 95.0)
    near.set_ylim(0.0, 3.2)
    label_axes(wide, x="ψ, yaw from motion along the normal [°]", y="Force on the plate [N]")
    label_axes(near, x="ψ [°]", y="Force on the plate [N]", title="Near motion in its own plane", legend={})
    wide.set_title("Upright plate, motion 0.6° downwards", fontsize=10)
    return jump_result("fails_along_itself", "A plate that moves in its own plane", figure, lines, DEGREES)


def wheel_sweep() -> Sweep:
    """A wheel pushed along its axle, from 3° upwards to 3° downwards."""
    mesh = trimesh.creation.cylinder(radius=0.0625, height=0.06, sections=120)

    def states(fall: Array) -> Array:
        along = 0.01 * np.column_stack([np.cos(fall), np.zeros_like(fall), -np.sin(fall)])
        return scene_states(Rotation.from_euler("y", 90.0, degrees=True), velocity=along, height=0.03)

    return Sweep(
        name="motion through the axle's direction",
        tool=both_rules(mesh),
        values=evenly(np.radians(-3.0), np.radians(3.0), ANGLE_STEP),
        states=states,
    )


def knife_edge() -> StudyResult:
    """Many facets exactly parallel to the motion: rounding decides which lead."""
    sweep = wheel_sweep()
    lines = measured(sweep)
    figure = new_figure(8.4, 3.6)
    axes, scatter = figure.subplots(1, 2, width_ratios=(3, 2))
    draw_lines(axes, lines, DEGREES)
    label_axes(axes, x="Motion below the axle's direction [°]", y="Force on the wheel [N]", legend={})
    axes.set_title("A wheel, a quarter buried, pushed along its axle", fontsize=10)

    exactly = sweep.states(np.zeros(_DRAWS))
    exactly[:, 7:10] += 1e-14 * np.random.default_rng(0).normal(size=(_DRAWS, 3))
    for k, (rule, plates) in enumerate(sweep.tool.items()):
        force = np.linalg.norm(wrenches(plates, law("constant", zeta=1.0), exactly)[:, :3], axis=1)
        scatter.plot(k + np.linspace(-0.3, 0.3, _DRAWS), force, ".", ms=3, color=RULE_COLOUR[rule], label=rule)
    scatter.set_xticks([0, 1], list(sweep.tool))
    label_axes(scatter, x="Rule", y="Force on the wheel [N]")
    scatter.set_title(f"{_DRAWS} draws of noise of 1e-12 of the speed", fontsize=10)
    return jump_result("fails_knife_edge", "Facets exactly parallel to the motion", figure, lines, DEGREES)


_ATTITUDES = {
    "upright": Rotation.from_euler("y", 90.0, degrees=True),
    "leaning": Rotation.from_euler("yx", [50.0, 20.0], degrees=True),
}


def yaw_sweeps(*tools: str) -> tuple[Sweep, ...]:
    """Yaw over 120° of shipped tools (default: plate, ellipsoid, root tip), moving forwards, or forwards and down."""
    sweeps = []
    for tool in tools or ("plate", "ellipsoid", "root_tip"):
        plates = shipped(tool)
        for name, attitude in _ATTITUDES.items():
            velocity = (0.01, 0.0, 0.0) if name == "upright" else (0.01, 0.002, -0.004)

            def states(
                yaw: Array, attitude: Rotation = attitude, velocity: tuple[float, float, float] = velocity
            ) -> Array:
                return scene_states(Rotation.from_euler("z", yaw[:, None]) * attitude, velocity=velocity)

            values = evenly(np.radians(-15.0), np.radians(105.0), ANGLE_STEP)
            sweeps.append(Sweep(name=f"yaw, {tool}, {name}", tool=plates, values=values, states=states))
    return tuple(sweeps)


_DEPTH = 1.0  # m; large beside the plate

_DIRECTIONS = 90  # of velocity, from the normal to the plate, and half of those around it


def direction_sweeps() -> tuple[Sweep, ...]:
    """The direction of motion, from up over forwards to down, of a plate at three attack angles."""
    sweeps = []
    for beta in (0.0, 45.0, 90.0):

        def states(fall: Array, beta: float = beta) -> Array:
            velocity = 0.01 * np.column_stack([np.cos(fall), 0.2 * np.ones_like(fall), -np.sin(fall)])
            return scene_states(Rotation.from_euler("y", -beta, degrees=True), velocity=velocity)

        fall = evenly(-0.5 * np.pi, 0.5 * np.pi, ANGLE_STEP)
        sweeps.append(Sweep(name=f"direction, β {beta:.0f}°", tool=shipped("plate"), values=fall, states=states))
    return tuple(sweeps)


def plate_facing(beta: float, rule: Integration) -> Plates:
    """One small triangle at the origin whose outward normal lies β [rad] from straight down towards +x."""
    along, up = np.array([0.0, 1.0, 0.0]), np.array([np.cos(beta), 0.0, np.sin(beta)])
    normal = np.array([[np.sin(beta), 0.0, -np.cos(beta)]])
    corners = 1e-3 * np.array([up, -0.5 * up - 0.8 * along, -0.5 * up + 0.8 * along])
    if np.cross(corners[1] - corners[0], corners[2] - corners[0]) @ normal[0] < 0.0:
        corners = corners[[0, 2, 1]]
    if rule == "refined":
        return Plates.from_triangles(corners[None], [FLAT_HALF_ANGLE])
    return Plates.from_arrays(np.zeros((1, 3)), normal, [1e-6])


def greatest_power(beta: float, rule: Integration, alpha_y: str, *, intruding: bool) -> float:
    """Greatest F·v of a leading plate over ζ, area, depth and speed [N/cm³], over all directions of motion.

    Positive: the grains would push the plate on. -inf: it leads in no direction. `intruding`: only directions that do
    not rise (γ >= 0).
    """
    # directions on the leading side, the same about the normal at every β
    normal, along = np.array([np.sin(beta), 0.0, -np.cos(beta)]), np.array([0.0, 1.0, 0.0])
    off, around = np.meshgrid(
        np.linspace(0.0, 0.499 * np.pi, _DIRECTIONS), np.linspace(0.0, 2.0 * np.pi, 2 * _DIRECTIONS)
    )
    aside = np.cos(around)[..., None] * along + np.sin(around)[..., None] * np.cross(normal, along)
    v = (np.cos(off)[..., None] * normal + np.sin(off)[..., None] * aside).reshape(-1, 3)
    v = v[v[:, 2] <= 0.0] if intruding else v
    if len(v) == 0:
        return -np.inf
    plates = plate_facing(beta, rule)
    force = wrenches(plates, law(alpha_y, zeta=1.0), scene_states(Rotation.identity(), velocity=v, height=-_DEPTH))
    return float((force[:, :3] * v).sum(axis=1).max() / (1e6 * plates.area * _DEPTH))


def withdrawal() -> StudyResult:
    """Vertical force against the direction of motion; greatest power against the attack angle."""
    sweeps = direction_sweeps()
    lines = [line for sweep in sweeps for line in measured(sweep)]
    figure = new_figure(8.4, 3.8)
    by_direction, by_angle = figure.subplots(1, 2)
    constant = [line for line in lines if line.alpha_y == "constant"]
    draw_lines(by_direction, constant, DEGREES, component=2, label="_{rule}")
    for line in constant[1::2]:
        at = int(0.8 * len(line.values))
        by_direction.text(
            np.degrees(line.values[at]),
            line.forces[at, 2] + 6.0,
            line.sweep.rpartition(", ")[2],
            fontsize=8,
            ha="right",
        )
    by_direction.plot([], [], color=RULE_COLOUR["centroid"], lw=2.4, label="centroid")
    by_direction.plot([], [], color=RULE_COLOUR["refined"], lw=1.4, label="refined")
    by_direction.axhline(0.0, color=BLACK, lw=0.6)
    label_axes(by_direction, x="Direction: up -90°, forwards 0, down 90°", y="Vertical force [N]", legend={})
    by_direction.set_title("A buried plate (3 mm thick)", fontsize=10)

    degrees = np.arange(0.0, 181.0, 2.0)
    for model, colour in zip(ALPHA_Y, (GREEN, PURPLE), strict=True):
        rules: tuple[tuple[Integration, str], ...] = (("centroid", "--"), ("refined", "-"))
        for rule, dash in rules:
            power = [greatest_power(b, rule, model, intruding=False) for b in np.radians(degrees)]
            by_angle.plot(degrees, power, dash, color=colour, label=f"α_y {model}, {rule}")
    by_angle.axhline(0.0, color=BLACK, lw=0.6)
    by_angle.axvline(0.2035 / 0.0015, color=GREY, lw=0.8, ls=":")
    by_angle.set_ylim(-0.15, 0.1)
    label_axes(
        by_angle, x="Attack angle β [°]", y="Greatest stress along the motion [N/cm³]", legend={"loc": "lower left"}
    )
    by_angle.set_title("Above 0 the grains drive the plate forward", fontsize=10)
    return jump_result("fails_withdrawal", "Withdrawal, and faces that look up and lead", figure, lines, DEGREES)


_SIZES = (1, 2, 4, 8, 16)  # facets along a side, in pairs


def turning_sweep(divisions: int = 1) -> Sweep:
    """An upright plate that turns about a vertical axis; the axis moves along the plate through its middle."""
    mesh = trimesh.creation.box((0.05, 0.05, 0.003))
    for _ in range(int(np.log2(divisions))):
        mesh = mesh.subdivide()

    def states(axis: Array) -> Array:
        # the axis at y = a: the origin moves with -ω x (0, a, 0)
        velocity = np.column_stack([axis, np.zeros_like(axis), np.zeros_like(axis)])
        about = Rotation.from_euler("y", -90.0, degrees=True)
        return scene_states(about, velocity=velocity, spin=(0.0, 0.0, 1.0))

    return Sweep(
        name=f"axis of turning, {len(mesh.faces)} facets",
        tool=both_rules(mesh),
        values=evenly(-0.04, 0.04, LENGTH_STEP),
        states=states,
    )


def turning() -> StudyResult:
    """Net force over the place of the axis, with 12 facets; jumps over the number of facets."""
    by_size = [measured(turning_sweep(n)) for n in _SIZES]
    lines = [line for lines in by_size for line in lines]
    coarse = [line for line in by_size[0] if line.alpha_y == "constant"]
    figure = new_figure(8.4, 3.6)
    force, sizes = figure.subplots(1, 2)
    draw_lines(force, coarse, MILLIMETRES, component=0, label="{rule}, 12 facets")
    fine = turning_sweep(16)
    exact = wrenches(fine.tool["refined"], law("constant", zeta=1.0), fine.states(fine.values))[:, 0]
    force.plot(1e3 * fine.values, exact, color=BLACK, lw=1.0, ls=":", label="refined, 3,072 facets")
    label_axes(force, x="Axis of turning, from the plate's middle [mm]", y="Net force along the normal [N]", legend={})
    force.set_title("An upright plate that turns about a vertical axis", fontsize=10)
    for rule in ("centroid", "refined"):
        count = [12 * n * n for n in _SIZES]
        jump = [100.0 * max(line.jump for line in lines if line.rule == rule) for lines in by_size]
        sizes.loglog(count, jump, "o-" if rule == "centroid" else "s--", ms=4, color=RULE_COLOUR[rule], label=rule)
    label_axes(sizes, x="Facets", y="Largest jump [% of the local force]", legend={})
    sizes.set_title("Each facet changes sides at once", fontsize=10)
    return jump_result("fails_turning", "Pure turning", figure, lines, MILLIMETRES)


def _coarse(kind: str) -> BothRules:
    mesh = trimesh.creation.box((0.05, 0.05, 0.003)) if kind == "plate" else trimesh.creation.icosphere(1, radius=0.025)
    return both_rules(mesh)


def height_sweeps() -> tuple[Sweep, ...]:
    """Heights through the surface of upright, level and leaning plates, a coarse ball, and shipped tools."""
    upright, leaning = Rotation.from_euler("y", -90.0, degrees=True), Rotation.from_euler("zyx", [0.3, 0.5, 0.2])
    level = Rotation.identity()
    cases: tuple[tuple[str, BothRules, Rotation, tuple[float, float, float]], ...] = (
        ("upright plate, 12 facets, entering", _coarse("plate"), upright, (0.01, 0.0, -0.003)),
        ("ball, 80 facets, entering", _coarse("ball"), level, (0.004, 0.0, -0.01)),
        ("ball, 80 facets, leaving", _coarse("ball"), level, (0.004, 0.0, 0.01)),
        ("level plate, 12 facets, entering", _coarse("plate"), level, (0.0, 0.0, -0.01)),
        *(
            (f"height of {name}", shipped(name), leaning, (0.004, 0.002, -0.01))
            for name in ("plate", "ellipsoid", "root_tip")
        ),
    )
    sweeps = []
    for name, tool, attitude, velocity in cases:

        def states(
            height: Array, attitude: Rotation = attitude, velocity: tuple[float, float, float] = velocity
        ) -> Array:
            return scene_states(attitude, velocity=velocity, height=height)

        sweeps.append(Sweep(name=name, tool=tool, values=evenly(-0.03, 0.03, LENGTH_STEP), states=states))
    return tuple(sweeps)


def surface() -> StudyResult:
    """Force over height of an upright plate and of a ball of few facets."""
    by_name = {sweep.name: measured(sweep) for sweep in height_sweeps()}
    lines = [line for lines in by_name.values() for line in lines]
    figure = new_figure(8.4, 3.6)
    plate, ball = figure.subplots(1, 2)
    constant = {name: [line for line in lines if line.alpha_y == "constant"] for name, lines in by_name.items()}
    draw_lines(plate, constant["upright plate, 12 facets, entering"], MILLIMETRES, label="{rule}")
    draw_lines(ball, constant["ball, 80 facets, entering"], MILLIMETRES, label="{rule}")
    for axes, title in ((plate, "Upright plate, 50 mm, 12 facets"), (ball, "Ball, 50 mm, 80 facets")):
        axes.axvline(0.0, color=BLACK, lw=0.5)
        label_axes(axes, x="Height of the middle over the surface [mm]", y="Force [N]", title=title, legend={})
    return jump_result("fails_surface", "At the surface", figure, lines, MILLIMETRES)


_SPEEDS = Unit(name="mm/s", per_si=1e3)

_STEP = 1e-5  # [m/s]

_RATE = 200.0  # [Hz] of the stroke in time

_MOBILIZATION_LENGTH = 0.003  # [m], the default of node and replay


def reversal_sweep() -> Sweep:
    """A plate whose vertical speed passes through zero while it drifts sideways at 0.01 mm/s."""
    values = evenly(-200.0 * _STEP, 200.0 * _STEP, _STEP)

    def states(speed: Array) -> Array:
        drift = np.full_like(speed, 1e-5)
        return scene_states(Rotation.identity(), velocity=np.column_stack([drift, 0.0 * drift, speed]))

    return Sweep(name="vertical speed through 0", tool=shipped("plate"), values=values, states=states)


def reversal() -> StudyResult:
    """Force over speed through zero, and over a stroke (down, rest, up) with and without memory."""
    lines = measured(reversal_sweep())
    figure = new_figure(8.4, 3.6)
    against_speed, over_time = figure.subplots(1, 2)
    draw_lines(against_speed, lines, _SPEEDS, component=2)
    label_axes(against_speed, x="Vertical speed [mm/s]", y="Vertical force [N]", legend={})
    against_speed.set_title("The sign of the speed decides, however slow", fontsize=10)

    times, states = _stroke()
    for rule, plates in reversal_sweep().tool.items():
        force = wrenches(plates, law("constant", zeta=1.0), states)[:, 2]
        over_time.plot(times, force, color=RULE_COLOUR[rule], lw=2.2 if rule == "centroid" else 1.0, label=rule)
        if rule == "refined":
            memory = Memory(plates)
            durations = np.diff(times, prepend=times[0])
            grains = law("constant", zeta=1.0, mobilization_length=_MOBILIZATION_LENGTH)
            held = wrenches_in_time(plates, grains, states, durations, memory)[:, 2]
            label = f"with memory, λ = {1e3 * _MOBILIZATION_LENGTH:g} mm"
            over_time.plot(times, held, color=GREEN, lw=2.0, ls="--", label=label, zorder=5)
    over_time.set_ylim(-95.0, 145.0)
    over_time.axvspan(2.0, 3.0, color="0.93")
    over_time.axhline(0.0, color=BLACK, lw=0.5)
    label_axes(over_time, x="Time [s]", y="Vertical force [N]", legend={"loc": "lower left"})
    over_time.set_title("Down, rest (shaded) with noise, up", fontsize=10)
    return jump_result("fails_reversal", "Rest and reversal", figure, lines, _SPEEDS)


def _stroke() -> tuple[Array, Array]:
    """Times [s] and states of a plate: 20 mm down, rest for a second, up; with noise of 0.03 mm/s."""
    times = np.arange(0.0, 5.0, 1.0 / _RATE)
    random = np.random.default_rng(0)
    speed = np.where(times < 2.0, -0.01, np.where(times < 3.0, 0.0, 0.01))
    height = -0.03 + np.concatenate([[0.0], np.cumsum(speed)[:-1]]) / _RATE
    noisy = random.normal(0.0, 3e-5, (len(times), 3))
    noisy[:, 2] += speed
    return times, scene_states(Rotation.identity(), velocity=noisy, height=height)


LIMIT = 0.02
"""Largest jump allowed under the refined rule, of the local force."""

_LEAST = 1e-7  # smaller jumps are drawn here


def overview() -> StudyResult:
    """The largest jump of each sweep with either α_y model."""
    sweeps = (
        *level_sweeps(),
        *yaw_sweeps(),
        wheel_sweep(),
        *direction_sweeps(),
        *height_sweeps(),
        reversal_sweep(),
        turning_sweep(1),
        turning_sweep(8),
    )
    found: dict[str, dict[Integration, float]] = {}
    for sweep in sweeps:
        lines = measured(sweep)
        found[sweep.name] = {rule: max(line.jump for line in lines if line.rule == rule) for rule in INTEGRATIONS}
    figure = new_figure(8.0, 6.2)
    axes = figure.subplots()
    place = np.arange(len(found))
    for rule, marker in zip(INTEGRATIONS, ("o", "s"), strict=True):
        jumps = [100.0 * max(jump[rule], _LEAST) for jump in found.values()]
        axes.semilogx(jumps, place, marker, ms=5, color=RULE_COLOUR[rule], label=rule)
    axes.axvline(100.0 * LIMIT, color=BLACK, lw=1.0, ls="--", label=f"limit for refined, {100.0 * LIMIT:.0f} %")
    axes.set_yticks(place, list(found), fontsize=7)
    axes.invert_yaxis()
    label_axes(axes, x="Largest jump over a step of 1e-4 rad, 1e-5 m or 1e-5 m/s [% of the local force]", y="Sweep")
    axes.legend(fontsize=8, loc="lower left")
    return by_rule_result(
        "fails_overview", "The largest jump of each sweep", figure, of="sweep", what="jump", values=found
    )
