"""From recordings to the load cell, the surface, ζ, λ and α_y, each with an error, or why it is not identifiable."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from rft_ros.calibration.alpha_y import AlphaYFit, AlphaYModel, fit_alpha_y, plate_runs
from rft_ros.calibration.fitting import FittedValue, NotIdentifiable
from rft_ros.calibration.memory_length import fit_memory_length
from rft_ros.calibration.surface import fit_surface
from rft_ros.calibration.tool_weight import Sensor, fit_tool_weight, tared
from rft_ros.calibration.track import Track
from rft_ros.calibration.zeta import ZetaFit, fit_zeta
from rft_ros.estimator.parameters import Values, model_of, settings_of
from rft_ros.rft import medium_named

__all__ = ["PARTS", "Calibration", "Options", "calibrate"]

PARTS = ("sensor", "surface", "zeta", "mobilization", "alpha_y")
"""What can be fitted: bias, mass and centre of mass; surface height; ζ; λ; α_y."""

_CLEAR = 0.002
"""A still tool is in the air if its lowest point is this much [m] above the surface."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Options:
    """What to fit: `parts`. `tare`: zero each bag's load cell over its first seconds [s]; None or 0: no tare.

    `alpha_y`: its model.
    """

    parts: tuple[str, ...] = PARTS
    tare: float | None = None
    alpha_y: AlphaYModel = "auto"


@dataclass(slots=True, kw_only=True)
class Calibration:
    """Fitted values, reasons by name of what is not identifiable, and notes on what a single value hides.

    `zeta`, `alpha_y`: the fits behind the values; None where not fitted.
    """

    fitted: list[FittedValue] = field(default_factory=list)
    not_identifiable: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    zeta: ZetaFit | None = None
    alpha_y: AlphaYFit | None = None


def calibrate(tracks: Sequence[Track], values: Values, options: Options | None = None) -> Calibration:
    """Fit `options.parts` to the tracks; what is not fitted is taken from `values`, the node's parameters.

    Each fit uses the results of those before it. Raises InputError where a tare is asked for and a bag does not begin
    with the tool at rest in the air.
    """
    options = options or Options()
    settings, result = settings_of(values), Calibration()
    rest, medium = settings.rest_speed, medium_named(str(values["medium.name"]))
    law = model_of({**values, "medium.zeta": 1.0}, tool=tracks[0].tool).law
    sensor = Sensor(cell=settings.load_cell)
    height, height_error = settings.surface_height, 0.0
    zeta, zeta_error = float(str(values["medium.zeta"])), 0.0

    air = height
    try:
        surface = fit_surface(tracks, sensor.cell, law, rest_speed=rest)
        if "surface" in options.parts:
            height, height_error = surface.height, surface.error
            result.fitted.append(surface.value())
            result.notes += surface.notes()
        air = max([height, *(contact.height for contact in surface.contacts)])
    except NotIdentifiable as reason:
        if "surface" in options.parts:
            result.not_identifiable["surface_height"] = str(reason)
    air += _CLEAR

    if "sensor" in options.parts:
        try:
            weight = fit_tool_weight(tracks, sensor.cell, air=air, rest_speed=rest)
            sensor = weight.sensor
            result.fitted += weight.fitted
            result.not_identifiable |= weight.not_identifiable
        except NotIdentifiable as reason:
            result.not_identifiable["sensor.bias"] = str(reason)
    if options.tare:
        tracks, sensor = tared(tracks, sensor, seconds=options.tare, air=air, rest_speed=rest)

    if "zeta" in options.parts:
        try:
            found = fit_zeta(tracks, sensor, law, surface=height, surface_error=height_error, rest_speed=rest)
            zeta, zeta_error = found.zeta, found.error
            result.zeta = found
            result.fitted += found.values()
            result.notes += found.notes()
        except NotIdentifiable as reason:
            result.not_identifiable["medium.zeta"] = str(reason)

    if "mobilization" in options.parts:
        try:
            result.fitted.append(fit_memory_length(tracks, sensor, law, surface=height, rest_speed=rest))
        except NotIdentifiable as reason:
            result.not_identifiable["medium.mobilization_length"] = str(reason)

    if "alpha_y" in options.parts:
        try:
            scaled = law._replace(stiffness=law.stiffness * zeta)
            runs = plate_runs(tracks, sensor, scaled, surface=height, rest_speed=rest)
            result.alpha_y = fit_alpha_y(
                runs,
                medium,
                zeta=zeta,
                zeta_error=zeta_error,
                surface_error=height_error,
                model=options.alpha_y,
            )
            result.fitted.append(result.alpha_y.value())
        except NotIdentifiable as reason:
            result.not_identifiable["alpha_y"] = str(reason)
    return result
