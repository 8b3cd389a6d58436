"""Learning the medium from the load cell: a Kalman filter of four correction factors, its records and surprises."""

from rft_ros.estimator.learning.learning import Belief, Learning
from rft_ros.estimator.learning.surprise import UNEXPLAINED_SENTENCE

__all__ = ["UNEXPLAINED_SENTENCE", "Belief", "Learning"]
