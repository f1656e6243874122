"""A linear system in state space, and its H-infinity norm from first principles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, matrix_balance

from smsid.errors import ControlError


@dataclass(frozen=True)
class StateSpace:
    """x' = a x + b u, y = c x + d u: ``a`` (n, n), ``b`` (n, m), ``c`` (p, n), ``d`` (p, m); n may be 0.

    Continuous, or with ``period`` [s] the next sample. Raises `ControlError` for shapes that do not fit
    and values that are not finite.
    """

    a: np.ndarray
    b: np.ndarray
    c: np.ndarray
    d: np.ndarray
    period: float | None = None

    def __post_init__(self) -> None:
        n, (p, m) = len(self.a), np.shape(self.d)
        shapes = {"a": (n, n), "b": (n, m), "c": (p, n), "d": (p, m)}
        for name, shape in shapes.items():
            value = np.asarray(getattr(self, name), dtype=float)
            if value.shape != shape or not np.isfinite(value).all():
                raise ControlError(
                    f"`{name}` of a linear system has shape {value.shape}, not {shape}, or is not finite.",
                    value=value,
                )
            object.__setattr__(self, name, value)

    @classmethod
    def zero_system(cls, outputs: int, inputs: int) -> StateSpace:
        """Return the system without states whose outputs are zero."""
        none = np.zeros((0, 0)), np.zeros((0, inputs)), np.zeros((outputs, 0)), np.zeros((outputs, inputs))
        return cls(*none)

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.a)

    @property
    def poles(self) -> np.ndarray:
        """Eigenvalues of ``a`` (n,)."""
        return np.linalg.eigvals(self.a) if self.order else np.zeros(0, dtype=complex)

    @property
    def stable(self) -> bool:
        """Whether all poles are inside the stability region."""
        if self.period is not None:
            return bool((np.abs(self.poles) < 1.0).all())
        return bool((self.poles.real < 0.0).all())

    def response(self, omega: np.ndarray) -> np.ndarray:
        """Return the frequency response (k, p, m) at omega (k,) [rad/s]."""
        w = np.asarray(omega, dtype=float)
        s = 1j * w if self.period is None else np.exp(1j * w * self.period)
        if not self.order:
            return np.broadcast_to(self.d.astype(complex), (len(w), *self.d.shape)).copy()
        lhs = s[:, None, None] * np.eye(self.order) - self.a
        return self.c @ np.linalg.solve(lhs, np.broadcast_to(self.b, (len(w), *self.b.shape))) + self.d

    def scaled(self, left: np.ndarray, right: np.ndarray) -> StateSpace:
        """Return left @ self @ right, matrices (q, p) and (m, r)."""
        return StateSpace(self.a, self.b @ right, left @ self.c, left @ self.d @ right, self.period)

    def balance_states(self) -> StateSpace:
        """Return the same system with its states scaled, by powers of two, until rows match columns in size.

        Units of states, and sensors of any quality, then cost no digits (Osborne's balancing of A, B and C).
        """
        n = self.order
        if not n:
            return self
        whole = np.zeros((n + 1, n + 1))
        whole[:n, :n] = np.abs(self.a)
        whole[:n, n] = np.linalg.norm(self.b, axis=1)
        whole[n, :n] = np.linalg.norm(self.c, axis=0)
        _, (scale, _) = matrix_balance(whole, permute=False, separate=True)
        t = scale[:n] / scale[n]
        return StateSpace(self.a * t / t[:, None], self.b / t[:, None], self.c * t, self.d, self.period)

    def sampled(self, period: float) -> StateSpace:
        """Return the bilinear (Tustin) discretisation at ``period`` [s]; stable stays stable."""
        half = 0.5 * period * self.a
        inverse = np.linalg.inv(np.eye(self.order) - half)
        b = inverse @ self.b * period
        c = self.c @ inverse
        return StateSpace(inverse @ (np.eye(self.order) + half), b, c, self.d + 0.5 * self.c @ b, period)


def stack(systems: list[StateSpace]) -> StateSpace:
    """Return the block-diagonal system."""
    a, b, c, d = (np.asarray(block_diag(*(getattr(s, k) for s in systems))) for k in "abcd")
    return StateSpace(a, b, c, d)


def lower_lft(plant: StateSpace, controller: StateSpace) -> StateSpace:
    """Return the loop closed around the last inputs and outputs of a plant: F_l(P, K), u = K y.

    The plant's last ``controller.d.shape[0]`` inputs are u, its last ``controller.d.shape[1]`` outputs y.
    Raises `ControlError` when the loop is not well posed.
    """
    nu, ny = controller.d.shape
    m, p = plant.d.shape[1] - nu, plant.d.shape[0] - ny
    if m < 0 or p < 0:
        raise ControlError(
            f"A controller of {ny} inputs and {nu} outputs does not fit a plant of {plant.d.shape[1]} inputs "
            f"and {plant.d.shape[0]} outputs."
        )
    b1, b2, c1, c2 = plant.b[:, :m], plant.b[:, m:], plant.c[:p], plant.c[p:]
    d11, d12, d21, d22 = plant.d[:p, :m], plant.d[:p, m:], plant.d[p:, :m], plant.d[p:, m:]
    k = controller
    loop = np.eye(nu) - k.d @ d22
    if np.linalg.cond(loop) > 1e12:
        raise ControlError("The loop is not well posed: I - D_K D_22 is singular.", condition=loop)
    e = np.linalg.inv(loop)
    gain = e @ k.d
    seen_c = c2 + d22 @ gain @ c2
    seen_k = d22 @ e @ k.c
    seen_w = d21 + d22 @ gain @ d21
    a = np.block([[plant.a + b2 @ gain @ c2, b2 @ e @ k.c], [k.b @ seen_c, k.a + k.b @ seen_k]])
    b = np.vstack([b1 + b2 @ gain @ d21, k.b @ seen_w])
    c = np.hstack([c1 + d12 @ gain @ c2, d12 @ e @ k.c])
    return StateSpace(a, b, c, d11 + d12 @ gain @ d21)


def hinf_norm(system: StateSpace, *, tolerance: float = 1e-9) -> tuple[float, float]:
    """Return the H-infinity norm of a stable continuous system and the frequency [rad/s] of its peak.

    A sweep over the poles' frequencies gives a lower bound; the Hamiltonian's imaginary eigenvalues raise it
    until there are none above it (Bruinsma and Steinbuch, 1990). Infinite for an unstable system.
    """
    if not system.stable or system.period is not None:
        return np.inf, np.nan
    size = np.abs(system.poles)
    sweep = np.unique(np.concatenate([[0.0], size, np.abs(system.poles.imag), np.logspace(-4, 5, 200)]))
    gains = _gain(system, sweep)
    peak, at = float(gains.max()), float(sweep[np.argmax(gains)])
    beyond = float(np.linalg.norm(system.d, 2)) if system.d.size else 0.0
    if beyond > peak:
        peak, at = beyond, np.inf
    if peak == 0.0 or not system.order:
        return peak, at
    for _ in range(60):
        crossings = _crossings(system, peak * (1.0 + 2.0 * tolerance))
        if not len(crossings):
            break
        points = np.concatenate([crossings, 0.5 * (crossings[:-1] + crossings[1:])])
        gains = _gain(system, points)
        if gains.max() <= peak * (1.0 + 2.0 * tolerance):
            break
        peak, at = float(gains.max()), float(points[np.argmax(gains)])
    return peak * (1.0 + tolerance), at


def _gain(system: StateSpace, omega: np.ndarray) -> np.ndarray:
    return np.linalg.svd(system.response(omega), compute_uv=False)[:, 0]


def _crossings(system: StateSpace, gamma: float) -> np.ndarray:
    """Frequencies (k,) >= 0 at which a singular value of the response is gamma."""
    a, b, c, d = system.a, system.b, system.c, system.d
    r = gamma**2 * np.eye(d.shape[1]) - d.T @ d
    left = np.linalg.solve(r, np.hstack([d.T @ c, b.T]))
    n = system.order
    x, y = left[:, :n], left[:, n:]
    top = a + b @ x
    hamiltonian = np.block([[top, b @ y], [-c.T @ (c + d @ x), -top.T]])
    found = np.linalg.eigvals(hamiltonian)
    imaginary = np.abs(found.real) < 1e-7 * np.maximum(np.abs(found), 1e-3)
    return np.unique(np.abs(found[imaginary].imag))
