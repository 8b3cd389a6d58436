"""Random estimators under random samples, good and hostile: each pose has an answer, each number is finite.

An estimator is made of random parameters, some of them at the ends of what the table allows. Its samples are those of a
tool that goes in and out of the grains; some have NaN, infinity, 1e308 or denormals, millimetres in place of metres,
quaternions of another length, stamps that are 0, go back or lie far ahead, or strange frames.
"""

import math
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import Any

import numpy as np

from rft_ros.errors import InputError
from rft_ros.estimator import (
    Estimate,
    Estimator,
    NoEstimate,
    PoseSample,
    Reason,
    Sample,
    TransformSample,
    TwistSample,
    WrenchSample,
)
from rft_ros.ground import Cloud
from rft_ros.parameters import (
    PARAMETERS,
    Config,
    Parameter,
    checked,
)
from rft_ros.rft import Law

Random = np.random.Generator

NUMBERS = (
    *(math.nan, math.inf, -math.inf, 0.0, -0.0, 5e-324, -5e-324, 1e-310, 1e-200, 1e-12),
    *(1.0, -1.0, 1e3, -2e4, 1e12, 1e99, 1e101, -1e160, 1e200, 1e300, 1e308, -1.7e308),
)
NAMES = (
    *("", "world", "tool", "ft_sensor", "base", "wörld", "世界"),
    *("a" * 256, "wor ld", "world/", "\u202eworld", "w\nd"),
)
_PERIOD = 4_000_000  # ns between two poses
_FIXED = (
    "mesh.file",
    "medium.file",
    "alpha_y.table",
    "ground.file",
    "tolerance",
    "executor",
)  # not random
_ANSWER = 1e100  # greatest size of a component of an answer [N], [N m]


def _value(random: Random, parameter: Parameter) -> object:
    """A value of a parameter: often one that it takes, sometimes the end of its range, sometimes anything."""
    default = parameter.default
    if parameter.choices:
        return str(random.choice(parameter.choices))
    if isinstance(default, str):
        return str(random.choice(NAMES))
    if isinstance(default, bool):
        return bool(random.integers(2))
    low, high = np.clip(parameter.bounds, -1e308, 1e308).tolist()
    size = 1 if isinstance(default, float) else len(default)
    numbers = [
        float(
            random.choice(
                [default if size == 1 else default[k], low, high, random.choice(NUMBERS), 0.01]
            )
        )
        for k in range(size)
    ]
    if parameter.unit == "xyzw" and random.random() < 0.8:
        numbers = random.standard_normal(4).tolist()
        numbers = [n / math.hypot(*numbers) for n in numbers]
    return numbers[0] if size == 1 else tuple(numbers)


def random_values(random: Random, *, most: int = 5) -> dict[str, Any]:
    """Parameters of a node, checked: the defaults, and up to `most` that are random."""
    values = {
        **Config().values,
        "tolerance": 0.0,
        "mesh.file": str(random.choice(["plate", "sphere", "root_tip"])),
    }
    values["learning.mode"] = str(random.choice(["off", "observe", "apply"]))
    for parameter in random.choice(
        np.array(PARAMETERS, dtype=object), size=random.integers(most + 1)
    ):
        if parameter.name in _FIXED or parameter.name == "alpha_y.model":
            continue
        with suppress(InputError):
            values[parameter.name] = checked(parameter.name, _value(random, parameter))
    return values


def _hostile(random: Random, sample: Any) -> Any:
    """The sample with one field that is hostile."""
    changes: dict[str, Any] = {}
    numbers = [
        n for n in sample._fields if n in ("position", "quaternion", "linear", "angular", "wrench")
    ]
    kind = random.integers(4)
    if kind == 0 and numbers:
        name = str(random.choice(numbers))
        found = [
            float(random.choice(NUMBERS)) if random.random() < 0.4 else v
            for v in getattr(sample, name)
        ]
        changes[name] = tuple(found)
    elif kind == 1 and numbers:  # millimetres, or a quaternion of another length
        name = str(random.choice(numbers))
        factor = float(random.choice([1e3, 0.0, 1e-3, 1.005, 1.02, -1.0, 1e-320]))
        changes[name] = tuple(factor * v for v in getattr(sample, name))
    elif kind == 2:
        stamp = sample.stamp
        at = [
            0,
            -1,
            1,
            stamp,
            stamp - 1,
            stamp - 50_000_000,
            stamp - 3 * 10**9,
            stamp + 10**9,
            2**31 * 10**9 - 1,
        ]
        changes["stamp"] = at[random.integers(len(at))]
    elif isinstance(sample, TransformSample):
        changes[str(random.choice(["parent", "child"]))] = str(random.choice(NAMES))
    else:
        changes["frame"] = str(random.choice(NAMES))
    return sample._replace(**changes)


def _cloud(random: Random, stamp: int, frame: str) -> Cloud:
    count = int(random.choice([0, 1, 30, 3000]))
    points = random.uniform((-0.1, -0.1, -0.02), (0.1, 0.1, 0.02), (count, 3))
    if count and random.random() < 0.3:
        points[random.integers(count), random.integers(3)] = float(random.choice(NUMBERS))
    kind = random.choice(["<f4", ">f8", "<f8"])
    with np.errstate(all="ignore"):
        return Cloud(stamp, frame, *(points[:, k].astype(kind) for k in range(3)))


