"""From the regression parameters of (24) or (27) to M, m_s, k_s, b_s and rho, and their covariance.

``f*/a = m_r + sum_i (c_i s + m_i kappa_i)/(s^2 + beta_i s + kappa_i)``, with kappa_i = k_i/m_i and beta_i =
b_i/m_i, is a partial fraction that the regression parameters determine one to one: the c_i, which physics
ties to m_i beta_i, are left free as the regression leaves them. Sensitivities are formed in these parameters,
since for several tanks the coefficients of the polynomials are too ill-conditioned.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

Kind = tuple[str, int]  # signal ('f', 'a', or 'p', 'p2', ... by panel) and number of integrations
STEP = 1e-30  # of the complex-step derivative, which has no cancellation


def panel_signals(panels: int) -> tuple[str, ...]:
    """Return the names of the panels' signals: p, p2, p3, ..."""
    return tuple("p" if i == 0 else f"p{i + 1}" for i in range(panels))


def kinds_of(tanks: int, panels: int) -> list[Kind]:
    """Return what each column of (25) or (27) is, in their order, generalised to more tanks and panels."""
    signals = ("f", *panel_signals(panels), "a")
    kinds = [(s, 0) for s in signals if s != "a"]
    return kinds + [(s, j) for j in range(2 * tanks, 0, -1) for s in signals]


def column_names(kinds: list[Kind]) -> list[str]:
    """Return names of the columns for messages: the signal and how often it is integrated."""
    return [f"{signal} integrated {j} times" if j else signal for signal, j in kinds]


def parameter_names(tanks: int, densities: Sequence[str], marks: Sequence[str] | None) -> tuple[str, ...]:
    """Return M, per tank m_s, k_s, b_s with its mark, and the names of the ``densities``."""
    names = ["M"]
    for mark in marks if marks is not None else [""] if tanks == 1 else [str(i + 1) for i in range(tanks)]:
        names += [f"m_s{mark}", f"k_s{mark}", f"b_s{mark}"]
    return (*names, *densities)


def fractions(pi: np.ndarray, kinds: list[Kind], tanks: int) -> np.ndarray:
    """Return (m_r, per tank (kappa, beta, m, c), rho and the integrated p's) of pi (n,), as many again.

    Tanks by rising frequency; not-a-number when there are several and not as many pairs of complex roots.
    """
    value = dict(zip(kinds, pi, strict=True))
    m_r = 1.0 / value[("f", 0)]
    p = np.array([1.0] + [m_r * value[("f", j)] for j in range(1, 2 * tanks + 1)])
    rest = m_r * (np.array([1.0] + [value[("a", j)] for j in range(1, 2 * tanks + 1)]) - p)
    found = [m_r]
    if tanks == 1:
        found += [p[2], p[1], rest[2] / p[2], rest[1]]
    elif tanks > 1:
        roots = np.roots(p)
        upper = roots[roots.imag > 0]
        if len(upper) != tanks:
            return np.full(len(pi), np.nan)
        for root in upper[np.argsort(np.abs(upper))]:
            kappa = abs(root) ** 2
            residue = np.polyval(rest, root) / np.polyval(np.polyder(p), root)
            mass = -2 * (residue * np.conj(root)).real / kappa
            found += [kappa, -2 * root.real, mass, 2 * residue.real]
    found += [value[k] * (m_r if k[1] == 0 else 1.0) for k in kinds if k[0].startswith("p")]
    return np.array(found)


def regression_parameters(theta: np.ndarray, kinds: list[Kind], tanks: int) -> np.ndarray:
    """Return pi (n,) of the parameters of `fractions`; its inverse, analytic in theta."""
    m_r, own = theta[0], [theta[1 + 4 * i : 5 + 4 * i] for i in range(tanks)]
    factors = [np.array([1.0, beta, kappa]) for kappa, beta, _, _ in own]
    p = _product(factors)
    rest = np.zeros(len(p), dtype=theta.dtype)
    for i, (kappa, _, mass, c) in enumerate(own):
        term = np.convolve(np.array([c, mass * kappa]), _product(factors[:i] + factors[i + 1 :]))
        rest[len(rest) - len(term) :] += term
    out, left = [], list(theta[1 + 4 * tanks :])
    for signal, j in kinds:
        if signal.startswith("p"):
            extra = left.pop(0)
            out.append(extra / m_r if j == 0 else extra)
        else:
            out.append(p[j] / m_r if signal == "f" else p[j] + rest[j] / m_r)
    return np.array(out)


