"""Signals of time: what thrusters, wheels and joints are commanded, and prescribed joint motion."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from smsid._short_repr import short_repr
from smsid.errors import ExperimentError


class Signal(Protocol):
    """A vector function of time, right-continuous, smooth between its ``breakpoints`` [s]."""

    @property
    def size(self) -> int:
        """Number of components."""
        ...

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Times at which the signal or a derivative jumps."""
        ...

    def __call__(self, t: float) -> np.ndarray:
        """Value at t: (size,)."""
        ...

    def mapped(self, matrix: np.ndarray) -> Signal:
        """Return the signal ``matrix @ self``, matrix (m, size)."""
        ...


@short_repr
@dataclass(frozen=True)
class Constant:
    """A constant value (size,)."""

    value: np.ndarray

    @property
    def size(self) -> int:
        """Number of components."""
        return len(self.value)

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """None."""
        return ()

    def __call__(self, t: float) -> np.ndarray:
        """Value at t."""
        return self.value

    def mapped(self, matrix: np.ndarray) -> Constant:
        """Return ``matrix @ self``, matrix (m, size)."""
        return Constant(matrix @ self.value)


@short_repr
@dataclass(frozen=True)
class PiecewiseConstant:
    """Piecewise constant: ``values[i]`` (size,) from ``times[i]`` on; zero before the first."""

    times: tuple[float, ...]
    values: np.ndarray  # (len(times), size)

    def __post_init__(self) -> None:
        if np.ndim(self.values) != 2 or len(self.times) != len(self.values):
            raise ExperimentError(
                f"A step signal has values of shape {np.shape(self.values)} at {len(self.times)} times.",
                advice="Give values (times, components).",
            )
        _check_times(np.asarray(self.times))

    @property
    def size(self) -> int:
        """Number of components."""
        return self.values.shape[1]

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """The times of the steps."""
        return tuple(self.times)

    def __call__(self, t: float) -> np.ndarray:
        """Value at t."""
        i = int(np.searchsorted(self.times, t, side="right")) - 1
        return self.values[i] if i >= 0 else np.zeros(self.size)

    def sampled(self, times: np.ndarray) -> np.ndarray:
        """Value at times (N,): (N, size)."""
        i = np.searchsorted(self.times, _with_rounding(times), side="right")
        return np.vstack([np.zeros(self.size), self.values])[i]

    def mapped(self, matrix: np.ndarray) -> PiecewiseConstant:
        """Return ``matrix @ self``, matrix (m, size)."""
        return PiecewiseConstant(self.times, self.values @ matrix.T)


@short_repr
@dataclass(frozen=True)
class Fourier:
    """Truncated Fourier series ``offset + sum_l cos[:, l] cos(l w t) + sin[:, l] sin(l w t)``, l = 1..L.

    ``frequency`` is that of the fundamental [Hz]; ``cos`` and ``sin`` are (size, L).
    """

    frequency: float
    cos: np.ndarray
    sin: np.ndarray
    offset: np.ndarray
    _table: np.ndarray = field(init=False, repr=False, compare=False)
    _rates: np.ndarray = field(init=False, repr=False, compare=False)
    _phases: np.ndarray = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        # offset + cos cos(l w t) + sin cos(l w t - pi / 2) as one product with cosines
        w = 2 * np.pi * self.frequency * np.arange(1, self.cos.shape[1] + 1)
        table = np.column_stack([self.offset, self.cos, self.sin])
        object.__setattr__(self, "_table", np.ascontiguousarray(table))
        object.__setattr__(self, "_rates", np.concatenate([[0.0], w, w]))
        object.__setattr__(self, "_phases", np.repeat([0.0, -np.pi / 2], [len(w) + 1, len(w)]))

    @property
    def size(self) -> int:
        """Number of components."""
        return self.cos.shape[0]

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """None."""
        return ()

    def __call__(self, t: float) -> np.ndarray:
        """Value at t."""
        phase = self._rates * t
        phase += self._phases
        return np.dot(self._table, np.cos(phase, out=phase))

    def sampled(self, times: np.ndarray) -> np.ndarray:
        """Value at times (N,): (N, size)."""
        return np.cos(np.multiply.outer(times, self._rates) + self._phases) @ self._table.T

    def mapped(self, matrix: np.ndarray) -> Fourier:
        """Return ``matrix @ self``, matrix (m, size)."""
        return Fourier(self.frequency, matrix @ self.cos, matrix @ self.sin, matrix @ self.offset)

    def derivative(self) -> Fourier:
        """Return the time derivative."""
        w = 2 * np.pi * self.frequency * np.arange(1, self.cos.shape[1] + 1)
        return Fourier(self.frequency, self.sin * w, -self.cos * w, np.zeros(self.size))


