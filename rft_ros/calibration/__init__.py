"""From recordings to calibrated parameters of the grains and the load cell, with standard errors."""

from rft_ros.calibration.calibrate import PARTS, Calibration, calibrate
from rft_ros.calibration.fitting import FittedValue, NotIdentifiable
from rft_ros.calibration.track import Track, read_track

__all__ = [
    "PARTS",
    "Calibration",
    "FittedValue",
    "NotIdentifiable",
    "Track",
    "calibrate",
    "read_track",
]
