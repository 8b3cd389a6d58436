"""``make bench``: the compiled kernel beside plain NumPy, in ns per plate element, forces and torques.

Kernel and NumPy take turns in one process; figures are medians, ratios medians of each turn's ratio. One state runs on
one core, a batch on all. The body is an ellipsoid, buried, pitching on its way down: half of its plates lead.
"""

import os
import platform
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from statistics import median

import numba
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from rft_ros.rft import (
    COLUMNS,
    INTEGRATIONS,
    LEVEL,
    MEDIA,
    SENSITIVITIES,
    Law,
    Memory,
    Plates,
    alpha_y_model,
    checked_states,
    treers2021,
    wrenches,
)
from rft_ros.rft import Table as AlphaYTable
from rft_ros.rft.wrench import prepared
from rft_ros.tool import load_tool
from studies import numpy_rft

GENERIC = MEDIA["generic"]
ZETA = 0.33
STATE = (0, 0, -0.05, 0, 0, 0, 1, 0.001, 0.002, -0.005, 0, 0.3, 0)
TURNS = 15
TURN_SECONDS = 0.02
BATCH_ELEMENTS = 4_000_000
BETA = np.deg2rad(np.arange(-90.0, 271.0, 15.0))
GAMMA = np.deg2rad(np.arange(-180.0, 181.0, 30.0))
TABLE = AlphaYTable.sampled(BETA, GAMMA, 0.1 + 0.02 * np.cos(BETA)[:, None] + 0.01 * np.sin(GAMMA))
TARGET = 33.0  # times NumPy, at the ellipsoid's 2,352 elements, one state on one core

Array = NDArray[np.float64]


def ellipsoid(n: int) -> Plates:
    """The paper's ellipsoid (36 x 19 x 19 mm) as n plates on a Fibonacci lattice."""
    i = np.arange(n) + 0.5
    z = 1.0 - 2.0 * i / n
    turn = np.pi * (1.0 + 5.0**0.5) * i
    h = np.sqrt(1.0 - z * z)
    sphere = np.stack([h * np.cos(turn), h * np.sin(turn), z], axis=1)
    axes = np.array([0.0095, 0.0095, 0.018])
    gradient = sphere / axes
    areas = np.linalg.norm(gradient, axis=1) * axes.prod() * 4.0 * np.pi / n
    return Plates.from_arrays(sphere * axes, gradient, areas)


def pin(cores: set[int] | None) -> None:
    """Run on these cores only, where the system can do that."""
    if cores and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, cores)


def cpu_model() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def seconds(call: Callable[[], object], times: int) -> float:
    start = time.perf_counter()
    for _ in range(times):
        call()
    return (time.perf_counter() - start) / times


def in_turns(calls: list[Callable[[], object]]) -> list[list[float]]:
    """Seconds of each call in each of its turns: one list a call."""
    times = [
        max(1, round(TURN_SECONDS / min(seconds(call, 1) for _ in range(3)))) for call in calls
    ]
    turns = [
        [seconds(call, n) for call, n in zip(calls, times, strict=True)] for _ in range(TURNS)
    ]
    return [list(of_call) for of_call in zip(*turns, strict=True)]


def ratio(slow: list[float], fast: list[float]) -> float:
    return median(s / f for s, f in zip(slow, fast, strict=True))


def agree(actual: Array, expected: Array) -> None:
    """Stop unless forces, and torques, are equal to 1e-9 of their largest component."""
    for columns in (slice(0, 3), slice(3, 6)):
        error = np.abs(actual[columns] - expected[columns]).max() / np.abs(expected[columns]).max()
        assert error < 1e-9, f"the kernel and the NumPy version differ by {error:.1e}"


