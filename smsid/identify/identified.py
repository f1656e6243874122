"""Putting identified modes and density into an appendage's description."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy  # loads a part of it when that is used

from smsid.effects.appendage import Appendage, ModalAppendage
from smsid.effects.appendage import Mode as DescribedMode
from smsid.identify.modes import Mode

SAME_MODE = 2.0  # ratio of frequencies, stiffness off by a factor of four, up to which a mode is recognised


def match_modes(found: Sequence[Mode], described: Sequence[DescribedMode]) -> dict[int, int]:
    """Return which found mode (value) is which described one (key): nearest in the logarithm of frequency.

    A described mode that none is found within `SAME_MODE` of stays unmatched; it does not push the others on.
    """
    if not found or not described:
        return {}
    log = [np.log([m.frequency for m in x]) for x in (described, found)]
    apart = np.abs(log[0][:, None] - log[1][None, :])
    limit = np.log(SAME_MODE)
    rows, columns = scipy.optimize.linear_sum_assignment(np.minimum(apart, limit))
    return {int(k): int(j) for k, j in zip(rows, columns, strict=True) if apart[k, j] < limit}


def identified_modes(
    appendage: Appendage,
    factor: float,
    modes: Sequence[Mode],
    described: Sequence[DescribedMode] | None = None,
) -> ModalAppendage:
    """Return an appendage as modal data with identified frequencies and damping, its mass times ``factor``.

    Participation factors scale with the root of the mass, mass-normalised shapes with one over it.
    ``described`` are the modes there are, where other effects say something of them; else its own.
    """
    data = list(appendage.modal_data() if described is None else described)
    for k, j in match_modes(modes, data).items():
        found = {"frequency": modes[j].frequency, "damping": max(modes[j].damping, 0.0)}
        data[k] = data[k].model_copy(update=found)
    return appendage.as_modal(factor, data)
