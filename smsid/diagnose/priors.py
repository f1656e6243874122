"""What is uncertain before any cause is looked for: the nominal parameters, with what is known of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace

import numpy as np

from smsid.description.schema import Description
from smsid.effects.base import Effect, Parameter
from smsid.errors import SmsidError
from smsid.estimation.bodies import (
    GROUPS,
    ROUNDING,
    identified_bodies,
    linear_terms,
    with_estimate,
)
from smsid.estimation.parameter_vector import JointPrior, Point, Unknown
from smsid.estimation.unknowns import moving_bodies, sensor_unknowns
from smsid.identify.estimate import Estimate, ParameterEstimate
from smsid.identify.momentum_rows import whole_bodies
from smsid.likelihood.parameters import body_size
from smsid.model.regressor import INERTIAL_NAMES, INERTIAL_UNITS, body_names, dynamic_parameters
from smsid.model.rigid_bodies import urdf_bodies

DEFAULT_INERTIAL = 0.01
DEFAULT_EFFECT = 0.10
"""Standard deviations where neither an estimate nor the description states any: relative to the body's own
mass, first moment and inertia, and to the value of an effect's parameter."""

BEYOND = 0.5
"""Of single inertial parameters where combinations of them are known: wide."""


@dataclass(frozen=True)
class Nominal:
    """The nominal parameters, what an estimate knows of them together, and where that is from.

    ``point`` has the estimate's values; ``combinations`` counts those of inertial parameters in ``joint``.
    ``sources`` counts the standard deviations: ``estimate``, ``description``, ``default``; ``notes`` say what
    of the estimate was not taken.
    """

    point: Point
    unknowns: tuple[Unknown, ...]
    joint: JointPrior
    combinations: int
    sources: dict[str, int]
    notes: tuple[str, ...] = ()

    @property
    def stated(self) -> str:
        """One sentence on where the standard deviations are from."""
        parts = [f"{n} from the {k}" for k, n in self.sources.items() if n and k != "default"]
        if self.combinations:
            parts.append(f"{self.combinations} combinations of them from the estimate")
        if self.sources["default"]:
            parts.append(
                f"{self.sources['default']} by default ({100 * DEFAULT_INERTIAL:g} % of a body's own size, "
                f"{100 * DEFAULT_EFFECT:g} % of an effect's parameter)"
            )
        return "standard deviations of the nominal parameters: " + ", ".join(parts)


def nominal(description: Description, estimate: Estimate | None, further: Sequence[str] = ()) -> Nominal:
    """Return the nominal parameters of a description with their priors.

    With an estimate, values are the estimate's: effects directly, bodies as the nearest physical ones that
    agree with the identified combinations. Standard deviations are the estimate's, else the description's
    priors, else the stated defaults; a single parameter that is known in combinations only has the wide
    default `BEYOND`. What the estimate knows has its covariance; without one its errors are taken as
    independent, which a note says. Errors of sensors are nuisances where the description states their
    standard deviation: of a first recording, and by their names each of the ``further`` ones has its own.

    Raises `SmsidError` for an estimate that belongs to another spacecraft.
    """
    notes: list[str] = []
    known: dict[str, ParameterEstimate] = {}
    told: set[str] = set()
    if estimate is not None:
        known = {p.name: p for p in estimate.parameters}
        description, notes, told = with_beams(description, estimate)
    point = Point.of(description)
    # what a URDF states in <dynamics> is listed, so that a friction found beside it adds to it
    point = replace(point, description=point.base.description)
    single, combinations = _inertial_knowledge(point, estimate)
    combined = {name for factors in combinations.values() for name in factors}
    if combinations:
        point = _moved_to(point, estimate, notes)
    found: list[Unknown] = []
    sources = {"estimate": 0, "description": 0, "default": 0}

    def add(name: str, kind: str, unit: str, value: float, scale: float, prior: float | None, **more) -> None:
        stated = known[name].sigma if name in known else np.nan
        if kind == "inertial" and name not in single:
            stated = np.nan
        if np.isfinite(stated) and stated > 0.0:
            source, sigma = "estimate", float(stated)
        elif prior is not None:
            source, sigma = "estimate" if name in told else "description", prior
        else:
            share = DEFAULT_EFFECT if kind == "effect" else BEYOND if name in combined else DEFAULT_INERTIAL
            source, sigma = "default", scale * share
        sources[source] += 1
        found.append(Unknown(name, kind, unit, value, sigma, min(scale, sigma), **more))  # type: ignore[arg-type]

    model = point.base
    names = body_names(model.pin)
    for j in moving_bodies(model):
        theta = dynamic_parameters(model.pin.inertias[j])
        size = body_size(theta)
        for i, (label, unit) in enumerate(zip(INERTIAL_NAMES, INERTIAL_UNITS, strict=True)):
            column = 10 * (j - 1) + i
            value = point.inertial_value(column)
            add(f"{names[j - 1]}.{label}", "inertial", unit, value, size[i], None, column=column)
    designed = [e for e in point.description.effect if e.nominal]
    told_by_mode = {p.name.rpartition(".")[0] for e in designed for p in e.parameters()}
    for effect in designed:
        mode = f"{getattr(effect, 'appendage', '')}.mode{getattr(effect, 'mode', '')}"
        if mode in told_by_mode:  # frequencies are the appendage's own
            continue
        for p in effect.unknowns():  # as in identification
            scale = _size(effect, p)
            if scale == 0.0:
                continue
            add(
                p.name,
                "effect",
                p.unit,
                p.value,
                scale,
                p.sigma,
                lower=p.lower,
                upper=p.upper,
                may_vanish=p.may_vanish,
            )
    for effect in point.description.effect:
        for p, sigma in () if effect.nominal else _known_within(effect, known):
            add(
                p.name,
                "effect",
                p.unit,
                p.value,
                abs(p.value) or sigma,
                sigma,
                lower=p.lower,
                upper=p.upper,
                may_vanish=p.may_vanish,
            )
    if estimate is not None and known and not (sources["estimate"] or combinations):
        raise SmsidError(
            "The estimate has no parameter of this description.",
            advice="Is it of another spacecraft?",
            estimate=sorted(known)[:10],
            description=[u.name for u in found][:10],
        )
    joint = _joint_prior(point, estimate, combinations, found, notes)
    own = {u.name.partition(".")[0] for u in found}
    biased = {c for e in point.description.effect if e.name in own for c in e.biased_channels()}
    unknowns = (*found, *sensor_errors(point, further, biased))
    return Nominal(point, unknowns, joint, len(combinations), sources, tuple(notes))


