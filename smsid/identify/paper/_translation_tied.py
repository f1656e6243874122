"""Exp. 1 with the regression whitened, its products tied, and constant accelerometer biases estimated.

The regression (22) as printed loses three things. Its noise is that of the acceleration integrated up to n
times, so plain (total) least squares weighs the slow end wrongly. The entries of (24) and (27) are products
of fewer parameters (M appears as a ratio twice, rho three times), which the regression leaves free. And a
constant bias of an accelerometer, integrated, becomes a polynomial in t that it has no columns for. Here the
equation error of (22) is the same, but it is multiplied by ``s^n/Q(s)``, with Q from the estimate before
(Steiglitz and McBride 1965), linearised about the parameters themselves, and has a column for the bias of the
IMU and one for that of the panel's accelerometers. Each step is total least squares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smsid._recursion import filter_recursively
from smsid.errors import NotIdentifiableError
from smsid.identify._tls import total_least_squares
from smsid.identify.paper._axis_parameters import Kind, fractions, parameter_names, tied_parameters
from smsid.identify.paper._translation import (
    AxisData,
    AxisEstimate,
    adjoint,
    check_axis,
    check_mass,
    errors_through,
    from_imu,
    integrals,
    regression_columns,
    row_noise,
)
from smsid.identify.robust import inverse_root

STEPS = 40  # at most; a good record takes about six
SETTLED = 1e-3  # of a standard deviation: a smaller step ends the iteration
ROUND_OFF = 1e-7  # of an unknown: as far as integrated columns determine it
LARGEST_STEP = 0.5  # relative change of a stiffness over mass or of m_r allowed in one step
SIGNIFICANT = 3.0  # standard deviations by which a mass may come out below zero
FIRST_PASSES = 4  # linear passes before the products are tied
PERIODS = 2.0  # in the record: where the whitening filter starts
FIRST_DAMPING = 0.5
ADVICE = "Thrust harder or longer, record a quieter accelerometer, or describe fewer tanks."
DRIFT_NODES, DRIFT_SHAPES = 61, 12


def identify_axis_tied(data: AxisData, tanks: int = 1, marks: Sequence[str] | None = None) -> AxisEstimate:
    """Identify one axis as `identify_axis` does, but whitened, its products tied, biases estimated.

    Arguments, names and units as there; no starting values are needed. Wandering errors of the accelerometers
    widen the covariance. ``pi`` are (24) or (27) at the estimate.

    Raises `NotIdentifiableError` as there, and with the evidence ``hidden`` when no slosh can be seen to
    start from, when the iteration does not settle (noise hides the slosh, or two tanks are alike) or ends at
    no oscillation or a mass clearly below zero; `SmsidError` for a noise that is not positive.
    """
    check_axis(data, tanks)
    problem = _Problem.of(data, tanks)
    unknowns = problem.start()
    for _ in range(STEPS):
        step, influence = problem.step(unknowns)
        sigma = np.linalg.norm(influence, axis=1)
        limit = _limit(unknowns, step, tanks)
        unknowns = unknowns + limit * step
        if limit == 1.0 and np.all(np.abs(step) <= SETTLED * sigma + ROUND_OFF * np.abs(unknowns)):
            break
    else:
        raise _hidden_error(
            f"The slosh along {data.axis} does not settle in {STEPS} steps: noise hides it or two are alike."
        )
    for i in range(tanks):
        at = 1 + 3 * i
        kappa, beta, mass = unknowns[at : at + 3]
        if abs(beta) >= 2.0 * np.sqrt(kappa) or mass < -SIGNIFICANT * sigma[at + 2]:
            what = "no oscillation" if abs(beta) >= 2.0 * np.sqrt(kappa) else f"a mass of {mass:.3g} kg"
            raise _hidden_error(f"The slosh along {data.axis} comes out as {what}: noise or drift hides it.")
    # tanks by rising frequency, whatever way the iteration took
    own = [np.arange(1 + 3 * i, 4 + 3 * i) for i in np.argsort(unknowns[1 : 1 + 3 * tanks : 3])]
    order = np.concatenate([[0], *own, np.arange(1 + 3 * tanks, len(unknowns))]).astype(int)
    unknowns, influence = unknowns[order], influence[order]
    values, jacobian = _physical(unknowns, tanks)
    check_mass(data.axis, values[0])
    spread = jacobian @ influence
    pi = tied_parameters(unknowns, problem.kinds, tanks)
    names = parameter_names(tanks, [p.name for p in data.panels], marks)
    return AxisEstimate(data.axis, names, values, spread @ spread.T, pi, problem.condition)


def _hidden_error(message: str) -> NotIdentifiableError:
    return NotIdentifiableError(message, advice=ADVICE, hidden=True)


@dataclass
class _Problem:
    """The equation (22) of one axis: ``columns @ pi + a = 0``, and what its errors are made of."""

    data: AxisData
    tanks: int
    kinds: list[Kind]
    columns: np.ndarray
    ramps: np.ndarray  # (N, order + 1): a constant and its integrals
    noise: np.ndarray
    condition: float = np.nan

    @classmethod
    def of(cls, data: AxisData, tanks: int) -> _Problem:
        kinds, columns = regression_columns(data, tanks)
        ramps = np.column_stack(integrals(data.unit, data.time, 2 * tanks))
        return cls(data, tanks, kinds, columns, ramps, row_noise(data, kinds))

    @property
    def sampling(self) -> float:
        """Sampling time [s]."""
        t = self.data.time
        return float((t[-1] - t[0]) / (len(t) - 1))

    def sections(self, pi: np.ndarray) -> list[Section]:
        value = dict(zip(self.kinds, pi, strict=True))
        return sections_of(np.array([1.0, *(value["a", j] for j in range(1, 2 * self.tanks + 1))]))

    def start(self) -> np.ndarray:
        """Return unknowns (m_r, per tank (kappa, beta, m), each rho / m_r) from the regression left linear.

        Its own bias columns are all powers of t, for the whitening filter is not yet Q.
        """
        frequency = 2.0 * np.pi * PERIODS / float(self.data.time[-1] - self.data.time[0])
        grid = frequency * (1.0 + np.arange(self.tanks))
        sections, theta = [(2.0 * FIRST_DAMPING * w, w**2) for w in grid], np.zeros(0)
        rows = np.column_stack([self.columns, self.ramps, -self.data.acceleration])
        noise = np.zeros((rows.shape[1], rows.shape[1]))
        noisy = [*range(len(self.kinds)), rows.shape[1] - 1]
        noise[np.ix_(noisy, noisy)] = self.noise
        for _ in range(FIRST_PASSES if self.tanks else 1):
            white = whiten(rows, self.sampling, sections)
            scale = np.linalg.norm(white, axis=0)
            try:
                found = total_least_squares(
                    white[:, :-1] / scale[:-1], white[:, -1] / scale[-1], noise=noise / np.outer(scale, scale)
                )
            except NotIdentifiableError as error:
                raise _hidden_error(
                    f"{self.data.axis} shows no slosh to start from: the record is short."
                ) from error
            pi = (found.x / scale[:-1] * scale[-1])[: len(self.kinds)]
            theta = fractions(pi, self.kinds, self.tanks)
            if not (np.isfinite(theta).all() and _sensible(theta, self.tanks)):
                raise _hidden_error(f"No slosh can be seen along {self.data.axis} to start from.")
            sections = self.sections(pi)
        own = [theta[1 + 4 * i : 4 + 4 * i] for i in range(self.tanks)]
        rho = theta[1 + 4 * self.tanks :][: len(self.data.panels)] / theta[0]
        return np.concatenate([theta[:1], *own, rho])

    def step(self, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return a step of the unknowns (n,) and F (n, ...), F F' the covariance they would have."""
        n = len(unknowns)
        pi = tied_parameters(unknowns, self.kinds, self.tanks)
        moved = unknowns[None, :] + 1e-30j * np.eye(n)
        slope = np.array([tied_parameters(row, self.kinds, self.tanks).imag / 1e-30 for row in moved]).T
        through = errors_through(self.kinds, pi, 2 * self.tanks)
        biases = [from_imu(self.data, through)]
        # without slosh both are a constant; those of several panels enter alike
        biases += [through["p"]] if self.data.panels and self.tanks else []
        rows = np.column_stack(
            [
                self.columns @ slope,
                *(self.ramps @ b for b in biases),
                -(self.columns @ pi + self.data.acceleration),
            ]
        )
        sections = self.sections(pi)
        white = whiten(rows, self.sampling, sections)
        scale = np.linalg.norm(white[:, :-1], axis=0)
        turn = np.zeros((len(self.kinds) + 1, rows.shape[1]))
        turn[:-1, :n], turn[:-1, -1], turn[-1, -1] = slope, -pi, 1.0
        noise = turn.T @ self.noise @ turn
        full = np.append(scale, 1.0)
        exact = [j for j in range(rows.shape[1] - 1) if not n - len(self.data.panels) <= j < n]
        found = total_least_squares(
            white[:, :-1] / scale, white[:, -1], noise=noise / np.outer(full, full), exact=exact
        )
        self.condition = found.condition
        return (found.x / scale)[:n], self.influence(white[:, :-1], through, sections)[:n]

    def influence(
        self, white: np.ndarray, through: dict[str, np.ndarray], sections: list[Section]
    ) -> np.ndarray:
        """Carry noise and drifts through filter, integrals and whitening into what ``white`` multiplies."""
        data = self.data
        back = whiten_transposed(white.T, self.sampling, sections)
        from_a = from_imu(data, through)
        factors = [data.noise * adjoint(back, from_a, data)]
        factors.append(self._drift(back, from_a, data.drift, data.drift_time))
        for s, p in zip(data.signals, data.panels, strict=True):
            size = float(np.linalg.norm(p.weights))
            factors.append(p.noise * size * adjoint(back, through[s], data))
            factors.append(size * self._drift(back, through[s], p.drift, p.drift_time))
        root = inverse_root(white)
        return root @ (root.T @ np.concatenate(factors, axis=1))

    def _drift(self, back: np.ndarray, through: np.ndarray, sigma: float, correlation: float) -> np.ndarray:
        """Return back @ (polynomial of the integral of the shapes of a first-order Gauss-Markov process)."""
        t = self.data.time
        if sigma <= 0.0:
            return np.zeros((len(back), 0))
        nodes = np.linspace(t[0], t[-1], DRIFT_NODES)
        size, vectors = np.linalg.eigh(
            sigma**2 * np.exp(-np.abs(nodes[:, None] - nodes[None, :]) / correlation)
        )
        shapes = (vectors * np.sqrt(np.maximum(size, 0.0)))[:, -DRIFT_SHAPES:]
        columns = []
        for shape in shapes.T:
            runs = integrals(np.interp(t, nodes, shape), t, 2 * self.tanks)
            columns.append(back @ sum(c * x for c, x in zip(through, runs, strict=True)))
        return np.column_stack(columns)


