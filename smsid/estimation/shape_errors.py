"""What errors of the shape of a law of friction do to parameters: they repeat wherever the rate does."""

from __future__ import annotations

import numpy as np

from smsid.estimation.filter_run import FilterRun
from smsid.estimation.sensitivities import Sensitivity, propagate

OCTAVE = 2.0  # factor within which the errors at two rates of one sign are taken as alike


def shape_errors(run: FilterRun, dof: int, *, by_load: bool = False) -> np.ndarray:
    """Return how whitened predictions change (N, rows, k) by torques of one against the motion of a degree of
    freedom, one for every octave of its rate.

    White noise has as many errors as samples; an error of shape is one error, however often the joint goes
    at that rate. ``by_load``: by torques as large as what drives the joint, too, one for every octave.
    """
    both = (run.middle, run.states)
    rates = [s.v[:, dof] for s in both]
    with np.errstate(divide="ignore"):
        octaves = [np.floor(np.log(np.abs(v)) / np.log(OCTAVE)) for v in rates]
    changes = []
    for octave in np.unique(np.concatenate(octaves)):
        here = [np.where(o == octave, np.sign(v), 0.0) for o, v in zip(octaves, rates, strict=True)]
        changes.append(Sensitivity.on(dof, *here))
        if by_load:
            loads = (np.abs(s.tau[:, dof]) for s in both)
            changes.append(Sensitivity.on(dof, *(x * load for x, load in zip(here, loads, strict=True))))
    return propagate(run, changes)