@dataclass(frozen=True)
class Sampled:
    """A signal known at samples, interpolated by a B-spline (``degree`` 0 holds, 1 linear, 3 or 5 smooth).

    Integration restarts at every sample of a held signal; error control resolves the kinks of a linear one.
    """

    spline: BSpline
    degree: int
    knots: tuple[float, ...]

    @classmethod
    def from_samples(cls, times: np.ndarray, values: np.ndarray, degree: int = 3) -> Sampled:
        """Return the interpolant of values (N, size) at times (N,) [s].

        Raises `ExperimentError` for times that do not increase, values that are not finite or do not match
        them, and fewer than ``degree + 1`` (at least 2) samples.
        """
        times = np.asarray(times, dtype=float)
        values = np.atleast_2d(np.asarray(values, dtype=float).T).T
        _check_times(times)
        if len(values) != len(times) or not np.isfinite(values).all() or len(times) < max(2, degree + 1):
            raise ExperimentError(
                f"Values of shape {values.shape} at {len(times)} times make no signal of degree {degree}.",
                advice=f"Give at least {max(2, degree + 1)} finite values, one row per time.",
            )
        if degree == 0:
            spline = BSpline(np.append(times, 2 * times[-1] - times[-2]), values, 0)
            return cls(spline, 0, tuple(times))
        return cls(make_interp_spline(times, values, k=degree), degree, ())

    @property
    def size(self) -> int:
        """Number of components."""
        return self.spline.c.shape[1]

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """The samples of a held signal."""
        return self.knots

    def __call__(self, t: float) -> np.ndarray:
        """Value at t; beyond the samples, the last value's extrapolation."""
        if self._held is None:
            return self.spline(t)
        return self._held[max(bisect_right(self.knots, t) - 1, 0)]

    @cached_property
    def _held(self) -> np.ndarray | None:
        """The values of a held signal, one per knot: looking one up is ten times faster than a spline."""
        if self.degree > 0 or len(self.knots) != len(self.spline.c):
            return None
        values = np.array(self.spline.c)
        values.flags.writeable = False
        return values

    @cached_property
    def integrals(self) -> tuple[BSpline, BSpline]:
        """The first and the second antiderivative."""
        return self.spline.antiderivative(), self.spline.antiderivative(2)

    def mapped(self, matrix: np.ndarray) -> Sampled:
        """Return ``matrix @ self``, matrix (m, size)."""
        spline = BSpline(self.spline.t, self.spline.c @ matrix.T, self.spline.k)
        return Sampled(spline, self.degree, self.knots)

    def derivative(self) -> Sampled:
        """Return the time derivative; raises `ExperimentError` for a held signal."""
        if self.degree == 0:
            raise ExperimentError("A held signal has no derivative.", advice="Interpolate with degree 1.")
        spline = self.spline.derivative()
        knots = np.unique(spline.t)[:-1] if self.degree == 1 else ()
        return Sampled(spline, self.degree - 1, tuple(float(k) for k in knots))


@dataclass(frozen=True)
class Sum:
    """The sum of signals of the same size."""

    parts: tuple[Signal, ...]

    @property
    def size(self) -> int:
        """Number of components."""
        return self.parts[0].size

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Those of all parts."""
        return tuple(b for p in self.parts for b in p.breakpoints)

    def __call__(self, t: float) -> np.ndarray:
        """Value at t."""
        total = self.parts[0](t)
        for part in self.parts[1:]:
            total = total + part(t)
        return total

    def mapped(self, matrix: np.ndarray) -> Sum:
        """Return ``matrix @ self``, matrix (m, size)."""
        return Sum(tuple(p.mapped(matrix) for p in self.parts))


def sample(signal: Signal, times: np.ndarray) -> np.ndarray:
    """Return the signal at times (N,): (N, size); what is held jumps at its knots, whatever they round to."""
    if isinstance(signal, Sampled):
        return np.asarray(signal.spline(times if signal.degree else _with_rounding(times)))
    if isinstance(signal, Sum):
        return np.sum([sample(part, times) for part in signal.parts], axis=0)
    sampled = getattr(signal, "sampled", None)
    if sampled is not None:
        return sampled(np.asarray(times, dtype=float))
    return np.array([signal(float(t)) for t in times]).reshape(len(times), signal.size)


def _with_rounding(times: np.ndarray) -> np.ndarray:
    """Return times (N,) a rounding later: k / 100 is often less than 0.01 k, where a command of it begins."""
    times = np.asarray(times, dtype=float)
    return times + 4.0 * np.spacing(np.abs(times).max(initial=0.0))


def is_held(signal: Signal) -> bool:
    """Return whether a signal is constant between its breakpoints."""
    if isinstance(signal, Sum):
        return all(map(is_held, signal.parts))
    return isinstance(signal, Constant | PiecewiseConstant) or (
        isinstance(signal, Sampled) and signal.degree == 0
    )


def merge(signals: list[Signal]) -> Signal:
    """Return the sum of signals of one size; what can be added up is.

    Constants, Fourier series of one frequency, and splines on the same samples.
    """
    fourier: dict[tuple[float, int], Fourier] = {}
    constant: np.ndarray = np.zeros(signals[0].size)
    rest: list[Signal] = []
    flat: list[Signal] = []
    for s in signals:
        flat.extend(s.parts if isinstance(s, Sum) else (s,))
    for s in flat:
        if isinstance(s, Fourier):
            key = (s.frequency, s.cos.shape[1])
            if key in fourier:
                o = fourier[key]
                s = Fourier(s.frequency, o.cos + s.cos, o.sin + s.sin, o.offset + s.offset)
            fourier[key] = s
        elif isinstance(s, Constant):
            constant = constant + s.value
        elif isinstance(s, Sampled):
            for i, o in enumerate(rest):
                if isinstance(o, Sampled) and o.degree == s.degree and np.array_equal(o.spline.t, s.spline.t):
                    total = BSpline(s.spline.t, o.spline.c + s.spline.c, s.spline.k)
                    rest[i] = Sampled(total, s.degree, s.knots)
                    break
            else:
                rest.append(s)
        else:
            rest.append(s)
    if constant.any() or not (fourier or rest):
        rest.append(Constant(constant))
    parts = (*fourier.values(), *rest)
    return parts[0] if len(parts) == 1 else Sum(parts)


def _check_times(times: np.ndarray) -> None:
    if times.ndim != 1 or not np.isfinite(times).all() or np.any(np.diff(times) <= 0.0):
        raise ExperimentError("The times of a signal must be finite and increase.", times=times)
