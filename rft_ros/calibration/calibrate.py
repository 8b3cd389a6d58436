"""Recordings in; the load cell, the surface, ζ, λ, α_y and the velocity weights out, or why they cannot be told."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rft_ros.calibration.alpha_y_fit import fit_alpha_y
from rft_ros.calibration.depth_exponent import depth_notes
from rft_ros.calibration.findings import CannotTell, Finding, mean_of
from rft_ros.calibration.first_contact import first_contact
from rft_ros.calibration.hanging import HangingFit, fit_hanging, hanging_pose
from rft_ros.calibration.load_cell_weight import gravity_in_sensor, sensor_rotations
from rft_ros.calibration.mobilization import fit_turn, length_finding
from rft_ros.calibration.outcome import Calibration, Options
from rft_ros.calibration.penetration import Penetration, fit_zeta, penetration
from rft_ros.calibration.plate_runs import plate_run, sheet_of
from rft_ros.calibration.regression import error_of_mean
from rft_ros.calibration.sigmoids import fit_f1, fit_f23, runs_over_psi
from rft_ros.calibration.stretches import Stroke, down_strokes, level_runs, still_intervals, turns_in_grains
from rft_ros.calibration.track import Track
from rft_ros.errors import InputError
from rft_ros.estimator import LoadCell
from rft_ros.estimator.parameters import Values, model_of, settings_of
from rft_ros.rft import Law

__all__ = ["calibrate"]

_CLEAR = 0.002
"""A still tool hangs in the air if its lowest point is this much [m] above the surface."""

_SCATTERED = 0.002


def calibrate(tracks: Sequence[Track], values: Values, options: Options | None = None) -> Calibration:
    """Fit to the tracks what `options.parts` names; what is not fitted is taken from `values`, the node's parameters.

    Raises InputError where a tare is asked for and a bag does not begin with the tool at rest in the air.
    """
    return _Session(tracks, values, options or Options()).run()


class _Session:
    """One calibration: later fits stand on earlier ones."""

    def __init__(self, tracks: Sequence[Track], values: Values, options: Options) -> None:
        settings = settings_of(values)
        self.tracks = list(tracks)
        self.options = options
        self.rest = settings.rest_speed
        self.cell: LoadCell = settings.load_cell
        self.hanging: HangingFit | None = None
        self.tare_error = 0.0
        self.surface, self.surface_error = settings.surface_height, 0.0
        model = model_of({**values, "medium.zeta": 1.0}, tool=self.tracks[0].tool)
        self.law: Law = model.law
        self.zeta, self.zeta_error = float(str(values["medium.zeta"])), 0.0
        self.strokes: list[tuple[int, Stroke]] = [
            (k, s) for k, track in enumerate(self.tracks) for s in down_strokes(track, self.rest)
        ]
        self.result = Calibration()

    def run(self) -> Calibration:
        parts = self.options.parts
        air = self._contacts()
        self._sensor(air)
        if "zeta" in parts:
            self._zeta()
        if "mobilization" in parts:
            self._mobilization()
        if "alpha_y" in parts or "weights" in parts:
            self._plates()
        return self.result

    def _contacts(self) -> float:
        """Fit the surface; returns the height above which the tool is in the air."""
        whys = []
        for k, stroke in self.strokes:
            try:
                self.result.contacts.append(first_contact(self.tracks[k], stroke, self.cell, self.law))
            except CannotTell as why:
                whys.append(str(why))
        contacts = self.result.contacts
        heights = [c.height for c in contacts]
        if "surface" in self.options.parts and not contacts:
            self.result.refused("surface_height", whys[0] if whys else "the tool never goes straight down")
        elif "surface" in self.options.parts:
            self.surface, self.surface_error = mean_of(heights, [c.error for c in contacts])
            worst = max(c.misfit for c in contacts)
            self.result.told(
                Finding(
                    name="surface_height",
                    values=(self.surface,),
                    errors=(self.surface_error,),
                    unit="m",
                    goodness=f"RMS up to {100 * worst:.1f} % of the force's rise",
                    source=f"first contact of {len(contacts)} ways down",
                    parameter="surface_height",
                )
            )
            if np.ptp(heights) > _SCATTERED:
                each = ", ".join(f"{c.bag} {1e3 * c.height:.1f} ± {1e3 * c.error:.1f} mm" for c in contacts)
                self.result.notes.append(f"The surface was not found at one height: {each}.")
        return max([self.surface, *heights]) + _CLEAR

    def _sensor(self, air: float) -> None:
        poses = [
            hanging_pose(track, rows, self.cell)
            for track in self.tracks
            for rows in still_intervals(track, self.rest)
            if track.heights()[rows].min() > air
        ]
        if "sensor" in self.options.parts:
            try:
                self.hanging = fit_hanging(poses, self.cell)
                self.cell = self.hanging.cell
                self.result.refusals.extend(self.hanging.refusals)
                for finding in self.hanging.findings:
                    self.result.told(finding)
            except CannotTell as why:
                self.result.refused("sensor.bias", why)
        if self.options.tare is not None:
            self.tracks = [self._tared(track, self.options.tare, air) for track in self.tracks]

    def _tared(self, track: Track, seconds: float, air: float) -> Track:
        """The track with its readings shifted so that the tool weighs what it should over the first seconds."""
        rows = np.flatnonzero(track.time <= seconds)
        fastest, lowest = float(track.speeds()[rows].max()), float(track.heights()[rows].min())
        if fastest >= self.rest or lowest <= air:
            raise InputError(
                f"tare refused: within the first {seconds:g} s of {track.name} the tool moves at {fastest:.4f} m/s"
                f" and is as low as z = {lowest:.4f} m; it must hang still above {air:.4f} m"
            )
        gravity = gravity_in_sensor(track, self.cell)[rows]
        force = np.array(self.cell.bias[:3]) + self.cell.sign * self.cell.mass * gravity
        excess = track.readings[rows, :3] - force
        self.tare_error = max(self.tare_error, *(error_of_mean(column) for column in excess.T))
        shift = np.append(excess.mean(axis=0), np.zeros(3))
        return replace(track, readings=track.readings - shift)

    def _zeta(self) -> None:
        found: list[Penetration] = []
        whys = []
        for k, stroke in self.strokes:
            track = self.tracks[k]
            try:
                found.append(
                    penetration(
                        track,
                        stroke,
                        self.cell,
                        self.law,
                        surface=self.surface,
                        surface_error=self.surface_error,
                        force_error=self._vertical_error(track, int(stroke.rows[-1])),
                    )
                )
            except CannotTell as why:
                if track.heights()[stroke.rows].min() < self.surface:
                    whys.append(str(why))
        try:
            if whys and not found:
                raise CannotTell(whys[0])
            fit = fit_zeta(found)
        except CannotTell as why:
            self.result.refused("medium.zeta", why)
            return
        self.result.zeta, self.zeta, self.zeta_error = fit, fit.zeta, fit.error
        held_out = fit.held_out()
        goodness = f"RMS {100 * max(p.misfit(fit.zeta) for p in found):.1f} % of the peak at worst"
        if held_out:
            goodness += f"; each predicted by the others' ζ: {100 * max(held_out):.1f} %"
        self.result.told(
            Finding(
                name="medium.zeta",
                values=(fit.zeta,),
                errors=(fit.error,),
                unit="",
                goodness=goodness,
                source=", ".join(f"{p.bag} {p.zeta:.3f} ± {p.error:.3f}" for p in found),
                parameter="medium.zeta",
            )
        )
        self.result.notes += depth_notes(found, self.law, surface_error=self.surface_error)

        deepest = max(found, key=lambda p: float(p.depth.max()))
        self.result.told(
            Finding(
                name="medium.calibrated_depth",
                values=(float(deepest.depth.max()),),
                errors=(self.surface_error,),
                unit="m",
                goodness="",
                source=f"deepest penetration, {deepest.bag}",
                parameter="medium.calibrated_depth",
            )
        )

    def _vertical_error(self, track: Track, row: int) -> float:
        """Standard error of the vertical force's zero in the orientation of a row [N]."""
        up = sensor_rotations(track, self.cell)[row, 2]
        own = self.hanging.vertical_error(up) if self.hanging else 0.0
        return float(np.hypot(own, self.tare_error))

    def _mobilization(self) -> None:
        whys = []
        for track in self.tracks:
            for turn in turns_in_grains(track, self.surface, self.rest):
                try:
                    self.result.turns.append(
                        fit_turn(
                            track,
                            turn,
                            self.cell,
                            self.law,
                            surface=self.surface,
                            rest_speed=self.rest,
                            force_error=self._vertical_error(track, turn.at),
                        )
                    )
                except CannotTell as why:
                    whys.append(str(why))
        try:
            self.result.told(length_finding(self.result.turns))
        except CannotTell as none:
            self.result.refused("medium.mobilization_length", whys[0] if whys else none)

    def _plates(self) -> None:
        whys = []
        law = self.law._replace(stiffness=self.law.stiffness * self.zeta)
        error = float(np.hypot(self.hanging.level_error if self.hanging else 0.0, self.tare_error))
        for track in self.tracks:
            for rows in level_runs(track, self.surface, self.rest):
                try:
                    sheet = sheet_of(track.tool.plates, track.tool.name)
                    self.result.runs.append(
                        plate_run(track, rows, sheet, self.cell, law, surface=self.surface, force_error=error)
                    )
                except CannotTell as why:
                    whys.append(str(why))
        if "alpha_y" in self.options.parts:
            self._alpha_y(whys)
        if "weights" in self.options.parts:
            self._weights(whys)

    def _alpha_y(self, whys: Sequence[str]) -> None:
        try:
            fit = fit_alpha_y(
                self.result.runs,
                zeta=self.zeta,
                zeta_error=self.zeta_error,
                surface_error=self.surface_error,
                model=self.options.alpha_y,
            )
        except CannotTell as why:
            self.result.refused("alpha_y", whys[0] if whys and not self.result.runs else why)
            return
        self.result.alpha_y = fit
        self.result.told(fit.finding())

    def _weights(self, whys: Sequence[str]) -> None:
        for name, fit in (("f1", fit_f1), ("f23", fit_f23)):
            try:
                curve = fit(runs_over_psi(self.result.runs), zeta=self.zeta)
            except CannotTell as why:
                self.result.refused(name, whys[0] if whys and not self.result.runs else why)
                continue
            self.result.weights.append(curve)
            self.result.told(curve.finding())
