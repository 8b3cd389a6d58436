"""From recordings to calibrated parameters: what the grains at hand and the load cell are, with standard errors."""

from rft_ros.calibration.calibrate import calibrate
from rft_ros.calibration.findings import CannotTell, Finding, Refusal
from rft_ros.calibration.outcome import PARTS, Calibration, Options
from rft_ros.calibration.track import Track, read_track

__all__ = [
    "PARTS",
    "Calibration",
    "CannotTell",
    "Finding",
    "Options",
    "Refusal",
    "Track",
    "calibrate",
    "read_track",
]
