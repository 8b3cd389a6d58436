"""What is told of a cell: the findings of its diagnosis, each with a sentence, a remedy and what to do."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from rft_ros.diagnosis.evidence import Evidence
from rft_ros.diagnosis.finding import Finding, in_words
from rft_ros.diagnosis.fit import MAX_USUAL_ZETA, MIN_USUAL_ZETA, rows_of
from rft_ros.diagnosis.hypotheses import UNITS_N, Cause, Explanation
from rft_ros.diagnosis.search import MAX_RIGHT_FACTOR, Diagnosis, Found, mended, unsure_numbers
from rft_ros.parameters import Value
from rft_ros.rft import FORCE

ADVICE = {
    Cause.PAYLOAD: "correct the payload in the driver",
    Cause.SURFACE: "check mesh.origin and the arm's TCP if the height was measured",
    Cause.DELAY: "fit it with rft calibrate",
    Cause.FILTER: "raise the cut-off frequency in the load cell's driver",
    Cause.TORQUE_UNIT: "the driver must give N m, and not N mm or kN m",
    Cause.QUATERNIONS: "give the poses' quaternions as x y z w: as if w came first, the tool points elsewhere",
    Cause.WORLD: "give the poses in a frame whose z points up",
    Cause.NOT_TURNING: "give poses that turn with the tool, such as those of a wheel's joint",
    Cause.STIFFNESS: "record poses as measured, and not as commanded",
    Cause.ZERO_MOVES: "zero the load cell once, before the recording, and let it warm up; calibrate would trust it",
    Cause.TCP: "check the TCP on the arm, too",
    Cause.LEVER: "check sensor.position",
    Cause.BIAS: "tare it there (~/tare, --tare)",
}
"""What to do about a cause beside its remedy, or in place of it."""
MOTIONS_THAT_DETERMINE = {
    "lever": "drag it along x and y",
    "turn": "drag it along x and y",
    "mass": "turn it in the air about two axes",
    "moment": "turn it in the air about two axes",
    "force_bias": "hold it in the air for some seconds",
    "torque_bias": "hold it in the air for some seconds",
    "delay": "press it down and lift it several times",
    "surface": "press it straight down",
}
"""The motion that determines a number of the fit."""
HARMLESS = {
    Cause.SURFACE,
    Cause.BIAS,
    Cause.WEIGHT,
    Cause.PAYLOAD,
    Cause.DELAY,
    Cause.FILTER,
    Cause.STRENGTH,
    Cause.LEVER,
    Cause.TORQUE_UNIT,
}
"""Causes beside which a calibration goes on: it fits them itself, or fits the force alone."""
APART = "drag it along x and y, and push at another attitude, to see which"
"""The motion that tells causes apart that fit alike."""


def of_diagnosis(e: Evidence, causes: Sequence[Found]) -> Iterator[Finding]:
    """The causes of a cell's misfit, that of the greatest one first."""
    explanations = [x for cause_found in causes for x in (cause_found.best, *cause_found.ties)]
    is_unit_wrong = any(x.cause is Cause.UNIT for x in explanations)
    for cause_found in causes:
        finding = _of_cause(e, cause_found)
        # values that fit readings in another unit are wrong once the driver is mended
        yield replace(finding, remedy={}) if is_unit_wrong else finding


def of_right_cell(e: Evidence, diagnosis: Diagnosis) -> Iterator[Finding]:
    """What shows that a cell is right."""
    result = diagnosis.fit
    given_values = diagnosis.problem.given()
    given = e.config.surface_height
    off = 1e3 * float(result.values["surface"][0] - given)
    error = 1e3 * float(result.errors["surface"][0])
    is_known = "surface_height" in e.named
    yield Finding(
        name="surface_height",
        ok=is_known,
        said=f"{given:g} m{'' if is_known else ', the default, since it is not set'}; by the force"
        f" the grains begin {off:+.1f} ± {error:.1g} mm from it",
        advice="" if is_known else "measure it, or run rft calibrate",
    )
    load = np.linalg.norm(result.values["force_bias"] - given_values[rows_of("force_bias")])
    tare = ""
    if e.tare:
        tare = f", after the tare of the first {e.tare:g} s; for the node call ~/tare in the air"
    said = f"it reads {load:.3g} N more in the air than its bias and weight{tare}"
    yield Finding(name="load cell", ok=True, said=said, evidence={"load": float(load)})
    said = f"measured and predicted force agree: the misfit is {result.per_stretch:.2g}"
    usual = MAX_RIGHT_FACTOR * diagnosis.problem.usual
    yield Finding(name="sign", ok=True, said=f"{said}, and with right cells up to {usual:.2g}")
    ratio = result.zeta / diagnosis.setup.law.zeta
    said = f"measured over predicted force {ratio:.3g}"
    yield Finding(name="strength", ok=True, said=said, evidence={"ratio": ratio})


