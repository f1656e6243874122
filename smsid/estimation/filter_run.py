"""What a filter made of a recording; of several, one after the other and apart again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.simulate.trajectory import States


@dataclass(frozen=True)
class FilterRun:
    """What a filter made of a recording. First index: sample k = 0 .. N - 1.

    ``innovations`` (N, rows) whitened, zero where nothing was measured; ``whitening`` (N, rows, rows) takes
    errors of the prediction to them; ``gain`` (N, x, rows), ``sensitivity`` H (N, rows, x) and
    ``transition`` F (N - 1, x, x), ``forcing`` Psi[:, nv:] (N - 1, x, nv) propagate a small change
    of the x = 2 nv states, the unknown inputs and biases that wander. ``by_a`` (N, rows, nv): measurement by
    acceleration. ``states`` are the predictions at the samples, ``middle`` the states between them;
    ``inverse`` and ``middle_inverse`` (., nv, nv) their inverse mass matrices. ``errors`` (N, rows) are
    measured minus ``predicted``; ``normalised`` the same in their own standard deviations, not decorrelated.
    ``used`` (N, rows): what took part. ``edges`` are the times of the
    samples and, where more follow, of the next one: there are then N transitions. The rows ``given`` (rows,)
    are no part of the likelihood, which is of the others beside them; of that ``volume`` is the part of the
    innovations' covariance alone. ``begins`` are the samples with which recordings begin, where there are
    several.
    """

    innovations: np.ndarray
    log_likelihood: float
    whitening: np.ndarray
    gain: np.ndarray
    sensitivity: np.ndarray
    by_a: np.ndarray
    transition: np.ndarray
    forcing: np.ndarray
    states: States
    middle: States
    inverse: np.ndarray
    middle_inverse: np.ndarray
    predicted: np.ndarray
    errors: np.ndarray
    normalised: np.ndarray
    used: np.ndarray
    edges: np.ndarray
    given: np.ndarray
    begins: tuple[int, ...] = (0,)
    volume: float = 0.0

    @property
    def fit(self) -> float:
        """The log-likelihood at the likeliest states and torques, of all readings, without constants."""
        return -0.5 * float((self.innovations**2).sum())

    @property
    def samples(self) -> int:
        """Number of innovations that count."""
        return int(self.used.sum())


def log_likelihoods(innovations: np.ndarray, whitening: np.ndarray, given: np.ndarray) -> np.ndarray:
    """Return the log-likelihood of each sample (N,) beside the rows ``given`` (rows,), without constants.

    Of ``innovations`` (N, rows) by their ``whitening`` (N, rows, rows), both zero where nothing was read.
    """
    return log_determinants(whitening, given) - 0.5 * (innovations[:, ~given] ** 2).sum(axis=1)


def log_determinants(whitening: np.ndarray, given: np.ndarray) -> np.ndarray:
    """Return minus half the log-determinant of each sample's innovation covariance (N,), without the rows
    ``given`` (rows,): the part of its log-likelihood that ``whitening`` (N, rows, rows) alone decides.
    """
    diagonal = np.einsum("nii->ni", whitening)[:, ~given]
    return np.log(np.where(diagonal > 0.0, diagonal, 1.0)).sum(axis=1)


def joined_runs(runs: Sequence[FilterRun]) -> FilterRun:
    """Return the runs over several recordings as one, in which nothing passes from one to the next."""

    def whole(name: str) -> np.ndarray:
        return np.concatenate([getattr(r, name) for r in runs])

    def between(name: str) -> np.ndarray:
        """Join arrays of one fewer than samples; where recordings meet, what is there is zero."""
        nothing = np.zeros((1, *getattr(runs[0], name).shape[1:]))
        parts = [x for r in runs for x in (getattr(r, name), nothing)]
        return np.concatenate(parts[:-1])

    middles = [r.middle for r in runs]
    for k in range(len(runs) - 1):  # a state stands where recordings meet, for nothing acts there
        at = 0.5 * (runs[k].states.time[-1:] + runs[k + 1].states.time[:1])
        middles[k] = _states([middles[k], replace(_last(runs[k].states), time=at)])
    return FilterRun(
        whole("innovations"), sum(r.log_likelihood for r in runs), whole("whitening"), whole("gain"),
        whole("sensitivity"), whole("by_a"), between("transition"), between("forcing"),
        _states([r.states for r in runs]), _states(middles), whole("inverse"), between("middle_inverse"),
        whole("predicted"), whole("errors"), whole("normalised"), whole("used"), whole("edges"),
        runs[0].given, tuple(np.cumsum([0, *(len(r.innovations) for r in runs[:-1])]).tolist()),
        sum(r.volume for r in runs),
    )  # fmt: skip


def run_of_each(run: FilterRun) -> list[FilterRun]:
    """Return a run over several recordings one by one."""
    count = len(run.innovations)
    out = []
    for a, b in zip(run.begins, [*run.begins[1:], count], strict=True):
        at, mid = slice(a, b), slice(a, b - 1)
        parts = {
            name: getattr(run, name)[at]
            for name in (
                "innovations", "whitening", "gain", "sensitivity", "by_a", "inverse", "predicted", "errors",
                "normalised", "used", "edges",
            )
        }  # fmt: skip
        between = {name: getattr(run, name)[mid] for name in ("transition", "forcing", "middle_inverse")}
        states, middle = _cut(run.states, at), _cut(run.middle, mid)
        out.append(replace(run, **parts, **between, states=states, middle=middle, begins=(0,)))
    return out


def _states(parts: Sequence[States]) -> States:
    names = ("time", "q", "v", "a", "tau", "reaction")
    return States(*(np.concatenate([getattr(s, n) for s in parts]) for n in names))


def _cut(states: States, where: slice) -> States:
    return States(*(getattr(states, n)[where] for n in ("time", "q", "v", "a", "tau", "reaction")))


def _last(states: States) -> States:
    return _cut(states, slice(len(states.time) - 1, None))
