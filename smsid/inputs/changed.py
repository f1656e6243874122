"""Signals made from others: late, or changing over at some time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid.inputs.signals import Sampled, Signal, Sum, sample


@dataclass(frozen=True)
class Delayed:
    """A signal that arrives ``delay`` [s] late; zero until what was commanded at ``begin`` [s] arrives."""

    signal: Signal
    delay: float
    begin: float = 0.0

    @classmethod
    def of(cls, signal: Signal, delay: float) -> Delayed:
        """Return the signal, late; samples begin with the first of them, anything else at time zero."""
        return cls(signal, delay, min(_beginnings(signal), default=0.0))

    @property
    def size(self) -> int:
        """Number of components."""
        return self.signal.size

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Those of the signal, late, and the arrival of its beginning."""
        later = {b + self.delay for b in self.signal.breakpoints if b > self.begin}
        return tuple(sorted({self.begin + self.delay, *later}))

    def __call__(self, t: float) -> np.ndarray:
        """Value at t."""
        return np.zeros(self.size) if t < self.begin + self.delay else self.signal(t - self.delay)

    def sampled(self, times: np.ndarray) -> np.ndarray:
        """Value at times (N,): (N, size)."""
        times = np.asarray(times, dtype=float)
        values = sample(self.signal, np.maximum(times - self.delay, self.begin))
        return np.where((times < self.begin + self.delay)[:, None], 0.0, values)

    def mapped(self, matrix: np.ndarray) -> Delayed:
        """Return ``matrix @ self``, matrix (m, size)."""
        return Delayed(self.signal.mapped(matrix), self.delay, self.begin)


@dataclass(frozen=True)
class Switched:
    """``before`` until ``at`` [s], ``after`` from then on."""

    before: Signal
    after: Signal
    at: float

    @property
    def size(self) -> int:
        """Number of components."""
        return self.before.size

    @property
    def breakpoints(self) -> tuple[float, ...]:
        """Those of the signal that is on, and the change."""
        own = {b for b in self.before.breakpoints if b < self.at}
        return tuple(sorted({self.at, *own, *(b for b in self.after.breakpoints if b > self.at)}))

    def __call__(self, t: float) -> np.ndarray:
        """Value at t."""
        return self.before(t) if t < self.at else self.after(t)

    def sampled(self, times: np.ndarray) -> np.ndarray:
        """Value at times (N,): (N, size)."""
        times = np.asarray(times, dtype=float)
        late = (times >= self.at)[:, None]
        return np.where(late, sample(self.after, times), sample(self.before, times))

    def mapped(self, matrix: np.ndarray) -> Switched:
        """Return ``matrix @ self``, matrix (m, size)."""
        return Switched(self.before.mapped(matrix), self.after.mapped(matrix), self.at)


def _beginnings(signal: Signal) -> list[float]:
    """Return when what is sampled of a signal begins [s]."""
    if isinstance(signal, Sum):
        return [begin for part in signal.parts for begin in _beginnings(part)]
    if isinstance(signal, Switched):
        return [*_beginnings(signal.before), *_beginnings(signal.after)]
    if isinstance(signal, Delayed):
        return [begin + signal.delay for begin in _beginnings(signal.signal)]
    return [float(signal.spline.t[0])] if isinstance(signal, Sampled) else []
