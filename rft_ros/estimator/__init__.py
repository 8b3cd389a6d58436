"""The estimator takes stamped samples and answers each pose with an estimate or a reason. Node and replay use it."""

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
