"""A measured map of stresses per depth, and the medium that fits it: nine coefficients by least squares.

Eq. (4) is linear in its coefficients, five of α_z and four of α_x. Angles that were not measured may leave combinations
of them open: there the generic medium fills in, scaled by the ζ that fits the map best.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.media import MEDIA, OF_ALPHA_X, OF_ALPHA_Z, Medium, stress_terms

Array = NDArray[np.float64]

_OPEN_SHARE = 0.04  # a combination of terms whose RMS over the cells is below this is not determined by the map
# least share in an open combination with which a coefficient counts as not identifiable
_OPEN_PART_SHARE = 0.15
_MAX_MISFIT_SHARE = 0.4  # share of the stress (RMS) that a fit may leave without a doubt
_OUTLIER_FACTOR = 5.0  # times the median residual; Gaussian noise reaches 3.5 in 5,000 cells
_LISTED_CELL_COUNT = 3  # cells that a doubt lists
_MIN_ZETA_RATIO = 0.05  # ζ of the generic medium; below, the stresses are probably in another unit
_MAX_ZETA_RATIO = 5.0  # and above
# least strength, of the generic medium's: weaker stresses are in another unit, or along the motion
_MIN_STRENGTH_RATIO = 5e-4


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

    `errors`: standard error of each coefficient [N/cm³], by its name; NaN where the map does not determine it, infinite
    where it has no cells to spare. `unmeasured`: names of the stresses that no cell has. `zeta`: of the generic medium
    that fits best. `size`, `misfit`, `misfit_scaled`: RMS of the stress (α_x, α_z) as measured, less the fit, and less
    that generic medium [N/cm³]. Sentences on what may be wrong with the map are the medium's `doubts`.
    """

    medium: Medium
    errors: Mapping[str, float]
    unmeasured: tuple[str, ...]
    zeta: float
    size: float
    misfit: float
    misfit_scaled: float

    @property
    def remarks(self) -> list[str]:
        """Sentences on stresses without a cell, and on the coefficients that the generic medium times ζ fills in."""
        open_names = [name for name, error in self.errors.items() if np.isnan(error)]
        if not open_names:
            return []
        return [
            *(f"no {stress} was measured" for stress in self.unmeasured),
            f"{', '.join(open_names)}: not identifiable from the measured stresses and angles; "
            f"the generic medium times {self.zeta:.3g} fills in",
        ]


def fit_medium(stress_map: StressMap, *, name: str) -> MediumFit:
    """The coefficients that fit the map best in the sense of least squares; cells without a number do not count.

    Raises ValueError where the map has no stress at all, or stresses that point along the motion.
    """
    stress = np.array([stress_map.alpha_x, stress_map.alpha_z])
    if not np.nan_to_num(stress).any():
        raise ValueError("no cell has a stress that is a number other than 0")
    generic = np.array(MEDIA["generic"].stresses(stress_map.beta, stress_map.gamma))
    generic_there = generic[np.isfinite(stress)]
    stress_there = stress[np.isfinite(stress)]
    zeta = max(float(generic_there @ stress_there / (generic_there @ generic_there)), 0.0)
    terms_of_z, terms_of_x = stress_terms(stress_map.beta, stress_map.gamma)
    coefficients: dict[str, float] = {}
    errors: dict[str, float] = {}
    for names, terms, values in (
        (OF_ALPHA_Z, terms_of_z, stress_map.alpha_z),
        (OF_ALPHA_X, terms_of_x, stress_map.alpha_x),
    ):
        start = np.array([zeta * MEDIA["generic"].coefficients[name] for name in names])
        best, error = _least_squares(terms, values, start)
        coefficients |= dict(zip(names, best.tolist(), strict=True))
        errors |= dict(zip(names, error.tolist(), strict=True))
    medium = checked_medium(Medium.of(name, coefficients))
    residual = stress - medium.stresses(stress_map.beta, stress_map.gamma)
    doubts = _units(zeta) or _far_cells(stress_map, residual, size=_rms(stress))
    return MediumFit(
        medium=replace(medium, doubts=tuple(doubts)),
        errors=errors,
        unmeasured=tuple(
            name
            for name, values in zip(("alpha_x", "alpha_z"), stress, strict=True)
            if np.isnan(values).all()
        ),
        zeta=zeta,
        size=_rms(stress),
        misfit=_rms(residual),
        misfit_scaled=_rms(stress - zeta * generic),
    )


