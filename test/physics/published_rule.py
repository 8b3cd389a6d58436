"""The published rule in plain Python, as in docs/method.md: angles by atan2, weights by tanh and atanh.

Slow on purpose and independent of rft_ros: it computes angles, the kernel avoids them.
"""

from collections.abc import Callable, Iterable, Sequence
from math import atan2, atanh, cos, degrees, hypot, pi, sin, tanh

from rft_ros.rft import ANGULAR_VELOCITY, QUATERNION, VELOCITY

Vec = Sequence[float]
AlphaY = Callable[[float, float], float]  # β, γ [rad] -> N/cm³

# A00, A10, B11, B01, B-11, C11, C01, C-11, D10 (Li, Zhang, Goldman 2013, table S2)
MEDIA = {
    "generic": (0.206, 0.169, 0.212, 0.358, 0.055, -0.124, 0.253, 0.007, 0.088),
    "poppy_seeds_loose": (0.051, 0.047, 0.053, 0.083, 0.020, -0.026, 0.057, 0.000, 0.025),
    "poppy_seeds_close": (0.094, 0.092, 0.092, 0.151, 0.035, -0.039, 0.086, 0.018, 0.046),
}
A1, A2, A3, N1 = 0.440850096954369, 3.62263982880971, 1.60910808139526, 0.832324700111401
B1, B2, B3, N23 = 1.99392673405210, 1.61146827229181, 0.973746396532650, 5.81083560370960


def f1(u: float) -> float:
    return A1 * (tanh(A2 * u - A3) + tanh(A3)) / N1


def f23(w: float) -> float:
    return B1 * (atanh(B2 * w - B3) + atanh(B3)) / N23


def alpha_z(medium: str, beta: float, gamma: float) -> float:
    A00, A10, B11, B01, Bm11, *_ = MEDIA[medium]
    return (
        A00
        + A10 * cos(2 * beta)
        + B11 * sin(2 * beta + gamma)
        + B01 * sin(gamma)
        + Bm11 * sin(-2 * beta + gamma)
    )


def alpha_x(medium: str, beta: float, gamma: float) -> float:
    *_, C11, C01, Cm11, D10 = MEDIA[medium]
    return (
        C11 * cos(2 * beta + gamma)
        + C01 * cos(gamma)
        + Cm11 * cos(-2 * beta + gamma)
        + D10 * sin(2 * beta)
    )


def constant(medium: str) -> AlphaY:
    value = alpha_x(medium, 0.0, 0.0)
    return lambda _beta, _gamma: value


def linear(beta: float, _gamma: float) -> float:
    return 0.2035 - 0.0015 * degrees(beta)


def tabulated(beta: float, _gamma: float) -> float:
    """That of `TABLE`, which is constant beyond its nodes: with e2 from the velocity β can be a little below 0."""
    return 0.1 + (0.3 - 0.1) * min(max(beta, 0.0), pi) / pi


TABLE = [0.0, pi], [0.0], [[0.1], [0.3]]
"""β [rad], γ [rad] and α_y [N/cm³] of a table."""

ALPHA_Y: dict[str, Callable[[str], AlphaY]] = {
    "constant": constant,
    "linear": lambda _medium: linear,
    "table": lambda _medium: tabulated,
}
"""For each value of `alpha_y.model`, Eq. (7) in a medium."""


def dot(a: Vec, b: Vec) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vec, b: Vec) -> tuple[float, float, float]:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def directions(n: Vec, v: Vec) -> tuple[Vec, Vec]:
    """e1 and e2 of a plate with outward unit normal n that moves at v."""
    speed = hypot(*v)
    hx, hy = n[0], n[1]
    if abs(n[2]) >= 1 - 1e-3:  # horizontal plate: the velocity's horizontal direction, nudged
        hx, hy = v[0] / speed + 1e-5, v[1] / speed
    h = hypot(hx, hy)
    e2 = (hx / h, hy / h, 0.0)
    return cross(e2, (0.0, 0.0, 1.0)), e2


def angles(n: Vec, v: Vec) -> tuple[float, float]:
    """Attack angle β and intrusion angle γ [rad]."""
    _, e2 = directions(n, v)
    beta = atan2(n[2], dot(n, e2)) + pi / 2
    gamma = -atan2(v[2], dot(v, e2)) if (v[2], dot(v, e2)) != (0.0, 0.0) else 0.0
    return beta, gamma


def plate_force(
    n: Vec, v: Vec, depth: float, area: float, medium: str, zeta: float, alpha_y: AlphaY
) -> Vec:
    """Force [N] on a plate: outward unit normal, velocity [m/s], depth of its centroid [m], area [m²]."""
    if dot(v, n) <= 0.0 or depth <= 0.0:
        return 0.0, 0.0, 0.0
    e1, e2 = directions(n, v)
    beta, gamma = angles(n, v)
    v1 = dot(v, e1)
    v23 = hypot(dot(v, e2), v[2])
    speed = hypot(*v)
    sign = (v1 > 0) - (v1 < 0)
    along_e1 = -f1(abs(v1) / speed) * alpha_y(beta, gamma) * sign
    along_e2 = -f23(v23 / speed) * alpha_x(medium, beta, gamma)
    along_e3 = f23(v23 / speed) * alpha_z(medium, beta, gamma)
    scale = zeta * 1e6 * depth * area
    return (
        scale * (along_e1 * e1[0] + along_e2 * e2[0]),
        scale * (along_e1 * e1[1] + along_e2 * e2[1]),
        scale * along_e3,
    )


def turned(q: Vec, r: Vec) -> Vec:
    """The vector r turned by the unit quaternion q (xyzw)."""
    t = cross(q[:3], r)
    c = cross(q[:3], t)
    return tuple(r[k] + 2 * (q[3] * t[k] + c[k]) for k in range(3))


def wrench(
    plates: Iterable[tuple[Vec, Vec, float]],
    state: Vec,
    medium: str = "generic",
    zeta: float = 1.0,
    alpha_y: AlphaY | None = None,
    surface_height: float = 0.0,
) -> list[float]:
    """Force [N] and torque about the tool frame's origin [N m] of plates (centroid, normal, area) in the tool frame."""
    p, q, v, w = state[0:3], state[QUATERNION], state[VELOCITY], state[ANGULAR_VELOCITY]
    total = [0.0] * 6
    for centroid, normal, area in plates:
        r, n = turned(q, centroid), turned(q, normal)
        wr = cross(w, r)
        u = (v[0] + wr[0], v[1] + wr[1], v[2] + wr[2])
        f = plate_force(
            n, u, surface_height - p[2] - r[2], area, medium, zeta, alpha_y or constant(medium)
        )
        for k, part in enumerate((*f, *cross(r, f))):
            total[k] += part
    return total
