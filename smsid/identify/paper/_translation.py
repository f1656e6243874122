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

from smsid._by_name import ByName, no_such_name
from smsid._short_repr import short_repr
from smsid.errors import NotIdentifiableError, SmsidError
from smsid.identify._tls import total_least_squares
from smsid.identify.paper._axis_parameters import (
    Kind,
    column_names,
    fractions,
    kinds_of,
    panel_signals,
    parameter_names,
    physical,
    sensitivity,
    without_tanks,
)
from smsid.identify.robust import inverse_root
from smsid.recording.checks.increments import integral

ROUND_OFF = 1e-9  # share of a variance


@short_repr
@dataclass(frozen=True)
class PanelForce:
    """The inertia force of one panel's bending (or of several that are not told apart) along an axis.

    ``name`` of its density among the parameters; ``force`` (N,) p per unit of density, ``weights``
    (stations,) how it follows from the panel's accelerometers, p = (y - a) @ weights; one sigma of ``noise``,
    constant ``bias`` and ``drift`` [m/s^2], and the drift's correlation time [s].
    """

    name: str
    force: np.ndarray
    weights: np.ndarray
    noise: float
    drift: float = 0.0
    drift_time: float = 1.0
    bias: float = 0.0


@short_repr
@dataclass(frozen=True)
class AxisData:
    """One axis of Exp. 1, all (N,): thrust ``force`` [N], base ``acceleration`` [m/s^2].

    ``panels`` are the inertia forces of the panels that bend along the axis, each with a density of its own;
    noise levels are one sigma of the samples [m/s^2]. ``filtered`` applies to white noise whatever filter the
    signals went through, ``filter_transposed`` its transpose (N, N). The first ``before`` samples are the
    rest before the record, without noise; ``constant`` (N,) is what became of a constant error of one from
    the record's beginning on (ones when not given). ``bias`` [m/s^2] is one sigma of a constant error, which
    matters where it is not estimated, ``drift`` [m/s^2] with its correlation time [s] that of one that
    wanders (first-order Gauss-Markov).
    """

    axis: str
    time: np.ndarray
    force: np.ndarray
    acceleration: np.ndarray
    noise: float
    panels: tuple[PanelForce, ...] = ()
    filtered: Callable[[np.ndarray], np.ndarray] | None = None
    filter_transposed: Callable[[np.ndarray], np.ndarray] | None = None
    drift: float = 0.0
    drift_time: float = 1.0
    bias: float = 0.0
    before: int = 0
    constant: np.ndarray | None = None

    @property
    def unit(self) -> np.ndarray:
        """Return a constant error of one, as filtered, (N,)."""
        return np.ones_like(self.time) if self.constant is None else self.constant

    @property
    def signals(self) -> tuple[str, ...]:
        """Return the names of the panels' signals among the columns: p, p2, ..."""
        return panel_signals(len(self.panels))


@short_repr
@dataclass(frozen=True)
class AxisEstimate(ByName[tuple[float, float]]):
    """What one axis of Exp. 1 says.

    ``names``, ``values``, ``covariance`` of the physical parameters: M, per tank m_s, k_s, b_s, and rho.
    ``pi`` are the regression parameters of (24) or (27), in the order printed, for one tank. ``note`` says
    what is to be known of it.
    """

    axis: str
    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    pi: np.ndarray
    condition: float
    note: str = ""

    @property
    def sigma(self) -> np.ndarray:
        """Standard deviations (n,) of ``values``."""
        return np.sqrt(np.diag(self.covariance))

    def keys(self) -> tuple[str, ...]:
        """Return the names of the parameters."""
        return self.names

    def __getitem__(self, name: str) -> tuple[float, float]:
        """Return value and standard deviation of a parameter."""
        if name not in self.names:
            no_such_name(name, self.names)
        i = self.names.index(name)
        return float(self.values[i]), float(self.sigma[i])


