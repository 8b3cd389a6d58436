"""Whether the stamps of the load cell differ from those of the poses by a constant delay, or its driver is slow.

`rft_ros.calibration.delay` fits the delay beside λ, to turns with rests around them. Here neither λ nor the strength of
the grains is known, and some seconds of live messages with gaps must do: so a grid of delays, on which the events vote.
"""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from rft_ros.diagnosis.evidence import ENOUGH, Array, Evidence, Indices
from rft_ros.diagnosis.finding import Finding

_LONGEST = 0.25  # s
_DELAYS = np.linspace(-_LONGEST, _LONGEST, 251)  # that are tried
_LAGS = np.linspace(0.005, 0.2, 40)  # time constants of a filter that are tried [s]
_WINDOW = 0.4  # s before and after a change of the motion
_SHARP = 0.05  # s in which such a change takes place
_LEAST = 0.012  # s: a smaller delay is not told from the time between two samples
# of the changes of the force: a greater misfit at every delay tells nothing about it
_EXPLAINED = 0.3
_BETTER = 0.5  # of the misfit without a delay: the greatest one with it
_FILTERED = 0.3  # of the misfit with a delay: the greatest one with a filter in its place
_NEAR = 0.35  # of the delay: events within this share agree with it
_AGREE = 0.6  # share of the events that must agree


def delay_of_load_cell(e: Evidence) -> Iterator[Finding]:
    """At starts, stops and turns in the grains the force changes at once: its time must be that of the motion.

    A contact does not count, since a wrong `surface_height` shifts it, too. Within a window about each event, each
    component of the measured force is fitted by a line in time plus a multiple of the predicted one some time before:
    errors of strength, surface and λ then change the fit of a single event, and hardly the time that all agree on.
    An event near which samples are missing for longer than twice the delay does not tell it.
    """
    known = list[tuple[_Event, Array]]()
    for event in _events(e):
        misfits = _misfits(e, event, _at_delays(e, event))
        if misfits.min() < _EXPLAINED:
            known.append((event, misfits))
    if len(known) < 2:
        return
    each = np.array([misfits for _, misfits in known])
    gaps = np.array([event.gap for event, _ in known])
    total = each.sum(axis=0)
    best = int(total.argmin())
    none = len(_DELAYS) // 2
    if not total[none] > 0.0:  # a load cell that reads one value tells no delay
        return
    delay = float(_DELAYS[best])
    gains = each[:, none] - each.min(axis=1)
    own = _DELAYS[each.argmin(axis=1)]
    agree = np.abs(own - delay) <= max(_NEAR * abs(delay), 0.01)
    tell = agree & (gaps <= 2.0 * abs(delay))
    agreeing = gains[agree].sum() >= _AGREE * gains.sum() and tell.sum() >= 2
    if abs(delay) < _LEAST or total[best] > _BETTER * total[none] or not agreeing:
        return
    left = float(100.0 * np.sqrt(total[best] / total[none]))
    milliseconds = 1e3 * abs(delay)
    evidence = {"delay": milliseconds}
    side = "later" if delay > 0.0 else "earlier"
    said = f"the load cell's stamps are {milliseconds:.0f} ms {side} than its events"
    advice = "fit it with rft calibrate"
    of_lags = np.sum([_misfits(e, event, _behind_filters(e, event)) for event, _ in known], axis=0)
    if of_lags.min() < _FILTERED * total[best]:
        lag = float(1e3 * _LAGS[of_lags.argmin()])
        evidence = {"lag": lag}
        said = f"the force follows the motion like a filter of {lag:.0f} ms, more slowly than the poses"
        advice = "raise the cut-off frequency in the load cell's driver"
    said += f", by {len(each)} stops (the misfit there falls to {left:.0f} % with it)"
    set_to = round(e.load_cell.delay + delay, 3)
    yield Finding(
        name="delay", said=said, evidence=evidence, remedy={"sensor.delay": set_to}, advice=advice
    )


class _Event(NamedTuple):
    """A great change of the velocity in the grains.

    `rows`: moments in the grains about it. `wide`: all that a delay or a filter of these needs. `gap`: the greatest
    time between two of `wide` [s].
    """

    rows: Indices
    wide: Indices
    gap: float


def _events(e: Evidence) -> Iterator[_Event]:
    """The events about which enough is known."""
    for at in _times(e):
        since = e.time - at
        rows = np.flatnonzero((np.abs(since) <= _WINDOW) & e.in_grains)
        wide = np.flatnonzero(np.abs(since) <= _WINDOW + _LONGEST)
        if len(rows) < ENOUGH:
            continue
        gap = float(np.diff(e.time[wide]).max())
        first, last = since[rows[[0, -1]]]
        # a busy machine leaves gaps; beyond `max_input_age` nothing lies between
        if min(-first, last) >= 0.5 * _WINDOW and gap <= e.settings.max_input_age:
            yield _Event(rows, wide, gap)


def _times(e: Evidence) -> list[float]:
    """When the velocity changes by more than half of the greatest one [s]."""
    wet = e.in_grains
    if wet.sum() < ENOUGH:
        return []
    velocity = e.velocity
    before, after = (
        np.column_stack([np.interp(e.time + shift, e.time, axis) for axis in velocity.T])
        for shift in (-_SHARP, _SHARP)
    )
    large = np.where(wet, np.linalg.norm(after - before, axis=1), 0.0)
    fastest = float(np.quantile(np.linalg.norm(velocity[wet], axis=1), 0.95))
    found = list[float]()
    while len(found) < 50 and large.max() > 0.5 * fastest:
        peak = np.flatnonzero(large >= 0.95 * large.max())
        at = float(e.time[peak[np.abs(e.time[peak] - e.time[peak[0]]) < _SHARP]].mean())
        found.append(at)
        large[np.abs(e.time - at) < _WINDOW] = 0.0
    return found


def _misfits(e: Evidence, event: _Event, courses: Iterable[Array]) -> Array:
    """The share of the force's square about an event that remains with each of k courses of the predicted force.

    `courses`: of x, y and z, shape [rows, k] each.
    """
    time = e.time[event.rows]
    line = np.linalg.qr(np.stack([np.ones_like(time), time - time[0]], axis=1))[0]

    def bent(force: Array) -> Array:
        """Without a line in time."""
        return np.asarray(force - line @ (line.T @ force))

    measured = bent(e.force[event.rows])
    whole = float((measured**2).sum())
    explained: Array | float = 0.0
    for force, course in zip(measured.T, courses, strict=True):
        predicted = bent(course)
        shared = np.maximum(force @ predicted, 0.0)
        explained += shared**2 / np.maximum((predicted**2).sum(axis=0), 1e-12)
    return np.asarray(np.maximum(whole - explained, 0.0) / max(whole, 1e-12))


def _at_delays(e: Evidence, event: _Event) -> Iterator[Array]:
    """The predicted force at each of the delays, for `_misfits`."""
    times = np.subtract.outer(e.time[event.rows], _DELAYS)
    for values in e.model.T:
        yield np.interp(times, e.time, values)


def _behind_filters(e: Evidence, event: _Event) -> Iterator[Array]:
    """The predicted force behind filters of first order of each of the lags, for `_misfits`."""
    steps = np.diff(e.time[event.wide])
    for values in e.model[event.wide].T:
        course = np.empty((len(values), len(_LAGS)))
        course[0] = values[0]
        for k, span in enumerate(steps):
            course[k + 1] = values[k + 1] + (course[k] - values[k + 1]) * np.exp(-span / _LAGS)
        yield course[np.searchsorted(event.wide, event.rows)]
