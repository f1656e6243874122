"""Where parameters may be compared at the likeliest torques, and where only in the mean over all of them.

At the likeliest torques (`Problem.profiled`), inertias are right where torques have moved the craft. Along a
combination that none has moved, residuals are the readings' noise, of rates or of wheels as the inertia is
large or small: what fits best is chance, and looks sharp. What tells both apart is the volume of the
innovations, as it goes with the parameters. Where torques tell them, it is a straight line over a standard
deviation, whose slope is the error that the mean makes; where it bends, it is all that holds them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from smsid.errors import SmsidError
from smsid.estimation._differences import principal_axes
from smsid.estimation._normal_equations import NormalEquations, log_determinant_of
from smsid.estimation._retraction import retract
from smsid.estimation._trust_region import sizes
from smsid.estimation.flight import Flight

STRAIGHT_WITHIN = 1.0  # second difference of the volume a sigma to both sides, of what is told; of noise: 3
ASKED_SHARE = 0.01  # share along an axis that the recordings tell, from which it is asked about
MOST_AXES = 3  # axes, those told least
MEAN = (
    "torques that followed the motion of joints or wheels do not tell all that is asked: values are those in "
    "the mean over torques that may have been, as lively as the motion says and more"
)


def with_mean_torques(flights: Sequence[Flight]) -> list[Flight]:
    """Return the flights with parameters compared in the mean over all torques, and a note that says so."""
    out = []
    for flight in flights:
        notes = (*flight.notes, MEAN) if flight.problem.profiled else flight.notes
        out.append(replace(flight, problem=replace(flight.problem, averaged=True), notes=notes))
    return out


def with_likeliest_motion(flights: Sequence[Flight]) -> list[Flight]:
    """Return the flights with parameters compared at the likeliest motion of all readings, if at torques."""
    return [replace(f, problem=replace(f.problem, of_all_readings=True)) for f in flights]


def are_told_by_torques(found: NormalEquations, flights: Sequence[Flight]) -> bool:
    """Whether what the recordings tell least is told by torques that moved the craft, not by noise.

    Asked are axes of the Gram matrix, a standard deviation to both sides. Of a single inertia that noise
    alone tells, the volume bends by three times what is told.
    """
    axes = principal_axes(found)
    told = np.einsum("ik,ij,jk->k", axes, found.information, axes)
    wide = np.linalg.norm(axes * sizes(found)[:, None], axis=0)
    order = [k for k in np.argsort(-wide, kind="stable") if told[k] > ASKED_SHARE]
    here = log_determinant_of(found.point, flights)
    for axis, share in zip(axes.T[order[:MOST_AXES]], told[order[:MOST_AXES]], strict=True):
        try:
            ends = [retract(found.point, found.unknowns, s * axis * found.scales) for s in (1.0, -1.0)]
            bend = sum(log_determinant_of(p, flights) for p in ends if p.physical()) - 2.0 * here
            if not all(p.physical() for p in ends) or abs(bend) > STRAIGHT_WITHIN * share:
                return False
        except SmsidError:
            return False
    return True
