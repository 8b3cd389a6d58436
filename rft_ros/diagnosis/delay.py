"""Whether the stamps of the load cell differ from those of the poses by a constant delay, or its driver is slow."""

from collections.abc import Iterator

import numpy as np

from rft_ros.diagnosis.evidence import ENOUGH, Array, Evidence
from rft_ros.diagnosis.finding import Finding

_LONGEST = 0.25  # s
_DELAYS = np.linspace(-_LONGEST, _LONGEST, 251)  # that are tried
_LAGS = np.linspace(0.0, 0.2, 41)[
    1:
]  # time constants of a filter of first order that are tried [s]
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
    known = [
        found
        for at in _events(e)
        if (found := _misfits(e, at)) is not None and found[0].min() < _EXPLAINED
    ]
    if len(known) < 2:
        return
    both = np.array([misfits for misfits, _ in known])
    gaps = np.array([gap for _, gap in known])
    each = both[:, : len(_DELAYS)]
    of_lags = both[:, len(_DELAYS) :].sum(axis=0)
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
    evidence = {
        "stops": len(each),
        "left": float(100.0 * np.sqrt(total[best] / total[none])),
        "delay": 1e3 * abs(delay),
    }
    said = (
        "the load cell's stamps are {delay:.0f} ms "
        + ("later" if delay > 0.0 else "earlier")
        + " than its events"
    )
    advice = "fit it with rft calibrate"
    if of_lags.min() < _FILTERED * total[best]:
        evidence |= {"lag": float(1e3 * _LAGS[of_lags.argmin()])}
        said = "the force follows the motion like a filter of {lag:.0f} ms, more slowly than the poses"
        advice = "raise the cut-off frequency in the load cell's driver"
    said += ", by {stops} stops (the misfit there falls to {left:.0f} % with it)"
    set_to = round(e.load_cell.delay + delay, 3)
    yield Finding(
        name="delay", said=said, evidence=evidence, remedy={"sensor.delay": set_to}, advice=advice
    )


def _events(e: Evidence) -> list[float]:
    """Times [s] in the grains at which the velocity changes by more than half of the greatest one."""
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


def _misfits(e: Evidence, at: float) -> tuple[Array, float] | None:
    """The share of the force's square that remains about a time [s], for each delay, then for each lag of a filter.

    Beside it the greatest time between two samples [s]. None if too little is known.
    """
    rows = np.flatnonzero((np.abs(e.time - at) <= _WINDOW) & e.in_grains)
    if len(rows) < ENOUGH:
        return None
    time = e.time[rows]
    wide = np.flatnonzero(np.abs(e.time - at) <= _WINDOW + _LONGEST)
    # a busy machine leaves gaps; beyond `max_input_age` nothing lies between
    gap = float(np.diff(e.time[wide]).max())
    if (
        time.min() > at - 0.5 * _WINDOW
        or time.max() < at + 0.5 * _WINDOW
        or gap > e.settings.max_input_age
    ):
        return None
    line = np.linalg.qr(np.stack([np.ones_like(time), time - at], axis=1))[0]

    def bent(force: Array) -> Array:
        """Without a line in time."""
        return np.asarray(force - line @ (line.T @ force))

    measured = bent(e.force[rows])
    at_delays = np.subtract.outer(time, _DELAYS)
    whole = float((measured**2).sum())
    misfits = np.full(len(_DELAYS) + len(_LAGS), whole)
    for force, of_model in zip(measured.T, e.model.T, strict=True):
        course = np.interp(at_delays, e.time, of_model)
        filtered = _filtered(e.time[wide], of_model[wide])[np.searchsorted(wide, rows)]
        predicted = bent(np.hstack([course, filtered]))
        shared = np.maximum(force @ predicted, 0.0)
        misfits -= shared**2 / np.maximum((predicted**2).sum(axis=0), 1e-12)
    return np.maximum(misfits, 0.0) / max(whole, 1e-12), gap


def _filtered(time: Array, values: Array) -> Array:
    """Values, shape [n], behind filters of first order, one column for each of the lags."""
    found = np.empty((len(time), len(_LAGS)))
    found[0] = values[0]
    for k, span in enumerate(np.diff(time)):
        found[k + 1] = values[k + 1] + (found[k] - values[k + 1]) * np.exp(-span / _LAGS)
    return found
