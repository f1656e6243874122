"""Modes found in windows of several lengths: which are one and the same, and how far they scatter."""

from __future__ import annotations

import numpy as np
from scipy.optimize import linear_sum_assignment

from smsid.identify.modes import IdentifiedMode, Poles, mac

AGREEING = 3
"""Number of windows that must find the same modes."""

RESAMPLED_ORDERS = 5

SAME_POLE = 0.05
"""A pole of a resampled record further from a mode than this share of its frequency is another one."""


def group_modes(found: list[list[IdentifiedMode]], tolerance: float) -> list[list[IdentifiedMode]]:
    """Put the modes of different windows that are one and the same together; at most one of each window."""
    every = sorted((m for modes in found for m in modes), key=lambda m: m.frequency)
    groups: list[list[IdentifiedMode]] = []
    for mode in every:
        near = groups[-1] if groups else []
        centre = np.median([m.frequency for m in near]) if near else 0.0
        if (
            near
            and mode.frequency - centre <= 1.5 * tolerance * centre
            and mac(near[0].shape, mode.shape)[0, 0] > 0.9
        ):
            near.append(mode)
        else:
            groups.append([mode])
    return groups


def least_agreeing(windows: int) -> float:
    """Return how many of so many windows have to find a mode."""
    return max(AGREEING, 0.7 * windows)


def finest_windows(found: list[list[IdentifiedMode]], tolerance: float) -> list[int]:
    """Windows that resolve most: with the largest number of modes on which three or more windows agree.

    Too short a window merges close modes, too long a one splits them by noise, each time elsewhere.
    """
    for count in sorted({len(modes) for modes in found}, reverse=True):
        used = [k for k, modes in enumerate(found) if len(modes) == count]
        groups = group_modes([found[k] for k in used], tolerance)
        if sum(len(g) >= least_agreeing(len(used)) for g in groups) == count:
            return used
    return []


def resampled_scatter(groups: list[list[IdentifiedMode]], again: list[list[tuple[Poles, ...]]]) -> np.ndarray:
    """Deviations (replicates, windows, modes, 2) of frequency and damping; NaN where a mode got lost.

    In each resampled record, for each window and order, every mode is given a pole of its own, so that close
    modes do not share one. The deviation is the median over orders, as the estimate is.
    """
    frequency = np.array([np.median([m.frequency for m in g]) for g in groups])
    damping = np.array([np.median([m.damping for m in g]) for g in groups])
    moved = np.full((len(again[0]), len(again), RESAMPLED_ORDERS, len(groups), 2), np.nan)
    for window, replicas in enumerate(again):
        for r, by_order in enumerate(replicas):
            for o, poles in enumerate(by_order):
                good = (poles.damping > 0.0) & (poles.damping < 0.2) & (poles.contributions > 0.05)
                if not good.any():
                    continue
                f, z = poles.frequency[good], poles.damping[good]
                # close modes differ in damping more than in frequency
                away = np.abs(np.log(f / frequency[:, None]))
                cost = away + 0.01 * np.abs(np.log(z / damping[:, None]))
                for k, j in zip(*linear_sum_assignment(np.minimum(cost, SAME_POLE)), strict=True):
                    if away[k, j] < SAME_POLE:
                        moved[r, window, o, k] = f[j] - frequency[k], z[j] - damping[k]
    found = np.mean(np.isfinite(moved[..., 0]), axis=2) > 0.25  # no median of nothing
    middle = np.nanmedian(np.where(found[:, :, None, :, None], moved, 0.0), axis=2)
    return np.where(found[..., None], middle, np.nan)


def sigma_over_windows(scatter: np.ndarray) -> np.ndarray:
    """Standard deviations (k,) of scatter (replicates, windows, k): the median over windows.

    The estimate is a median over windows, which scatters a little less. Infinite where most of the windows
    lose the mode in half of the resampled records.
    """
    kept: np.ndarray = np.all(np.isfinite(scatter), axis=2)
    lost = np.mean(kept, axis=0) < 0.5
    square = np.where(kept[..., None], scatter, 0.0) ** 2
    sigma = np.sqrt(square.sum(axis=0) / np.maximum(kept.sum(axis=0), 1)[:, None])
    return np.median(np.where(lost[:, None], np.inf, sigma), axis=0)
