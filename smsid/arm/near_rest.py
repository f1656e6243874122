"""Torques near rest and at reversals, where no law says what friction is: errors count as large as they are.

Bodies that slide obey a law of their rate. Before that they creep, stick and lag, by as much as only the
residual tells; weighed as all others, such instants bend delays, Coulomb and viscous friction.
"""

from __future__ import annotations

import numpy as np

from smsid.effects.friction_law import SMOOTHING

FEW = 10
"""Instants at least, near rest and not, that tell by how much errors differ."""


def near_rest(time: np.ndarray, rates: np.ndarray, at: np.ndarray, reach: float) -> np.ndarray:
    """Return whether joints are slow or turn round within ``reach`` [s] of instants ``at`` (n,): (n, joints).

    Args:
        time: (N,) of the motion [s], one stretch without gaps.
        rates: (N, joints) [rad/s | m/s].
        at: (n,) [s].
        reach: of what blurs the equations in time [s].
    """
    slow = np.abs(rates) < SMOOTHING
    slow[1:] |= np.sign(rates[1:]) != np.sign(rates[:-1])
    out = np.zeros((len(at), rates.shape[1]), dtype=bool)
    for j, own in enumerate(slow.T):
        instants = np.concatenate([[-np.inf], time[own], [np.inf]])
        after = np.searchsorted(instants, at)
        out[:, j] = np.minimum(instants[after] - at, at - instants[after - 1]) < reach
    return out


def variance_ratio(squares: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Return by how much errors' variance is larger where joints are ``near`` rest, at least 1: (joints,).

    Args:
        squares: (n, joints) of errors.
        near: (n, joints), see `near_rest`.
    """
    few, many = near.sum(axis=0), (~near).sum(axis=0)
    own, others = (np.where(where, squares, 0.0).sum(axis=0) for where in (near, ~near))
    told = (few >= FEW) & (many >= FEW) & (others > 0.0)
    ratio = np.divide(own * many, few * others, out=np.ones(len(own)), where=told)
    return np.maximum(ratio, 1.0)
