"""The load cell's range, units and place on the tool, and the strength of the grains."""

from collections.abc import Iterator, Mapping
from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from rft_ros.diagnosis.air import cross, noise
from rft_ros.diagnosis.attitude import fewer, mesh_turns, mount
from rft_ros.diagnosis.evidence import ENOUGH, LEAST_FORCE, Array, Evidence
from rft_ros.diagnosis.finding import Finding, in_words
from rft_ros.diagnosis.residual import LEAST_ZETA, MOST_ZETA, is_dry, residual, zeta_of
from rft_ros.parameters import Value
from rft_ros.rft import TORQUE

_WEAKEST = 0.5  # measured over predicted: beds differ by less once they are calibrated
_STRONGEST = 2.0
_UNITS = {"kgf": 9.80665, "lbf": 4.44822, "kN": 1e3, "mN": 1e-3, "gf": 9.80665e-3}  # N
_TURNED_AS_GOOD = 2.0  # residual of a turned mesh over the given one's, whose ζ no dry grains have
_SLACK = 0.002
# m, and this share of the tool's size: the model does not give the lever more exactly
_LEVER = 0.01
_LEVER_OF_SIZE = 0.25
_LONGEST_LEVER = 2.0  # m: a longer one comes from a torque in another unit
_NOISE_OF_LEVER = 0.1  # of the misfit of the torque; with more, no lever is judged
_EXPLAINED = 0.25  # of a misfit: the greatest rest under a hypothesis that explains it


def push(e: Evidence) -> Iterator[Finding]:
    """Whether grains have pushed the tool: what follows needs it."""
    if not e.push_is_seen:
        # if messages are missing, the push may have been among them
        advice = "push the tool down into the grains and run again"
        yield Finding(name="sign", ok=not e.complete, said="no push was seen", advice=advice)


def saturation(e: Evidence) -> Iterator[Finding]:
    """A component stays at its greatest reading while the prediction, which it followed so far, grows on.

    Readings count from the one in the air, which an offset or the tool's weight moves; without it nothing is known.
    """
    wet = e.at(e.in_grains)
    if not (e.air.is_enough and wet.is_enough):
        return
    zero = np.median(e.air.raw, axis=0)
    noise_of_raw = noise(e.raw)
    # the weight varies where the tool turns
    weight = wet.cell_along.weight - np.median(e.air.cell_along.weight, axis=0)
    for axis, side in product(range(3), (1.0, -1.0)):
        reading = side * (wet.raw - zero)[:, axis]
        expected = side * (wet.predicted + weight)[:, axis]
        top = float(np.quantile(reading, 0.995))
        below = (reading > 0.2 * top) & (reading < 0.9 * top)
        band = max(4.0 * noise_of_raw[axis], 1e-6 * abs(top))
        at_top = reading >= top - band
        if top < LEAST_FORCE or min(below.sum(), at_top.sum()) < ENOUGH:
            continue
        followed = (reading * expected)[below].sum() / max((expected[below] ** 2).sum(), 1e-12)
        beyond = followed * expected[at_top] / top
        least, low, high = np.quantile(beyond, (0.1, 0.2, 0.9))
        grows = low > 0.9 and high > 1.15 and high - least > max(0.1, 2.0 * band / top)
        if followed > 0.0 and grows:
            limit = float(side * top + zero[axis])
            greatest = float(beyond.max())
            said = f"the force along {'xyz'[axis]} stays at {limit:.3g} N"
            yield Finding(
                name="saturation",
                said=f"{said}; the model's grows to {greatest:.2g} times it",
                evidence={"limit": limit},
                advice="set a larger range in the load cell or its driver, or press less",
            )


def torque(e: Evidence) -> Iterator[Finding]:
    """Another place of the sensor, or a torque in N mm beside a force in N.

    Expected is the torque of the measured force, where the model's acts: the strength of the grains has no part in it.
    """
    has_torque = np.any(e.measured[:, TORQUE] != e.measured[:1, TORQUE])
    if not (e.air.is_enough and has_torque and all(finding.ok for finding in mount(e))):
        return
    model = e.push.model
    tool = np.array(e.load_cell.place.inverse().position)
    about_tool = e.push.predicted[:, TORQUE] - np.cross(tool, model)
    square = np.maximum((model**2).sum(axis=1, keepdims=True), 1e-12)
    expected = np.cross(tool + np.cross(model, about_tool) / square, e.push.force)
    measured = e.push.measured[:, TORQUE]
    found = list(_lever(e, measured - expected))
    yield from found
    ratio = float((measured * expected).sum() / max((expected**2).sum(), 1e-12))
    alike = ratio * np.sqrt((expected**2).sum() / max((measured**2).sum(), 1e-12))
    if not found and alike > 0.9 and not 0.03 < ratio < 30.0:
        yield Finding(
            name="units of torque",
            said=f"the torque is {ratio:.3g} times that of the measured force at its lever",
            evidence={"ratio": ratio},
            advice="the driver must give N m, and not N mm or kN m",
        )


