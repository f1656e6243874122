"""Which poles of a subspace identification are modes: stable over model orders, then clustered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy  # loads a part of it when that is used

from smsid.errors import SmsidError
from smsid.identify.modes import IdentifiedMode, Poles, mac, real_shape


@dataclass(frozen=True)
class Stability:
    """When a pole counts as stable, and a cluster of stable poles as a mode.

    Attributes:
        frequency: largest relative change of frequency from one order to the next.
        damping: largest relative change of damping ratio.
        shape: largest 1 - MAC.
        largest_damping: damping ratios must lie between 0 and this.
        share_of_orders: a mode must be stable in at least this share of the orders.
        contribution: a mode must carry at least this share of the covariance.
    """

    frequency: float = 0.01
    damping: float = 0.1
    shape: float = 0.05
    largest_damping: float = 0.2
    share_of_orders: float = 0.5
    contribution: float = 1e-3


def stable_poles(poles: Sequence[Poles], stability: Stability | None = None) -> tuple[np.ndarray, ...]:
    """For each order, the (k,) mask of poles that the previous order has too, within tolerance.

    Those of the lowest order are not stable: there is nothing to compare them with. This is the stabilisation
    diagram of Peeters and De Roeck (1999).
    """
    limits = stability or Stability()
    masks = [np.zeros(len(poles[0].values), bool)] if poles else []
    for before, now in pairwise(poles):
        if not len(before.values) or not len(now.values):
            masks.append(np.zeros(len(now.values), bool))
            continue
        f, d = now.frequency[:, None], now.damping[:, None]
        near = np.abs(before.frequency - f) <= limits.frequency * f
        near &= np.abs(before.damping - d) <= limits.damping * np.abs(d)
        near &= mac(now.shapes, before.shapes) >= 1 - limits.shape
        masks.append(near.any(axis=1) & (now.damping > 0) & (now.damping <= limits.largest_damping))
    return tuple(masks)


def stable_modes(
    poles: Sequence[Poles], rate: float, stability: Stability | None = None
) -> tuple[IdentifiedMode, ...]:
    """Cluster the stable poles into modes, ascending in frequency. No order is picked by hand.

    Average-linkage clustering with distance ``|df| / f + 1 - MAC``, cut where a pole would no longer count as
    stable; one pole per order and cluster. A mode is the median of its cluster.

    Args:
        poles: one `Poles` per order, ascending (from `ssi_cov` or `ssi_cov_input`).
        rate: sampling rate they were found at [Hz].
        stability: tolerances; default `Stability()`.

    Raises:
        SmsidError: fewer than three orders.
    """
    limits = stability or Stability()
    if len(poles) < 3:
        raise SmsidError(
            f"{len(poles)} orders are too few to judge stability.", advice="Give at least three."
        )
    masks = stable_poles(poles, limits)
    frequency = np.concatenate([p.frequency[m] for p, m in zip(poles, masks, strict=True)])
    damping = np.concatenate([p.damping[m] for p, m in zip(poles, masks, strict=True)])
    shapes = np.concatenate([p.shapes[m] for p, m in zip(poles, masks, strict=True)])
    weight = np.concatenate([p.contributions[m] for p, m in zip(poles, masks, strict=True)])
    order = np.concatenate([np.full(m.sum(), p.order) for p, m in zip(poles, masks, strict=True)])
    if frequency.size < 2:
        return ()
    distance = 2 * np.abs(frequency[:, None] - frequency) / (frequency[:, None] + frequency)
    distance += 1 - mac(shapes, shapes)
    distance = (distance + distance.T) / 2
    np.fill_diagonal(distance, 0.0)
    pairs = distance[np.triu_indices(len(distance), k=1)]
    tree = scipy.cluster.hierarchy.linkage(np.maximum(pairs, 0.0), "average")
    labels = scipy.cluster.hierarchy.fcluster(tree, limits.frequency + limits.shape, "distance")
    needed = max(2, int(np.ceil(limits.share_of_orders * (len(poles) - 1))))
    modes = []
    for label in np.unique(labels):
        members = _one_per_order(np.flatnonzero(labels == label), frequency, order)
        contribution = float(np.median(weight[members]))
        if members.size < needed or contribution < limits.contribution:
            continue
        modes.append(
            IdentifiedMode(
                frequency=float(np.median(frequency[members])),
                damping=float(np.median(damping[members])),
                shape=real_shape(shapes[members]),
                frequency_order_spread=float(np.std(frequency[members], ddof=1)),
                damping_order_spread=float(np.std(damping[members], ddof=1)),
                contribution=contribution,
                orders=int(members.size),
                rate=rate,
            )
        )
    return tuple(sorted(modes, key=lambda mode: mode.frequency))


def _one_per_order(members: np.ndarray, frequency: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Of members of the same order keep the one nearest the median frequency."""
    centre = np.median(frequency[members])
    by_distance = members[np.argsort(np.abs(frequency[members] - centre))]
    _, first = np.unique(order[by_distance], return_index=True)
    return by_distance[np.sort(first)]
