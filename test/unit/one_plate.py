"""A tool of one plate, and samples for it: what the estimator's tests push."""

import math
from collections import Counter
from dataclasses import replace

import numpy as np

from rft_ros.estimator import (
    Estimator,
    Measurement,
    PoseSample,
    Reason,
    TransformSample,
    TwistSample,
    WrenchSample,
)
from rft_ros.parameters import PARAMETERS, Config, LoadCell, Model
from rft_ros.rft import MEDIA, Plates, alpha_y_model, treers2021
from rft_ros.tool import Tool

SECOND = 1_000_000_000
MS = SECOND // 1000
START = 100 * SECOND
LEVEL = (0.0, 0.0, 0.0, 1.0)
AREA = 4e-4
"""One plate of 4 cm² at the tool frame's origin that faces down: 4 N for each cm of depth when it is pushed down."""


def plate_tool(*, distance: float = 0.0) -> Tool:
    """`distance` of the plate from the tool frame's origin, along y."""
    corners = np.array([[-0.01, -0.01, 0.0], [0.01, -0.01, 0.0], [0.0, 0.03, 0.0]])
    plates, faces = (
        Plates.from_arrays([[0, distance, 0]], [[0, 0, -1]], [AREA]),
        np.array([[0, 2, 1]]),
    )
    return Tool(
        name="one",
        file="",
        plates=plates,
        facets=plates,
        vertices=corners,
        faces=faces,
        issues={},
        corners=corners,
    )


def plate_model(*, generation: int = 0, tool: Tool | None = None, **grains: float) -> Model:
    """`grains`: zeta, density, mobilization_length."""
    generic = MEDIA["generic"]
    law = treers2021(generic, alpha_y_model("constant", generic), **grains)
    return Model(tool=tool or plate_tool(), law=law, generation=generation)


_NAMES = {parameter.name.replace(".", "_"): parameter.name for parameter in PARAMETERS}


def config(of: Config | None = None, *, sensor: LoadCell | None = None, **values) -> Config:
    """With these values of parameters, whose names have _ for the dot, and this load cell; otherwise as `of`."""
    made = (of or Config()).changed({_NAMES[name]: value for name, value in values.items()})
    return replace(made, sensor=sensor or made.sensor)


def estimator(
    *, sensor: LoadCell | None = None, model: Model | None = None, **values
) -> Estimator:
    """`values`: as of `config`."""
    return Estimator(config(sensor=sensor, **values), model or plate_model())


def use(
    e: Estimator, *, sensor: LoadCell | None = None, model: Model | None = None, **values
) -> None:
    """Change some values of parameters, as of `config`."""
    e.use(config=config(e.config, sensor=sensor, **values), model=model)


def push(e, *samples):
    """Push samples; the answer to the last one, or the reason that it was counted under."""
    for sample in samples:
        before = Counter(e.counts)
        answer = e.push((sample,) if isinstance(sample, TransformSample) else sample)
    return answer or next(map(Reason, e.counts - before), None)


def measurement(e) -> Measurement:
    """The load cell's answer to the last estimate, with no sample to follow."""
    e.finish()
    return e.measurements()[-1]


def pose(stamp=START, position=(0.0, 0.0, -0.01), quaternion=LEVEL, frame="world") -> PoseSample:
    """By default the tool frame's origin 1 cm under the surface."""
    return PoseSample(stamp, frame, position, quaternion)


def twist(
    stamp=START, linear=(0.0, 0.0, -0.01), angular=(0.0, 0.0, 0.0), frame="world"
) -> TwistSample:
    """By default straight down at 1 cm/s."""
    return TwistSample(stamp, frame, linear, angular)


def wrench(stamp=START, numbers=(0.0,) * 6, frame="ft_sensor") -> WrenchSample:
    return WrenchSample(stamp, frame, tuple(float(n) for n in numbers))


def about(axis, degrees) -> tuple[float, float, float, float]:
    """The quaternion of a turn about a unit axis."""
    s, c = math.sin(math.radians(degrees) / 2), math.cos(math.radians(degrees) / 2)
    return axis[0] * s, axis[1] * s, axis[2] * s, c
