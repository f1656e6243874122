"""The rate of a state in a chart of the configuration manifold."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from smsid.model.spacecraft import SpacecraftModel

Enforce = Callable[[float, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


class ChartDerivative:
    """Right-hand side in the chart q = q_ref (+) xi: the rate of y = (xi, v) for vdot = acceleration(t, q,
    v).

    Called with t, y (2 nv,) and ``out`` (2 nv,) to write into. Times beyond ``latest`` are taken as
    ``latest``; ``enforce`` first puts q and v on what is prescribed.
    """

    def __init__(
        self,
        model: SpacecraftModel,
        acceleration: Callable[[float, np.ndarray, np.ndarray], np.ndarray],
        q_ref: np.ndarray,
        latest: float = np.inf,
        enforce: Enforce | None = None,
    ) -> None:
        self.pin, self.nv, self.free = model.pin, model.nv, model.free
        self.acceleration, self.q_ref, self.latest, self.enforce = acceleration, q_ref, latest, enforce

    def __call__(self, t: float, y: np.ndarray, out: np.ndarray) -> np.ndarray:
        """Write the rate of y at t into ``out`` and return it."""
        nv = self.nv
        if t > self.latest:
            t = self.latest
        xi, v = y[:nv], y[nv:]
        q = pin.integrate(self.pin, self.q_ref, xi)
        if self.enforce is not None:
            q, v = self.enforce(t, q, v)
        out[:nv] = v
        if self.free:
            np.dot(pin.Jlog6(pin.exp6(xi[:6])), v[:6], out=out[:6])
        out[nv:] = self.acceleration(t, q, v)
        return out
