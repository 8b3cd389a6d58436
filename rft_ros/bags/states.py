"""The states that a bag's estimates were made for."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.progress import with_progress
from rft_ros.bags.reading import Recording
from rft_ros.bags.remapping import remapped_topics
from rft_ros.bags.replay_options import ReplayOptions
from rft_ros.errors import InputError
from rft_ros.estimator import Estimate, Estimator, Model, PoseSample, TwistSample
from rft_ros.estimator.parameters import Values, settings_of

__all__ = ["states_of"]


def states_of(
    bag: Path, values: Values, model: Model, options: ReplayOptions
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times since the first estimate [s], shape [n], and states, shape [n, 13], of the poses that have an estimate."""
    topics = remapped_topics(options.remap)
    if values["twist_source"] != "topic":
        del topics["twist"]
    estimator = Estimator(settings_of(values), model)
    stamps, states = [], []
    with Recording(bag, topics, start=options.start, end=options.end) as recording:
        for sample in with_progress(recording, bag.name):
            if isinstance(sample, PoseSample):
                if isinstance(estimator.push_pose(sample), Estimate):
                    stamps.append(sample.stamp)
                    states.append(estimator.state.copy())
            elif isinstance(sample, TwistSample):
                estimator.push_twist(sample)
    if not states:
        reasons = ", ".join(estimator.counted())
        raise InputError(f"bag '{bag}' has no pose with an estimate to show ({reasons or 'no poses'})")
    return (np.array(stamps) - stamps[0]) * 1e-9, np.array(states)