def _sensible(theta: np.ndarray, tanks: int) -> bool:
    return bool(theta[0] > 0.0 and all(theta[1 + 4 * i] > 0.0 for i in range(tanks)))


def _limit(unknowns: np.ndarray, step: np.ndarray, tanks: int) -> float:
    """Return the share of a step that keeps m_r and every kappa positive and within reach."""
    watched = [0, *(1 + 3 * i for i in range(tanks))]
    worst = float(np.max(np.abs(step[watched]) / np.abs(unknowns[watched])))
    return 1.0 if worst <= LARGEST_STEP else LARGEST_STEP / worst


def _physical(unknowns: np.ndarray, tanks: int) -> tuple[np.ndarray, np.ndarray]:
    """Return M, per tank (m_s, k_s, b_s), each rho, and their Jacobian with respect to the unknowns."""
    m_r, unit = unknowns[0], np.eye(len(unknowns))
    values, rows = [m_r], [unit[0].copy()]
    for i in range(tanks):
        at = 1 + 3 * i
        kappa, beta, mass = unknowns[at : at + 3]
        values[0] += mass
        rows[0] += unit[at + 2]
        values += [mass, kappa * mass, beta * mass]
        rows += [
            unit[at + 2],
            mass * unit[at] + kappa * unit[at + 2],
            mass * unit[at + 1] + beta * unit[at + 2],
        ]
    for k in range(1 + 3 * tanks, len(unknowns)):
        values.append(unknowns[k] * m_r)
        rows.append(m_r * unit[k] + unknowns[k] * unit[0])
    return np.array(values), np.array(rows)


