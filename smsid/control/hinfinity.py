"""H-infinity synthesis for general plants: a bounded search over gamma in which every answer is verified.

The controller for one gamma is `smsid.control.glover_doyle`'s; a gamma counts as feasible only when the loop
closed with it is stable and its norm, computed apart, is below. (SLICOT's sb10ad as in ctrlsys 1.1.1 is no
substitute: it names gammas that its controllers miss, and stops at 67.0 on plants whose optimum is far
lower; see the tests.)
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np

from smsid.control.glover_doyle import central_controller
from smsid.control.statespace import StateSpace, hinf_norm, lower_lft
from smsid.errors import ControlError

logger = logging.getLogger(__name__)
LARGEST_GAMMA = 1e6


@dataclass(frozen=True)
class Plant:
    """A generalised plant: ``system`` from (w, u) to (z, y) with ``controls`` u and ``measurements`` y.

    Raises `ControlError` when sizes do not fit.
    """

    system: StateSpace
    controls: int
    measurements: int

    def __post_init__(self) -> None:
        p, m = self.system.d.shape
        if not (0 < self.controls < m and 0 < self.measurements < p):
            raise ControlError(
                f"A plant of {m} inputs and {p} outputs cannot have {self.controls} controls and "
                f"{self.measurements} measurements.",
                advice="Both at least one, and at least one disturbance and one output to keep small.",
            )


@dataclass(frozen=True)
class Synthesis:
    """A controller u = K y: ``gamma`` asked, ``norm`` reached, ``optimum`` the least gamma found feasible.

    ``closed_loop`` from w to z; ``peak`` [rad/s] is where its norm is.
    """

    controller: StateSpace
    closed_loop: StateSpace
    gamma: float
    norm: float
    peak: float
    optimum: float


def synthesize(
    plant: Plant, *, tolerance: float = 1e-4, margin: float = 0.02, gamma: float | None = None
) -> Synthesis:
    """Return an H-infinity controller, D11 of any kind.

    ``gamma`` asks for that level; by default the least feasible one is searched to a relative ``tolerance``
    and the controller taken ``margin`` above it, where its poles stay slow.

    Raises:
        ControlError: not stabilisable or detectable, an assumption broken, or none reaches the level.
    """
    _check(plant)
    if gamma is not None:
        found = _attempt(plant, gamma)
        if found is None:
            raise ControlError(
                f"No stabilising controller keeps the norm below {gamma:.6g}.",
                advice="Ask for less: a larger error, less bandwidth, or a smaller uncertainty.",
                gamma=gamma,
            )
        return _verified(plant, found, gamma, gamma)
    low, high = _bracket(plant)
    for _ in range(60):
        if high - low <= tolerance * high:
            break
        middle = float(np.sqrt(low * high)) if low > 0.1 * high else 0.3 * high
        low, high = (low, middle) if _attempt(plant, middle) is not None else (middle, high)
        if high < 1e-9:
            break
    level = high * (1.0 + margin)
    found = _attempt(plant, level)
    if found is None:
        raise ControlError(
            f"The search for gamma is not consistent: {high:.6g} is feasible, {level:.6g} is not.",
            advice="The plant is badly scaled: give weights nearer to one in size.",
        )
    return _verified(plant, found, level, high)


def feasible(plant: Plant, gamma: float) -> bool:
    """Return whether a stabilising controller keeps the norm below gamma."""
    return _attempt(plant, gamma) is not None


def _attempt(plant: Plant, gamma: float) -> StateSpace | None:
    """Return the central controller for gamma, or nothing when there is none."""
    s = plant.system.balanced()
    controller = central_controller(s, plant.controls, plant.measurements, gamma)
    if controller is None:
        return None
    closed = lower_lft(s, controller).balanced()
    if not closed.stable or hinf_norm(closed, tolerance=1e-7)[0] > gamma * (1.0 + 1e-6):
        return None
    return controller


def _verified(plant: Plant, controller: StateSpace, gamma: float, optimum: float) -> Synthesis:
    closed = lower_lft(plant.system, controller)
    norm, peak = hinf_norm(closed)
    return Synthesis(controller, closed, gamma, norm, peak, optimum)


def _bracket(plant: Plant) -> tuple[float, float]:
    """Return a level below and one above the least feasible gamma."""
    nothing = StateSpace.nothing(plant.controls, plant.measurements)
    passive, _ = hinf_norm(lower_lft(plant.system, nothing))
    high = 1.01 * passive + 1e-9 if np.isfinite(passive) else 1.0
    low = 0.0
    while _attempt(plant, high) is None:
        low, high = high, 10.0 * high
        if high > LARGEST_GAMMA * max(1.0, passive if np.isfinite(passive) else 1.0):
            raise ControlError(
                f"No stabilising controller was found for gamma up to {low:.3g}.",
                advice="The plant may hold modes that the controller cannot reach or see.",
                poles=plant.system.poles,
            )
    return low, high


def _check(plant: Plant) -> None:
    """Raise `ControlError` when a mode that is not stable is out of reach or out of sight."""
    s = plant.system
    p, m = s.d.shape
    b2, c2 = s.b[:, m - plant.controls :], s.c[p - plant.measurements :]
    size = max(1.0, float(np.linalg.norm(s.a, 2)) if s.order else 1.0)
    for pole in s.poles:
        if pole.real < 0.0:
            continue
        shifted = s.a - pole * np.eye(s.order)
        for matrix, word in (
            (np.hstack([shifted, b2]), "moved by u"),
            (np.vstack([shifted, c2]), "seen in y"),
        ):
            if np.linalg.svd(matrix, compute_uv=False)[s.order - 1] < 1e-10 * size:
                raise ControlError(
                    f"The design is ill-posed: the unstable mode s = {pole:.4g} cannot be {word}.",
                    advice="An integrating weight must be stable: give it a small decay.",
                    pole=complex(pole),
                )
    d12, d21 = (
        s.d[: p - plant.measurements, m - plant.controls :],
        s.d[p - plant.measurements :, : m - plant.controls],
    )
    for matrix, full, what in (
        (d12, plant.controls, "D12 has not full column rank: some control signal is free of cost"),
        (d21, plant.measurements, "D21 has not full row rank: some measurement is free of noise"),
    ):
        if np.linalg.matrix_rank(matrix) < full:
            raise ControlError(
                f"The design is ill-posed: {what}.",
                advice="Weigh every control signal, put noise on every measurement.",
            )
    if np.any(s.d[p - plant.measurements :, m - plant.controls :]):
        raise ControlError(
            "The plant passes u to y at once (D22 is not zero).",
            advice="Design for y - D22 u and close the loop K (I + D22 K)^-1.",
        )
