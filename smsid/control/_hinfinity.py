"""H-infinity synthesis for general plants: a bounded search over gamma in which every answer is verified.

The controller for one gamma is the central one of Glover and Doyle (1988), in the form of Zhou, Doyle and
Glover, *Robust and Optimal Control*, theorem 17.1: D11 of any kind, D22 = 0, D12 and D21 of full rank,
Riccati equations by the stable subspace of their Hamiltonians. A gamma counts as feasible only when the
loop closed with it is stable and its norm, computed apart, is below. (SLICOT's sb10ad as in ctrlsys 1.1.1
is no substitute: it names gammas that its controllers miss, and stops at 67.0 on plants whose optimum is far
lower; see the tests.)
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

import numpy as np
from scipy.linalg import schur

from smsid.control._statespace import StateSpace, hinf_norm, lower_lft
from smsid.errors import ControlError

logger = logging.getLogger(__name__)
LARGEST_GAMMA = 1e6
MARGIN = 0.02  # of the level that is taken above the least feasible one, where poles stay slow


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

    ``closed_loop`` from w to z.
    """

    controller: StateSpace
    closed_loop: StateSpace
    gamma: float
    norm: float
    optimum: float


def synthesize(plant: Plant, *, tolerance: float = 1e-4, gamma: float | None = None) -> Synthesis:
    """Return an H-infinity controller, D11 of any kind.

    ``gamma`` asks for that level; by default the least feasible one is searched to a relative ``tolerance``
    and the controller taken `MARGIN` above it, where its poles stay slow.

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
        return _verify_norm(plant, found, gamma, gamma)
    low, high = _bracket(plant)
    for _ in range(60):
        if high - low <= tolerance * high:
            break
        middle = float(np.sqrt(low * high)) if low > 0.1 * high else 0.3 * high
        low, high = (low, middle) if _attempt(plant, middle) is not None else (middle, high)
        if high < 1e-9:
            break
    level = high * (1.0 + MARGIN)
    found = _attempt(plant, level)
    if found is None:
        raise ControlError(
            f"The search for gamma is not consistent: {high:.6g} is feasible, {level:.6g} is not.",
            advice="The plant is badly scaled: give weights nearer to one in size.",
        )
    return _verify_norm(plant, found, level, high)


def feasible(plant: Plant, gamma: float) -> bool:
    """Return whether a stabilising controller keeps the norm below gamma."""
    return _attempt(plant, gamma) is not None


def _attempt(plant: Plant, gamma: float) -> StateSpace | None:
    """Return the central controller for gamma, or nothing when there is none."""
    s = plant.system.balance_states()
    controller = central_controller(s, plant.controls, plant.measurements, gamma)
    if controller is None:
        return None
    closed = lower_lft(s, controller).balance_states()
    if not closed.stable or hinf_norm(closed, tolerance=1e-7)[0] > gamma * (1.0 + 1e-6):
        return None
    return controller


def _verify_norm(plant: Plant, controller: StateSpace, gamma: float, optimum: float) -> Synthesis:
    closed = lower_lft(plant.system, controller)
    return Synthesis(controller, closed, gamma, hinf_norm(closed)[0], optimum)


def _bracket(plant: Plant) -> tuple[float, float]:
    """Return a level below and one above the least feasible gamma."""
    nothing = StateSpace.zero_system(plant.controls, plant.measurements)
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
    p1, m1 = s.d.shape[0] - plant.measurements, s.d.shape[1] - plant.controls
    size = max(1.0, float(np.linalg.norm(s.a, 2)) if s.order else 1.0)
    for pole in s.poles:
        if pole.real < 0.0:
            continue
        shifted = s.a - pole * np.eye(s.order)
        for matrix, word in (
            (np.hstack([shifted, s.b[:, m1:]]), "moved by u"),
            (np.vstack([shifted, s.c[p1:]]), "seen in y"),
        ):
            if np.linalg.svd(matrix, compute_uv=False)[s.order - 1] < 1e-10 * size:
                raise ControlError(
                    f"The design is ill-posed: the unstable mode s = {pole:.4g} cannot be {word}.",
                    advice="An integrating weight must be stable: give it a small decay.",
                    pole=complex(pole),
                )
    for matrix, full, what in (
        (s.d[:p1, m1:], plant.controls, "D12 has not full column rank: some control signal is free of cost"),
        (s.d[p1:, :m1], plant.measurements, "D21 has not full row rank: some measurement is free of noise"),
    ):
        if np.linalg.matrix_rank(matrix) < full:
            raise ControlError(
                f"The design is ill-posed: {what}.",
                advice="Weigh every control signal, put noise on every measurement.",
            )
    if np.any(s.d[p1:, m1:]):
        raise ControlError(
            "The plant passes u to y at once (D22 is not zero).",
            advice="Design for y - D22 u and close the loop K (I + D22 K)^-1.",
        )


def central_controller(
    system: StateSpace, controls: int, measurements: int, gamma: float
) -> StateSpace | None:
    """Return the central controller u = K y with norm below gamma, or nothing when there is none.

    ``system`` takes (w, u) to (z, y), u the last ``controls`` inputs, y the last ``measurements`` outputs;
    its D12 must have full column rank, its D21 full row rank, its D22 be zero.
    """
    m1, p1 = system.d.shape[1] - controls, system.d.shape[0] - measurements
    q12, r12 = _to_bottom(system.d[:p1, m1:])
    q21, r21 = _to_bottom(system.d[p1:, :m1].T)
    inverse12, inverse21 = np.linalg.inv(r12), np.linalg.inv(r21.T)
    a = system.a
    b1, b2 = system.b[:, :m1] @ q21, system.b[:, m1:] @ inverse12
    c1, c2 = q12.T @ system.c[:p1], inverse21 @ system.c[p1:]
    d11 = q12.T @ system.d[:p1, :m1] @ q21
    found = _normalised_controller(a, b1, b2, c1, c2, d11, gamma)
    if found is None or not all(np.isfinite(x).all() for x in found):
        return None
    ak, bk, ck, dk = found
    return StateSpace(ak, bk @ inverse21, inverse12 @ ck, inverse12 @ dk @ inverse21)


def _normalised_controller(
    a: np.ndarray,
    b1: np.ndarray,
    b2: np.ndarray,
    c1: np.ndarray,
    c2: np.ndarray,
    d11: np.ndarray,
    gamma: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray] | None:
    """As `central_controller` with D12 = [0; I] and D21 = [0, I]."""
    n, m1, m2, p1, p2 = len(a), b1.shape[1], b2.shape[1], c1.shape[0], c2.shape[0]
    g2 = gamma**2
    d1111, d1112 = d11[: p1 - m2, : m1 - p2], d11[: p1 - m2, m1 - p2 :]
    d1121, d1122 = d11[p1 - m2 :, : m1 - p2], d11[p1 - m2 :, m1 - p2 :]
    if max(_norm(np.hstack([d1111, d1112])), _norm(np.vstack([d1111, d1121]))) >= gamma:
        return None
    b, c = np.hstack([b1, b2]), np.vstack([c1, c2])
    row = np.hstack([d11, np.vstack([np.zeros((p1 - m2, m2)), np.eye(m2)])])
    column = np.vstack([d11, np.hstack([np.zeros((p2, m1 - p2)), np.eye(p2)])])
    r = row.T @ row - g2 * np.diag([1.0] * m1 + [0.0] * m2)
    r_dual = column @ column.T - g2 * np.diag([1.0] * p1 + [0.0] * p2)
    x = _riccati(a, b, r, c1.T @ row, c1.T @ c1)
    if x is None:
        return None
    y = _riccati(a.T, c.T, r_dual, b1 @ column.T, b1 @ b1.T)
    if y is None or np.abs(np.linalg.eigvals(x @ y)).max(initial=0.0) >= g2:
        return None
    f = -np.linalg.solve(r, row.T @ c1 + b.T @ x)
    l = -np.linalg.solve(r_dual, column @ b1.T + c @ y).T
    f12, f2 = f[m1 - p2 : m1], f[m1:]
    l12, l2 = l[:, p1 - m2 : p1], l[:, p1:]
    left = np.linalg.inv(g2 * np.eye(p1 - m2) - d1111 @ d1111.T)
    right = np.linalg.inv(g2 * np.eye(m1 - p2) - d1111.T @ d1111)
    dk = -d1121 @ d1111.T @ left @ d1112 - d1122
    try:
        d12 = np.linalg.cholesky(np.eye(m2) - d1121 @ right @ d1121.T)
        d21 = np.linalg.cholesky(np.eye(p2) - d1112.T @ left @ d1112).T
    except np.linalg.LinAlgError:
        return None
    z = np.linalg.inv(np.eye(n) - y @ x / g2)
    # the square roots d12, d21 parametrise all controllers; the central one only needs the products
    input2 = z @ (b2 + l12) @ d12
    output2 = -d21 @ (c2 + f12)
    bk = -z @ l2 + input2 @ np.linalg.solve(d12, dk)
    ck = f2 + dk @ np.linalg.solve(d21, output2)
    return a + b @ f + bk @ np.linalg.solve(d21, output2), bk, ck, dk


def _riccati(
    a: np.ndarray, b: np.ndarray, r: np.ndarray, cross: np.ndarray, weight: np.ndarray
) -> np.ndarray | None:
    """Return X >= 0 that stabilises A'X + XA - (XB + S) R^-1 (B'X + S') + Q = 0, or nothing."""
    n = len(a)
    try:
        solved = np.linalg.solve(r, np.hstack([cross.T, b.T]))
    except np.linalg.LinAlgError:
        return None
    drift = a - b @ solved[:, :n]
    hamiltonian = np.block([[drift, -b @ solved[:, n:]], [-weight + cross @ solved[:, :n], -drift.T]])
    # a similarity that evens out the two halves; without it small noise weights cost most digits
    top, bottom = np.linalg.norm(hamiltonian[:n, n:]), np.linalg.norm(hamiltonian[n:, :n])
    scale = np.sqrt(top / bottom) if top > 0.0 and bottom > 0.0 else 1.0
    hamiltonian[:n, n:] /= scale
    hamiltonian[n:, :n] *= scale
    if not np.isfinite(hamiltonian).all():
        return None
    try:
        _, u, stable = schur(hamiltonian, sort="lhp")  # type: ignore[misc]
    except np.linalg.LinAlgError:  # eigenvalues on the imaginary axis
        return None
    if stable != n or np.linalg.cond(u[:n, :n]) > 1e14:
        return None
    x = np.linalg.solve(u[:n, :n].T, u[n:, :n].T).T / scale
    x = 0.5 * (x + x.T)
    return x if np.linalg.eigvalsh(x)[0] >= -1e-7 * max(_norm(x), 1e-300) else None


def _to_bottom(tall: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return orthogonal Q and square R with tall = Q [0; R]."""
    rows, columns = tall.shape
    q, r = np.linalg.qr(tall, mode="complete")
    order = [*range(columns, rows), *range(columns)]
    return q[:, order], r[:columns]


def _norm(x: np.ndarray) -> float:
    return float(np.linalg.norm(x, 2)) if x.size else 0.0