def identify_axis(data: AxisData, tanks: int = 1, marks: Sequence[str] | None = None) -> AxisEstimate:
    """Identify one axis as printed: total least squares on (22), for any number of tanks, none included.

    The reference that `smsid.identify.paper._translation_tied` is held against. The thrust columns are exact,
    repeated integrals of white noise are far smaller than the noise itself and count as exact, so the errors
    of a row are those of a and p (generalised TLS). The covariance follows the sensors' white noise through
    the integrals, in which it is no longer white, and adds what constant biases do. Where several tanks are
    not told apart they are not-a-number. ``marks`` tell the tanks apart in the names, in the order of rising
    frequency along this axis (default: nothing for one tank, 1, 2, ... for more).

    Raises `NotIdentifiableError` without thrust along the axis, for too short a record, or when the mass
    comes out negative; `SmsidError` for a noise that is not positive.
    """
    check_axis(data, tanks)
    kinds, columns = regression_columns(data, tanks)
    scale = np.linalg.norm(columns, axis=0) / np.linalg.norm(data.acceleration)
    full = np.append(scale, 1.0)
    noise = row_noise(data, kinds) / np.outer(full, full)
    found = total_least_squares(columns / scale, -data.acceleration, noise=noise, names=column_names(kinds))
    pi = found.x / scale
    theta = fractions(pi, kinds, tanks)
    if np.isfinite(theta).all():
        turned = columns @ sensitivity(theta, kinds, tanks)
        values, jacobian = physical(theta, tanks, len(data.panels))
    else:
        turned = columns
        values, jacobian = without_tanks(pi, kinds, tanks)
    influence = jacobian @ _influence(data, turned, errors_through(kinds, pi, 2 * tanks))
    check_mass(data.axis, values[0])
    names = parameter_names(tanks, [p.name for p in data.panels], marks)
    return AxisEstimate(data.axis, names, values, influence @ influence.T, pi, found.condition)


def _influence(data: AxisData, columns: np.ndarray, through: dict[str, np.ndarray]) -> np.ndarray:
    """Return F (n, ...) with F F' the covariance of the parameters of ``columns``.

    Noise, sample by sample, and biases are carried through filter and integrals into the equation and from
    there into the parameters. Kept as a factor: its square would lose what is left of sums that nearly
    cancel.
    """
    ramps = np.column_stack(integrals(data.unit, data.time, len(through["a"]) - 1))
    sources = [(data.noise, data.bias, from_imu(data, through))]
    for signal, p in zip(data.signals, data.panels, strict=True):
        size = float(np.linalg.norm(p.weights))
        sources.append((size * p.noise, size * p.bias, through[signal]))
    factors = []
    for noise, bias, polynomial in sources:
        factors += [
            noise * adjoint(columns.T, polynomial, data),
            bias * (columns.T @ (ramps @ polynomial))[:, None],
        ]
    root = inverse_root(columns)
    return root @ (root.T @ np.concatenate(factors, axis=1))


def regression_columns(data: AxisData, tanks: int) -> tuple[list[Kind], np.ndarray]:
    """Return what each column of (25) or (27) is, and the columns (N, n): ``columns @ pi = -a``."""
    order = 2 * tanks
    kinds = kinds_of(tanks, len(data.panels))
    signals = {
        "f": [-x for x in integrals(data.force, data.time, order)],
        "a": integrals(data.acceleration, data.time, order),
    }
    for signal, panel in zip(data.signals, data.panels, strict=True):
        signals[signal] = integrals(panel.force, data.time, order)
    return kinds, np.column_stack([signals[s][j] for s, j in kinds])


def check_axis(data: AxisData, tanks: int) -> None:
    """Refuse data without thrust, without noise, or too short for the number of tanks, as `identify_axis`.

    Raises `NotIdentifiableError`, and `SmsidError` for a noise that is not positive.
    """
    if np.abs(data.force).max() <= 0.0:
        raise NotIdentifiableError(
            f"No thrust acts along {data.axis}: mass and slosh cannot be identified there.",
            advice=f"Fly Exp. 1 with thrust along {data.axis}.",
        )
    if not (np.isfinite(data.noise) and data.noise > 0.0):
        raise SmsidError(
            f"The noise along {data.axis} is {data.noise} m/s^2; total least squares needs it positive."
        )
    fewest = 20 * (6 * tanks + 2)
    if len(data.time) < fewest:
        raise NotIdentifiableError(
            f"{len(data.time)} samples along {data.axis} are too few for {tanks} tank(s).",
            advice=f"Record longer: at least {fewest} samples, and a few periods of the slosh.",
            samples=len(data.time),
            needed=fewest,
        )