def _lever(e: Evidence, missing: Array) -> Iterator[Finding]:
    """The place of the sensor that explains a missing torque [N m], shape [m, 3].

    It is fitted to half of the moments, and judged on the other. It must explain what neither a wrong weight of the
    tool does nor the noise, which the measured force has, too.
    """
    of_weight = cross(e.push.down).reshape(-1, 3)

    def without_weight(part: Array) -> Array:
        return np.asarray(part - of_weight @ np.linalg.lstsq(of_weight, part, rcond=None)[0])

    rest = without_weight(missing.ravel())
    of_shift = without_weight(cross(e.push.force).reshape(-1, 3))
    scatter = 0.5 * (np.diff(rest.reshape(-1, 3), axis=0) ** 2).sum()
    part = np.repeat(np.arange(len(missing)) // ENOUGH % 2 == 0, 3)
    if part.all() or scatter > _NOISE_OF_LEVER * (rest**2).sum():
        return
    shift = np.linalg.lstsq(of_shift[part], rest[part], rcond=0.1)[0]
    left = ((rest - of_shift @ shift)[~part] ** 2).sum() / max((rest[~part] ** 2).sum(), 1e-12)
    moved = float(np.linalg.norm(shift))
    if left > _EXPLAINED or not _LEVER + _LEVER_OF_SIZE * e.tool.size < moved < _LONGEST_LEVER:
        return
    turned = Rotation.from_quat(e.load_cell.quaternion).apply(shift)
    place = tuple(np.round(np.array(e.load_cell.position) + turned, 3).tolist())
    remedy: dict[str, Value] = {"sensor.position": place}
    advice = []
    if e.place_parameter:
        remedy = {}
        advice.append(f"correct {e.place_parameter} to the position {in_words(place)}")
    if np.linalg.cond(of_shift[part]) > 10.0:
        advice.append("mind that it is not known along the force")
    millimetres = 1e3 * moved
    percent = 100.0 * float(np.sqrt(left))
    yield Finding(
        name="lever",
        said=f"a sensor {millimetres:.0f} mm away explains the torque; {percent:.0f} % of the misfit remain",
        evidence={"millimetres": millimetres},
        remedy=remedy,
        advice="; ".join(advice),
    )


def strength(e: Evidence) -> Iterator[Finding]:
    """Measured over predicted force; far from 1 it comes from a unit, a scale or the medium, or the mesh is turned."""
    zeta = zeta_of(e)
    ratio = zeta / e.law.zeta
    said = f"measured over predicted force {ratio:.3g}"
    evidence = {"ratio": ratio, "zeta": zeta}
    if _WEAKEST <= ratio <= _STRONGEST:
        yield Finding(name="strength", ok=True, said=said, evidence=evidence)
        return
    unit = min(_UNITS, key=lambda name: abs(np.log(max(ratio, 1e-9) * _UNITS[name])))
    like = f" (as if it were {unit})" if 0.4 < ratio * _UNITS[unit] < 2.5 else ""
    remedy: Mapping[str, Value] = {"medium.zeta": zeta}
    if not is_dry(zeta):
        said += f", a ζ of {zeta:.2g}; dry grains have {LEAST_ZETA:g} to {MOST_ZETA:g}"
        few = fewer(e)
        most = _TURNED_AS_GOOD * residual(few) + _SLACK
        turns = [x for x in mesh_turns(few) if x.residual <= most]
        remedy = min(turns, key=lambda x: x.residual).remedy if turns else {}
    yield Finding(
        name="strength",
        said=said,
        evidence=evidence,
        remedy=remedy,
        advice=f"check mesh.scale and the driver's unit, which is N{like}",
    )
