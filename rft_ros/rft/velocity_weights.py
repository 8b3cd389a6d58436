"""The weights f1 and f23 of the velocity along and across a plate (Eqs. (5), (6); Treers et al. 2021).

Both are fits to a plate dragged horizontally at angle ψ, exactly 0 at 0 and exactly 1 at 1. The paper prints them
rounded and without the atanh; these are the released code's digits. The kernels below are rational (minimax in the
square of the argument, relative error under 5e-13, fitted by ``bench/fit_rationals.py``): library calls of tanh and
atanh would take three quarters of a plate's time and prevent vectorisation.
"""

import math

from rft_ros.rft.kernel.compilation import inlined

__all__ = ["A1", "A2", "A3", "B1", "B2", "B3", "exact_f1", "exact_f23", "f1_and_f23"]

A1, A2, A3 = 0.440850096954369, 3.62263982880971, 1.60910808139526
B1, B2, B3 = 1.99392673405210, 1.61146827229181, 0.973746396532650
"""Coefficients of Eqs. (5) and (6), with all digits of the released code; no unit."""

_TANH_A3, _ATANH_B3 = math.tanh(A3), math.atanh(B3)
_F1_BRACKET = math.tanh(A2 - A3) + _TANH_A3  # the brackets of Eqs. (5) and (6) at 1
_F23_BRACKET = math.atanh(B2 - B3) + _ATANH_B3


def exact_f1(u: float) -> float:
    """f1 with the library's tanh, Eq. (5): weight of the force along e1, from u = abs(v1)/abs(v) in 0 to 1."""
    return (math.tanh(A2 * u - A3) + _TANH_A3) / _F1_BRACKET


def exact_f23(w: float) -> float:
    """f23 with the library's atanh, Eq. (6): weight of the force across e1, from w = abs(v23)/abs(v) in 0 to 1."""
    return (math.atanh(B2 * w - B3) + _ATANH_B3) / _F23_BRACKET


@inlined
def f1_and_f23(u, w):
    """Rational `exact_f1` of u and `exact_f23` of w, both in 0 to 1 and clamped above against rounding; and 1 / w."""
    x = A2 * min(u, 1.0) - A3
    y = x * x
    # tanh on [-2.02, 2.02] is x p / q
    p = 0.9999999999999886 + y * (0.13302099960519095 + y * (0.003381084867620261 + y * 1.7142159321202105e-05))
    q = 1.0 + y * (
        0.46635433293806744 + y * (0.02549919584996656 + y * (0.0003045503448204258 + y * 4.6455496565101557e-07))
    )
    # atanh on [-B3, B3] is z m / n in s = 1 - z², so that every term is positive and nothing cancels
    z = B2 * min(w, 1.0) - B3
    s = 1.0 - z * z
    m = 12300803.010922123 + s * (9560971.1590504 + s * (2056962.9007124235 + s * 53230.14975437819))
    m = 942294.1898347555 + s * (5548958.519711758 + s * m)
    m = 4.289115687171275 + s * (1132.1464818246257 + s * (58434.8494029061 + s * m))
    n = 10390843.33103938 + s * (11547977.837189073 + s * (4209592.087113166 + s * 331184.6682444988))
    n = 23508.22782228692 + s * (473971.42322102754 + s * (3545352.247192668 + s * n))
    n = 1.0 + s * (360.39315043415434 + s * n)
    reciprocal = 1.0 / (q * n * max(w, 1e-290))  # one division for three
    per_qn = reciprocal * max(w, 1e-290)
    f1 = (1.0 / _F1_BRACKET) * (x * p * (n * per_qn) + _TANH_A3)
    f23 = (1.0 / _F23_BRACKET) * (z * m * (q * per_qn) + _ATANH_B3)
    return (f1 if u > 0.0 else 0.0), (f23 if w > 0.0 else 0.0), reciprocal * (q * n)