def _known_within(
    effect: Effect, known: Mapping[str, ParameterEstimate]
) -> Iterator[tuple[Parameter, float]]:
    """Yield an effect's parameters that are known to a standard deviation only, by an estimate or the
    description, with that; and of these, what nature has in size only: its shape may be another by itself.
    """
    told = set[str]()
    for p in effect.unknowns() if effect.polar_pair() is None else ():
        stated = float(known[p.name].sigma) if p.name in known else np.nan
        sigma = stated if 0.0 < stated < np.inf else p.sigma
        if sigma is not None:
            told.add(p.name)
            yield p, sigma
    shape = {f"{effect.name}.{field}" for field in effect.open_shape} - told if told else set()
    for p in effect.parameters():
        if p.name in shape and not {p.name.rpartition(".")[2], "all"} & {*effect.known}:
            yield p, abs(p.value)


def _size(effect: Effect, p: Parameter) -> float:
    """Return what a share of an effect's parameter is taken of; zero where it stays as it is."""
    own = p.name.rpartition(".")[2]
    if own == "frequency" and p.unit == "1":
        described = own not in effect.strength or p.value != 0.0 or p.sigma is not None
        return 1.0 + p.value if described else 0.0  # it is relative to the beam's
    if "damping" in p.name and (p.value == 0.0 or own in effect.strength):
        return 1e-3
    return abs(p.value)


def _inertial_knowledge(
    point: Point, estimate: Estimate | None
) -> tuple[set[str], dict[str, dict[str, float]]]:
    """Return the inertial parameters an estimate knows singly, and the factors of the combinations it knows
    by its own name for them.
    """
    if estimate is None:
        return set(), {}
    names = {f"{body}.{p}" for body in body_names(point.base.pin) for p in INERTIAL_NAMES}
    single, combined = set(), {}
    known = linear_terms(estimate, whole_bodies(point.base)[:10])
    for p in estimate.parameters:
        if not (np.isfinite(p.sigma) and p.sigma > 0.0):
            continue
        terms = known[p.name][0] if p.name in known else None
        own = {n: f for n, f in (terms or {}).items() if n in names}
        if not own:
            continue
        if terms == {p.name: 1.0} and p.group not in GROUPS:
            single.add(p.name)
        else:
            combined[p.name] = own
    return single, combined


