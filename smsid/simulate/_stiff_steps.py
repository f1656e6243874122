"""Implicit steps for stretches where friction or drag on light links makes explicit ones too short.

Dry friction of 1 N m on a wrist of 1e-3 kg m^2 settles within microseconds. The explicit method stays stable
there by steps of that length, however little happens. Where its steps are bounded by stability and not by
accuracy, SciPy's Radau IIA, fifth order, takes over to the end of the stretch. How this is told: Hairer and
Wanner, Solving Ordinary Differential Equations II, IV.2.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.integrate import DenseOutput, Radau

from smsid._time_text import time_text
from smsid.errors import SimulationError

BOUNDARY = 6.1  # step times eigenvalue at which the method of order eight is about to lose stability
SURE, CALM = 15, 6  # steps at the boundary that make a stretch stiff; steps within that end the suspicion

ROOT, SMALL = float(np.sqrt(np.finfo(float).eps)), 1e-2  # of a difference: its share, and of what at least


class Stiffness:
    """Counts explicit steps that stability has bounded."""

    def __init__(self) -> None:
        self.bounded, self.free = 0, 0

    def seen(self, stretch: float) -> bool:
        """Whether the motion is stiff after a step with this estimate of step times eigenvalue."""
        if stretch > BOUNDARY:
            self.bounded, self.free = self.bounded + 1, 0
        else:
            self.free += 1
            if self.free == CALM:
                self.bounded = 0
        return self.bounded >= SURE

    def anew(self) -> None:
        """Begin another stretch: after a stiff one a single step at the boundary is enough."""
        self.bounded, self.free = min(self.bounded, SURE - 1), 0


class StiffPiece(DenseOutput):
    """An accepted implicit step and its polynomial."""

    def __init__(self, solver: Radau) -> None:
        super().__init__(solver.t_old, solver.t)
        self.y, self.end_rate = solver.y.copy(), solver.f.copy()
        self.polynomial = solver.dense_output()

    def _call_impl(self, t: np.ndarray) -> np.ndarray:
        return self.polynomial(t)


class StiffSteps:
    """Implicit steps from (t, y) on, y (n,), to ``t_end`` [s] at most."""

    def __init__(
        self,
        derivative: Callable[[float, np.ndarray, np.ndarray], np.ndarray],
        t: float,
        y: np.ndarray,
        t_end: float,
        first: float,
        relative: float,
        absolute: float,
    ) -> None:
        def rate(at: float, x: np.ndarray) -> np.ndarray:
            return derivative(at, x, np.empty_like(x))

        self.solver = Radau(
            rate,
            t,
            y,
            t_end,
            jac=lambda at, x: _jacobian(rate, at, x),
            first_step=min(first, t_end - t),
            rtol=relative,
            atol=absolute,
        )

    def step(self, longest: float) -> StiffPiece:
        """Return the next step, of ``longest`` [s] at most. Raises `SimulationError` when there is none."""
        solver = self.solver
        solver.max_step = longest
        t, y = solver.t, solver.y
        try:
            message = solver.step()
        except (ValueError, np.linalg.LinAlgError) as error:
            raise integration_error(t, y, f"the implicit method failed ({error})") from error
        if solver.status == "failed":
            raise integration_error(t, y, message or "no step of the implicit method holds the tolerance")
        if not np.isfinite(solver.f).all():
            raise integration_error(t, y, "the state is not finite")
        return StiffPiece(solver)


def integration_error(t: float, y: np.ndarray, reason: str) -> SimulationError:
    """Return the error of an integration that cannot go on from y (n,) at t [s]."""
    return SimulationError(
        f"The simulation failed at t = {time_text(t)}: {reason}.",
        advice="Are the inputs bounded and the inertias right? A stiff effect may need smaller steps.",
        time=t,
        state=y,
    )


def _jacobian(rate: Callable[[float, np.ndarray], np.ndarray], t: float, y: np.ndarray) -> np.ndarray:
    """Return d rate / d y (n, n) by forward differences, as exact as Newton's iteration needs.

    SciPy's own (``num_jac``) widens the step of a component that does nothing until it overflows.
    """
    here = rate(t, y)
    out = np.empty((len(y), len(y)))
    for i, size in enumerate(np.maximum(np.abs(y), SMALL)):
        moved = y.copy()
        moved[i] += ROOT * size
        out[:, i] = (rate(t, moved) - here) / (moved[i] - y[i])
    return out
