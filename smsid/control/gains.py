"""The gains K_P, K_D of (43): positive definite, of the right size."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse.csgraph import connected_components

from smsid.errors import ControlError


@dataclass(frozen=True)
class Gains:
    """``proportional`` K_P (n, n) [1/s^2] and ``derivative`` K_D (n, n) [1/s] of (43).

    Made by `gains`. Raises `ControlError` when a matrix is not square, not finite, not symmetric or not
    positive definite.
    """

    proportional: np.ndarray
    derivative: np.ndarray

    def __post_init__(self) -> None:
        for name, symbol in (("proportional", "K_P"), ("derivative", "K_D")):
            k = np.asarray(getattr(self, name), dtype=float)
            if k.ndim != 2 or k.shape[0] != k.shape[1] or not np.isfinite(k).all():
                raise ControlError(f"{symbol} of shape {k.shape} is no finite square matrix.", gains=k)
            if not np.allclose(k, k.T, rtol=1e-12, atol=0.0):
                raise ControlError(f"{symbol} is not symmetric.", advice="Give a symmetric matrix.", gains=k)
            smallest = float(np.linalg.eigvalsh(k)[0])
            if smallest <= 0.0:
                raise ControlError(
                    f"{symbol} is not positive definite: its smallest eigenvalue is {smallest:.4g}.",
                    advice="The error dynamics (44) are stable only with positive definite gains.",
                    gains=k,
                )
            object.__setattr__(self, name, k)
        if self.proportional.shape != self.derivative.shape:
            raise ControlError(
                f"K_P is {self.proportional.shape}, K_D is {self.derivative.shape}: they must be of one size."
            )

    @property
    def size(self) -> int:
        """Number of coordinates n."""
        return len(self.proportional)

    def blocks(self) -> list[np.ndarray]:
        """Return the coordinates that the gains couple, group by group, indices (k,) each."""
        count, label = connected_components(
            (self.proportional != 0.0) | (self.derivative != 0.0), directed=False
        )
        return [np.flatnonzero(label == k) for k in range(count)]


def gains(size: int, proportional: float | np.ndarray, derivative: float | np.ndarray) -> Gains:
    """Return gains for ``size`` coordinates, each a number, a diagonal (size,) or a matrix (size, size).

    ``proportional`` is K_P [1/s^2], ``derivative`` K_D [1/s] of (43).

    Raises `ControlError` for another shape or a matrix that is not positive definite.
    """
    matrices = []
    for symbol, k in (("K_P", proportional), ("K_D", derivative)):
        given = np.asarray(k, dtype=float)
        if given.shape not in ((), (size,), (size, size)):
            raise ControlError(
                f"{symbol} has shape {given.shape}; the spacecraft has {size} coordinates (3 of attitude and "
                f"{size - 3} joints).",
                advice=f"Give a number, {size} numbers or a {size} x {size} matrix.",
            )
        matrices.append(given if given.ndim == 2 else np.diag(np.broadcast_to(given, size)))
    return Gains(*matrices)
