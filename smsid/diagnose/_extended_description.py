"""Writing what was found into a description that simulates, identifies and controls like any other."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.description.schema import Description
from smsid.diagnose._described_effects import free_name
from smsid.diagnose.priors import DEFAULT_EFFECT
from smsid.diagnose.score_test import Candidate
from smsid.diagnose.stepwise import Search
from smsid.effects import BodyError
from smsid.effects.base import Effect
from smsid.errors import DescriptionError, SmsidError
from smsid.estimation.joint_problem import by_own_clock
from smsid.estimation.map_estimate import MapFit
from smsid.estimation.parameter_vector import Point
from smsid.likelihood.consistent import consistent_inertias
from smsid.likelihood.parameters import body_size
from smsid.likelihood.pseudo_inertia import SIZE
from smsid.model import rebuild
from smsid.model.regressor import body_names, dynamic_parameters
from smsid.model.rigid_bodies import described_bodies

LOGGER = logging.getLogger(__name__)

WIDE = 5.0
"""Standard deviations of a fit that a prior of what it found is wide: the same recording, which it came from,
counts for 1.04 of itself when it is identified again."""


@dataclass(frozen=True)
class BodyValues:
    """Inertial parameters of rigid bodies (bodies, 10), and what a unit of a step of them is."""

    inertias: np.ndarray
    sizes: np.ndarray


def extended_point(found: Search, hints: Sequence[Candidate] = ()) -> Point:
    """Return where the last fit stands, of several recordings in the last of them, without the effects of
    ``hints``, which are no causes.

    Of an effect that is added the parameters that were not fitted are marked `known`: who identifies what is
    written, estimates what was found. What was fitted of causes has a wide prior, see `WIDE`.
    """
    point = as_now(found.last)
    described = {e.name for e in found.nominal.point.description.effect}
    out = {c.effect.name for c in hints if c.effect is not None} - described
    deviations = np.sqrt(np.diag(found.last.covariance()))
    told = zip(found.last.unknowns, deviations, found.last.told, strict=True)
    fitted = {u.name: float(sigma) if known else np.inf for u, sigma, known in told}
    causes = {c.score.candidate.effect.name for c in found.causes if c.score.candidate.effect is not None}
    kept = tuple(
        e if e.name in described - causes else _with_fitted_unknown(e, fitted, listed=e.name in described)
        for e in point.description.effect
        if e.name not in out
    )
    return replace(point, description=point.description.model_copy(update={"effect": kept}))


def _with_fitted_unknown(effect: Effect, fitted: Mapping[str, float], *, listed: bool) -> Effect:
    """Return an effect with priors of what was ``fitted``, standard deviations by name, whose other
    parameters, of one that was not ``listed``, are known; itself where nothing of it was fitted.
    """
    own = {p.name.removeprefix(f"{effect.name}."): p for p in effect.parameters()}
    rest = tuple(field for field, p in own.items() if p.name not in fitted)
    if len(rest) == len(own):
        return effect
    wide = {field: WIDE * fitted[p.name] for field, p in own.items() if p.name in fitted}
    if effect.nominal:  # taken for known to a share where nothing is said
        wide = {f: x for f, x in wide.items() if x > DEFAULT_EFFECT * abs(own[f].value)}
    sure = {f: x for f, x in wide.items() if 0.0 < x < np.inf}
    known = effect.known if listed else rest
    return effect.model_copy(update={"known": known, "prior": {**effect.prior, **sure}})


def with_inertial_shifts(point: Point, last: MapFit) -> tuple[Description, tuple[str, ...]]:
    """Return the description of a point, shifts of inertial parameters as ``body_error`` effects; and notes.

    Where a shifted body could not exist - the recording determines combinations of bodies only - the bodies
    are the nearest that can, in the sense of the uncertainty of ``last``, the fit: they simulate as it does.
    """
    if not point.inertial:
        return point.description, ()
    try:
        return _shifted_description(point, point.inertial), ()
    except DescriptionError as error:
        LOGGER.info("refitted bodies cannot exist: %s", error)
    try:
        near = _that_can_exist(last)
        return _shifted_description(point, near), (
            "refitted bodies that could not exist singly are the nearest that can, by the fit's uncertainty",
        )
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.warning("bodies are left as described: %s", error)
        return point.description, (
            f"extended.toml has the bodies as described: as refitted they could not exist ({error})",
        )


def as_now(found: MapFit) -> Point:
    """Return where a fit stands by its recording's clock, of several by the last's: when effects begin."""
    point, parts = by_own_clock(found.point, found.problem), found.problem.parts
    if not parts:
        return point
    first = found.problem.shift
    begins, shift = float(found.problem.data.times[parts[-1].first]) - first, parts[-1].shift - first
    point = point.seen_in(parts[-1].label)

    def now(effect: Effect) -> Effect:
        start = getattr(effect, "start", None)
        if start is not None and start <= begins and not effect.grows:
            return effect.model_copy(update={"start": None})
        return effect.later(-shift) if shift else effect

    effects = tuple(now(e) for e in point.description.effect)
    description = point.description.model_copy(update={"effect": effects})
    return replace(point, description=description)


def _that_can_exist(found: MapFit) -> dict[int, float]:
    """Return shifts by column of bodies that can exist, nearest to those of a fit."""
    point = found.point
    index = [i for i, u in enumerate(found.unknowns) if u.kind == "inertial"]
    bodies = sorted({found.unknowns[i].column // SIZE for i in index})
    columns = [SIZE * b + k for b in bodies for k in range(SIZE)]
    by_column = {found.unknowns[i].column: i for i in index}
    own = described_bodies(point.description)
    described = np.array([own[point.base.pin.names[b + 1]] for b in bodies])
    shifts = np.array([point.inertial.get(c, 0.0) for c in columns]).reshape(-1, SIZE)
    sizes = np.array([body_size(dynamic_parameters(point.base.pin.inertias[b + 1])) for b in bodies])
    places = [by_column[c] for c in columns]
    covariance = found.covariance()[np.ix_(places, places)]
    covariance = covariance / np.outer(sizes.ravel(), sizes.ravel())
    there = BodyValues(described + shifts, sizes)
    near = consistent_inertias(there, BodyValues(described, sizes), covariance)
    return dict(zip(columns, (near - described).ravel().tolist(), strict=True))


def with_body_errors(description: Description, shifts: Mapping[str, np.ndarray]) -> Description:
    """Return a description whose bodies have other inertial parameters.

    Args:
        description: it may have ``body_error`` effects already: a shift is added to the one of its name.
        shifts: by body or joint, what is added to its parameters (10,) as described.
    """
    there = {e.name: e for e in description.effect}
    effects: list[Effect] = []
    for body, shift in shifts.items():
        if not np.any(shift):
            continue
        name = f"body_error_{body}".replace("/", "_")
        own = there[name].shifted_by(body, shift) if name in there else None
        found = own or BodyError(name=free_name(name, there), body=body, known=("all",)).plus(shift)
        there[found.name] = found
        effects.append(found)
    return description.with_effects(*effects)


def _shifted_description(point: Point, inertial: Mapping[int, float]) -> Description:
    """Return a description with shifts by column; raises `DescriptionError` where a body could not exist."""
    names = body_names(point.base.pin)
    bodies = {c // SIZE: np.zeros(SIZE) for c in inertial}
    for column, shift in inertial.items():
        bodies[column // SIZE][column % SIZE] = shift
    extended = with_body_errors(point.description, {names[b]: x for b, x in bodies.items()})
    rebuild(point.base, extended)
    return extended
