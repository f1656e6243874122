"""What is known of an arm's combinations before its torques are looked at."""

from __future__ import annotations

import logging

import numpy as np

from smsid.description import Description
from smsid.diagnose._extended_description import with_body_errors
from smsid.diagnose.torque._equations import TorqueEquations
from smsid.diagnose.torque._fit import TorqueFit, TorquePrior, effects_of
from smsid.errors import SmsidError
from smsid.estimation.bodies import identified_bodies
from smsid.identify.estimate import Estimate, classify
from smsid.model import build_model
from smsid.model.regressor import Regressor
from smsid.model.rigid_bodies import urdf_bodies


def described_values(equations: TorqueEquations) -> np.ndarray:
    """Return the combinations (b,) as the description has them."""
    effects = {p.name: p.value for e in equations.description.effect for p in e.parameters()}
    regressor = Regressor(equations.model)
    theta = np.concatenate([regressor.parameters, [effects.get(n, 0.0) for n in _beyond_links(equations)]])
    return equations.base.values(theta)


def prior_of(
    equations: TorqueEquations, estimate: Estimate | None
) -> tuple[TorquePrior, str, tuple[str, ...]]:
    """Return the prior, one sentence on where it is from, and notes.

    From the estimate, combination by combination; else the priors that the description states for its
    effects; all else is fitted freely: torques determine the links' combinations well, and no URDF of a real
    arm is known to a per cent.

    Raises:
        SmsidError: the estimate has no parameter of this description.
    """
    names = equations.base.names
    mean, sigma = described_values(equations), np.full(len(names), np.inf)
    stated = {p.name: p.sigma for e in equations.description.effect for p in e.parameters()}
    described = 0
    for i, name in enumerate(names):
        width = stated.get(name)
        if width is not None:
            sigma[i] = width
            described += 1
    taken, notes = 0, []
    if estimate is not None:
        values = {p.name: p for p in estimate.parameters}
        for i, name in enumerate(names):
            p = values.get(name)
            if p is not None and np.isfinite(p.value) and np.isfinite(p.sigma) and p.sigma > 0.0:
                mean[i], sigma[i] = p.value, p.sigma
                taken += 1
        if not taken:
            raise SmsidError(
                "The estimate has no parameter of this description.",
                advice="Is it of another arm, or made with other effects?",
                estimate=sorted(values)[:10],
                description=list(names)[:10],
            )
        if taken < len(names):
            notes.append(f"{len(names) - taken} of {len(names)} combinations are not in the estimate")
    free = int(np.sum(~np.isfinite(sigma)))
    parts = [f"{taken} from the estimate"] if taken else []
    parts += [f"{described} from the description"] if described else []
    parts += [f"{free} fitted freely, without any prior"] if free else []
    sentence = f"of {len(names)} combinations that torques tell apart: " + ", ".join(parts)
    if not taken:
        notes.append(
            "links are identified along with the causes, so that a payload, a wrong link or the gain of a "
            "torque signal cannot be told from them; an estimate made before makes them candidates"
        )
    named = dict(zip(names, zip(mean.tolist(), sigma.tolist(), strict=True), strict=True))
    return TorquePrior(mean, sigma, named), sentence, tuple(notes)


def links_known(equations: TorqueEquations, prior: TorquePrior) -> bool:
    """Whether something is known of the links beforehand."""
    count = Regressor(equations.model).columns
    return bool(np.any(prior.known[equations.base.independent < count]))


def _beyond_links(equations: TorqueEquations) -> tuple[str, ...]:
    from smsid.arm.identify import torque_rows
    from smsid.arm.motion import measured_states

    motion = equations.motion
    _, names, _ = torque_rows(equations.model, measured_states(motion).instants(slice(1)))
    return names[Regressor(equations.model).columns :]


LOGGER = logging.getLogger(__name__)


def extended_description(found: TorqueFit) -> tuple[Description, tuple[str, ...]]:
    """Return the description with the causes in it, and notes on what could not be written.

    Links that were identified along with the causes become ``body_error`` effects: the bodies that agree with
    the identified combinations, can exist, and are nearest to the described ones.
    """
    described = found.equations.description
    sensors = {s.name for s in described.sensor}
    effects, notes = [], []
    for effect in effects_of(found):
        sensor = getattr(effect, "sensor", None)
        if sensor is None or sensor in sensors:
            effects.append(effect)
        else:
            notes.append(f"'{effect.name}' is not written: the description has no sensor '{sensor}'")
    extended = described.with_effects(*effects)
    if links_known(found.equations, found.prior):
        return extended, tuple(notes)
    try:
        return _with_links(extended, found), tuple(notes)
    except (SmsidError, np.linalg.LinAlgError) as error:
        LOGGER.info("links as described: %s", error)
        return extended, (*notes, f"links stay as described: {error}")


def _with_links(extended: Description, found: TorqueFit) -> Description:
    sigma = np.sqrt(np.diag(found.covariance))
    base = found.equations.base
    parameters = tuple(
        classify(n, float(x), u, float(s), "arm")
        for n, u, x, s in zip(base.names, base.units, found.x, sigma, strict=False)
    )
    model = build_model(extended)
    bodies = identified_bodies(model, Estimate(extended.name, "torque diagnosis", parameters)).parameters
    shifts = {joint: bodies[joint] - own for joint, own in urdf_bodies(extended).items()}
    with_links = with_body_errors(extended, shifts)
    build_model(with_links)
    return with_links
