"""Outliers: single readings far off, how large their share is, and the smaller ones among them."""

from __future__ import annotations

from collections.abc import Sequence, Set
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit, logit, logsumexp
from scipy.stats import binom, laplace, norm

from smsid.diagnose._sensor_faults import Fault
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.measurements import Measurements
from smsid.estimation.problem import Problem

OUTLIER = THRESHOLDS.outlier
CALM = THRESHOLDS.outlier_calm
FEW = THRESHOLDS.outlier_few
WIDE = THRESHOLDS.outlier_wide
ALONE = THRESHOLDS.outlier_alone
ELSEWHERE = THRESHOLDS.outlier_elsewhere


def outliers(data: Measurements, run: FilterRun) -> list[Fault]:
    """Return the channels with more single samples far off than Gaussian noise has, and which they are.

    Few of them have to be of what cannot jump there and back in a sample, which an acceleration can, with
    calm before and after and in all other channels: the first and the last reading are none. Where there are
    more, smaller ones are among them, see `outlier_share`.
    """
    return _found(data, run.normalised, run.used)


def _found(data: Measurements, normalised: np.ndarray, used: np.ndarray) -> list[Fault]:
    found = []
    size = np.abs(normalised)
    before, after = _neighbour_readings(size, used)
    many = (size > OUTLIER) & ((before < CALM) | (after < CALM))
    few = (size > ALONE) & (before < CALM) & (after < CALM)
    for block in data.blocks:
        others = np.delete(size, np.arange(block.rows.start, block.rows.stop), axis=1)
        calm = others.max(axis=1, initial=0.0) < ELSEWHERE
        for row, name in zip(range(block.rows.start, block.rows.stop), block.names, strict=True):
            hits, there = many[:, row], used[:, row]
            if hits.sum() < FEW:
                hits = few[:, row] & calm & (block.quantity != "acceleration")
            # a channel that is off throughout has no outliers
            if not hits.any() or float(np.median(size[there, row])) > 1.2:
                continue
            marked = np.zeros(size.shape, dtype=bool)
            marked[:, row] = hits
            share, sigma, among = outlier_share(normalised[there, row], int(hits.sum()))
            marked[np.flatnonzero(there)[among], row] = True
            found.append(Fault("outliers", block.channel, name, share, sigma, marked))
    return found


def recount_outliers(
    faults: Sequence[Fault], whole: Measurements, problem: Problem, run: FilterRun
) -> list[Fault]:
    """Return the faults with their shares as a fit without them sees them, less those it shows to be none.

    Readings (N, rows) of ``whole`` are compared with the predictions of ``run`` on a ``problem``, which they
    no longer pull along, and asked again: what was far off may have been a motion that is followed now.
    Nor are those outliers that follow each other more often than by chance, as where teeth cross a gap: of
    these, one has nothing to do with the next. Attitudes stay as they are.
    """
    data = replace(problem.data, values=whole.values)
    left = np.array([data.residual(k, run.predicted[k], None) for k in range(len(data.times))])
    normalised, used = np.where(run.used, run.normalised, 0.0), run.used.copy()
    for fault in faults:
        row = data.names.index(fault.component)
        read = run.used[:, row] & (run.normalised[:, row] != 0.0)
        if not read.any():
            continue
        sigma = float(np.median(run.errors[read, row] / run.normalised[read, row]))
        out = np.isfinite(data.values[:, row]) & ~run.used[:, row] & fault.samples[:, row]
        normalised[out, row], used[out, row] = left[out, row] / sigma, True
    attitudes = {b.channel for b in data.blocks if b.quantity == "attitude"}
    again = {f.component: f for f in _found(data, normalised, used)}
    size = np.abs(normalised)
    before, _ = _neighbour_readings(size, used)
    for row, name in enumerate(data.names):
        if name in again and _in_a_row(size[used[:, row], row], before[used[:, row], row]):
            del again[name]
    known = [(f, f if f.channel in attitudes else again.get(f.component)) for f in faults]
    return [replace(f, value=now.value, sigma=now.sigma) for f, now in known if now is not None]