def random_samples(
    random: Random, values: dict[str, Any], count: int, *, hostile: float
) -> Iterator[Sample]:
    """The samples of a tool that goes in and out of the grains; `hostile`: the share of them with a hostile field."""
    start = int(random.choice([1, 10**9, 1_600_000_000 * 10**9, 2**31 * 10**9 - 10**10]))
    scale = 1e3 if random.random() < 0.05 else 1.0  # of a driver that gives millimetres
    world, tool, sensor = (values[f"{name}_frame"] for name in ("world", "tool", "sensor"))
    surface, spin = values["surface_height"], random.normal(0.0, 0.3, 3)
    fixed = [TransformSample(start, world, "base", (0.1, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), True)]
    fixed.append(TransformSample(start, tool, sensor, (0.0, 0.0, 0.1), (0.0, 0.0, 0.0, 1.0), True))
    yield tuple(fixed)
    for k in range(count):
        stamp, t = start + k * _PERIOD, 4e-9 * k * 1e6
        z, vz = surface - 0.02 + 0.03 * math.cos(3.0 * t), -0.09 * math.sin(3.0 * t)
        turn = np.array([*np.sin(0.5 * spin * t), 1.0])
        quaternion = tuple((turn / np.linalg.norm(turn)).tolist())
        place, speed = (scale * 0.02 * t, 0.0, scale * z), (scale * 0.02, 0.0, scale * vz)
        force = tuple(random.normal(0.0, 0.1 + 100.0 * max(surface - z, 0.0), 6).tolist())
        moment: list[Any] = [
            WrenchSample(stamp, sensor, force),
            TwistSample(stamp, world, speed, tuple(spin.tolist())),
            PoseSample(stamp, world, place, quaternion),
            TransformSample(stamp, "base", tool, place, quaternion),
        ]
        if k % 50 == 0:
            moment.append(_cloud(random, stamp, world))
        if random.random() < 0.05:
            random.shuffle(moment)
        for sample in moment:
            if not isinstance(sample, Cloud) and random.random() < hostile:
                sample = _hostile(random, sample)
            yield (sample,) if isinstance(sample, TransformSample) else sample


def _change(random: Random, estimator: Estimator, values: dict[str, Any]) -> None:
    """What a user does between two samples; each works, or raises InputError."""
    deeds: list[Callable[[], object]] = [
        lambda: estimator.tare(float(random.choice([0.0, 0.1, 1.0, 1e9]))),
        lambda: estimator.use(config=Config.of({**values, **_changed(random, values)})),
        lambda: estimator.use(
            model=Config.of({**values, **_changed(random, values)}).model(generation=1)
        ),
        estimator.level_ground,
        estimator.issues,
        estimator.unknown_frames,
        estimator.counted,
        estimator.forget,
        lambda: (
            estimator.learning and (estimator.learning.belief(), estimator.learning.strength())
        ),
    ]
    try:
        deeds[random.integers(len(deeds))]()
    except InputError as error:
        assert "\n" not in str(error), f"not one sentence: {error}"


def _changed(random: Random, values: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in random_values(random).items() if value != values[name]}


def run(seed: int, *, count: int = 150) -> tuple[list[object], Law | None]:
    """What a random estimator answers to `count` random moments; the law of its model, None if there is no model.

    Raises AssertionError for an answer that is none, and whatever the estimator raises.
    """
    random = np.random.default_rng(seed)
    values = random_values(random)
    try:
        config = Config.of(values)
        estimator = Estimator(config, config.model())
    except InputError as error:
        assert "\n" not in str(error), f"not one sentence: {error}"
        return [str(error)], None
    answers: list[object] = []
    hostile = float(random.choice([0.0, 0.03, 0.3]))
    for sample in random_samples(random, values, count, hostile=hostile):
        for pose, answer in estimator.answers(sample):
            _check(answer, pose)
            answers.append(answer)
        if random.random() < 0.01:
            _change(random, estimator, values)
    estimator.finish()
    for measurement in estimator.measurements():
        for wrench in (measurement.compensated, measurement.residual):
            assert wrench is None or all(map(math.isfinite, wrench[:3])), measurement
        answers.append(measurement)
    estimates = sum(isinstance(answer, Estimate) for answer in answers)
    assert estimator.estimates == estimates
    assert set(estimator.counts) <= set(Reason)
    if estimator.learning is not None:
        assert np.isfinite(estimator.learning.belief()).all()
    return answers, estimator.model.law


def fuzz(*, seconds: float, first: int = 0) -> tuple[Counter[str], list[str]]:
    """Try random estimators for so many seconds, each twice; how many of each answer, and a traceback of each fault."""
    outcomes, findings, seed, ends = Counter[str](), list[str](), first, time.monotonic() + seconds
    while time.monotonic() < ends:
        try:
            answers, law = run(seed)
            assert repr(run(seed)) == repr((answers, law)), "the same samples gave other answers"
            outcomes.update(f"estimator: {_kind(answer)}" for answer in answers)
        except Exception:
            findings.append(f"estimator {seed}: {traceback.format_exc()}")
            print(findings[-1])
        seed += 1
    return outcomes, findings


def _kind(answer: object) -> str:
    return answer.reason.value if isinstance(answer, NoEstimate) else type(answer).__name__


def _check(answer: object, pose: PoseSample) -> None:
    assert isinstance(answer, Estimate | NoEstimate), f"{pose}: {answer}"
    assert answer.stamp == pose.stamp
    if isinstance(answer, Estimate):
        assert all(abs(number) < _ANSWER for number in answer.predicted), answer
        assert all(0.0 <= number < _ANSWER for number in answer.sigma), answer
        assert 0.0 <= answer.speed_bound < math.inf, answer
        assert 0.0 <= answer.submerged_area < math.inf, answer
