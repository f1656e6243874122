"""An oscillator, driven or let go, with a spring that need not be linear, fitted by its simulation error.

Output error (Ljung 1999, *System Identification*, chapter 7), as the Silverbox benchmark asks for (Wigren and
Schoukens 2013).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import resample_poly

from smsid._short_repr import short_repr
from smsid.arm.regression import correlation_lags
from smsid.errors import NotIdentifiableError
from smsid.identify.estimate import Estimate, classify
from smsid.identify.robust import hac_covariance

SUBSTEPS = 3
TERMS = {"quadratic": 1, "cubic": 2, "quintic": 4, "damping_growth": 2}
"""Terms beyond the linear oscillator, with the power of the output their unit is the inverse of."""

FIELDS = ("frequency", "damping", "gain", *TERMS)
SHARES = {"frequency": 1e-4, "damping": 1e-3, "gain": 1e-4}
"""Steps of finite differences, relative; those of the terms change the force at the peaks by a thousandth."""

STEP = 1e-3
"""Step of what a piece begins with, in amplitudes."""

LEAST = 20
"""Samples of a piece."""

EDGE = 64
"""Samples by which a drive goes on at either end, for its interpolation."""

MOST_ROUNDS = 60


@dataclass(frozen=True)
class Oscillator:
    """A driven oscillator, ``y = x + offset``:

        x'' + 2 damping w (1 + damping_growth x^2) x' + w^2 (x + quadratic x^2 + cubic x^3 + quintic x^5)
            = gain w^2 u

    ``frequency`` w / 2 pi [Hz]; ``gain`` [y per u] is the static one; ``quadratic`` [1/y], ``cubic`` and
    ``damping_growth`` [1/y^2], ``quintic`` [1/y^4]; ``offset`` [y]. A positive ``cubic`` is a hardening
    spring.
    """

    frequency: float
    damping: float
    gain: float
    quadratic: float = 0.0
    cubic: float = 0.0
    quintic: float = 0.0
    damping_growth: float = 0.0
    offset: float = 0.0

    def simulate(self, drive: np.ndarray, rate: float) -> np.ndarray:
        """Return the output (N,) for a band-limited drive (N,) at a rate [Hz], from rest. Free-running."""
        column = np.array([[getattr(self, f)] for f in FIELDS])
        return _run(column, np.zeros((2, 1)), _interpolate_drive(drive)[None], rate)[:, 0] + self.offset


@short_repr
@dataclass(frozen=True)
class OscillatorFit:
    """A fitted oscillator: values with intervals in ``estimate``, ``rmse`` of the simulation error [y].

    ``begin`` (2, pieces) is what each piece of the record began with, position [y] and rate [y/s].
    """

    oscillator: Oscillator
    estimate: Estimate
    rmse: float
    begin: np.ndarray


def fit_oscillator(
    drive: np.ndarray | None,
    output: np.ndarray,
    rate: float,
    start: Oscillator,
    *,
    terms: tuple[str, ...] = (),
    pieces: int = 10,
    unit: str = "V",
    name: str = "oscillator",
) -> OscillatorFit:
    """Fit an oscillator to a record by the error of its free-running simulation.

    The record is cut into pieces that are simulated side by side, each from a state of its own that is
    estimated beside. Standard deviations allow for errors correlated in time.

    Args:
        drive: (N,) input, band-limited: between samples it is interpolated as such. ``None`` for an
            oscillator that was let go; it has no gain then.
        output: (N,) [``unit``].
        rate: [Hz].
        start: first guess; what is not fitted keeps its value.
        terms: beyond the linear oscillator, of `TERMS`.
        pieces: number of pieces.
        unit: of the output, for the names of units.
        name: of the estimate.

    Raises:
        NotIdentifiableError: not finite, too short for its pieces, or the fit does not converge.
    """
    unknown = set(terms) - set(TERMS)
    if unknown:
        raise NotIdentifiableError(
            f"The spring has no term {sorted(unknown)}.", advice=f"Use {', '.join(TERMS)}."
        )
    linear = FIELDS[:2] if drive is None else FIELDS[:3]
    fields = (*linear, *(t for t in FIELDS[3:] if t in terms))
    cut = _Pieces.of(drive, output, rate, pieces)
    count = len(fields) + 1
    x = np.concatenate([[getattr(start, f) for f in (*fields, "offset")], np.zeros(2 * pieces)])

    last: dict[bytes, tuple[np.ndarray, np.ndarray]] = {}

    def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if x.tobytes() not in last:
            values = dict(zip((*fields, "offset"), x[:count].tolist(), strict=True))
            found = cut.linearised(replace(start, **values), fields, x[count:].reshape(2, pieces))
            last.clear()
            last[x.tobytes()] = found
        return last[x.tobytes()]

    residual, columns = at(x)
    if not np.isfinite(columns).all():
        raise NotIdentifiableError("The first guess runs away.", advice="Give another.", oscillator=start)
    # what each piece begins with, before anything else moves
    x[count:] += np.linalg.lstsq(columns[:, count - 1 :], residual, rcond=None)[0][1:]
    lower = np.full(x.size, -np.inf)
    lower[:2] = 1e-9  # of frequency and damping
    done = least_squares(
        lambda x: at(x)[0],
        x,
        lambda x: -at(x)[1],  # type: ignore[arg-type]
        (lower, np.inf),
        x_scale="jac",
        max_nfev=MOST_ROUNDS,
    )
    if not done.success:
        raise NotIdentifiableError(
            f"The fit has not settled after {MOST_ROUNDS} rounds, at an error of "
            f"{np.sqrt(2.0 * done.cost / residual.size):.4g}.",
            advice="Start nearer: the linear fit first, then with the terms of the spring.",
        )
    found = replace(start, **dict(zip((*fields, "offset"), done.x[:count].tolist(), strict=True)))
    begin = done.x[count:].reshape(2, pieces)
    residual, columns = done.fun, -done.jac
    lags = correlation_lags(residual.reshape(pieces, -1).T)
    covariance = hac_covariance(columns, residual, residual.size, lags)[:count, :count]
    sigma = np.sqrt(np.diag(covariance))
    units = {"frequency": "Hz", "damping": "1", "gain": "1", "quadratic": f"1/{unit}"}
    units |= {t: f"1/{unit}^{power}" for t, power in TERMS.items() if power > 1}
    parameters = [
        classify(f"{name}.{f}", getattr(found, f), units.get(f, unit), float(s), name)
        for f, s in zip((*fields, "offset"), sigma, strict=True)
    ]
    estimate = Estimate(
        name,
        "simulation error",
        tuple(parameters),
        notes=(f"residuals correlated over {lags} samples",),
        covariance=covariance,
    )
    return OscillatorFit(found, estimate, float(np.sqrt(np.mean(residual**2))), begin)


def sensitivities(
    drive: np.ndarray, output: np.ndarray, rate: float, fit: OscillatorFit
) -> tuple[np.ndarray, dict[str, np.ndarray], tuple[slice, ...]]:
    """Return what a fit leaves (M,), and its derivatives by every parameter (M,) by name.

    Pieces as in `fit_oscillator`, one after the other; what they begin with is among the derivatives. Last,
    which samples of the record they are.

    Raises:
        NotIdentifiableError: as `fit_oscillator`.
    """
    pieces = fit.begin.shape[1]
    cut = _Pieces.of(drive, output, rate, pieces)
    residual, columns = cut.linearised(fit.oscillator, FIELDS, fit.begin)
    length = len(cut.target)
    names = (*FIELDS, "offset", *(f"begin{k}" for k in range(2 * pieces)))
    parts = tuple(slice(k * length, (k + 1) * length) for k in range(pieces))
    return residual, dict(zip(names, columns.T, strict=True)), parts


@dataclass(frozen=True)
class _Pieces:
    """``drives`` (pieces, n), ``target`` (m, pieces), half the output's range ``size``, ``rate`` [Hz]."""

    drives: np.ndarray
    target: np.ndarray
    size: float
    rate: float

    @classmethod
    def of(cls, drive: np.ndarray | None, output: np.ndarray, rate: float, pieces: int) -> _Pieces:
        y = np.asarray(output, dtype=float)
        u = np.zeros(y.shape) if drive is None else np.asarray(drive, dtype=float)
        if u.shape != y.shape or u.ndim != 1 or not (np.isfinite(u).all() and np.isfinite(y).all()):
            raise NotIdentifiableError(
                f"Drive {u.shape} and output {y.shape} must be (N,) and finite.",
                advice="Cut the record at gaps.",
            )
        length = u.size // pieces
        if length < LEAST:
            raise NotIdentifiableError(
                f"{u.size} samples in {pieces} pieces are too short: a piece takes {LEAST}.",
                advice="Use fewer pieces or a longer record.",
            )
        fine, per = _interpolate_drive(u), 2 * SUBSTEPS
        starts = range(0, pieces * length, length)
        drives = np.array([fine[per * b : per * (b + length)] for b in starts])
        # a term counts by what it does at the peaks
        return cls(drives, y[: pieces * length].reshape(pieces, length).T, float(np.ptp(y)) / 2.0, rate)

    def linearised(
        self, oscillator: Oscillator, fields: tuple[str, ...], begin: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Residuals piece by piece (M,) and their columns (M, n): fields, offset, and what each piece begins
        with, ``begin`` (2, pieces), position and rate; not finite when the simulation runs away.
        """
        pieces = len(self.drives)
        values = np.array([getattr(oscillator, f) for f in FIELDS])
        sets, steps = [values], []
        for f in fields:
            moved = values.copy()
            k = FIELDS.index(f)
            steps.append(SHARES[f] * abs(values[k]) if f in SHARES else 1e-3 / self.size ** TERMS[f])
            moved[k] += steps[-1]
            sets.append(moved)
        shift = STEP * self.size * np.array([1.0, 2.0 * np.pi * oscillator.frequency])
        begins = [begin] * len(sets) + [begin + d for d in np.diag(shift)[:, :, None]]
        every = np.repeat(np.array([*sets, values, values]).T, pieces, axis=1)
        with np.errstate(over="ignore", invalid="ignore"):
            out = _run(every, np.hstack(begins), self.drives, self.rate)
            out = out.reshape(len(out), len(begins), pieces)
            moves = [((out[:, k + 1] - out[:, 0]) / s).T for k, s in enumerate([*steps, *shift])]
        columns = [m.ravel() for m in moves[: len(fields)]] + [np.ones(self.target.size)]
        for m in moves[len(fields) :]:
            for k in range(pieces):
                own = np.zeros(m.shape)
                own[k] = m[k]
                columns.append(own.ravel())
        residual = (self.target - out[:, 0] - oscillator.offset).T.ravel()
        return residual, np.stack(columns, axis=1)


def _interpolate_drive(drive: np.ndarray) -> np.ndarray:
    """Band-limited interpolation of a drive (N,) to the points the integrator asks for."""
    per = 2 * SUBSTEPS
    padded = np.concatenate([np.full(EDGE, drive[0]), drive, np.full(EDGE, drive[-1])])
    return resample_poly(padded, per, 1, window=("kaiser", 10.0))[per * EDGE : per * (EDGE + drive.size)]


def _run(parameters: np.ndarray, begin: np.ndarray, drives: np.ndarray, rate: float) -> np.ndarray:
    """Outputs (n, k) of oscillators ``parameters`` (fields, k); ``drives`` (B, n * 2 SUBSTEPS) in turn.
    They begin with position and rate ``begin`` (2, k).

    Classical Runge-Kutta of fourth order, all oscillators at once.
    """
    w2 = (2 * np.pi * parameters[0]) ** 2
    damping, gain, b2, b3, b5, growth = 2 * parameters[1] * np.sqrt(w2), parameters[2] * w2, *parameters[3:]
    per, count = 2 * SUBSTEPS, parameters.shape[1]
    samples = drives.shape[1] // per
    forces = np.tile(drives.T, (1, count // len(drives)))
    forces = np.vstack([forces, np.repeat(forces[-1:], 2, axis=0)])
    h = 1.0 / (rate * SUBSTEPS)
    x, v = begin
    out = np.empty((samples, count))

    def slope(x: np.ndarray, v: np.ndarray, u: np.ndarray) -> np.ndarray:
        x2 = x * x
        return gain * u - damping * (1.0 + growth * x2) * v - w2 * x * (1.0 + x * b2 + x2 * (b3 + b5 * x2))

    for k in range(samples):
        out[k] = x
        for i in range(per * k, per * (k + 1), 2):
            a1 = slope(x, v, forces[i])
            v2 = v + 0.5 * h * a1
            a2 = slope(x + 0.5 * h * v, v2, forces[i + 1])
            v3 = v + 0.5 * h * a2
            a3 = slope(x + 0.5 * h * v2, v3, forces[i + 1])
            v4 = v + h * a3
            a4 = slope(x + h * v3, v4, forces[i + 2])
            x, v = x + h * (v + 2 * v2 + 2 * v3 + v4) / 6, v + h * (a1 + 2 * a2 + 2 * a3 + a4) / 6
    return out