def checked_medium(medium: Medium) -> Medium:
    """The medium. Raises ValueError if its stresses do not resist the motion, or are far too weak."""
    if medium.strength < _MIN_STRENGTH_RATIO:
        raise ValueError(
            f"the stresses are {medium.strength:.3g} times those of the generic medium: "
            "the force is along the motion, or not in N/cm³; check signs and unit"
        )
    return medium


def _rms(stresses: Array) -> float:
    """RMS over the cells of the vector (α_x, α_z), shape [2, n], of which either may be missing (NaN)."""
    return float(np.sqrt(2.0 * np.nanmean(stresses**2)))


def _units(zeta: float) -> list[str]:
    """A sentence on stresses that are weaker or stronger than those of any grains measured so far."""
    if _MIN_ZETA_RATIO <= zeta <= _MAX_ZETA_RATIO:
        return []
    return [
        f"the stresses are {zeta:.3g} times those of the generic medium, "
        f"outside of {_MIN_ZETA_RATIO:g} to {_MAX_ZETA_RATIO:g}; they must be in N/cm³, a pressure over its depth"
    ]


def _far_cells(stress_map: StressMap, residual: Array, *, size: float) -> list[str]:
    """A sentence on the worst cells, where the fit leaves much of the stress, or some cells stand out.

    Both come of swapped columns, of copied cells, of wrong signs and of angles that are counted from elsewhere.
    `residual`: measured less fitted α_x and α_z, shape [2, n]. `size`: RMS of the stress.
    """
    far = np.hypot(*np.nan_to_num(residual))
    misfit = _rms(residual)
    most = max(_OUTLIER_FACTOR * float(np.median(far)), _MAX_MISFIT_SHARE * size)
    if misfit <= _MAX_MISFIT_SHARE * size and far.max() <= most:
        return []
    cells = []
    for k in np.argsort(far)[::-1][:_LISTED_CELL_COUNT]:
        beta, gamma = np.rad2deg([stress_map.beta[k], stress_map.gamma[k]])
        cells.append(f"beta {beta:.4g}, gamma {gamma:.4g} (by {far[k]:.3g} N/cm³)")
    return [
        f"the fit leaves {misfit:.3g} of {size:.3g} N/cm³ (RMS); "
        f"it is furthest from the cells {', '.join(cells)}: "
        "check these, the order of the columns, and the signs and angles against docs/method.md"
    ]


def _least_squares(terms: Array, values: Array, start: Array) -> tuple[Array, Array]:
    """The coefficients of one stress and their errors; in combinations that the cells leave open, those of `start`.

    `terms`: of each cell, shape [n, k]; `values`: the stress of each cell, shape [n], NaN where missing.
    """
    is_there = np.isfinite(values)
    terms_there = terms[is_there]
    values_there = values[is_there]
    count = max(len(values_there), 1)
    # a combination is a column
    mean_squares, combinations = np.linalg.eigh(terms_there.T @ terms_there / count)
    is_known = mean_squares > _OPEN_SHARE**2
    determined_combinations = combinations[:, is_known]
    inverse = determined_combinations / mean_squares[is_known] @ determined_combinations.T / count
    best = start + inverse @ terms_there.T @ (values_there - terms_there @ start)
    residual = values_there - terms_there @ best
    freedom = len(values_there) - int(is_known.sum())
    errors = np.full(len(start), np.inf)
    if freedom > 0:
        errors = np.sqrt(residual @ residual / freedom * np.diag(inverse))
    is_open = (combinations[:, ~is_known] ** 2).sum(axis=1) > _OPEN_PART_SHARE**2
    errors[is_open] = np.nan
    return best, errors