def _joint_prior(
    point: Point,
    estimate: Estimate | None,
    combinations: Mapping[str, Mapping[str, float]],
    unknowns: Sequence[Unknown],
    notes: list[str],
) -> JointPrior:
    """Return what an estimate knows of combinations and single parameters together.

    Errors of an estimate go together: taken as independent, their sum would be known far too well, and what
    it is off by be taken for a cause. Factors are rounded in the combinations' names, which adds to them.
    """
    if estimate is None:
        return JointPrior()
    own = {p.name: i for i, p in enumerate(estimate.parameters)}
    single = {u.name: {u.name: 1.0} for u in unknowns if u.name in own and u.name not in combinations}
    single = {n: f for n, f in single.items() if _of_estimate(n, unknowns, estimate)}
    factors = {**combinations, **single}
    if not factors:
        return JointPrior()
    places = [own[n] for n in factors]
    sigma = estimate.sigmas[places]
    if estimate.covariance is None:
        notes.append("the estimate has no covariance: its parameters' errors are taken as independent")
        covariance = np.diag(sigma**2)
    else:
        covariance = estimate.covariance[np.ix_(places, places)].copy()
    values = {u.name: point.value(u) for u in unknowns}
    rounded = [
        ROUNDING * sum(abs(f * values.get(n, 0.0)) for n, f in some.items() if abs(f) != 1.0)
        for some in factors.values()
    ]
    covariance[np.diag_indices_from(covariance)] += np.square(rounded)
    return JointPrior(tuple(factors.values()), covariance)


def _of_estimate(name: str, unknowns: Sequence[Unknown], estimate: Estimate) -> bool:
    """Whether the prior of a parameter is the estimate's own standard deviation."""
    stated = estimate[name].sigma
    return bool(np.isfinite(stated)) and any(u.name == name and u.sigma == stated for u in unknowns)


def _moved_to(point: Point, estimate: Estimate | None, notes: list[str]) -> Point:
    """Return the point with the bodies an estimate's combinations stand for."""
    assert estimate is not None
    found = identified_bodies(point.base, estimate)
    notes += found.notes
    own = urdf_bodies(point.base.description)
    joints = {name: k for k, name in enumerate(list(point.base.pin.names)[1:])}
    inertial = {
        10 * joints[name] + i: float(shift)
        for name, theta in found.parameters.items()
        for i, shift in enumerate(theta - own[name])
        if shift != 0.0
    }
    return replace(point, inertial=inertial)


def sensor_errors(
    point: Point, further: Sequence[str] = (), biased: AbstractSet[str] = frozenset()
) -> list[Unknown]:
    """Return the errors of sensors that the description states, of every recording its own; channels that are
    ``biased`` have a bias by an effect.
    """
    sensors = point.description.sensor
    channels = {f"{s.name}.{q}" for s in sensors for q in s.quantities}
    found = sensor_unknowns(point.base, sensors, channels, "", set(biased), only_stated=True)
    own = [replace(u, name=u.name.removeprefix(": ")) for u in found]
    return [*own, *(replace(u, name=f"{label}: {u.name}") for label in further for u in own)]


def with_beams(description: Description, estimate: Estimate) -> tuple[Description, list[str], set[str]]:
    """Return `with_estimate` with beams as beams, its notes, and the names whose prior is the estimate's.

    Modal data would have the same frequencies and dampings as `Appendage.bent_as` has, but could no longer
    soften as a beam does. How well these are known goes with the beam and the errors of its modes.
    """
    found, notes = with_estimate(description, estimate)
    panels = (e.as_appendage() for e in description.effect)
    beams = {p.name: p for p in panels if p is not None and p.higher_mode(1) is not None}
    effects: list[Effect] = []
    known, told = set[str](), set[str]()  # of parameters, of beams

    def sigma(name: str) -> float:
        return float(estimate[name].sigma) if name in estimate else np.nan

    def relative(name: str) -> float:
        return sigma(name) / abs(estimate[name].value) if name in estimate else np.nan

    for effect in found.effect:
        identified, beam = effect.as_appendage(), beams.get(effect.name)
        if beam is not None and any(p.name.startswith(f"{beam.name}.") for p in estimate.parameters):
            told.add(beam.name)
        parts: Sequence[Effect] = (effect,)
        if beam is not None and identified is not None and effect.kind != beam.kind:
            parts = beam.bent_as(identified)
        for part in parts:
            own = part.estimated_sigmas(sigma, relative) if told & {part.name, part.part_of()} else {}
            prior = {k: float(v) for k, v in own.items() if np.isfinite(v) and v > 0.0}
            known |= {f"{part.name}.{key}" for key in prior if key not in part.prior}
            effects.append(part.model_copy(update={"prior": {**part.prior, **prior}}) if prior else part)
    return found.model_copy(update={"effect": tuple(effects)}), notes, known
