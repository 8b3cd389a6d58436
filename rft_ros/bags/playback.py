"""Play a recording through an estimator."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from rft_ros.bags.estimates import ESTIMATE, ReplayTable, Rows
from rft_ros.bags.options import ReplayOptions
from rft_ros.bags.reading import Recording, bag_name, opened_recording
from rft_ros.errors import InputError
from rft_ros.estimator import Answer, Estimator, PoseSample, Sample
from rft_ros.parameters import Config, Model, Values
from rft_ros.progress import bar
from rft_ros.report import DrawnMotion
from rft_ros.rft import FORCE, QUATERNION, rotate_vectors, rotation_matrices, rotation_matrix

_BAR_PERIOD = 512  # samples between updates of the progress bar


def play(recording: Recording, estimator: Estimator) -> Iterator[tuple[Sample, Answer | None]]:
    """Push every sample of a recording. Yields each sample, and each pose with its answer (`Estimator.answers`).

    At the end all measurements are final, and messages that cannot be decoded are counted.
    """
    label = bag_name(recording.bag)
    with bar(label, recording.last - recording.first) as update:
        for number, sample in enumerate(recording):
            answers = estimator.answers(sample)
            if not isinstance(sample, PoseSample):
                yield sample, None
            yield from answers
            if number % _BAR_PERIOD == 0:
                update(recording.time - recording.first, label)
    estimator.finish()
    if recording.unreadable:
        estimator.count_unreadable(recording.unreadable)


def reasons(recording: Recording, estimator: Estimator) -> str:
    """Damage of a recording that was played, and the counted reasons, as the end of an error."""
    damage = [recording.damage] if recording.damage else []
    return "; ".join([*damage, *estimator.counted()]) or "no sample was refused"


def played(recording: Recording, estimator: Estimator) -> Rows:
    """The rows of all answers of an estimator to a recording, shape [n]."""
    table = ReplayTable(estimator)
    for _, answer in play(recording, estimator):
        if answer is not None:
            table.add(answer)
    return table.rows()


def played_estimates(
    bag: Path, parameters: Config | Values, model: Model, options: ReplayOptions
) -> tuple[Rows, Estimator]:
    """The rows of all estimates of a recording, after its tare, and their estimator. Raises InputError if none is."""
    config = tared(bag, Config.of(parameters), model, options)
    with opened_recording(bag, config, options) as recording:
        estimator = Estimator(recording.config, model)
        rows = played(recording, estimator)
    estimates = rows[rows["reason"] == ESTIMATE]
    if not len(estimates):
        why = reasons(recording, estimator)
        raise InputError(f"bag '{bag}' has no pose with an estimate ({why})")
    return estimates, estimator


def played_motion(rows: Rows, estimator: Estimator, *, begin: int) -> DrawnMotion:
    """The motion in rows of estimates, shape [n], which the estimator gave. `begin`: the stamp of its time 0 [ns]."""
    states = np.array(rows["state"])
    to_world = rotation_matrices(states[:, QUATERNION]) @ rotation_matrix(
        estimator.load_cell.quaternion
    )
    return DrawnMotion(
        times=1e-9 * (rows["stamp"] - begin),
        states=states,
        forces=rotate_vectors(to_world, rows["predicted"][:, FORCE]),
        ground=estimator.ground,
    )


def tared(bag: Path, config: Config, model: Model, options: ReplayOptions) -> Config:
    """The parameters with the bias by the tare of the options over the first seconds, if they have one.

    It begins at the first pose with a known velocity. Raises InputError if it is refused.
    """
    seconds = options.tare
    if not seconds:
        return config
    start = options.start or 0.0
    with opened_recording(
        bag, config, replace(options, start=start, end=start + seconds)
    ) as recording:
        estimator = Estimator(recording.config, model)
        rows = played(recording, estimator)
        with_velocity = rows["stamp"][~np.isnan(rows["depth"])]
        last_reading = estimator.last_reading
        window = seconds
        if len(with_velocity) and last_reading and with_velocity[0] < last_reading.stamp:
            window = 1e-9 * (last_reading.stamp - with_velocity[0])
        try:
            bias = estimator.tare(window)
        except InputError as error:
            height = estimator.config.surface_height
            where = f"of the first {seconds:g} s, surface_height {height:g} m"
            raise InputError(
                f"bag '{bag}': {error} ({where}; {reasons(recording, estimator)})"
            ) from None
    return config.changed({"sensor.bias": bias})
