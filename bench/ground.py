"""What a map of the ground costs a tick: ``python -m bench.ground``.

An estimator on a level plane and one on a map of 2 mm cells over 1 m², in turn; ellipsoid, 2,352 plates; medians of 200
turns of 200 poses each.
"""

import gc
import time
from statistics import median

import numpy as np

from rft_ros.estimator import Estimate, Estimator, PoseSample, TwistSample, WrenchSample
from rft_ros.ground import Cloud
from rft_ros.parameters import Config

CELL = 0.002
POINTS = 300_000
RATE = 500
START = 10**18


def cloud() -> Cloud:
    """A bed of 1 m² as a camera sees it: waves 5 mm high, noise of 0.5 mm."""
    generator = np.random.default_rng(1)
    x, y = generator.uniform(-0.5, 0.5, (2, POINTS))
    z = 0.005 * np.sin(20.0 * x) * np.cos(15.0 * y) + generator.normal(0.0, 0.0005, POINTS)
    return Cloud(START + 1, "world", *np.array([x, y, z], dtype=np.float32))


def estimator(cell: float, learning: str, memory: float) -> Estimator:
    """With the full ellipsoid."""
    values = {**Config().values, "mesh.file": "ellipsoid", "tolerance": 0.0, "ground.cell": cell}
    values |= {"medium.mobilization_length": memory, "learning.mode": learning}
    config = Config.of(values)
    return Estimator(config, config.model())


def tick_times(e: Estimator, first: int, count: int) -> list[float]:
    """Time of each push_pose [us]: the tool is drawn to and fro at 0.1 m/s, 10 mm deep, and lifted at each end."""
    found = []
    for k in range(first, first + count):
        row, along = divmod(0.1 * k / RATE, 0.8)
        sign = 1.0 if row % 2 == 0 else -1.0
        stamp = START + k * (10**9 // RATE)
        place = sign * (along - 0.4), -0.4 + 0.04 * (row % 20), 0.02 if along < 0.05 else -0.01
        e.push(WrenchSample(stamp, "ft_sensor", (-sign, 0.0, 1.0, 0.0, 0.0, 0.0)))
        e.push(TwistSample(stamp, "world", (0.1 * sign, 0.0, 0.0), (0.0, 0.0, 0.0)))
        start = time.perf_counter_ns()
        answer = e.push_pose(PoseSample(stamp, "world", place, (0.0, 0.0, 0.0, 1.0)))
        found.append(1e-3 * (time.perf_counter_ns() - start))
        assert isinstance(answer, Estimate), answer
        e.measurements()
    return found


def main() -> None:
    cases = (
        ("as published", "off", 0.0),
        ("memory", "off", 0.003),
        ("memory, learning", "apply", 0.003),
    )
    for name, learning, memory in cases:
        level, mapped = (estimator(cell, learning, memory) for cell in (0.0, CELL))
        for e in (level, mapped):
            tick_times(e, 1, 1)
            if e is mapped:
                e.push(cloud())
            tick_times(e, 2, RATE)
        gc.collect()
        gc.freeze()
        turns = [
            [median(tick_times(e, 200 * k, 200)) for e in (level, mapped)] for k in range(3, 203)
        ]
        on_level, on_map = np.median(turns, axis=0)
        ratio = median(b / a for a, b in turns)
        assert mapped.ground is not None
        known = len(mapped.ground.points())
        print(
            f"{name}: level plane {on_level:.1f} us, map of {known:,} cells {on_map:.1f} us, ratio {ratio:.2f}"
        )


if __name__ == "__main__":
    main()
