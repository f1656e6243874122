"""Exp. 1: mass, slosh and appendage density from pure translation, equations (16)-(27).

Along one axis the base acceleration answers thrust like ``a = (1/m_r) P(s)/Q(s) f*`` with ``f* = f - rho p``,
where ``rho p = L_t^T delta''`` is the inertia force of the panel's bending and P, Q are polynomials of degree
two per tank (21). Divided by the highest power of s this is linear in f*, a and their repeated integrals
(22): the regressor (25), or (27) with the panel.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

from smsid.errors import NotIdentifiableError, SmsidError
from smsid.identify.tls import total_least_squares


@dataclass(frozen=True)
class AxisData:
    """One axis of Exp. 1, all (N,): thrust ``force`` [N], base ``acceleration`` [m/s^2].

    ``panel`` (N,) is p, the panel's inertia force per unit of density, ``panel_weights`` (stations,) how it
    follows from the panel accelerometers (p = (y - a) @ weights); noise levels are one sigma of the samples
    [m/s^2]. ``filtered`` applies to white noise whatever filter the signals went through. ``bias`` and
    ``panel_bias`` [m/s^2] are one sigma of constant errors that are not estimated: they widen the covariance.
    """

    axis: str
    time: np.ndarray
    force: np.ndarray
    acceleration: np.ndarray
    noise: float
    panel: np.ndarray | None = None
    panel_weights: np.ndarray | None = None
    panel_noise: float = 0.0
    filtered: Callable[[np.ndarray], np.ndarray] | None = None
    bias: float = 0.0
    panel_bias: float = 0.0


@dataclass(frozen=True)
class AxisEstimate:
    """What one axis of Exp. 1 says.

    ``names``, ``values``, ``covariance`` of the physical parameters: M, per tank m_s, k_s, b_s, and rho.
    ``pi`` are the regression parameters of (24) or (27), in the order printed, for one tank.
    """

    axis: str
    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    pi: np.ndarray
    condition: float

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations."""
        return np.sqrt(np.diag(self.covariance))

    def __getitem__(self, name: str) -> tuple[float, float]:
        """Return value and standard deviation of a parameter."""
        i = self.names.index(name)
        return float(self.values[i]), float(self.sigma[i])


def identify_axis(data: AxisData, tanks: int = 1, marks: Sequence[str] | None = None) -> AxisEstimate:
    """Identify one axis by total least squares on (22), for any number of tanks, none included.

    The thrust columns are exact, repeated integrals of white noise are far smaller than the noise itself and
    count as exact, so the errors of a row are those of a and p (generalised TLS). The covariance follows the
    sensor noise through the integrals, in which it is no longer white, and adds what constant biases do.
    ``marks`` tell the tanks apart in the names, in the order of rising frequency along this axis (default:
    nothing for one tank, 1, 2, ... for more).

    Raises `NotIdentifiableError` without thrust along the axis, for too short a record, or when the mass
    comes out negative; `SmsidError` for a noise that is not positive.
    """
    t, f, a = data.time, data.force, data.acceleration
    if np.abs(f).max() <= 0.0:
        raise NotIdentifiableError(
            f"No thrust acts along {data.axis}: mass and slosh cannot be identified there.",
            advice=f"Fly Exp. 1 with thrust along {data.axis}.",
        )
    if not (np.isfinite(data.noise) and data.noise > 0.0):
        raise SmsidError(
            f"The noise along {data.axis} is {data.noise} m/s^2; total least squares needs it positive."
        )
    order = 2 * tanks
    fewest = 20 * (3 * order + 2)
    if len(t) < fewest:
        raise NotIdentifiableError(
            f"{len(t)} samples along {data.axis} are too few for {tanks} tank(s).",
            advice=f"Record longer: at least {fewest} samples, and a few periods of the slosh.",
            samples=len(t),
            needed=fewest,
        )
    fs, accs = _integrals(f, t, order), _integrals(a, t, order)
    ps = _integrals(data.panel, t, order) if data.panel is not None else None
    columns, kinds = _layout(fs, accs, ps, order)
    scale = np.linalg.norm(columns, axis=0) / np.linalg.norm(a)
    full = np.append(scale, 1.0)
    noise = _row_noise(data, kinds) / np.outer(full, full)
    found = total_least_squares(columns / scale, -a, noise=noise, names=_symbols(kinds))
    pi = found.x / scale
    covariance = _covariance(data, columns, kinds, pi, order)
    names = _physical_names(tanks, data.panel is not None, marks)
    values = _physical(pi, kinds, tanks)
    if not values[0] > 0.0:
        raise NotIdentifiableError(
            f"The mass along {data.axis} comes out as {values[0]:.4g} kg.",
            advice="Thrust and acceleration contradict each other: check signs, units and the "
            "accelerometer's bias.",
            mass=float(values[0]),
        )
    jacobian = _jacobian(lambda x: _physical(x, kinds, tanks), pi)
    return AxisEstimate(data.axis, names, values, jacobian @ covariance @ jacobian.T, pi, found.condition)