def remedy_of(e: Evidence, x: Explanation, unknown_names: Collection[str]) -> dict[str, Value]:
    """The values of parameters that mend a cause. `unknown_names`: of `unsure_numbers`."""
    if x.cause in (Cause.PAYLOAD, Cause.UNIT):
        return {}
    changes = dict(x.variant.remedy)
    setup = mended(x)
    cell = setup.cell
    # beside a turned axis, what it determines is written; numbers alone are written together or not at all
    if unknown_names and not x.variant.remedy:
        return {}
    free = [name for name in x.hypothesis.free if name not in unknown_names]
    if "surface" in free and x.cause is Cause.SURFACE:
        changes["surface_height"] = round(setup.surface, 4)
    if "force_bias" in free:
        changes["sensor.bias"] = cell.bias
    if "mass" in free:
        changes["sensor.mass"] = cell.mass
    if "moment" in free and cell.mass > 0.0:
        changes["sensor.center_of_mass"] = cell.center_of_mass
    if "lever" in free:
        changes["sensor.position"] = tuple(np.round(cell.position, 3).tolist())
    if "turn" in free:
        changes["sensor.quaternion"] = cell.quaternion
    if "delay" in free:
        changes["sensor.delay"] = round(cell.delay, 3)
    if "zeta" in free:
        zeta = setup.law.zeta
        if MIN_USUAL_ZETA <= zeta <= MAX_USUAL_ZETA:
            changes["medium.zeta"] = float(f"{zeta:.4g}")
    if e.place_parameter:
        for name in ("sensor.quaternion", "sensor.position"):
            changes.pop(name, None)
    return changes


def _of_cause(e: Evidence, cause_found: Found) -> Finding:
    x = cause_found.best
    cause = x.cause
    sentence, evidence = _sentence(cause_found)
    unsure_names = unsure_numbers(x)
    remedy = remedy_of(e, x, unsure_names)
    advice = list(filter(None, [_advice(e, x)]))
    motions = [MOTIONS_THAT_DETERMINE[name] for name in unsure_names if name != "zeta"]
    if motions and not remedy:
        advice.append(f"{motions[0]}: the motion seen does not determine the value")
    name = cause.title
    if cause_found.ties:
        advice += [a for other_cause in cause_found.ties if (a := _advice(e, other_cause))]
        advice.append(APART)
    return Finding(
        name=name,
        said=sentence,
        evidence=evidence,
        remedy=remedy,
        alike=tuple(remedy_of(e, other, unsure_numbers(other)) for other in cause_found.ties),
        advice=", or ".join(dict.fromkeys(advice)),
        spoils_calibration=cause not in HARMLESS,
    )


def _advice(e: Evidence, x: Explanation) -> str:
    place = e.place_parameter
    cell = mended(x).cell
    if place and x.cause in (Cause.TURN, Cause.ANGLE, Cause.SIGN_AND_TURN):
        return f"correct {place} to the quaternion {in_words(cell.quaternion)}"
    if place and x.cause is Cause.LEVER:
        return f"correct {place} to the position {in_words(tuple(np.round(cell.position, 3).tolist()))}"
    if x.cause in (Cause.STRENGTH, Cause.UNIT):
        ratio = x.fit.zeta / x.problem.setup.law.zeta
        if x.cause is Cause.UNIT:
            ratio = 1.0 / x.variant.number
        unit = min(UNITS_N, key=lambda name: abs(np.log(max(ratio, 1e-9) * UNITS_N[name])))
        like = f" (as if it were {unit})" if 0.4 < ratio * UNITS_N[unit] < 2.5 else ""
        return f"check mesh.scale and the driver's unit, which is N{like}"
    return ADVICE.get(x.cause, "")