def tied_parameters(unknowns: np.ndarray, kinds: list[Kind], tanks: int) -> np.ndarray:
    """Return pi (n,) of (m_r, per tank (kappa, beta, m), each rho / m_r): the products of (24), (27).

    Ties c_i to m_i beta_i and rho's integrals to rho; analytic in the unknowns.
    """
    own = [unknowns[1 + 3 * i : 4 + 3 * i] for i in range(tanks)]
    theta = [unknowns[:1], *(np.array([kappa, beta, m, m * beta]) for kappa, beta, m in own)]
    signals = [s for s, j in kinds if s.startswith("p") and j == 0]
    if signals:
        p = _product([np.array([1.0, beta, kappa]) for kappa, beta, _ in own])
        rho = dict(zip(signals, unknowns[1 + 3 * tanks :], strict=True))
        at_once = [rho[s] * unknowns[0] for s in signals]
        theta.append(np.array([*at_once, *(rho[s] * p[j] for s, j in kinds if s in rho and j)]))
    return regression_parameters(np.concatenate(theta), kinds, tanks)


def sensitivity(theta: np.ndarray, kinds: list[Kind], tanks: int) -> np.ndarray:
    """Return d pi / d theta (n, n), exact."""
    n = len(theta)
    moved = theta.astype(complex)[None, :] + 1j * STEP * np.eye(n)
    return np.array([regression_parameters(row, kinds, tanks).imag / STEP for row in moved]).T


def physical(theta: np.ndarray, tanks: int, panels: int) -> tuple[np.ndarray, np.ndarray]:
    """Return M, per tank (m_s, k_s, b_s), each rho, and their Jacobian with respect to theta (k, n)."""
    unit = np.eye(len(theta))
    values, rows = [theta[0]], [unit[0]]
    for i in range(tanks):
        at = 1 + 4 * i
        kappa, beta, mass = theta[at : at + 3]
        values[0] += mass
        rows[0] = rows[0] + unit[at + 2]
        values += [mass, kappa * mass, beta * mass]
        rows += [
            unit[at + 2],
            mass * unit[at] + kappa * unit[at + 2],
            mass * unit[at + 1] + beta * unit[at + 2],
        ]
    own = slice(1 + 4 * tanks, 1 + 4 * tanks + panels)
    return np.array([*values, *theta[own]]), np.array([*rows, *unit[own]])


def without_tanks(pi: np.ndarray, kinds: list[Kind], tanks: int) -> tuple[np.ndarray, np.ndarray]:
    """Return what `physical` does, with respect to pi, when tanks cannot be told apart: M and each rho alone.

    ``pi`` (k,); values (n,) and derivatives (n, k). M is f*/a at s = 0, the ratio of the last coefficients;
    the tanks are not-a-number.
    """
    densities = [k for k in kinds if k[0].startswith("p") and k[1] == 0]
    values = np.full(1 + 3 * tanks + len(densities), np.nan)
    rows = np.full((len(values), len(pi)), np.nan)
    pairs = [(0, ("a", 2 * tanks), ("f", 2 * tanks))]
    pairs += [(1 + 3 * tanks + i, k, ("f", 0)) for i, k in enumerate(densities)]
    for k, over, under in pairs:
        i, j = kinds.index(over), kinds.index(under)
        values[k] = pi[i] / pi[j]
        rows[k] = 0.0
        rows[k, i], rows[k, j] = 1.0 / pi[j], -pi[i] / pi[j] ** 2
    return values, rows


def _product(factors: Sequence[np.ndarray]) -> np.ndarray:
    out = np.ones(1)
    for factor in factors:
        out = np.convolve(out, factor)
    return out