def of_white_components(found: Sequence[Fault], left: Set[str]) -> list[Fault]:
    """Return the outliers but of components ``left``, whose errors still go with their own past: those far
    off may be of what is not followed, too.
    """
    return [f for f in found if f.component not in left]


def _in_a_row(size: np.ndarray, before: np.ndarray) -> bool:
    """Whether readings far off follow one that is off more often than chance has it; ``size`` and that of the
    reading before (n,).
    """
    hits = size > OUTLIER
    alone = int((hits & (before < CALM)).sum())
    return float(binom.cdf(alone, int(hits.sum()), np.mean(size < CALM))) < THRESHOLDS.beyond


def _neighbour_readings(size: np.ndarray, used: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the reading before and the one after each (N, rows), infinite where there is none."""
    before, after = np.full((2, *size.shape), np.inf)
    for row in range(size.shape[1]):
        there = np.flatnonzero(used[:, row])
        before[there[1:], row], after[there[:-1], row] = size[there[:-1], row], size[there[1:], row]
    return before, after


def outlier_share(x: np.ndarray, hits: int) -> tuple[float, float, np.ndarray]:
    """Return the share of outliers among normalised prediction errors (n,), its standard deviation, and which
    are more likely outliers than not (n,).

    By likelihood, of a normal distribution and a wide one (Laplace's or normal, as is likelier), whose sizes
    are fitted as well: some of the wide one's errors are no larger than noise. Of fewer than `FEW` ``hits``,
    which tell no distribution, or where the wide one is hardly wider than noise (noise with heavy tails), by
    counting these, and none is added.
    """
    n, none = len(x), np.zeros(len(x), dtype=bool)
    counted = hits / n
    by_counting = counted, float(np.sqrt(counted * (1.0 - counted) / n))
    if hits < FEW:
        return *by_counting, none

    fits = [_mixture(x, wide, counted) for wide in (laplace, norm)]
    share, sigma, among, size, _ = max(fits, key=lambda f: f[-1])
    return (share, sigma, among) if size > 1.01 * WIDE else (*by_counting, none)


def _mixture(x: np.ndarray, wide: Any, share: float) -> tuple[float, float, np.ndarray, float, float]:
    """Return the share of a wide distribution beside a normal one, its standard deviation, which errors (n,)
    are more likely of it, how wide it is, and the log-likelihood.
    """

    def parts(p: np.ndarray) -> np.ndarray:
        mixed = float(expit(p[0]))
        narrow = norm.logpdf(x, scale=float(np.exp(p[1])))
        return np.array(
            [np.log1p(-mixed) + narrow, np.log(mixed) + wide.logpdf(x, scale=float(np.exp(p[2])))]
        )

    def likely(p: np.ndarray) -> np.ndarray:
        return np.asarray(logsumexp(parts(p), axis=0))

    start = np.array([logit(share), 0.0, np.log(2.0 * OUTLIER)])
    bounds = [(logit(0.5 / len(x)), 0.0), (-1.0, 0.5), (np.log(WIDE), 12.0)]
    found = minimize(lambda p: -float(likely(p).sum()), start, method="L-BFGS-B", bounds=bounds).x
    slopes = np.column_stack([(likely(found + d) - likely(found - d)) / 2e-4 for d in 1e-4 * np.eye(3)])
    variance = float(np.linalg.pinv(slopes.T @ slopes, hermitian=True)[0, 0])  # Fisher's information, as seen
    best, (of_noise, of_wide) = float(expit(found[0])), parts(found)
    spread = best * (1.0 - best) * float(np.sqrt(variance))
    return best, spread, of_wide > of_noise, float(np.exp(found[2])), float(likely(found).sum())