def measured(
    plates: Plates, law: Law, alpha_y: numpy_rft.AlphaY, cores: set[int]
) -> tuple[list[str], float]:
    """A row of the table, and the kernel's advantage over NumPy on one state."""
    n = len(plates)
    state = checked_states(STATE)

    def by_numpy(live_only: bool) -> Array:
        return numpy_rft.wrench(plates, GENERIC, ZETA, alpha_y, state[0], live_only=live_only)

    one = wrenches(plates, law, state, threads=1)[0]
    agree(one, by_numpy(False))
    agree(one, by_numpy(True))
    pin({min(cores)} if cores else None)
    kernel, plain, live = in_turns(
        [
            lambda: wrenches(plates, law, state, threads=1),
            lambda: by_numpy(False),
            lambda: by_numpy(True),
        ]
    )

    pin(cores)
    states = np.repeat(state, max(len(cores) or 1, BATCH_ELEMENTS // n), axis=0)
    batch, beside = in_turns([lambda: wrenches(plates, law, states), lambda: by_numpy(False)])
    per_state = [seconds_of_batch / len(states) for seconds_of_batch in batch]
    columns = [
        *(f"{median(t) / n * 1e9:.1f}" for t in (kernel, plain, live)),
        f"{ratio(plain, kernel):.1f}",
        f"{ratio(live, kernel):.1f}",
        f"{median(per_state) / n * 1e9:.2f}",
        f"{ratio(beside, per_state):.0f}",
    ]
    return columns, ratio(plain, kernel)


def rules(cores: set[int]) -> Table:
    """The rules of integration, without and with memory: the ellipsoid deep, and half buried."""
    table = Table(
        title="Rules, 2,352 elements, one state on one core: ns per plate element, and over the published rule"
    )
    for heading in ("α_y", "scene", "rule", "plain", "x published", "memory", "x plain"):
        table.add_column(heading, justify="right", no_wrap=True)
    pin({min(cores)} if cores else None)
    tools = {rule: load_tool("ellipsoid", integration=rule).plates for rule in INTEGRATIONS}
    for name in ("constant", "linear", "table"):
        law = treers2021(
            GENERIC, alpha_y_model(name, GENERIC, TABLE), zeta=ZETA, mobilization_length=3e-3
        )
        for scene, height in (("deep", -0.05), ("half buried", 0.0)):
            state = checked_states(STATE)
            state[0, 2] = height
            still = np.zeros((1, 12))
            calls: list[Callable[[], object]] = []
            for plates in tools.values():
                out = np.empty((1, len(COLUMNS) + len(SENSITIVITIES)))
                for memory in (None, Memory(plates)):
                    step = prepared(plates, memory)
                    calls.append(partial(step, law.packed, state, 0.0, LEVEL, still, out))
            turns = in_turns(calls)
            for k, (rule, plates) in enumerate(tools.items()):
                without, with_memory = turns[2 * k : 2 * k + 2]
                table.add_row(
                    *(
                        name,
                        scene,
                        rule,
                        f"{median(without) / len(plates) * 1e9:.1f}",
                        f"{ratio(without, turns[0]):.2f}",
                    ),
                    *(
                        f"{median(with_memory) / len(plates) * 1e9:.1f}",
                        f"{ratio(with_memory, without):.2f}",
                    ),
                )
    pin(cores)
    return table


def main() -> int:
    cores: set[int] = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()
    console = Console(width=100)
    console.print(
        f"{cpu_model()}, {len(cores) or os.cpu_count()} cores; Python {platform.python_version()},"
        f" NumPy {np.__version__}, numba {numba.__version__}"
    )
    table = Table(
        title="Force and torque: ns per plate element, and how many times faster than NumPy"
    )
    table.caption = (
        "live: NumPy picks out the plates that carry a force first; "
        "batch: all cores, beside NumPy on one state"
    )
    for heading in (
        "elements",
        "α_y",
        "kernel",
        "NumPy",
        "live",
        "x NumPy",
        "x live",
        "batch",
        "x NumPy",
    ):
        table.add_column(heading, justify="right", no_wrap=True)
    bodies = {n: ellipsoid(n) for n in (100, 1_000)}
    shipped = load_tool("ellipsoid", integration="centroid").plates
    bodies[len(shipped)] = shipped
    bodies |= {n: ellipsoid(n) for n in (10_000, 100_000)}
    advantage = {}
    for n, plates in bodies.items():
        for name, alpha_y in (
            ("constant", numpy_rft.constant(GENERIC)),
            ("linear", numpy_rft.linear),
        ):
            law = treers2021(GENERIC, alpha_y_model(name, GENERIC), zeta=ZETA)
            row, advantage[n, name] = measured(plates, law, alpha_y, cores)
            table.add_row(f"{n:,}", name, *row)
    console.print(table)
    console.print(rules(cores))
    many = np.repeat(checked_states(STATE), 10_000, axis=0)
    law = treers2021(GENERIC, alpha_y_model("constant", GENERIC), zeta=ZETA)
    wrenches(shipped, law, many)
    batch = median(seconds(lambda: wrenches(shipped, law, many), 1) for _ in range(7))
    console.print(f"10,000 states of the {len(shipped):,} elements on all cores: {batch:.3f} s")
    reached = ", ".join(
        f"{advantage[len(shipped), name]:.1f} {name}" for name in ("constant", "linear")
    )
    console.print(
        f"Target {TARGET:g} times NumPy at {len(shipped):,} elements, one state, one core: {reached}"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
