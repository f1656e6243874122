"""Steps of a fit that go straight in what a recording tells, where parameters alone would go round a bend."""

from __future__ import annotations

from collections.abc import Sequence
from collections.abc import Set as AbstractSet
from dataclasses import replace

import numpy as np

from smsid.errors import SmsidError
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.model.regressor import dynamic_parameters

STEP_SHARE = 1e-4  # share of a step by which its first order is found


def retract(start: Point, unknowns: Sequence[Unknown], step: np.ndarray) -> Point:
    """Return the point a step (unknowns,) away, in the parameters' units, bodies moved as it means.

    A payload's mass times its place is no straight line, and what bodies are together is known far better
    than what each is: the link it is on, or hangs at on springs, makes up for the bend.

    Raises `SmsidError` when the step takes away a body that an effect has added.
    """
    end = _move_places(start, start.moved(unknowns, step))
    if all(u.kind == "inertial" for u in unknowns):
        return end
    links = frozenset(u.column // 10 + 1 for u in unknowns if u.kind == "inertial")
    near, a_little, far = (
        _inertias(p, links) for p in (start, start.moved(unknowns, STEP_SHARE * step), end)
    )
    if not len(near) == len(a_little) == len(far):
        raise SmsidError("The step takes away a body that an effect has added.", advice="Take a shorter one.")
    bend = far - near - (a_little - near) / STEP_SHARE
    shift = {u.column: bend[u.column] for u in unknowns if u.kind == "inertial" and bend[u.column] != 0.0}
    inertial = {c: v - shift.get(c, 0.0) for c, v in ({**dict.fromkeys(shift, 0.0), **end.inertial}).items()}
    return replace(end, inertial=inertial)


def _move_places(start: Point, step: Point) -> Point:
    """Return the end of a step, masses at unknown places moved by the roots of the masses.

    A point mass is ``a^2`` at ``b / a``: its moment of inertia, which rotation tells best, is ``b^2``,
    whatever its mass is. In ``a`` and ``b`` the likelihood has no bent ridge.
    """
    end = step
    for effect in step.description.effect:
        if effect.point_mass is None:
            continue
        before = start.description.get_effect(effect.name)
        mass, place = effect.point_mass
        old, new = float(getattr(before, mass)), float(getattr(effect, mass))
        if old <= 0.0 or new <= 0.0:
            continue
        was, to = np.array(getattr(before, place)), np.array(getattr(effect, place))
        half = 0.5 * (new - old) / old
        values = {mass: old * (1.0 + half) ** 2, place: tuple((was + (to - was) / (1.0 + half)).tolist())}
        end = end.with_effect(effect.model_copy(update=values))
    return end


def _inertias(point: Point, links: AbstractSet[int]) -> np.ndarray:
    """Return the inertial parameters (10 n,) of the bodies, those of links with all that hangs at them and
    is no link itself, at rest.
    """
    model = point.model().pin
    bodies = list(model.inertias)
    for j in range(model.njoints - 1, 1, -1):
        if j not in links:  # without mass, too: an imbalance gives a wheel some
            carrier = model.parents[j]
            bodies[carrier] = bodies[carrier] + model.jointPlacements[j].act(bodies[j])
    return np.concatenate([dynamic_parameters(i) for i in bodies[1:]])
