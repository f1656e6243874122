"""A structure whose motion is taken as unknown, where all else is followed so, and taken in again.

A panel or a tank is described by a few modes; what else it does reaches all channels, but is a force on these
modes and a wrench on what carries it.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from smsid.diagnose._noise_covariance import (
    InflatedFit,
    exact_fit,
    fit_to_stated_noise,
    with_misfit,
    with_noise,
)
from smsid.diagnose._unknown_input import with_unknown
from smsid.errors import SmsidError
from smsid.estimation.joint_problem import with_likely_timing
from smsid.estimation.map_estimate import MapFit, fit
from smsid.estimation.problem import Problem

LOGGER = logging.getLogger(__name__)


def refit_noise(
    found: InflatedFit,
    *,
    strong: bool = False,
    told: Callable[[MapFit, str], Sequence[float]] = lambda found, place: (),
) -> InflatedFit:
    """Return a fit with its noise levels found again, where misfit was counted in them or may have been.

    ``strong``: a cause was found since that the levels may have had a part of. A structure is taken as
    unknown only where that tells causes at least as well as misfit that is counted does: what acts on the
    bus, as its wrench does, it hides. ``told`` is how well a fit tells each of them but those at a place: of
    itself, what is unknown tells nothing.
    """
    if not found.misfit:
        return with_noise(found) if strong else found
    exact = exact_fit(found) if strong else None
    if exact is not None:
        return exact
    counted, rest = with_misfit(found), but_for_a_structure(found) if found.local else None
    if rest is None or not counted.misfit:
        return counted
    as_well = zip(*(told(f.fit, rest.unknown) for f in (rest, counted)), strict=True)
    return rest if all(a >= b for a, b in as_well) else counted


def but_for_a_structure(
    found: InflatedFit, held: Callable[[str], Collection[str]] = lambda place: ()
) -> InflatedFit | None:
    """Return the fit to the noise as stated with the motion of one structure unknown and its own channels
    left out, where all else is followed; else nothing.

    ``held`` are names of parameters that stay, by structure.
    """
    last = found.fit
    for place, problem in unknown_structures(last, found.stated):
        unknowns = tuple(u for u in last.unknowns if u.name not in held(place))
        # what was not followed told badly how commands act
        rest = fit_to_stated_noise(last.point, unknowns, with_likely_timing(last.point, problem))
        if rest is None:
            continue
        LOGGER.info("followed to the noise with %s unknown", place)
        return replace(found, fit=rest, factors=np.ones_like(found.factors), misfit=False, unknown=place)
    return None


def unknown_structures(found: MapFit, problem: Problem) -> Iterator[tuple[str, Problem]]:
    """Yield the name of every structure, and a problem as a fit's in which its motion is unknown and its own
    channels are left out.
    """
    model, data = found.changes.model, problem.data
    places = {a.appendage.name: [model.pin.joints[j].idx_v for j in a.seen] for a in model.appendages}
    places |= {tank.name: [*range(tank.v.start, tank.v.stop)] for tank in model.slosh}
    for place, own_dofs in places.items():
        dofs = [*(range(6) if model.free else ()), *own_dofs]
        own = {b.channel for b in data.blocks if place in (b.sensor.appendage, b.sensor.name)}
        yield place, with_unknown(problem, *own, run=found.run, dofs=dofs, held=len(data.times))


def with_structure_again(
    found: InflatedFit, whole: Problem, known: MapFit, own: Collection[str]
) -> InflatedFit:
    """Return a fit with the structure that was unknown taken in again, misfit counted where it is; ``whole``
    is the problem with it.

    What it alone tells of was free to go anywhere meanwhile: parameters but the ``own`` of causes begin where
    a fit from before has them (``known``), too.
    """
    last = found.fit
    before = {u.name for u in known.unknowns} - set(own)
    kept = [u for u in last.unknowns if u.name in before]
    back = np.array([known.point.value(u) - last.point.value(u) for u in kept])
    reached, lost = [], None
    for start in (last.point, *([last.point.moved(kept, back)] if kept else ())):
        try:
            reached.append(fit(start, last.unknowns, whole, iterations=2))
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("not taken in again from there: %s", error)
            lost = error
    if lost and not reached:
        raise lost
    best = min(reached, key=lambda f: f.objective)
    return with_misfit(InflatedFit(best, np.ones(whole.data.rows), misfit=True, local=False))
