"""The estimator takes stamped samples and answers each pose with an estimate or a reason. Node and replay use it."""

from rft_ros.estimator.estimator import Estimator
from rft_ros.estimator.load_cell import GRAVITY, LoadCellFrame
from rft_ros.estimator.motion import dead_band_of
from rft_ros.estimator.pose_difference import PoseDifference
from rft_ros.estimator.pose_jumps import FASTEST_M_S
from rft_ros.estimator.pose_noise import NOISY, PoseNoise
from rft_ros.estimator.quality import (
    TOUCH_DEPTH_M,
    QualityFlag,
    Trust,
    begins_in_grains,
    flag_names,
    sentence_on,
    sentences,
    trust,
)
from rft_ros.estimator.samples import (
    OF_TRANSFORMS,
    STAMP_ZERO,
    Answer,
    Estimate,
    Measurement,
    NoEstimate,
    PoseSample,
    Reason,
    Sample,
    Stamped,
    TransformSample,
    TwistSample,
    WrenchSample,
)
from rft_ros.estimator.sigma import is_withdrawn, predict_without_learning
from rft_ros.estimator.tare import OFFSET_SENTENCE, is_offset

__all__ = [
    "FASTEST_M_S",
    "GRAVITY",
    "NOISY",
    "OFFSET_SENTENCE",
    "OF_TRANSFORMS",
    "STAMP_ZERO",
    "TOUCH_DEPTH_M",
    "Answer",
    "Estimate",
    "Estimator",
    "LoadCellFrame",
    "Measurement",
    "NoEstimate",
    "PoseDifference",
    "PoseNoise",
    "PoseSample",
    "QualityFlag",
    "Reason",
    "Sample",
    "Stamped",
    "TransformSample",
    "Trust",
    "TwistSample",
    "WrenchSample",
    "begins_in_grains",
    "dead_band_of",
    "flag_names",
    "is_offset",
    "is_withdrawn",
    "predict_without_learning",
    "sentence_on",
    "sentences",
    "trust",
]
