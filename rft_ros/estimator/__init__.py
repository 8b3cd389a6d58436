"""Stamped samples in, an estimate or a named reason out: the object that the live node and the replay both drive."""

from rft_ros.estimator.estimator import Estimator
from rft_ros.estimator.samples import Estimate, PoseSample, Reason, TwistSample, Vector, Withheld, Wrench, WrenchSample
from rft_ros.estimator.settings import LoadCell, Model, Settings

__all__ = [
    "Estimate",
    "Estimator",
    "LoadCell",
    "Model",
    "PoseSample",
    "Reason",
    "Settings",
    "TwistSample",
    "Vector",
    "Withheld",
    "Wrench",
    "WrenchSample",
]
