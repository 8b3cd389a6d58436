"""A measured map of stresses per depth, and the medium that fits it: nine coefficients by least squares.

Eq. (4) is linear in its coefficients, five of α_z and four of α_x. Angles that were not measured may leave combinations
of them open: there the generic medium fills in, scaled by the ζ that fits the map best.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.media import MEDIA, OF_ALPHA_X, OF_ALPHA_Z, Medium, stress_terms

__all__ = ["LeftOut", "MediumFit", "StressMap", "fit_medium"]

Array = NDArray[np.float64]

_OPEN = 0.04  # a combination of terms whose RMS over the cells is below this is not determined by the map
_PART = 0.15  # least share in an open combination with which a coefficient is named in a remark
_BETTER = 0.9  # a change of convention is named if it lowers the misfit below this share; n changes: its nth power
_ENOUGH = 8  # cells, of which fewer say nothing about conventions
_FEW = 20  # with fewer cells there is no check on left-out cells: each half would be too small
_NO_MEDIUM = 0.4  # share of the stress (RMS) that a fit may leave without a doubt
_OUTLIER = 5.0  # times the median residual; Gaussian noise reaches 3.5 in 5,000 cells
_WORST = 3  # cells that a doubt lists
_WEAKEST, _STRONGEST = 0.05, 5.0  # ζ of the generic medium; beyond, the stresses are probably in another unit


_RIGHT = 0.5 * np.pi
_BETAS = {
    "": (0.0, 1.0),
    "beta negated": (0.0, -1.0),
    "90° - beta as beta": (_RIGHT, -1.0),
    "90° + beta as beta": (_RIGHT, 1.0),
}
"""For each change of convention: β of Eq. (3) is `first` + `sign` · the map's β."""
_GAMMAS = {
    "": (0.0, 1.0),
    "gamma negated": (0.0, -1.0),
    "90° - gamma as gamma": (_RIGHT, -1.0),
    "gamma - 90° as gamma": (-_RIGHT, 1.0),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StressMap:
    """Stresses per depth on a plate at n pairs of angles, shape [n] each.

    `beta`: attack angle [rad], 0 for a level plate, as in Eq. (3); `gamma`: intrusion angle [rad], positive downwards;
    `alpha_x`, against the motion along e2, and `alpha_z`, upwards [N/cm³]: NaN where missing.
    """

    beta: Array
    gamma: Array
    alpha_x: Array
    alpha_z: Array


class LeftOut(NamedTuple):
    """RMS of the stress (α_x, α_z) [N/cm³] on cells that a fit did not see: each half by a fit to the other half."""

    fitted: float
    scaled: float


@dataclass(frozen=True, slots=True, kw_only=True)
class MediumFit:
    """The medium that fits a map.

    `errors`: standard error of each coefficient [N/cm³], by its name; NaN where the map does not determine it. `zeta`:
    of the generic medium that fits best. `size`, `misfit`, `misfit_scaled`: RMS of the stress (α_x, α_z) as measured,
    less the fit, and less that generic medium [N/cm³]. `left_out`: None with fewer than 20 cells. `remarks`: sentences
    on what the map does not say. Sentences on what may be wrong with it are the medium's `doubts`.
    """

    medium: Medium
    errors: Mapping[str, float]
    zeta: float
    size: float
    misfit: float
    misfit_scaled: float
    left_out: LeftOut | None
    remarks: tuple[str, ...]


class _OneStress(NamedTuple):
    """The fit of the coefficients of one stress, by their names. `open`: those that the cells determine only together.

    `is_measured`: whether any cell has this stress.
    """

    stress: str
    is_measured: bool
    coefficients: dict[str, float]
    errors: dict[str, float]
    open: list[tuple[str, ...]]

    def remarks(self, zeta: float) -> list[str]:
        """Sentences on the coefficients that the generic medium times ζ fills in."""
        filled = f"the generic medium times {zeta:.3g}"
        if not self.is_measured:
            return [f"no {self.stress} was measured: {_listed([*self.coefficients])} are those of {filled}"]
        sentences = []
        for group in self.open:
            if len(group) == 1:
                why = f"{group[0]} of {self.stress} is not identifiable, since its term is 0 at the measured angles"
            else:
                why = f"{_listed(group)} of {self.stress} are not identifiable one by one from the measured angles,"
                why += " only in combination"
            sentences.append(f"{why}; {filled} fills in")
        return sentences


def fit_medium(measured: StressMap, *, name: str) -> MediumFit:
    """The coefficients that fit the map best in the sense of least squares; cells without a number do not count.

    Raises ValueError where the map has no stress at all, or stresses that point along the motion.
    """
    fitted, parts, zeta = _fitted(measured, name)
    if fitted is None:
        raise ValueError("no cell has a stress that is a number other than 0")
    doubts = _conventions(measured) or _units(zeta) or _far_cells(fitted, measured)
    if fitted.strength <= 0.0:
        reason = "with these stresses the force points along the motion, where it should resist"
        raise ValueError("; ".join([reason, *doubts]))
    if fitted.alpha_x_flat <= 0.0:
        value = f"alpha_x at beta 0, gamma 0 is {fitted.alpha_x_flat:.3g} N/cm³ by the fit"
        along = "with alpha_y.model constant the force on a plate would point along its motion"
        doubts.append(f"{value}, so that {along}; use linear or a table")
    of_z, of_x = parts
    return MediumFit(
        medium=replace(fitted, doubts=tuple(doubts)),
        errors=of_z.errors | of_x.errors,
        zeta=zeta,
        size=_misfit(_scaled(0.0), measured),
        misfit=_misfit(fitted, measured),
        misfit_scaled=_misfit(_scaled(zeta), measured),
        left_out=_left_out(measured, name),
        remarks=(*_missing(measured), *of_z.remarks(zeta), *of_x.remarks(zeta)),
    )


def _far_cells(fitted: Medium, measured: StressMap) -> list[str]:
    """A sentence on the worst cells, where the fit leaves much of the stress, or some cells stand out.

    Both come of swapped columns, of copied cells and of wrong signs in a part of the map.
    """
    of_x, of_z = fitted.stresses(measured.beta, measured.gamma)
    residual = np.hypot(np.nan_to_num(measured.alpha_x - of_x), np.nan_to_num(measured.alpha_z - of_z))
    size, misfit = _misfit(_scaled(0.0), measured), _misfit(fitted, measured)
    outlying = residual > max(_OUTLIER * float(np.median(residual)), _NO_MEDIUM * size)
    if misfit <= _NO_MEDIUM * size and not outlying.any():
        return []
    cells = []
    for k in np.argsort(residual)[::-1][:_WORST]:
        beta, gamma = np.rad2deg([measured.beta[k], measured.gamma[k]])
        cells.append(f"beta {beta:.4g}, gamma {gamma:.4g} (by {residual[k]:.3g} N/cm³)")
    left = f"the fit leaves {misfit:.3g} of {size:.3g} N/cm³ (RMS)"
    return [f"{left}; it is furthest from the cells {', '.join(cells)}: check these, and the order of the columns"]


def _scaled(zeta: float) -> Medium:
    """The generic medium times ζ."""
    return Medium.of("generic", {name: zeta * value for name, value in MEDIA["generic"].coefficients.items()})


def _fitted(measured: StressMap, name: str) -> tuple[Medium | None, tuple[_OneStress, _OneStress], float]:
    """The medium, the parts of its fit and ζ of the generic medium; no medium where there is no stress to fit."""
    zeta = _zeta(*_both(MEDIA["generic"], measured))
    start = _scaled(zeta)
    of_z, of_x = stress_terms(measured.beta, measured.gamma)
    parts = _fit("alpha_z", OF_ALPHA_Z, of_z, measured, start), _fit("alpha_x", OF_ALPHA_X, of_x, measured, start)
    found = parts[0].coefficients | parts[1].coefficients
    return (Medium.of(name, found) if any(found.values()) else None), parts, zeta


def _fit(stress: str, names: tuple[str, ...], terms: Array, measured: StressMap, start: Medium) -> _OneStress:
    """The coefficients of one stress; in combinations that the cells leave open, those of the medium `start`."""
    values: Array = getattr(measured, stress)
    there = np.isfinite(values)
    terms, values, count = terms[there], values[there], max(int(there.sum()), 1)
    first = np.array([getattr(start, name) for name in names])
    mean_squares, combinations = np.linalg.eigh(terms.T @ terms / count)  # combinations: a column each
    known = mean_squares > _OPEN**2
    determined = combinations[:, known]
    inverse = determined / mean_squares[known] @ determined.T / count
    coefficients = first + inverse @ terms.T @ (values - terms @ first)
    groups = _groups(names, combinations[:, ~known])
    residual, freedom = values - terms @ coefficients, len(values) - int(known.sum())
    variance = float(residual @ residual) / freedom if freedom > 0 else np.nan
    errors = dict(zip(names, np.sqrt(variance * np.diag(inverse)).tolist(), strict=True))
    errors |= dict.fromkeys(itertools.chain(*groups), np.nan)
    return _OneStress(stress, bool(there.any()), dict(zip(names, coefficients.tolist(), strict=True)), errors, groups)


def _groups(names: tuple[str, ...], combinations: Array) -> list[tuple[str, ...]]:
    """The coefficients that open combinations, a column each, tie together.

    A group of one is a coefficient whose term is 0 at all measured angles.
    """
    from scipy.sparse.csgraph import connected_components

    tied = np.abs(combinations @ combinations.T) > _PART**2  # the projector on what is open
    is_open = np.flatnonzero(np.diag(tied))
    count, group_of = connected_components(tied[np.ix_(is_open, is_open)], directed=False)
    return [tuple(names[k] for k in is_open[group_of == group]) for group in range(count)]


def _listed(names: Sequence[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}"


def _both(medium: Medium, measured: StressMap) -> tuple[Array, Array]:
    """The stresses of a medium and as measured, α_x and then α_z, where measured."""
    model = np.concatenate(medium.stresses(measured.beta, measured.gamma))
    stress = np.concatenate([measured.alpha_x, measured.alpha_z])
    there = np.isfinite(stress)
    return model[there], stress[there]


def _zeta(model: Array, stress: Array) -> float:
    """The factor ζ, 0 or more, with which a model fits best."""
    over = float(model @ model)
    return max(float(model @ stress) / over, 0.0) if over > 0.0 else 0.0


def _misfit(medium: Medium, measured: StressMap) -> float:
    """RMS over the cells of the vector (α_x, α_z), measured less the medium's [N/cm³]."""
    model, stress = _both(medium, measured)
    return _rms(stress - model)


def _rms(components: Array) -> float:
    """RMS of vectors of two components, of which either may be missing."""
    return float(np.sqrt(2.0 * np.mean(components**2))) if len(components) else 0.0


def _selected(measured: StressMap, rows: NDArray[np.bool_]) -> StressMap:
    return StressMap(**{field.name: getattr(measured, field.name)[rows] for field in fields(measured)})


def _left_out(measured: StressMap, name: str) -> LeftOut | None:
    """Two fits, each to one colour of a checkerboard over β and γ, judged on the other colour."""
    there = np.isfinite(measured.alpha_x) | np.isfinite(measured.alpha_z)
    measured = _selected(measured, there)
    dark = (_ranks(measured.beta) + _ranks(measured.gamma)) % 2 == 0
    if len(dark) < _FEW or not 0.25 < dark.mean() < 0.75:
        return None
    squares = np.zeros(2)
    for seen in (dark, ~dark):
        rest = _selected(measured, ~seen)
        fitted, _, zeta = _fitted(_selected(measured, seen), name)
        for k, medium in enumerate((fitted or _scaled(0.0), _scaled(zeta))):
            squares[k] += (~seen).mean() * _misfit(medium, rest) ** 2
    return LeftOut(*np.sqrt(squares).tolist())


def _ranks(angles: Array) -> NDArray[np.int64]:
    """The place of each angle among the different ones, to 0.1 degrees."""
    return np.unique(np.round(np.rad2deg(angles), 1), return_inverse=True)[1].astype(np.int64)


def _missing(measured: StressMap) -> list[str]:
    """A sentence on cells without a number, where the angles make a grid of which at least half is there."""
    beta, gamma = _ranks(measured.beta), _ranks(measured.gamma)
    cells = (beta.max() + 1) * (gamma.max() + 1)
    sentences = []
    for stress, values in (("alpha_x", measured.alpha_x), ("alpha_z", measured.alpha_z)):
        there = np.isfinite(values)
        measured_cells = len(set(zip(beta[there].tolist(), gamma[there].tolist(), strict=True)))
        if 0.5 * cells <= measured_cells < cells:
            grid = f"grid of {beta.max() + 1} beta x {gamma.max() + 1} gamma"
            sentences.append(f"{cells - measured_cells} of {cells} cells of the {grid} have no {stress}")
        elif measured_cells < cells and not there.all():
            sentences.append(f"{(~there).sum()} of {len(there)} rows have no {stress}")
    return sentences


def _conventions(measured: StressMap) -> list[str]:
    """A sentence on signs and zeros of the angles with which Li's media, scaled, fit better than with those given.

    The fit itself cannot tell: it follows a map with reversed signs as closely as the right one.
    """
    if min(np.isfinite(measured.alpha_x).sum(), np.isfinite(measured.alpha_z).sum()) < _ENOUGH:
        return []
    there = np.isfinite([measured.alpha_x, measured.alpha_z])
    tried = []
    for (of_beta, beta), (of_gamma, gamma) in itertools.product(_BETAS.items(), _GAMMAS.items()):
        angles = beta[0] + beta[1] * measured.beta, gamma[0] + gamma[1] * measured.gamma
        models = [np.array(medium.stresses(*angles))[there] for medium in MEDIA.values()]
        for x, z in itertools.product((1.0, -1.0), repeat=2):
            stress = np.array([x * measured.alpha_x, z * measured.alpha_z])[there]
            changes = [change for change in (of_beta, of_gamma) if change]
            changes += [f"{name} negated" for name, sign in (("alpha_x", x), ("alpha_z", z)) if sign < 0.0]
            misfit = min(_rms(stress - _zeta(model, stress) * model) for model in models)
            tried.append((misfit / _BETTER ** len(changes), misfit, changes))
    as_given = tried[0][1]
    _, misfit, changes = min(tried)
    if not changes:
        return []
    better = f"RMS {misfit:.3g} N/cm³ in place of {as_given:.3g}"
    named = " and ".join(changes)
    return [f"with {named} the map fits Li's media better ({better}); check its conventions against docs/method.md"]


def _units(zeta: float) -> list[str]:
    """A sentence on stresses that are weaker or stronger than those of any grains measured so far."""
    if _WEAKEST <= zeta <= _STRONGEST:
        return []
    stresses = f"the stresses are {zeta:.3g} times those of the generic medium"
    return [f"{stresses}, outside of {_WEAKEST:g} to {_STRONGEST:g}; they must be in N/cm³, a pressure over its depth"]
