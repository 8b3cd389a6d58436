"""Media: the Fourier coefficients of the 2D stresses per depth (Eq. (4); Li, Zhang, Goldman 2013, table S2)."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

OF_ALPHA_Z = ("A00", "A10", "B11", "B01", "Bm11")
"""The coefficients of α_z, in the order of Eq. (4)."""

OF_ALPHA_X = ("C11", "C01", "Cm11", "D10")
"""The coefficients of α_x, in the order of Eq. (4)."""


def stress_terms(beta: Array, gamma: Array) -> tuple[Array, Array]:
    """What each coefficient is multiplied with in Eq. (4): for α_z shape [n, 5], for α_x shape [n, 4]; no unit.

    `beta`, `gamma`: angles of attack and intrusion [rad], shape [n]. Columns: `OF_ALPHA_Z` and `OF_ALPHA_X`.
    """
    z_terms = (
        np.ones_like(beta),
        np.cos(2.0 * beta),
        np.sin(2.0 * beta + gamma),
        np.sin(gamma),
        np.sin(gamma - 2.0 * beta),
    )
    x_terms = (
        np.cos(2.0 * beta + gamma),
        np.cos(gamma),
        np.cos(gamma - 2.0 * beta),
        np.sin(2.0 * beta),
    )
    return np.column_stack(z_terms), np.column_stack(x_terms)


@dataclass(frozen=True, slots=True, kw_only=True)
class Medium:
    """Nine Fourier coefficients of α_z(β, γ) and α_x(β, γ) [N/cm³], Eq. (4), before the scale factor ζ.

    Subscripts follow Li et al. 2013: A and B make α_z, C and D make α_x; ``m1`` stands for -1. `doubts`: sentences on
    why the measurement behind the coefficients may be wrong.
    """

    name: str
    A00: float
    A10: float
    B11: float
    B01: float
    Bm11: float
    C11: float
    C01: float
    Cm11: float
    D10: float
    doubts: tuple[str, ...] = field(default=(), compare=False)

    @classmethod
    def of(
        cls, name: str, coefficients: Mapping[str, float], *, doubts: tuple[str, ...] = ()
    ) -> "Medium":
        """The medium with these coefficients [N/cm³], by their names. Raises KeyError for one that is missing."""
        coefficients_used = {part: coefficients[part] for part in (*OF_ALPHA_Z, *OF_ALPHA_X)}
        return cls(name=name, doubts=doubts, **coefficients_used)

    @property
    def coefficients(self) -> dict[str, float]:
        """The nine coefficients [N/cm³] by name."""
        return {name: getattr(self, name) for name in (*OF_ALPHA_Z, *OF_ALPHA_X)}

    @property
    def alpha_x_flat(self) -> float:
        """α_x at γ = 0, β = 0 [N/cm³]: the `constant` model's α_y, Eq. (7) (Treers et al. 2021, IV-B)."""
        return self.C11 + self.C01 + self.Cm11

    @property
    def strength(self) -> float:
        """The factor with which the generic medium's stresses come closest to these over all directions; no unit."""
        product = norm = 0.0
        for name, generic in _GENERIC.coefficients.items():
            mean_square = 1.0 if name == "A00" else 0.5  # of its term of Eq. (4) over all angles
            product += mean_square * generic * getattr(self, name)
            norm += mean_square * generic * generic
        return product / norm

    def stresses(self, beta: Array, gamma: Array) -> tuple[Array, Array]:
        """α_x and α_z [N/cm³] by Eq. (4), shape [n] each, at these β and γ [rad], shape [n]."""
        z_terms, x_terms = stress_terms(beta, gamma)
        alpha_z: Array = z_terms @ [getattr(self, name) for name in OF_ALPHA_Z]
        alpha_x: Array = x_terms @ [getattr(self, name) for name in OF_ALPHA_X]
        return alpha_x, alpha_z


_GENERIC = Medium(
    name="generic",
    A00=0.206, A10=0.169, B11=0.212, B01=0.358, Bm11=0.055,
    C11=-0.124, C01=0.253, Cm11=0.007, D10=0.088,
)  # fmt: skip
_POPPY_LOOSE = Medium(
    name="poppy_seeds_loose",
    A00=0.051, A10=0.047, B11=0.053, B01=0.083, Bm11=0.020,
    C11=-0.026, C01=0.057, Cm11=0.000, D10=0.025,
)  # fmt: skip
_POPPY_CLOSE = Medium(
    name="poppy_seeds_close",
    A00=0.094, A10=0.092, B11=0.092, B01=0.151, Bm11=0.035,
    C11=-0.039, C01=0.086, Cm11=0.018, D10=0.046,
)  # fmt: skip

MEDIA: dict[str, Medium] = {m.name: m for m in (_GENERIC, _POPPY_LOOSE, _POPPY_CLOSE)}
"""The media that Li et al. 2013 measured, by name."""


def medium_named(name: str) -> Medium:
    """The medium of that name, a key of `MEDIA`. Raises ValueError that lists the known names."""
    try:
        return MEDIA[name]
    except KeyError:
        raise ValueError(f"medium.name '{name}' is none of {', '.join(MEDIA)}") from None
