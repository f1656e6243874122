"""Recursive filters along the first axis, without `scipy.signal`, whose import alone takes half a second."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

FloatArray = NDArray[np.float64]


def filter_recursively(
    b: FloatArray, a: FloatArray, x: FloatArray, start: FloatArray | None = None
) -> FloatArray:
    """Return ``y`` (N, ...) with ``a_0 y_n + a_1 y_n-1 + ... = b_0 x_n + b_1 x_n-1 + ...``, ``a_0`` one.

    Equivalent to `scipy.signal.lfilter` with ``axis=0``: solved as a system with a lower band.

    Args:
        b: (m,) coefficients of the input.
        a: (n,) coefficients of the output, the first is 1.
        x: (N, ...) input [unit].
        start: (k, ...) state before the first sample, k at most N, as ``zi`` of scipy; without it at rest.
    """
    y = b[0] * x
    for lag in range(1, min(b.size, len(x))):
        y[lag:] += b[lag] * x[:-lag]
    if start is not None:
        y[: len(start)] += start
    if y.size == 0:
        return y
    band = np.repeat(a[: len(x), None], len(x), axis=1)
    return lapack.dtbtrs(band, y.reshape(len(x), -1), uplo="L", diag="U")[0].reshape(x.shape)
