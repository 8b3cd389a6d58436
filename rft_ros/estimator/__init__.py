"""Stamped samples in, an estimate or a named reason out: the object that the live node and the replay both drive."""

from rft_ros.estimator.estimator import Estimator
from rft_ros.estimator.samples import (
    Estimate,
    Measurement,
    NoEstimate,
    PoseSample,
    Reason,
    Sample,
    Stamped,
    TransformSample,
    TwistSample,
    Wrench,
    WrenchSample,
)
from rft_ros.parameters import LoadCell, Model, Settings

__all__ = ["Estimate", "Estimator", "LoadCell", "Measurement", "Model", "NoEstimate", "PoseSample", "Reason", "Sample"]
__all__ += ["Settings", "Stamped", "TransformSample", "TwistSample", "Wrench", "WrenchSample"]