def check_mass(axis: str, mass: float) -> None:
    """Raise `NotIdentifiableError` for a total mass [kg] that is not positive."""
    if not mass > 0.0:
        raise NotIdentifiableError(
            f"The mass along {axis} comes out as {mass:.4g} kg.",
            advice="Thrust and acceleration contradict each other: check signs, units and the "
            "accelerometer's bias.",
            mass=float(mass),
        )


def panel_weights(shapes: np.ndarray, participation: np.ndarray) -> np.ndarray:
    """Return weights (stations,) that take relative accelerations of the stations to ``L_t^T delta''``.

    ``shapes`` (stations, modes) along the bending direction and ``participation`` (modes,) along the axis.
    """
    return np.asarray(participation @ np.linalg.pinv(shapes))


def integrals(x: np.ndarray, t: np.ndarray, order: int) -> list[np.ndarray]:
    """Return x (N,) and its integrals up to ``order``, by trapezoids from the first sample."""
    out = [np.asarray(x, dtype=float)]
    for _ in range(order):
        out.append(integral(t, out[-1][:, None])[:, 0])
    return out


def row_noise(data: AxisData, kinds: list[Kind]) -> np.ndarray:
    """Covariance (n + 1, n + 1) of the errors of a row of [Y, b]: b = -a and the columns of p carry them."""
    n = len(kinds)
    noise = np.zeros((n + 1, n + 1))
    noise[n, n] = data.noise**2
    places = [kinds.index((s, 0)) for s in data.signals]
    sums = [float(p.weights.sum()) for p in data.panels]
    for k, p, total in zip(places, data.panels, sums, strict=True):
        for j, other in zip(places, sums, strict=True):
            noise[k, j] = data.noise**2 * total * other
        # perfect panel sensors leave p the IMU's error alone; a little more keeps the covariance positive
        noise[k, k] *= 1.0 + ROUND_OFF
        noise[k, k] += p.noise**2 * float(p.weights @ p.weights)
        noise[k, n] = noise[n, k] = data.noise**2 * total  # both contain -n_a
    return noise


def errors_through(kinds: list[Kind], pi: np.ndarray, order: int) -> dict[str, np.ndarray]:
    """Return by which polynomial of the integral, (order + 1,), errors of a and of each p enter."""
    through = {s: np.zeros(order + 1) for s in ("a", "p", *(s for s, _ in kinds if s != "f"))}
    through["a"][0] = 1.0
    for (signal, j), value in zip(kinds, pi, strict=True):
        if signal in through:
            through[signal][j] += value
    return through


def from_imu(data: AxisData, through: dict[str, np.ndarray]) -> np.ndarray:
    """Return by which polynomial of the integral, (order + 1,), the IMU's errors enter: every p has them."""
    shares = [float(p.weights.sum()) * through[s] for s, p in zip(data.signals, data.panels, strict=True)]
    return through["a"] - sum(shares, start=np.zeros_like(through["a"]))


def adjoint(rows: np.ndarray, through: np.ndarray, data: AxisData) -> np.ndarray:
    """Apply the adjoint of ``sum_j through[j] I^j`` (and of the filter) to rows (n, N)."""
    total = through[0] * rows
    integral = rows
    for weight in through[1:]:
        integral = _transposed_integral(integral, data.time)
        total = total + weight * integral
    if data.filter_transposed is not None:
        total = data.filter_transposed(total.T).T
    total[:, : data.before] = 0.0
    return total


def _transposed_integral(rows: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Apply the transpose of the cumulative trapezoid rule, exactly: repeated integrals nearly cancel."""
    after = np.cumsum(rows[:, ::-1], axis=1)[:, ::-1][:, 1:] * (0.5 * np.diff(t))
    out = np.zeros_like(rows)
    out[:, 1:] += after
    out[:, :-1] += after
    return out
