"""The part of a triangle below the surface: depth integrated over it, exactly, from the depths of its corners."""

from rft_ros.rft.compiled import inlined

__all__ = ["wet_part"]


@inlined
def wet_part(d0, d1, d2):  # type: ignore[no-untyped-def]
    """Integrals of depth times each barycentric coordinate over the submerged part, and that part's size, by the area.

    The corner that is alone on its side of the surface cuts off a triangle, over which the integrals are known; the
    rest of a triangle with two corners in the grains is the whole less that (with depths below zero).
    """
    in0, in1, in2 = d0 > 0.0, d1 > 0.0, d2 > 0.0
    count = (1 if in0 else 0) + (1 if in1 else 0) + (1 if in2 else 0)
    one = count == 1
    cut = one or count == 2
    alone0, alone1 = in0 == one, in1 == one
    a = d0 if alone0 else (d1 if alone1 else d2)
    b = d1 if alone0 else (d2 if alone1 else d0)
    c = d2 if alone0 else (d0 if alone1 else d1)
    s = a / (a - b) if cut else 0.0
    t = a / (a - c) if cut else 0.0
    q = s * t * a * (1.0 / 12.0)
    q = q if one else -q
    p, of_b, of_c = (4.0 - s - t) * q, s * q, t * q
    whole = (d0 + d1 + d2) * (1.0 / 12.0) if count > 1 else 0.0
    part = 1.0 / 12.0 if count > 1 else 0.0
    p0 = whole + part * d0 + (p if alone0 else (of_c if alone1 else of_b))
    p1 = whole + part * d1 + (of_b if alone0 else (p if alone1 else of_c))
    p2 = whole + part * d2 + (of_c if alone0 else (of_b if alone1 else p))
    return p0, p1, p2, (s * t if one else (1.0 - s * t if count > 1 else 0.0))
