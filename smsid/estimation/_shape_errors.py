"""What errors of the shape of a law of friction do to parameters: they repeat wherever the rate does, and the
load.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from smsid.estimation.filter_run import FilterRun
from smsid.estimation.sensitivities import Sensitivity, propagate
from smsid.kernel.arrays import Force
from smsid.model.spacecraft import SpacecraftModel

OCTAVE = 2.0  # factor within which the errors at two rates of one sign are taken as alike


def shape_errors(model: SpacecraftModel, run: FilterRun, dof: int) -> np.ndarray:
    """Return how whitened predictions change (N, rows, k) by torques of one against the motion of a degree of
    freedom, one for every octave of its rate. Where its friction goes by the load, so do its errors, whose
    mean square is one then, and there is one for every octave of the load, too: no friction is exactly in
    proportion.

    White noise has as many errors as samples; an error of shape is one error, however often the joint goes
    at that rate.
    """
    both = (run.middle, run.states)
    rates = [s.v[:, dof] for s in both]
    sizes = [np.ones_like(v) for v in rates]
    regions = [_octaves(rates)]
    if any(dof in t.rows and t.by_load() for t in model.loads if isinstance(t, Force)):
        loads = [np.abs(s.tau[:, dof]) for s in both]
        usual = float(np.sqrt(np.mean(loads[1] ** 2))) or 1.0
        sizes = [x / usual for x in loads]
        regions.append(_octaves(loads))
    changes = []
    for octaves in regions:
        for octave in np.unique(np.concatenate(octaves)):
            each = zip(octaves, rates, sizes, strict=True)
            changes.append(
                Sensitivity.on(dof, *(np.where(o == octave, np.sign(v) * x, 0.0) for o, v, x in each))
            )
    return propagate(run, changes) / np.sqrt(len(regions))  # together they are as large as the errors


def _octaves(values: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return the octave that each value of each array lies in."""
    with np.errstate(divide="ignore"):
        return [np.floor(np.log(np.abs(x)) / np.log(OCTAVE)) for x in values]
