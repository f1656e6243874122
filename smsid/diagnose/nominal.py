"""What is uncertain before any cause is looked for: the nominal parameters, with what is known of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from smsid.diagnose.point import Point, Unknown
from smsid.effects.appendage import Appendage
from smsid.effects.slosh import Slosh
from smsid.errors import SmsidError
from smsid.identify.estimate import Estimate
from smsid.likelihood.parameters import body_size
from smsid.model.regressor import INERTIAL_NAMES, INERTIAL_UNITS, body_names, dynamic_parameters

DEFAULT_INERTIAL = 0.01
DEFAULT_EFFECT = 0.10
"""Standard deviations where neither an estimate nor the description states any: relative to the body's own
mass, first moment and inertia, and to the value of an effect's parameter."""


@dataclass(frozen=True)
class Nominal:
    """The nominal parameters and where their standard deviations are from.

    ``sources`` counts them: ``estimate``, ``description``, ``default``.
    """

    unknowns: tuple[Unknown, ...]
    sources: dict[str, int]

    @property
    def stated(self) -> str:
        """One sentence on where the standard deviations are from."""
        parts = [f"{n} from the {k}" for k, n in self.sources.items() if n and k != "default"]
        if self.sources["default"]:
            parts.append(
                f"{self.sources['default']} by default ({100 * DEFAULT_INERTIAL:g} % of a body's own size, "
                f"{100 * DEFAULT_EFFECT:g} % of an effect's parameter)"
            )
        return "standard deviations of the nominal parameters: " + ", ".join(parts)


def nominal(point: Point, estimate: Estimate | None) -> Nominal:
    """Return the nominal parameters of a point's description with their priors.

    Values are the description's (apply an estimate to it first); standard deviations the estimate's, else the
    description's priors, else the stated defaults. Sensor biases are nuisances where the description states
    their standard deviation.

    Raises `SmsidError` for an estimate that belongs to another spacecraft.
    """
    known = {p.name: p for p in estimate.parameters} if estimate is not None else {}
    found: list[Unknown] = []
    sources = {"estimate": 0, "description": 0, "default": 0}

    def add(name: str, kind: str, unit: str, value: float, scale: float, prior: float | None, **more) -> None:
        stated = known[name].sigma if name in known else np.nan
        if np.isfinite(stated) and stated > 0.0:
            source, sigma = "estimate", float(stated)
        elif prior is not None:
            source, sigma = "description", prior
        else:
            source, sigma = "default", scale * (DEFAULT_INERTIAL if kind == "inertial" else DEFAULT_EFFECT)
        sources[source] += 1
        # an estimate that knows less than the default says nothing the default does not
        found.append(Unknown(name, kind, unit, value, sigma, min(scale, sigma), **more))  # type: ignore[arg-type]

    model = point.base
    names = body_names(model.pin)
    special = {int(j) for g in (model.wheels, model.modes) for j in g.joints}
    special |= {s.joint for s in model.slosh}
    for j in range(1, model.pin.njoints):
        if j in special:
            continue
        theta = dynamic_parameters(model.pin.inertias[j])
        size = body_size(theta)
        for i, (label, unit) in enumerate(zip(INERTIAL_NAMES, INERTIAL_UNITS, strict=True)):
            add(f"{names[j - 1]}.{label}", "inertial", unit, theta[i], size[i], None, column=10 * (j - 1) + i)
    for effect in point.description.effect:
        if not isinstance(effect, Slosh | Appendage):
            continue
        for p in effect.parameters():
            if p.value == 0.0 and "damping" not in p.name:
                continue
            scale = abs(p.value) if p.value != 0.0 else 1e-3
            add(p.name, "effect", p.unit, p.value, scale, p.sigma, lower=p.lower, upper=p.upper)
    if estimate is not None and known and not sources["estimate"]:
        raise SmsidError(
            "The estimate has no parameter of this description.",
            advice="Is it of another spacecraft?",
            estimate=sorted(known)[:10],
            description=[u.name for u in found][:10],
        )
    return Nominal((*found, *_biases(point)), sources)


def _biases(point: Point) -> list[Unknown]:
    found = []
    for sensor in point.description.sensor:
        for quantity in ("acceleration", "angular_rate"):
            if quantity not in sensor.quantities or sensor.kind != "imu":
                continue
            errors = sensor.error(quantity)
            sigma = np.hypot(
                np.asarray(errors.bias_sigma, dtype=float), np.asarray(errors.gauss_markov_sigma, dtype=float)
            )
            unit = "m/s^2" if quantity == "acceleration" else "rad/s"
            for i, (axis, s) in enumerate(zip("xyz", np.broadcast_to(sigma, 3), strict=True)):
                if s > 0.0:
                    name = f"{sensor.name}.{quantity}.bias.{axis}"
                    found.append(Unknown(name, "bias", unit, 0.0, float(s), float(s), column=i))
    return found
