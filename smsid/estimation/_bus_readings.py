"""What sensors on the bus of a spacecraft read, with derivatives by the tangent of q, by v and by a."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from smsid.estimation.measurements import matrix

_CROSS = np.zeros((3, 9))  # of each component, the nine of its matrix: one product instead of six assignments
_CROSS[[2, 1, 0], [1, 2, 5]] = -1.0, 1.0, -1.0
_CROSS[[2, 1, 0], [3, 6, 7]] = 1.0, -1.0, 1.0


class Bus:
    """The bus at one instant: q (nq,), v (nv,), a (nv,) of a free-flyer, gravity (3,) [m/s^2].

    Methods write predictions into ``rows`` of h, and derivatives into the first six columns of others.
    """

    def __init__(self, q: np.ndarray, v: np.ndarray, a: np.ndarray, gravity: np.ndarray) -> None:
        self.origin, self.rotation = q[:3], matrix(q[3:7])
        self.linear, self.omega = v[:3], v[3:6]
        self.a, self.alpha = a[:3], a[3:6]
        self.weight = self.rotation.T @ gravity if gravity.any() else None

    @cached_property
    def spin(self) -> np.ndarray:
        """omega x, (3, 3)."""
        return cross_matrices(self.omega)

    @cached_property
    def turning(self) -> np.ndarray:
        """Acceleration of a point per its place (3, 3): alpha x + omega x omega x."""
        return cross_matrices(self.alpha) + self.spin @ self.spin

    def position(self, rows: slice, r: np.ndarray, h: np.ndarray, cq: np.ndarray) -> None:
        """Write the place of a point r (3,) fixed in the bus, world axes: h (m,), cq (m, nv)."""
        h[rows] = self.origin + self.rotation @ r
        cq[rows, 0:3] = self.rotation
        cq[rows, 3:6] = -self.rotation @ cross_matrices(r)

    def velocity(self, rows: slice, r: np.ndarray, h: np.ndarray, cq: np.ndarray, cv: np.ndarray) -> None:
        """Write the velocity of a point r (3,) fixed in the bus, world axes: h (m,), cq, cv (m, nv)."""
        u = self.linear + self.spin @ r
        h[rows] = self.rotation @ u
        cq[rows, 3:6] = -self.rotation @ cross_matrices(u)
        cv[rows, 0:3] = self.rotation
        cv[rows, 3:6] = -self.rotation @ cross_matrices(r)

    def force(
        self, rows: slice, places: np.ndarray, h: np.ndarray, cq: np.ndarray, cv: np.ndarray, ca: np.ndarray
    ) -> None:
        """Write specific forces at ``places`` (n, 3) fixed in the bus, bus axes: h (m,), cq, cv, ca (m, nv).

        By the bus's own acceleration they have the unit matrix, which is left to the caller.
        """
        n = len(places)
        arms = cross_matrices(places)
        h[rows] = (self.a + self.spin @ self.linear + places @ self.turning.T).ravel()
        carried = arms @ self.spin
        by_v = cv[rows].reshape(n, 3, -1)
        by_v[:, :, 0:3] = self.spin
        # -(v + omega x r) x - omega x r x, with (omega x r) x = omega x r x - r x omega x
        by_v[:, :, 3:6] = carried - 2.0 * carried.transpose(0, 2, 1) - cross_matrices(self.linear)
        ca[rows].reshape(n, 3, -1)[:, :, 3:6] = -arms
        if self.weight is not None:
            h[rows] -= np.tile(self.weight, n)
            cq[rows].reshape(n, 3, -1)[:, :, 3:6] = -cross_matrices(self.weight)


def cross_matrices(x: np.ndarray) -> np.ndarray:
    """Return the matrices (..., 3, 3) of the cross product with vectors (..., 3)."""
    return (x @ _CROSS).reshape(*x.shape, 3)
