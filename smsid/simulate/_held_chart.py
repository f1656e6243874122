"""Stretches of a simulation whose inputs are held from sample to sample, by the compiled kernel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid.kernel.arrays import Kernel
from smsid.kernel.short import short_states, short_steps


@dataclass(frozen=True)
class HeldChart:
    """States at ``times`` (N + 1,) [s], q (N + 1, nq), v (N + 1, nv), tau (N, nv) held between them.

    Every stretch was taken in ``parts`` (N,) equal steps of fifth order, each in a chart of its own; what is
    between its ends is found by taking them again.
    """

    kernel: Kernel
    times: np.ndarray
    q: np.ndarray
    v: np.ndarray
    tau: np.ndarray
    parts: np.ndarray

    @property
    def steps(self) -> int:
        """Number of integration steps."""
        return int(self.parts.sum())

    def states(self, times: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return q (M, nq), v (M, nv) at times (M,) [s] within, and accelerations (M, nv) under tau."""
        q = np.empty((len(times), self.q.shape[1]))
        v, a = np.empty((2, len(times), self.v.shape[1]))
        taken = self.times, self.q, self.v, self.tau, self.parts
        short_states(*self.kernel.arrays, *taken, times, tau, q, v, a)
        return q, v, a


class HeldRun:
    """A simulation from edge to edge (K + 1,) [s] under generalised forces tau (K, nv) held between them."""

    def __init__(self, kernel: Kernel, edges: np.ndarray, tau: np.ndarray, nq: int) -> None:
        self.kernel, self.edges, self.tau = kernel, edges, tau
        self.parts = np.ones(len(tau), dtype=np.int64)
        self.q, self.v = np.empty((len(edges), nq)), np.empty((len(edges), tau.shape[1]))

    def advance(
        self, k: int, q: np.ndarray, v: np.ndarray, step: float, relative: float, absolute: float
    ) -> tuple[HeldChart | None, float]:
        """Go on from q (nq,), v (nv,) at edge k as far as every stretch is short.

        ``step`` [s] is what the eighth-order method would take next; it is returned as it is after. Without
        any such stretch there is no chart.
        """
        self.q[k], self.v[k] = q, v
        done, step = short_steps(
            *self.kernel.arrays,
            self.edges[k:],
            self.q[k:],
            self.v[k:],
            self.tau[k:],
            self.parts[k:],
            step,
            relative,
            absolute,
        )
        if not done:
            return None, step
        rows, steps = slice(k, k + done + 1), slice(k, k + done)
        chart = HeldChart(
            self.kernel, self.edges[rows], self.q[rows], self.v[rows], self.tau[steps], self.parts[steps]
        )
        return chart, step
