"""A measured map of stresses per depth, and the medium that fits it: nine coefficients by least squares.

Eq. (4) is linear in its coefficients, five of α_z and four of α_x. Angles that were not measured may leave combinations
of them open: there the generic medium fills in, scaled by the ζ that fits the map best.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.media import MEDIA, OF_ALPHA_X, OF_ALPHA_Z, Medium, stress_terms

Array = NDArray[np.float64]

_OPEN = 0.04  # a combination of terms whose RMS over the cells is below this is not determined by the map
_PART = 0.15  # least share in an open combination with which a coefficient is named in a remark
_NO_MEDIUM = 0.4  # share of the stress (RMS) that a fit may leave without a doubt
_OUTLIER = 5.0  # times the median residual; Gaussian noise reaches 3.5 in 5,000 cells
_WORST = 3  # cells that a doubt lists
_WEAKEST = 0.05  # ζ of the generic medium; below, the stresses are probably in another unit
_STRONGEST = 5.0  # and above
_TINY = 1e-300


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


@dataclass(frozen=True, slots=True, kw_only=True)
class MediumFit:
    """The medium that fits a map.

    `errors`: standard error of each coefficient [N/cm³], by its name; NaN where the map does not determine it. `zeta`:
    of the generic medium that fits best. `size`, `misfit`, `misfit_scaled`: RMS of the stress (α_x, α_z) as measured,
    less the fit, and less that generic medium [N/cm³]. `remarks`: sentences on what the map does not say.
    Sentences on what may be wrong with it are the medium's `doubts`.
    """

    medium: Medium
    errors: Mapping[str, float]
    zeta: float
    size: float
    misfit: float
    misfit_scaled: float
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
            return [
                f"no {self.stress} was measured: {_listed([*self.coefficients])} are those of {filled}"
            ]
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
    model, stress = _both(MEDIA["generic"], measured)
    zeta = max(float(model @ stress) / max(float(model @ model), _TINY), 0.0)
    start = _scaled(zeta)
    terms_of_z, terms_of_x = stress_terms(measured.beta, measured.gamma)
    of_z = _fit("alpha_z", OF_ALPHA_Z, terms=terms_of_z, values=measured.alpha_z, start=start)
    of_x = _fit("alpha_x", OF_ALPHA_X, terms=terms_of_x, values=measured.alpha_x, start=start)
    coefficients = of_z.coefficients | of_x.coefficients
    if not any(coefficients.values()):
        raise ValueError("no cell has a stress that is a number other than 0")
    fitted = Medium.of(name, coefficients)
    doubts = _units(zeta) or _far_cells(fitted, measured)
    if fitted.strength <= 0.0:
        reason = "with these stresses the force points along the motion, where it should resist"
        raise ValueError("; ".join([reason, *doubts]))
    if fitted.alpha_x_flat <= 0.0:
        value = f"alpha_x at beta 0, gamma 0 is {fitted.alpha_x_flat:.3g} N/cm³ by the fit"
        along = "with alpha_y.model constant the force on a plate would point along its motion"
        doubts.append(f"{value}, so that {along}; use linear or a table")
    return MediumFit(
        medium=replace(fitted, doubts=tuple(doubts)),
        errors=of_z.errors | of_x.errors,
        zeta=zeta,
        size=_misfit(_scaled(0.0), measured),
        misfit=_misfit(fitted, measured),
        misfit_scaled=_misfit(start, measured),
        remarks=(*of_z.remarks(zeta), *of_x.remarks(zeta)),
    )


def _units(zeta: float) -> list[str]:
    """A sentence on stresses that are weaker or stronger than those of any grains measured so far."""
    if _WEAKEST <= zeta <= _STRONGEST:
        return []
    stresses = f"the stresses are {zeta:.3g} times those of the generic medium"
    return [
        f"{stresses}, outside of {_WEAKEST:g} to {_STRONGEST:g}; they must be in N/cm³, a pressure over its depth"
    ]


def _far_cells(fitted: Medium, measured: StressMap) -> list[str]:
    """A sentence on the worst cells, where the fit leaves much of the stress, or some cells stand out.

    Both come of swapped columns, of copied cells, of wrong signs and of angles that are counted from elsewhere.
    """
    of_x, of_z = fitted.stresses(measured.beta, measured.gamma)
    residual = np.hypot(
        np.nan_to_num(measured.alpha_x - of_x), np.nan_to_num(measured.alpha_z - of_z)
    )
    size = _misfit(_scaled(0.0), measured)
    misfit = _misfit(fitted, measured)
    most = max(_OUTLIER * float(np.median(residual)), _NO_MEDIUM * size)
    if misfit <= _NO_MEDIUM * size and residual.max() <= most:
        return []
    cells = []
    for k in np.argsort(residual)[::-1][:_WORST]:
        beta, gamma = np.rad2deg([measured.beta[k], measured.gamma[k]])
        cells.append(f"beta {beta:.4g}, gamma {gamma:.4g} (by {residual[k]:.3g} N/cm³)")
    left = f"the fit leaves {misfit:.3g} of {size:.3g} N/cm³ (RMS)"
    check = (
        "check these, the order of the columns, and the signs and angles against docs/method.md"
    )
    return [f"{left}; it is furthest from the cells {', '.join(cells)}: {check}"]


def _scaled(zeta: float) -> Medium:
    """The generic medium times ζ."""
    return Medium.of(
        "generic", {name: zeta * value for name, value in MEDIA["generic"].coefficients.items()}
    )


def _fit(
    stress: str, names: tuple[str, ...], *, terms: Array, values: Array, start: Medium
) -> _OneStress:
    """The coefficients of one stress; in combinations that the cells leave open, those of the medium `start`.

    `terms`: of each cell, shape [n, names]; `values`: the stress of each cell, shape [n], NaN where missing.
    """
    there = np.isfinite(values)
    count = max(int(there.sum()), 1)
    terms_there = terms[there]
    values_there = values[there]
    first = np.array([getattr(start, name) for name in names])
    # combinations: a column each
    mean_squares, combinations = np.linalg.eigh(terms_there.T @ terms_there / count)
    known = mean_squares > _OPEN**2
    determined = combinations[:, known]
    inverse = determined / mean_squares[known] @ determined.T / count
    coefficients = first + inverse @ terms_there.T @ (values_there - terms_there @ first)
    residual = values_there - terms_there @ coefficients
    freedom = len(values_there) - int(known.sum())
    variance = float(residual @ residual) / freedom if freedom > 0 else np.nan
    errors = dict(zip(names, np.sqrt(variance * np.diag(inverse)).tolist(), strict=True))
    groups = _groups(names, combinations[:, ~known])
    for group in groups:
        errors |= dict.fromkeys(group, np.nan)
    return _OneStress(
        stress=stress,
        is_measured=bool(there.any()),
        coefficients=dict(zip(names, coefficients.tolist(), strict=True)),
        errors=errors,
        open=groups,
    )


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


def _misfit(medium: Medium, measured: StressMap) -> float:
    """RMS over the cells of the vector (α_x, α_z), of which either may be missing: measured less the medium's."""
    model, stress = _both(medium, measured)
    return float(np.sqrt(2.0 * np.mean((stress - model) ** 2)))