__all__ = ["identify_axis_tied"]


LEAST_DAMPING = 0.01  # damping ratio the filter is given at least: the estimate's may be negative

Section = tuple[float, float]  # (beta [rad/s], kappa [rad^2/s^2]) of s^2 + beta s + kappa


def sections_of(denominator: np.ndarray) -> list[Section]:
    """Return Q(s) = s^n + ..., highest power first (n + 1,) with n even, as stable sections of degree two.

    Roots in the right half plane are mirrored, and no section is damped by less than `LEAST_DAMPING`.
    """
    roots = np.roots(denominator)
    complex_ones = roots[roots.imag > 0.0]
    real = np.sort(np.abs(roots[roots.imag == 0.0].real))
    found = [(2.0 * abs(r.real), abs(r) ** 2) for r in complex_ones]
    found += [(float(a + b), float(a * b)) for a, b in zip(real[::2], real[1::2], strict=True)]
    return [(max(beta, 2.0 * LEAST_DAMPING * np.sqrt(kappa)), float(kappa)) for beta, kappa in found]


def whiten(x: np.ndarray, step: float, sections: Sequence[Section]) -> np.ndarray:
    """Return the solution of ``prod (1 + beta I + kappa I^2) y = x``, I the cumulative trapezoid from zero.

    ``x`` (N, ...) sampled every ``step`` [s]; the same shape and unit come back.
    """
    y = np.asarray(x, dtype=float)
    for beta, kappa in sections:
        b, a = _coefficients(beta, kappa, step)
        lever = 0.5 * step * (beta + 0.5 * kappa * step)
        second = -lever / (1.0 + lever)  # of a unit first sample: the trapezoid starts at zero there
        start = np.array([1.0 - b[0], second - b[1] + a[1]])
        y = filter_recursively(b, a, y, start.reshape(2, *(1,) * (y.ndim - 1)) * y[:1])
    return y


def whiten_transposed(rows: np.ndarray, step: float, sections: Sequence[Section]) -> np.ndarray:
    """Apply the transpose of `whiten` to rows (n, N); exact but for the first sample, of order ``step``."""
    y = rows.T[::-1]
    for beta, kappa in sections:
        y = filter_recursively(*_coefficients(beta, kappa, step), y)
    return y[::-1].T


def _coefficients(beta: float, kappa: float, step: float) -> tuple[np.ndarray, np.ndarray]:
    first, second = 0.5 * beta * step, 0.25 * kappa * step**2
    size = 1.0 + first + second
    return np.array([1.0, -2.0, 1.0]) / size, np.array(
        [1.0, (2.0 * second - 2.0) / size, (1.0 - first + second) / size]
    )
