"""Products and solutions of small systems in compiled code, where many numbers are zero.

Bodies that do not meet have zeros in common, and joints of different trees. These are skipped, so that many free bodies
in one model cost little more than each alone.
"""

from rft_ros.rft.kernel.compilation import inlined

__all__ = ["dot", "multiply", "solve"]


@inlined
def dot(a, b):
    """The sum of products of two vectors."""
    s = 0.0
    for k in range(len(a)):
        s += a[k] * b[k]
    return s


@inlined
def multiply(a, b, out):
    """Write the product of two matrices."""
    out[:] = 0.0
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            if a[i, k] != 0.0:
                for j in range(b.shape[1]):
                    out[i, j] += a[i, k] * b[k, j]


@inlined
def solve(a, x):
    """Solve a x = x in place for the columns of x, by elimination with pivots; a is overwritten too."""
    size = len(a)
    for i in range(size):
        p = i
        for j in range(i + 1, size):
            if abs(a[j, i]) > abs(a[p, i]):
                p = j
        if p != i:
            for k in range(i, size):
                a[i, k], a[p, k] = a[p, k], a[i, k]
            for k in range(x.shape[1]):
                x[i, k], x[p, k] = x[p, k], x[i, k]
        for j in range(i + 1, size):
            if a[j, i] != 0.0:
                f = a[j, i] / a[i, i]
                for k in range(i, size):
                    a[j, k] -= f * a[i, k]
                for k in range(x.shape[1]):
                    x[j, k] -= f * x[i, k]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            if a[i, k] != 0.0:
                for j in range(x.shape[1]):
                    x[i, j] -= a[i, k] * x[k, j]
        for j in range(x.shape[1]):
            x[i, j] /= a[i, i]