def _sentence(cause_found: Found) -> tuple[str, Mapping[str, float]]:
    """What is said of a cause, and the numbers that show it."""
    x = cause_found.best
    values = x.fit.values
    errors = x.fit.errors
    number = x.variant.number
    misfit_before = cause_found.fit_before.per_stretch
    misfit_after = x.fit.per_stretch
    misfit = f"the misfit falls from {misfit_before:.2g} to {misfit_after:.2g} with it"
    evidence: dict[str, float] = {"own": misfit_before, "left": misfit_after}
    match x.cause:
        case Cause.SURFACE:
            off = 1e3 * float(values["surface"][0] - x.problem.setup.surface)
            error = 1e3 * float(errors["surface"][0])
            side = "above" if off > 0.0 else "below"
            sentence = f"the grains begin {abs(off):.1f} ± {error:.1g} mm {side} where they should"
            sentence += f" with {x.problem.setup.surface:g} m"
            evidence["millimetres"] = abs(off)
        case Cause.BIAS:
            off = float(
                np.linalg.norm(values["force_bias"] - x.problem.given()[rows_of("force_bias")])
            )
            sentence = f"it reads {off:.3g} N more in the air than its bias and weight"
            evidence["load"] = off
        case Cause.WEIGHT:
            sentence = f"it reads a weight of {values['mass'][0]:.3g} ± {errors['mass'][0]:.1g} kg"
            evidence["mass"] = float(values["mass"][0])
        case Cause.PAYLOAD:
            excess = -float(values["mass"][0])
            sentence = f"the driver subtracts {excess:.2g} kg more than the tool weighs"
            evidence["too_much"] = excess
        case Cause.DELAY:
            late = 1e3 * float(values["delay"][0])
            side = "later" if late > 0.0 else "earlier"
            error = 1e3 * float(errors["delay"][0])
            sentence = f"the load cell's stamps are {abs(late):.0f} ± {error:.1g} ms {side} than its events"
            evidence["delay"] = abs(late)
        case Cause.FILTER:
            sentence = f"the force follows the motion like a filter of {number:.0f} ms"
            evidence["lag"] = number
        case Cause.STRENGTH:
            zeta = x.fit.zeta
            ratio = zeta / x.problem.setup.law.zeta
            sentence = f"measured over predicted force {ratio:.3g}"
            if not MIN_USUAL_ZETA <= zeta <= MAX_USUAL_ZETA:
                usual_range = f"{MIN_USUAL_ZETA:g} to {MAX_USUAL_ZETA:g}"
                sentence += f", a ζ of {zeta:.2g}; dry grains usually have {usual_range}"
            evidence["ratio"] = ratio
        case Cause.UNIT:
            sentence = f"measured over predicted force {1.0 / number:.3g}"
            evidence["ratio"] = 1.0 / number
        case Cause.LEVER:
            far = 1e3 * float(np.linalg.norm(values["lever"]))
            sentence = f"a sensor {far:.0f} mm away explains the torque"
            evidence["millimetres"] = far
        case Cause.TURN | Cause.SIGN_AND_TURN | Cause.ANGLE:
            turn_before = Rotation.from_quat(cause_found.setup_before.cell.quaternion)
            turn = turn_before.inv() * Rotation.from_quat(mended(x).cell.quaternion)
            number = float(np.degrees(turn.magnitude()))
            sentence = f"measured and predicted force do not agree, by {number:.0f} degrees"
            evidence["angle"] = number
        case Cause.WORLD:
            sentence = f"the world frame's z points {number:.0f} degrees away from up"
            evidence["angle"] = number
        case Cause.ZERO_MOVES:
            sentence, change = _moved_zero(x)
            evidence["moved"] = change
        case Cause.NOT_TURNING:
            sentence = (
                f"the poses do not turn, and the force is that of a tool that turns by {number:.0f}"
                " degrees along its way"
            )
            evidence["angle"] = number
        case Cause.STIFFNESS:
            sentence = (
                f"the tool is not at the poses: the arm yields, with about {number:.2g} N/mm"
            )
            evidence["stiffness"] = number
        case Cause.MESH_UNIT:
            sentence = f"a mesh {number:.4g} times as large explains the force"
        case Cause.TCP:
            sentence = f"a mesh {number:.0f} mm elsewhere in its frame explains the force"
            evidence["millimetres"] = number
        case Cause.TORQUE_UNIT:
            sentence = f"the torque is {1.0 / number:.3g} times that of the force at its lever"
        case _:
            sentence = "measured and predicted force do not agree"
    return f"{sentence} ({misfit})", evidence


def _moved_zero(x: Explanation) -> tuple[str, float]:
    change = float(np.linalg.norm(x.fit.values["zero_change"][FORCE]))
    match x.variant.zero_motion:
        case "step":
            sentence = (
                f"the zero of the load cell steps by {change:.3g} N at {x.variant.number:.3g} s"
            )
        case "drift":
            sentence = f"the zero of the load cell drifts by {change:.3g} N"
        case _:
            change *= 2.0
            turns = f"it changes by {change:.3g} N where the motion turns back"
            sentence = f"the reading depends on the motion: {turns}"
    return sentence, change
