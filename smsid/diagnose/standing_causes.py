"""Which causes stand though something else is left: those that are proven where they show themselves."""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from smsid.diagnose.model_comparison import Cause, wald
from smsid.diagnose.plausibility import LEFT, OF_JOINTS, impossible
from smsid.diagnose.result import FoundCause
from smsid.diagnose.specification_tests import adequacy, equations_of
from smsid.diagnose.stepwise import Search
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.diagnose.unknown_input_test import LOUD, NEAR, disturbances
from smsid.errors import SmsidError
from smsid.estimation.map_estimate import Fit, fit

LOGGER = logging.getLogger(__name__)
MOSTLY = THRESHOLDS.mostly
PEELED = 3  # equations and channels at most that are taken as unknown


def standing(found: Search, named: Sequence[FoundCause]) -> tuple[Search, tuple[bool, ...]]:
    """Return which causes of a search stand whatever is left elsewhere, and the search with the fit that says
    how large they are; ``named`` are all of them.

    Their values can be, nothing of another place looks like them, and
    - where misfit is counted, nine tenths of the squared errors of their own components went with them, and
      what is left there is not above three times its noise;
    - else they are needed also where the equations and channels that still depend on something are taken as
      unknown, and act at none of these. Their values are those they have then: before, they bent to the rest.
    """
    rest = None if found.misfit or not named else _rest_unknown(found)
    out = []
    for cause, told in zip(found.causes, named, strict=True):
        alone = all((a.location, a.family) == (told.location, told.family) for a in told.aliases)
        if not alone or impossible(told):
            out.append(False)
        elif found.misfit:
            out.append(_explained(found, cause))
        else:
            out.append(rest is not None and _needed(found, cause, *rest))
    return found if rest is None else replace(found, last=rest[0]), tuple(out)


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


def _needed(found: Search, cause: Cause, rest: Fit, lost: Mapping[str, str]) -> bool:
    """Whether a cause is needed with equations and channels unknown, and is at no place of those ``lost``."""
    own = cause.score.candidate
    if any(_at(own.location, place) for place in lost.values()):
        return False
    chance = 0.5 * cause.score.sides * found.candidates * float(chi2.sf(wald(rest, own), len(own.free)))
    return chance < found.levels.further


def _at(place: str, other: str) -> bool:
    """Whether one place is the other, a component of its channel or a channel of its sensor, or may be it:
    what acts on the bus (empty) may be anything.
    """
    inner = place.startswith((f"{other}[", f"{other}.")) or other.startswith((f"{place}[", f"{place}."))
    return not other or place == other or inner


def _rest_unknown(found: Search) -> tuple[Fit, dict[str, str]] | None:
    """Return the last fit made again with what is left taken as unknown, and the places of that by name;
    nothing where it cannot be fitted or something is still left.

    One after the other, the worst first: what it leaves shows in its neighbours, too.
    """
    lost, here = dict[str, str](), found
    for _ in range(PEELED):
        left = [t for t in here.left if t.where not in lost]
        if not left:
            return here.last, lost
        worst = max(left, key=lambda t: t.ratio / max(t.freedom, 1))
        lost[worst.where] = worst.location
        try:
            fitted = _without(found.last, lost)
            here = replace(found, last=fitted, blocks=tuple(adequacy(fitted)))
        except (SmsidError, np.linalg.LinAlgError) as error:
            LOGGER.info("nothing stands without %s: %s", ", ".join(lost), error)
            return None
        LOGGER.info("without %s is left: %s", lost, [(t.where, t.dependence) for t in here.left])
    return None if any(t.where not in lost for t in here.left) else (here.last, lost)


def _without(last: Fit, lost: Collection[str]) -> Fit:
    """Return a fit with noise on the inputs of equations, and without the readings of channels."""
    data, run = last.problem.data, last.run
    _, known = disturbances(run)
    dofs = sorted({dof for e in equations_of(last) if e.name in lost for dof in e.v})
    loud = tuple((d, float(np.sqrt(LOUD / max(float(known[:, d].mean()), 1e-300)))) for d in dofs)
    out = np.zeros(data.values.shape, dtype=bool)
    for block in data.blocks:
        out[:, block.rows] = [block.channel in lost or name in lost for name in block.names]
    out[list(run.begins)] = False  # where the filter begins is read from there
    noise = replace(last.problem.noise, more=(*last.problem.noise.more, *loud))
    problem = replace(last.problem, data=data.without(out), noise=noise)
    return fit(last.point, last.unknowns, problem, iterations=4, enough=NEAR)
