"""Whether a recording starts at rest, as both experiments of the paper do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from smsid.errors import NotIdentifiableError

WINDOW = 1.0  # [s] from which the start is extrapolated
FEWEST = 8  # samples in it
SHARE = 0.01  # of the later motion: what a start may have without mattering


def check_at_rest(name: str, rates: Mapping[str, tuple[np.ndarray, np.ndarray, str]]) -> None:
    """Raise `NotIdentifiableError` if something moves at the first sample.

    ``name`` of the recording; ``rates``: by what it is, times (N,) [s], raw samples (N, k) and their unit.
    The start is that of a cubic through the first second; it counts as rest within six of its standard
    deviations or 1 % of the later change, whichever is more.
    """
    for label, (time, samples, unit) in rates.items():
        t = time - time[0]
        count = max(int(np.searchsorted(t, WINDOW)), FEWEST)
        if len(t) < count or not samples.size:
            continue
        basis = np.vander(t[:count] / t[count - 1], 4, increasing=True)
        fit, *_ = np.linalg.lstsq(basis, samples[:count], rcond=None)
        left = samples[:count] - basis @ fit
        spread = np.sqrt(np.sum(left**2, axis=0) / (count - 4))
        sigma = spread * np.sqrt(np.linalg.inv(basis.T @ basis)[0, 0])
        start = fit[0]
        later = np.abs(samples - start).max(axis=0)
        allowed = np.maximum(6.0 * sigma, SHARE * later.max())
        over = np.abs(start) / np.maximum(allowed, 1e-300)
        worst = int(np.argmax(over))
        if over[worst] > 1.0:
            raise NotIdentifiableError(
                f"'{name}' does not start at rest: {label} is {start[worst]:.3g} {unit} at its first sample "
                f"(allowed: {allowed[worst]:.2g}).",
                advice="The method needs slosh, panels and momentum at rest at the start: give the recording "
                "from before the motion began, wheels standing still.",
                quantity=label,
                start=start,
                allowed=allowed,
                other_flight=True,
            )
