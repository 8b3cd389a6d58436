"""Play a recording through an estimator."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.options import ReplayOptions
from rft_ros.bags.reading import Recording, bag_name
from rft_ros.errors import InputError
from rft_ros.estimator import Answer, Estimate, Estimator, PoseSample, Reason, Sample
from rft_ros.parameters import LoadCell, Model, Values, settings_of
from rft_ros.progress import bar
from rft_ros.report import Motion
from rft_ros.rft import FORCE, QUATERNION

_BAR_PERIOD = 512  # samples between updates of the progress bar


def play(recording: Recording, estimator: Estimator) -> Iterator[tuple[Sample, Answer | None]]:
    """Push every sample of a recording. Yields each sample, and each pose with its answer (`Estimator.answers`).

    At the end all measurements are final, and messages that cannot be decoded are counted.
    """
    label = bag_name(recording.bag)
    from_transforms = estimator.settings.pose_source == "tf"
    with recording, bar(label, recording.last - recording.first) as update:
        for number, sample in enumerate(recording):
            answers = estimator.answers(sample)
            if not isinstance(sample, PoseSample):
                yield sample, None
            for pose, answer in answers:
                if from_transforms:
                    recording.counts["pose"] += 1
                yield pose, answer
            if number % _BAR_PERIOD == 0:
                update(recording.time - recording.first, label)
    estimator.finish()
    if recording.unreadable:
        estimator.counts[Reason.MESSAGE_UNREADABLE] += recording.unreadable


def reasons(recording: Recording, estimator: Estimator) -> str:
    """Damage of a recording that was played, and the counted reasons, as the end of an error."""
    damage = [recording.damage] if recording.damage else []
    return "; ".join([*damage, *estimator.counted()]) or "no sample was refused"


def states_of(bag: Path, values: Values, model: Model, options: ReplayOptions) -> Motion:
    """The estimates of a recording, from the first one on. Raises InputError if no pose has an estimate."""
    recording = Recording(bag, values, options)
    estimator = Estimator(settings_of(recording.values), model)
    stamps = []
    states_of_estimates = []
    wrenches = []
    for _, answer in play(recording, estimator):
        if isinstance(answer, Estimate):
            stamps.append(answer.stamp)
            states_of_estimates.append(estimator.state.copy())
            wrenches.append(answer.predicted)
    if not stamps:
        raise InputError(
            f"bag '{bag}' has no pose with an estimate ({reasons(recording, estimator)})"
        )
    states = np.array(states_of_estimates)
    return Motion(
        times=(np.array(stamps) - stamps[0]) * 1e-9,
        states=states,
        forces=world_forces(np.array(wrenches), states, estimator.load_cell),
        ground=estimator.ground,
    )


def world_forces(
    wrenches: NDArray[np.float64], states: NDArray[np.float64], cell: LoadCell
) -> NDArray[np.float64]:
    """Rotate the forces of wrenches in sensor axes [N], shape [n, 3 or 6], to world axes. `states`: shape [n, 13]."""
    from scipy.spatial.transform import Rotation

    sensor = Rotation.from_quat(states[:, QUATERNION]) * Rotation.from_quat(cell.quaternion)
    return np.asarray(sensor.apply(wrenches[:, FORCE]))
