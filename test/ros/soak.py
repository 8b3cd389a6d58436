"""``make soak``: a node under seeded random messages, valid and not, and parameter calls; no tick is unaccounted for.

Counts that the node reports must add up to the poses sent: each is an estimate or one of the reasons for a pose.
"""

import argparse
import math
import os
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rclpy
from distribution import own_domain
from harness import NodeProcess, parameters, stamp_of
from rcl_interfaces.srv import SetParameters

_POSE_REASONS = (
    "twist_missing",
    "twist_stale",
    "at_rest",
    "estimate_not_finite",
)  # and all that begin with pose_
_CALLS = {
    "medium.zeta": (0.5, 1, -1.0, "x"),
    "alpha_y.model": ("linear", "constant", "nonsense"),
    "mesh.file": ("sphere", "plate", "/none.stl"),
    "twist_source": ("pose_difference", "topic"),
    "max_input_age": (0.05,),
    "learning.lag": (0.005, 0.0),
    "learning.mode": ("observe", "apply"),
    "medium.zeta_error": (0.1,),
    "sensor.bias": ([1.0, 2.0, 3.0, 0.0, 0.0, 0.0], [math.nan] * 6),
    "sensor.quaternion": ([0.0, 0.0, 0.0, 0.0],),
    "no.such.parameter": (1.0,),
}


class Soaked(NamedTuple):
    """What came of it; memory in MB, of the second and the last tenth of the run."""

    poses: int
    answered: int
    estimates: int
    reasons: dict[str, int]
    calls: int
    first_mb: float
    last_mb: float

    @property
    def unaccounted(self) -> int:
        """Poses that the node has neither answered nor counted."""
        refused = (
            n for r, n in self.reasons.items() if r in _POSE_REASONS or r.startswith("pose_")
        )
        return self.poses - self.estimates - sum(refused)


def resident_mb(pid: int) -> float:
    return (
        int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20
    )


def soak(rft: NodeProcess, *, seconds: float, rate: float) -> Soaked:
    """Send at the rate; one message in ten is bad in a random way, one call in every half second of ticks."""
    random = np.random.default_rng(1)
    client = rft.node.create_client(SetParameters, f"{rft.name}/set_parameters")
    assert client.wait_for_service(timeout_sec=240.0)
    count, stamp, predicted = (
        round(seconds * rate),
        time.time_ns(),
        rft.received["wrench_predicted"],
    )
    calls = [(name, value) for name, values in _CALLS.items() for value in values]
    pending, memory = [], []
    start = time.monotonic()
    for k in range(count):
        for _ in range(8):  # also when late: answers that nobody takes are lost
            rft.executor.spin_once(timeout_sec=max(0.0, start + k / rate - time.monotonic()))
        stamp += round(1e9 / rate)
        when, inputs = _moment(random, stamp, k / rate)
        rft.send(when, **inputs)
        if (
            k % 50 == 49 and k > 100
        ):  # a busy machine may stall the node for longer than its queue lasts
            behind = stamp - round(100e9 / rate)
            rft.until(lambda behind=behind: predicted and stamp_of(predicted[-1]) >= behind)
        if k % round(rate / 2) == 0:
            memory.append(resident_mb(rft.process.pid))
            name, value = calls[int(random.integers(len(calls)))]
            pending.append(
                client.call_async(SetParameters.Request(parameters=parameters({name: value})))
            )
        if k % 5000 == 0:
            for messages in rft.received.values():
                messages.clear()
            rft.diagnostics.clear()
        assert rft.process.poll() is None, f"the node died with status {rft.process.returncode}"
    rft.until(lambda: all(f.done() for f in pending))
    rft.spin(1.0)
    inputs, estimates = rft.diagnostic("inputs")[2], rft.diagnostic("estimates")[2]
    reasons = {
        k.removeprefix("count."): int(v) for k, v in inputs.items() if k.startswith("count.")
    }
    answered = sum(f.result() is not None for f in pending)
    tenth = max(1, len(memory) // 10)
    first, last = (
        float(np.median(part or memory)) for part in (memory[tenth : 2 * tenth], memory[-tenth:])
    )
    return Soaked(count, answered, int(estimates["estimates"]), reasons, len(pending), first, last)


def _moment(random: np.random.Generator, stamp: int, t: float) -> tuple[int, dict[str, object]]:
    """A tool that goes in and out of grains whose strength changes, with noise in the load cell; or something bad."""
    z, vz = -0.02 + 0.03 * math.sin(t), 0.03 * math.cos(t)
    size = 1000.0 * (1.5 + math.sin(0.13 * t)) * max(-z, 0.0) * (vz < 0.0)
    force = tuple(random.normal((-0.1 * size, 0.0, size), 0.05 + 0.03 * size).tolist())
    inputs: dict[str, object] = {"z": z, "linear": (0.001, 0.0, vz), "force": force}
    if random.random() > 0.1:
        return stamp, inputs
    bad: list[tuple[int, dict[str, object]]] = [
        (stamp, {"z": math.nan}),
        (stamp, {"z": 1e300}),
        (stamp, {"quaternion": (0.0, 0.0, 0.0, 0.0)}),
        (stamp, {"quaternion": (math.inf, 0.0, 0.0, 1.0)}),
        (stamp, {"frame": "elsewhere"}),
        (stamp, {"frame": ""}),
        (0, {}),
        (stamp - 50_000_000, {}),
        (stamp, {"linear": (math.nan, 0.0, 0.0)}),
        (stamp, {"linear": (0.0, 0.0, 0.0)}),
        (stamp, {"linear": (1e300, -1e300, 1e300)}),
        (stamp, {"linear": None}),
        (stamp, {"force": None}),
        (stamp, {"force": (math.nan, math.inf, 0.0)}),
        (stamp, {"force": (1e9, -1e9, 1e9)}),
        (stamp, {"force": (0.0, 0.0, -size)}),
        (stamp, {"twist_stamp": 1}),
    ]
    when, change = bad[int(random.integers(len(bad)))]
    return when, inputs | change


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument(
        "--learning", choices=("off", "observe", "apply"), default="off", help="learning.mode"
    )
    arguments = parser.parse_args()
    os.environ.update(own_domain())
    rclpy.init()
    with tempfile.TemporaryDirectory() as folder:
        given = ("-p", "mesh.file:=plate", "-p", f"learning.mode:={arguments.learning}")
        rft = NodeProcess(*given, log=Path(folder) / "node.log").wait_ready()
        result = soak(rft, seconds=arguments.seconds, rate=500.0)
        status = rft.stop()
        print(result)
        print(
            f"unaccounted: {result.unaccounted}; growth: {result.last_mb - result.first_mb:.2f} MB; exit: {status}"
        )
        print("tracebacks:", rft.said().count("Traceback"))


if __name__ == "__main__":
    main()