def panel_weights(shapes: np.ndarray, participation: np.ndarray) -> np.ndarray:
    """Return weights (stations,) that take relative accelerations of the stations to ``L_t^T delta''``.

    ``shapes`` (stations, modes) along the bending direction and ``participation`` (modes,) along the axis.
    """
    return np.asarray(participation @ np.linalg.pinv(shapes))


@dataclass(frozen=True)
class Combined:
    """Parameters of several axes brought together: those that axes share are averaged.

    ``names``: the shared ones as they are (``M``, ``m_s``, ``rho``), the others with their axis (``k_s.x``).
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray

    def __getitem__(self, name: str) -> tuple[float, float]:
        """Return value and standard deviation."""
        i = self.names.index(name)
        return float(self.values[i]), float(np.sqrt(self.covariance[i, i]))

    def __contains__(self, name: object) -> bool:
        return name in self.names

    def directions(self) -> list[dict[str, float]]:
        """Return changes of the parameters, by name, whose outer products add up to the covariance."""
        size, vectors = np.linalg.eigh(self.covariance)
        moves = vectors * np.sqrt(np.maximum(size, 0.0))
        return [dict(zip(self.names, column, strict=True)) for column in moves.T]


def combine(estimates: Sequence[AxisEstimate]) -> Combined:
    """Bring axes together; shared parameters are weighed by their variances, not-a-number is left out."""
    rows: dict[str, list[tuple[int, int]]] = {}
    for e, estimate in enumerate(estimates):
        for i, name in enumerate(estimate.names):
            if np.isfinite(estimate.values[i]) and np.isfinite(estimate.covariance[i, i]):
                shared = name == "M" or name == "rho" or name.startswith("m_s")
                rows.setdefault(name if shared else f"{name}.{estimate.axis}", []).append((e, i))
    offsets = np.cumsum([0, *(len(e.names) for e in estimates)])
    weights = np.zeros((len(rows), offsets[-1]))
    for r, places in enumerate(rows.values()):
        share = np.array([1.0 / estimates[e].covariance[i, i] for e, i in places])
        for (e, i), w in zip(places, share / share.sum(), strict=True):
            weights[r, offsets[e] + i] = w
    stacked = np.nan_to_num(np.concatenate([e.values for e in estimates]))
    full = np.zeros((offsets[-1], offsets[-1]))
    for e, estimate in enumerate(estimates):
        full[offsets[e] : offsets[e + 1], offsets[e] : offsets[e + 1]] = np.nan_to_num(estimate.covariance)
    return Combined(tuple(rows), weights @ stacked, weights @ full @ weights.T)


def _integrals(x: np.ndarray, t: np.ndarray, order: int) -> list[np.ndarray]:
    out = [np.asarray(x, dtype=float)]
    for _ in range(order):
        out.append(cumulative_trapezoid(out[-1], t, initial=0.0))
    return out


Kind = tuple[str, int]  # signal ('f', 'p' or 'a') and number of integrations


def _layout(
    fs: list[np.ndarray], accs: list[np.ndarray], ps: list[np.ndarray] | None, order: int
) -> tuple[np.ndarray, list[Kind]]:
    """Columns in the order of (25) and (27), generalised to more tanks."""
    columns, kinds = [-fs[0]], [("f", 0)]
    if ps is not None:
        columns.append(ps[0])
        kinds.append(("p", 0))
    for j in range(order, 0, -1):
        columns.append(-fs[j])
        kinds.append(("f", j))
        if ps is not None:
            columns.append(ps[j])
            kinds.append(("p", j))
        columns.append(accs[j])
        kinds.append(("a", j))
    return np.column_stack(columns), kinds


def _row_noise(data: AxisData, kinds: list[Kind]) -> np.ndarray:
    """Covariance of the errors of a row of [Y, b]: b = -a and the column of p carry them."""
    n = len(kinds)
    noise = np.zeros((n + 1, n + 1))
    noise[n, n] = data.noise**2
    if data.panel is not None and data.panel_weights is not None:
        w, k = data.panel_weights, kinds.index(("p", 0))
        noise[k, k] = data.panel_noise**2 * float(w @ w) + data.noise**2 * w.sum() ** 2
        noise[k, n] = noise[n, k] = data.noise**2 * w.sum()  # both contain -n_a
    return noise


def _covariance(
    data: AxisData, columns: np.ndarray, kinds: list[Kind], pi: np.ndarray, order: int
) -> np.ndarray:
    """Covariance of pi: sensor noise and biases carried through filter and integrals into the equation."""
    through = {"a": np.zeros(order + 1), "p": np.zeros(order + 1)}
    through["a"][0] = 1.0
    for (signal, j), value in zip(kinds, pi, strict=True):
        if signal in through:
            through[signal][j] += value
    rows = columns.T
    bread = np.linalg.pinv(columns.T @ columns, hermitian=True)
    ramps = np.array(_integrals(np.ones_like(data.time), data.time, order))
    from_a = through["a"].copy()
    meat = np.zeros((len(pi), len(pi)))
    if data.panel is not None and data.panel_weights is not None:
        w = data.panel_weights
        from_a -= w.sum() * through["p"]
        z = _adjoint(rows, through["p"], data)
        meat += data.panel_noise**2 * float(w @ w) * z @ z.T
        meat += data.panel_bias**2 * float(w @ w) * _square(rows @ (through["p"] @ ramps))
    z = _adjoint(rows, from_a, data)
    meat += data.noise**2 * z @ z.T + data.bias**2 * _square(rows @ (from_a @ ramps))
    return bread @ meat @ bread


def _square(x: np.ndarray) -> np.ndarray:
    return np.outer(x, x)


def _adjoint(rows: np.ndarray, through: np.ndarray, data: AxisData) -> np.ndarray:
    """Apply the adjoint of ``sum_j through[j] I^j`` (and of the filter) to rows (n, N)."""
    total = through[0] * rows
    integral = rows
    for weight in through[1:]:
        integral = cumulative_trapezoid(integral[:, ::-1], data.time, axis=1, initial=0.0)[:, ::-1]
        total = total + weight * integral
    if data.filtered is not None:
        total = data.filtered(total.T).T  # zero-phase: its own adjoint away from the ends
    return total


def _symbols(kinds: list[Kind]) -> list[str]:
    """Names of the columns, for messages: the signal and how often it is integrated."""
    return [f"{signal} integrated {j} times" if j else signal for signal, j in kinds]


def _physical_names(tanks: int, panel: bool, marks: Sequence[str] | None) -> tuple[str, ...]:
    names = ["M"]
    for mark in marks if marks is not None else [""] if tanks == 1 else [str(i + 1) for i in range(tanks)]:
        names += [f"m_s{mark}", f"k_s{mark}", f"b_s{mark}"]
    return (*names, "rho") if panel else tuple(names)


def _physical(pi: np.ndarray, kinds: list[Kind], tanks: int) -> np.ndarray:
    """Return M, per tank (m_s, k_s, b_s), and rho, from the regression parameters.

    f*/a = m_r Q/P = m_r + sum_i m_i (beta_i s + kappa_i)/(s^2 + beta_i s + kappa_i), tanks in the order of
    rising frequency; for one tank these are the formulas behind (24). M is its value at s = 0. Tanks are
    not-a-number when P has not as many pairs of complex roots.
    """
    value = dict(zip(kinds, pi, strict=True))
    order = 2 * tanks
    m_r = 1.0 / value[("f", 0)]
    p = np.array([1.0] + [m_r * value[("f", j)] for j in range(1, order + 1)])
    q = np.array([1.0] + [value[("a", j)] for j in range(1, order + 1)])
    mass = m_r * q[-1] / p[-1]
    found = [mass]
    if tanks == 1:
        m_s = mass - m_r
        found += [m_s, p[2] * m_s, p[1] * m_s]
    elif tanks > 1:
        found += _several(p, m_r * (q - p), tanks)
    if ("p", 0) in value:
        found.append(m_r * value[("p", 0)])
    return np.array(found)


def _several(p: np.ndarray, rest: np.ndarray, tanks: int) -> list[float]:
    """Partial fractions of rest/P: (m_s, k_s, b_s) of each tank, by rising frequency."""
    roots = np.roots(p)
    upper = roots[roots.imag > 0]
    if len(upper) != tanks:
        return [np.nan] * (3 * tanks)
    found: list[float] = []
    for root in upper[np.argsort(np.abs(upper))]:
        kappa, beta = abs(root) ** 2, -2 * root.real
        residue = np.polyval(rest, root) / np.polyval(np.polyder(p), root)
        mass = -2 * (residue * np.conj(root)).real / kappa
        found += [mass, kappa * mass, beta * mass]
    return found


def _jacobian(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray) -> np.ndarray:
    columns = []
    for i in range(len(x)):
        h = 1e-6 * max(abs(x[i]), 1e-12)
        up, down = x.copy(), x.copy()
        up[i] += h
        down[i] -= h
        columns.append((function(up) - function(down)) / (2 * h))
    return np.column_stack(columns)
