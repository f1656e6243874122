"""Compare two estimates of a spacecraft: what has changed, and what that means."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.stats import chi2, norm

from smsid._given import PathLike, given_estimate, given_spacecraft
from smsid.comparison._added_body import Propellant, added_body
from smsid.comparison._common_basis import Common, common_basis
from smsid.comparison._explanations import Differences, Explained, explain
from smsid.comparison.result import LEVEL, Comparison, Finding, FindingQuantity, ParameterChange
from smsid.description.schema import Description
from smsid.effects.base import AXES, Effect, catalogue
from smsid.identify.estimate import Estimate
from smsid.identify.momentum_rows import whole_bodies
from smsid.model import build_model
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel

UNEXPLAINED = 1e-3  # probability of what is left below which something else has changed as well


def compare(
    first: Estimate | PathLike,
    second: Estimate | PathLike,
    description: Description | PathLike | None = None,
    *,
    names: tuple[str, str] | None = None,
) -> Comparison:
    """Say what has changed from one estimate to the other.

    Parameters are matched by name; combinations that differ in name are brought to a common basis, or said
    not to be comparable. The estimates are taken as independent: of two that share recordings the
    differences are smaller than their covariances say.

    Args:
        first: before; it and the others may be paths of their files.
        second: after, of the same spacecraft with the same names of links and effects.
        description: what both were identified from, which knows links, tanks and kinds of effects; without,
            names alone are used.
        names: what the two are called in the result; their recordings if not given.

    Raises:
        DescriptionError: the description's model cannot be built.
        EstimateError: what is given is no estimate.
    """
    first, second = given_estimate(first), given_estimate(second)
    description = None if description is None else given_spacecraft(description)
    model = None if description is None else build_model(description)
    common = common_basis(first, second, _sizes(model))
    called = names or (", ".join(first.recordings) or "first", ", ".join(second.recordings) or "second")
    parameters = _changes(common)
    statistic, freedom, p_value = None, 0, None
    notes = list(_notes(first, second, common, called))
    findings: list[Finding] = []
    left = None
    if common.joint and len(common.names):
        data = Differences(common)
        statistic, freedom = data.statistic, data.freedom
        p_value = float(chi2.sf(statistic, freedom))
    changed = any(p.changed for p in parameters)
    if changed and p_value is None:
        notes.append("what the changes mean is not evaluated: that takes the covariance of both estimates")
    elif changed or (p_value is not None and p_value < LEVEL):
        parts, left = explain(common)
        tanks = _tanks(model)
        for part in parts:
            if part.hypothesis.kind == "body":
                findings.append(added_body(part, tanks))
            else:
                findings.append(_effect_change(part, common, description))
        if left < UNEXPLAINED or not findings:
            findings.append(_unexplained_finding(parameters, left))
    overall = statistic, freedom, p_value, tuple(findings), left, tuple(notes)
    return Comparison(*called, parameters, common.not_comparable, *overall)


def _changes(common: Common) -> tuple[ParameterChange, ...]:
    variance = np.diag(common.covariances[0]) + np.diag(common.covariances[1])
    found = []
    for k, (name, unit) in enumerate(zip(common.names, common.units, strict=True)):
        sigma = float(np.sqrt(variance[k]))
        deviations = abs(common.after[k] - common.before[k]) / sigma
        p_value = 2.0 * float(norm.sf(deviations))
        values = float(common.before[k]), float(common.after[k]), sigma, p_value
        sure = p_value * len(common.names) < LEVEL
        found.append(ParameterChange(name, unit, *values, sure, bool(common.derived[k])))
    return tuple(found)


def _effect_change(part: Explained, common: Common, description: Description | None) -> Finding:
    """Return the change of an effect's parameters, those first that changed most."""
    h = part.hypothesis
    sigma = np.sqrt(np.diag(part.covariance))
    deviations = np.abs(part.values) / np.where(sigma > 0.0, sigma, np.inf)
    order = np.argsort(-deviations)
    quantities = []
    units = dict(zip(common.names, common.units, strict=True))
    for i in order.tolist():
        numbers = float(part.values[i]), float(sigma[i]), bool(part.told[i])
        quantities.append(FindingQuantity(h.names[i], units.get(h.names[i], ""), *numbers))
    limit = float(norm.isf(0.5 * LEVEL / len(order)))
    sure = [i for i in order.tolist() if deviations[i] > limit] or order[:1].tolist()
    effects = () if description is None else description.effect
    effect = next((e for e in effects if e.name == h.subject), None)
    told = []
    for i in sure:
        name, change = h.names[i], float(part.values[i])
        words = _words(effect, name.removeprefix(f"{h.subject}."), change > 0.0)
        row = common.names.index(name) if name in common.names else None
        course = "" if row is None else f"{common.before[row]:.4g} -> {common.after[row]:.4g} "
        text = f"{name} {course}{units.get(name, '')} ({change:+.3g} ± {1.96 * sigma[i]:.2g})"
        told.append(f"{words}: {text}" if words and not any(x.startswith(words) for x in told) else text)
    joints = ", ".join(effect.driven_joints()) if effect is not None else ""
    subject = f"'{h.subject}'" + (f" ({joints})" if joints else "")
    sentence = f"{subject} has changed; {'; '.join(told)}."
    return Finding("effect_changed", h.subject, sentence, tuple(quantities), part.p_value)


