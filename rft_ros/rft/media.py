"""Media: the Fourier coefficients of the 2D stresses per depth (Eq. (4); Li, Zhang, Goldman 2013, table S2)."""

from dataclasses import dataclass

__all__ = ["MEDIA", "Medium", "medium_named"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Medium:
    """Nine Fourier coefficients of α_z(β, γ) and α_x(β, γ) [N/cm³], Eq. (4), before the scale factor ζ.

    Subscripts follow Li et al. 2013: A and B make α_z, C and D make α_x; ``m1`` stands for -1.
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

    @property
    def alpha_x_flat(self) -> float:
        """α_x at γ = 0, β = 0 [N/cm³]: the `constant` model's α_y, Eq. (7) (Treers et al. 2021, IV-B)."""
        return self.C11 + self.C01 + self.Cm11


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
