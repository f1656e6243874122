"""Which causes stand though something else is left: those that are proven where they show themselves."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from smsid.diagnose.model_comparison import Cause, wald
from smsid.diagnose.plausibility import LEFT, OF_JOINTS, impossible
from smsid.diagnose.result import FoundCause
from smsid.diagnose.stepwise import Search
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.diagnose.unknown_input_test import LOUD, NEAR, disturbances, inputs_of
from smsid.errors import SmsidError
from smsid.estimation.map_estimate import Fit, fit

LOGGER = logging.getLogger(__name__)
MOSTLY = THRESHOLDS.mostly
AGREE = 3.0  # standard deviations


def standing(found: Search, named: Sequence[FoundCause]) -> tuple[FoundCause, ...]:
    """Return the causes of a search that stand whatever is left elsewhere; ``named`` are all of them.

    Their values can be, nothing of another place looks like them, and
    - where misfit is counted, nine tenths of the squared errors of their own components went with them, and
      what is left there is not above three times its noise;
    - else they are needed, and are what they are, also where the equations and channels that still depend on
      something are taken as unknown.
    """
    rest = None if found.misfit else _rest_unknown(found)
    out = []
    for cause, told in zip(found.causes, named, strict=True):
        own = cause.score.candidate
        alone = all((a.location, a.family) == (told.location, told.family) for a in told.aliases)
        if not alone or impossible(told):
            continue
        if _explained(found, cause) if found.misfit else _needed(found, cause, rest):
            LOGGER.info("%s stands", own.key)
            out.append(told)
    return tuple(out)


def own_components(found: Search, cause: Cause) -> np.ndarray:
    """Return the components of channels (rows,) that a cause shows in: those of its sensor or its joint, else
    the fewest that hold nine tenths of what it explains.
    """
    place, names = cause.score.candidate.location, found.last.problem.data.names
    quantities = (*OF_JOINTS, "wheel_rate")
    if cause.score.candidate.family == "sensor":
        own = [n == place or n.startswith((f"{place}[", f"{place}.")) for n in names]
    else:
        own = [n.endswith(f"[{place}]") and n.partition("[")[0].endswith(quantities) for n in names]
    if any(own):
        return np.array(own)
    done = (cause.score.columns @ cause.score.estimate)[: found.last.run.innovations.size]
    size = (done.reshape(-1, len(names)) ** 2).sum(axis=0)
    order = np.argsort(-size)
    few = int(np.searchsorted(np.cumsum(size[order]), MOSTLY * size.sum())) + 1
    return np.isin(np.arange(len(names)), order[:few])


def _explained(found: Search, cause: Cause) -> bool:
    own = own_components(found, cause)
    before, after = (x[own] for x in found.strays)
    gone = 1.0 - float(after @ after) / max(float(before @ before), 1e-300)
    LOGGER.info("%s: %.3g of its own gone, %.3g left", cause.score.candidate.key, gone, after.max())
    return gone >= MOSTLY and float(after.max()) <= LEFT


def _needed(found: Search, cause: Cause, rest: Fit | None) -> bool:
    own = cause.score.candidate
    joint = {f"torque of {own.location}"}
    lost = {t.where for t in found.left}
    if rest is None or lost & joint or any(_at(own.location, where) for where in lost):
        return False
    names = [u.name for u in found.last.unknowns]
    sigma = np.sqrt(np.diag(rest.covariance()))
    for name in own.free:
        i = names.index(name)
        u = rest.unknowns[i]
        if abs(rest.point.value(u) - found.last.point.value(u)) > AGREE * sigma[i]:
            return False
    chance = 0.5 * cause.score.sides * found.candidates * float(chi2.sf(wald(rest, own), len(own.free)))
    return chance < THRESHOLDS.further


def _at(place: str, where: str) -> bool:
    """Whether a channel or component is one of a sensor, or a part of the place."""
    return where == place or where.startswith((f"{place}[", f"{place}.")) or place.startswith(f"{where}[")


def _rest_unknown(found: Search) -> Fit | None:
    """Return the last fit made again with noise on the inputs that still depend on something, and without the
    channels that do; nothing where that cannot be fitted.
    """
    last, inputs = found.last, inputs_of(found.last)
    data, run = last.problem.data, last.run
    lost = {t.where for t in found.left}
    dofs = sorted({dof for name in lost for dof in inputs.get(name, ())})
    _, known = disturbances(run)
    loud = tuple((d, float(np.sqrt(LOUD / max(float(known[:, d].mean()), 1e-300)))) for d in dofs)
    out = np.zeros(data.values.shape, dtype=bool)
    for block in data.blocks:
        own = [block.channel in lost or name in lost for name in block.names]
        out[:, block.rows] = own
    out[list(run.begins)] = False  # where the filter begins is read from there
    noise = replace(last.problem.noise, more=(*last.problem.noise.more, *loud))
    problem = replace(last.problem, data=data.without(out), noise=noise)
    try:
        return fit(last.point, last.unknowns, problem, iterations=4, enough=NEAR)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("nothing stands without what is left: %s", error)
        return None
