"""What the compiled filter takes and gives: bodies, sensors, parameters, forces, samples, and its record."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from smsid.kernel.readings import Readings


class TreeTables(NamedTuple):
    """A ``tree`` (n, 5); T tables of ``bodies`` (T, n, 28) and ``roots`` (T, 26 + ...), the model's own
    first.
    """

    tree: np.ndarray
    bodies: np.ndarray
    roots: np.ndarray


class StateParameters(NamedTuple):
    """Parameters in the state (m,), in units of ``scales``; the model is at the values ``at``.

    ``terms`` (k, 2) are (table, parameter): inverse dynamics of that table, times a weight, is how the forces
    that a motion takes change with the parameter; ``read_terms`` are the same of readings. Constant changes
    of readings are ``columns`` (rows, m). Applied forces change with the parameters ``pushed`` (d,).
    Variances grow by ``rates`` (m,) a second; ``trends`` (k, 2) are (parameter, parameter by which it changes
    in a second), per scales ``steep`` (k,). ``close``, ``regular``: see `smsid.kernel.filter.reference`.
    """

    scales: np.ndarray
    at: np.ndarray
    rates: np.ndarray
    terms: np.ndarray
    weights: np.ndarray
    read_terms: np.ndarray
    read_weights: np.ndarray
    columns: np.ndarray
    pushed: np.ndarray
    trends: np.ndarray
    steep: np.ndarray
    close: np.ndarray
    regular: float


class Model(NamedTuple):
    """What stays the same from sample to sample: bodies, sensors, parameters."""

    craft: TreeTables
    senses: Readings
    parameters: StateParameters


class Drive(NamedTuple):
    """Applied forces: at samples (n, nv), in the middle and over substeps between them (N, nv), (N, s, nv),
    their half rises; just before and after samples (n, nv); by how much they change with parameters
    (n, d, nv), (N, d, nv). In intervals where a command switches at a time that is not known, they err by
    ``jumps`` (N, nv), all together, in the mean over the interval (none: (0, nv)). Unknown inputs act on
    ``acts`` (k,), have rates in the state where ``sloped`` (j,) and wander by ``walk`` (3, k + j) a second;
    ``noise`` (nv,) is the variance of what is held.
    """

    at: np.ndarray
    middle: np.ndarray
    means: np.ndarray
    rise: np.ndarray
    before: np.ndarray
    after: np.ndarray
    push_at: np.ndarray
    push_middle: np.ndarray
    jumps: np.ndarray
    acts: np.ndarray
    sloped: np.ndarray
    walk: np.ndarray
    noise: np.ndarray

    def part(self, first: int, last: int) -> Drive:
        """Return what drives the motion from one sample to another."""
        at, between = slice(first, last + 1), slice(first, last)
        return Drive(
            self.at[at],
            self.middle[between],
            self.means[between],
            self.rise[between],
            self.before[at],
            self.after[at],
            self.push_at[at],
            self.push_middle[between],
            self.jumps[between],
            *self[9:],
        )


class State(NamedTuple):
    """What is believed, changed in place: q (nq,), v (nv,), unknown inputs and their rates (k,), values of
    parameters (m,), and covariance (x, x) of all, x = 2 nv + k + m.
    """

    q: np.ndarray
    v: np.ndarray
    unknown: np.ndarray
    values: np.ndarray
    covariance: np.ndarray


class Samples(NamedTuple):
    """What was read: values (n, rows), attitudes (n, a, 4), what is there (n, rows), variances (rows,), and
    how many ``corrections`` are made; ``edges`` are the times and, where one follows, the next. Rows are
    whitened in ``order`` (rows,), each for what those before it do not tell.
    """

    edges: np.ndarray
    values: np.ndarray
    attitudes: np.ndarray
    there: np.ndarray
    variance: np.ndarray
    corrections: int
    order: np.ndarray


class Record(NamedTuple):
    """What came out, as in `smsid.estimation.filter_run.FilterRun`.

    ``values`` and ``sigmas`` (n, m) are of the parameters after each sample, ``log_likelihood`` (n,) by
    sample; ``at`` samples and in the ``middle`` between them are q, v, a, tau and M^-1.
    """

    innovations: np.ndarray
    whitening: np.ndarray
    gain: np.ndarray
    sensitivity: np.ndarray
    by_a: np.ndarray
    transition: np.ndarray
    forcing: np.ndarray
    predicted: np.ndarray
    errors: np.ndarray
    normalised: np.ndarray
    log_likelihood: np.ndarray
    values: np.ndarray
    sigmas: np.ndarray
    at: tuple[np.ndarray, ...]
    middle: tuple[np.ndarray, ...]

    def part(self, first: int, last: int) -> Record:
        """Return what came out from the way to sample ``first`` on to sample ``last``."""
        at, between = slice(first, last + 1), slice(max(0, first - 1), last)
        moves = {name: getattr(self, name)[between] for name in ("transition", "forcing")}
        moments = {"at": tuple(x[at] for x in self.at), "middle": tuple(x[between] for x in self.middle)}
        rest = {name: getattr(self, name)[at] for name in self._fields if name not in moves | moments}
        return self._replace(**rest, **moves, **moments)