def _words(effect: Effect | None, key: str, up: bool) -> str:
    """Return what a change of a parameter means; nothing where that is not said, or depends on the kind."""
    field = key.rpartition(".")[0] if key.rpartition(".")[2] in (*AXES[3], *AXES[6]) else key
    field = field.rpartition(".")[2]
    kinds = [type(effect)] if effect is not None else list(catalogue().values())
    said = {kind.changes[field][0 if up else 1] for kind in kinds if field in kind.changes}
    return said.pop() if len(said) == 1 else ""


def _unexplained_finding(parameters: tuple[ParameterChange, ...], left: float) -> Finding:
    worst = sorted(parameters, key=lambda p: p.p_value)[:3]
    named = ", ".join(f"{p.name} ({p.deviations:+.1f} sigma)" for p in worst)
    return Finding(
        "unexplained",
        "",
        f"Changes of links and effects do not explain all differences (p = {left:.1g} for what is left). "
        f"Largest: {named}. Did one of the fits explain its recordings?",
        p_value=left,
    )


def _sizes(model: SpacecraftModel | None) -> dict[str, float]:
    if model is None:
        return {}
    return dict(zip(Regressor(model).names, np.abs(whole_bodies(model)).tolist(), strict=True))


def _tanks(model: SpacecraftModel | None) -> tuple[Propellant, ...]:
    """Return where propellant is, by the bodies that carry it."""
    if model is None:
        return ()
    bodies = Regressor(model).bodies
    found = []
    for effect in model.description.effect:
        place = effect.propellant_at()
        if place is None:
            continue
        frame, at = place
        joint = 1
        if frame is not None:
            own = model.pin.frames[model.pin.getFrameId(frame)]
            joint, at = own.parentJoint, own.placement.act(at)
        if joint > 0:
            found.append(Propellant(effect.name, bodies[joint - 1], np.asarray(at)))
    return tuple(found)


def _notes(first: Estimate, second: Estimate, common: Common, called: tuple[str, str]) -> Iterator[str]:
    for estimate, name in zip((first, second), called, strict=True):
        if estimate.covariance is None:
            yield (
                f"'{name}' has no covariance: parameters are compared one by one, nothing is said of all of "
                "them together; identify by maximum likelihood"
            )
    if first.description != second.description:
        yield f"the estimates are of '{first.description}' and of '{second.description}': is that one craft?"
    shared = sorted(set(first.recordings) & set(second.recordings) - {""})
    if shared:
        yield (
            f"both estimates are from recordings called {', '.join(shared)}: if these are the same, they are "
            "not independent, and differences look smaller than they are"
        )
    if not len(common.names):
        yield "the estimates have no parameter in common"
