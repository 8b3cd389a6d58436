"""Refit the rational approximations of rft_ros/rft/traction.py (tanh, atanh) and alpha_y.py (arctan).

Each odd function F is fitted as F(x) = x p(y) / q(y), where y is a function of x² in which nothing cancels. The fit
minimises the relative error by linearised least squares whose weights grow where the error is largest (Lawson's
method), in 50 digits. Prints the coefficients as the code holds them, the fit's error and that of its evaluation in
double precision. Takes a few seconds. Needs mpmath: pip install mpmath
"""

import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rft_ros.rft import traction as weights

try:
    import mpmath as mp
except ImportError:
    sys.exit("bench/fit_rationals.py needs mpmath: pip install mpmath")

POINTS = 160
ITERATIONS = 12


@dataclass(frozen=True)
class Target:
    """F(x)/x as a function of y on [low, high], to be fitted by degrees (numerator, denominator)."""

    name: str
    ratio: Callable[[mp.mpf], mp.mpf]
    low: mp.mpf
    high: mp.mpf
    degrees: tuple[int, int]


@dataclass(frozen=True)
class Fit:
    """Coefficients in ascending order (the denominator's first is 1) and the greatest relative error."""

    numerator: list[mp.mpf]
    denominator: list[mp.mpf]
    error: mp.mpf


def over(function: Callable[[mp.mpf], mp.mpf]) -> Callable[[mp.mpf], mp.mpf]:
    """F(x)/x of y = x²."""
    return lambda y: function(mp.sqrt(y)) / mp.sqrt(y) if y else mp.mpf(1)


def chebyshev_points(low: mp.mpf, high: mp.mpf) -> list[mp.mpf]:
    middle = (low + high) / 2
    half = (high - low) / 2
    return [middle - half * mp.cos(mp.pi * (k + mp.mpf(1) / 2) / POINTS) for k in range(POINTS)]


def horner(coefficients: list[mp.mpf], y: mp.mpf) -> mp.mpf:
    return mp.polyval(coefficients[::-1], y)


def fit(target: Target) -> Fit:
    m, n = target.degrees
    ys = chebyshev_points(target.low, target.high)
    wanted = [target.ratio(y) for y in ys]
    linearised = [mp.mpf(1)] * POINTS  # 1/|q| of the last iteration
    lawson = [mp.mpf(1)] * POINTS
    best: Fit | None = None
    for _ in range(ITERATIONS):
        rows = mp.matrix(POINTS, m + n + 1)
        right = mp.matrix(POINTS, 1)
        for i, (y, g) in enumerate(zip(ys, wanted, strict=True)):
            weight = linearised[i] * lawson[i] / abs(g)
            for k in range(m + 1):
                rows[i, k] = weight * y**k
            for k in range(1, n + 1):
                rows[i, m + k] = -weight * g * y**k
            right[i] = weight * g
        solution = list(mp.lu_solve(rows.T * rows, rows.T * right))
        p = solution[: m + 1]
        q = [mp.mpf(1), *solution[m + 1 :]]
        errors = [
            abs(horner(p, y) / horner(q, y) / g - 1) for y, g in zip(ys, wanted, strict=True)
        ]
        worst = max(errors)
        if best is None or worst < best.error:
            best = Fit(p, q, worst)
        linearised = [1 / abs(horner(q, y)) for y in ys]
        lawson = [
            w * mp.sqrt(e / worst + mp.mpf("0.05")) for w, e in zip(lawson, errors, strict=True)
        ]
    assert best is not None
    return best


def error_in_double(target: Target, found: Fit) -> float:
    """Greatest relative error with coefficients and arithmetic in double precision."""
    p, q = ([float(c) for c in reversed(part)] for part in (found.numerator, found.denominator))
    ys = [float(y) for y in chebyshev_points(target.low, target.high)]
    values = np.polyval(p, ys) / np.polyval(q, ys)
    return max(
        float(abs(mp.mpf(float(v)) / target.ratio(mp.mpf(y)) - 1))
        for v, y in zip(values, ys, strict=True)
    )


def main() -> int:
    mp.mp.dps = 50
    tanh_end = (mp.mpf(weights.A2) - mp.mpf(weights.A3)) ** 2
    atanh_end = 1 - mp.mpf(weights.B3) ** 2
    targets = [
        Target("tanh, y = x²", over(mp.tanh), mp.mpf(0), tanh_end, (3, 4)),
        Target("atanh, y = 1 - x²", lambda s: over(mp.atanh)(1 - s), atanh_end, mp.mpf(1), (8, 8)),
        Target("arctan, y = x²", over(mp.atan), mp.mpf(0), mp.mpf(1), (4, 5)),
    ]
    for target in targets:
        found = fit(target)
        print(f"{target.name}, degrees {target.degrees[0]} / {target.degrees[1]}")
        print(
            f"  relative error {float(found.error):.1e}, in double precision {error_in_double(target, found):.1e}"
        )
        print("  p:", ", ".join(repr(float(c)) for c in found.numerator))
        print("  q:", ", ".join(repr(float(c)) for c in found.denominator))
    return 0


if __name__ == "__main__":
    sys.exit(main())
