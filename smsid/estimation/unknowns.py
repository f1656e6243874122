"""Which parameters of a description are unknown, and what is known of them beforehand."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from smsid.effects.base import Effect
from smsid.effects.sensor import UNITS
from smsid.errors import DescriptionError
from smsid.estimation.measurements import COMPONENTS, component_labels
from smsid.estimation.parameter_vector import Kind, Point, Polar, Unknown
from smsid.likelihood.parameters import body_size
from smsid.likelihood.prior import CAD, EFFECT, Cad
from smsid.model.regressor import INERTIAL_NAMES, INERTIAL_UNITS, body_names, dynamic_parameters
from smsid.model.spacecraft import SpacecraftModel
from smsid.parameter import Parameter
from smsid.sensing import Sensor

DEFAULT_STEP = 1e-3  # size of a change of a parameter that is zero and has no prior, in its own unit
BIAS_SIGMA = {"acceleration": 0.05, "angular_rate": 0.01}
"""Standard deviations of sensor biases that no description states [m/s^2, rad/s]: wide."""
MOST = (
    1e6  # standard deviation of what has no prior at all, in its steps: finite, so that nothing is singular
)


@dataclass(frozen=True)
class Unknowns:
    """The parameters to be estimated, and why others are not: reasons by name."""

    unknowns: tuple[Unknown, ...]
    held: Mapping[str, str]

    def notes(self) -> list[str]:
        """Return a sentence for each effect and reason for which parameters are not estimated."""
        together: dict[tuple[str, str], list[str]] = {}
        for name, why in self.held.items():
            effect, _, field = name.partition(".")
            together.setdefault((effect, why), []).append(field)
        return [
            f"'{effect}.{fields[0]}' is not estimated: {why}"
            if not fields[1:]
            else f"of '{effect}' {', '.join(fields)} are not estimated: {why}"
            for (effect, why), fields in together.items()
        ]


def unknowns_of(
    point: Point, *, cad: Cad | None = None, bodies: bool = True, components: bool = False
) -> Unknowns:
    """Return every parameter of bodies and listed effects, but for those marked as known.

    Inertial parameters have the prior ``cad`` (as in `smsid.likelihood.Prior`: of bodies as the URDF has
    them, wheels included, what effects add to them not; wide when not given) around the description,
    effects' that of the description, or ten times their value. Without ``bodies`` the rigid bodies are taken
    as known. With ``components``, an amplitude and its angle are two components (`Unknown.polar`). Raises
    `DescriptionError` for a prior of a parameter that there is not.
    """
    found = list(_inertial(point, cad)) if bodies else []
    held: dict[str, str] = {}
    for effect in point.description.effect:
        held |= effect.held()
        part = _part_of_a_body(effect, point.base) if bodies else {}
        held |= part
        own = [effect_unknown(p) for p in effect.unknowns() if p.name not in part]
        pair = effect.polar_pair() if components else None
        found += own if pair is None else _components(own, *pair, effect.prior)
    return Unknowns(tuple(found), held)


def sensor_unknowns(
    model: SpacecraftModel,
    sensors: tuple[Sensor, ...],
    present: set[str],
    label: str,
    taken: set[str],
    *,
    only_stated: bool = False,
) -> list[Unknown]:
    """Return the errors that sensors have in one recording: biases, scales and misalignments.

    Those that are stated, with the standard deviations that are stated, and, unless ``only_stated``, biases
    of gyros and accelerometers in any case. They are named ``<label>: <channel>.bias.<axis>``, ``scale`` and
    ``misalignment`` likewise, joints and wheels by name. ``present`` are the recording's channels; channels
    in ``taken`` have a bias by an effect that is listed.
    """
    found = []
    for sensor in sensors:
        for quantity in sensor.quantities:
            channel = f"{sensor.name}.{quantity}"
            if channel not in present:
                continue
            errors, labels = sensor.error(quantity), component_labels(model, sensor, quantity)
            wide = BIAS_SIGMA.get(quantity, 0.0) if sensor.kind == "imu" and not only_stated else 0.0
            bias = np.hypot(np.asarray(errors.bias_sigma, dtype=float), errors.gauss_markov_sigma)
            bias = np.where(bias > 0.0, bias, wide)
            walk = np.asarray(errors.random_walk, dtype=float) * (bias == 0.0)
            stated: list[tuple[str, Kind, str, np.ndarray]] = []
            if channel not in taken:  # a walk is followed about a value that it hardly begins off
                stated.append(("bias", "bias", UNITS[quantity], np.hypot(bias, walk)))
            stated.append(("scale", "sensor", "1", np.asarray(errors.scale_sigma, dtype=float)))
            if quantity in COMPONENTS:
                turned = np.asarray(errors.misalignment_sigma, dtype=float)
                stated.append(("misalignment", "sensor", "rad", turned))
            for term, kind, unit, sigma in stated:
                whole = np.resize(sigma, len(labels)) if sigma.ndim else np.full(len(labels), float(sigma))
                for i in np.flatnonzero(whole):
                    name, s = f"{label}: {channel}.{term}.{labels[i]}", float(whole[i])
                    scale = min(s, 1e-3 * BIAS_SIGMA.get(quantity, 1e3 * s)) if kind == "bias" else s
                    found.append(Unknown(name, kind, unit, 0.0, s, scale, column=int(i)))
    return found


def _inertial(point: Point, cad: Cad | None) -> list[Unknown]:
    model = point.base
    names = body_names(model.pin)
    own = moving_bodies(model)
    relative = CAD if cad is None or isinstance(cad, Mapping) else float(cad)
    stated = dict(cad) if isinstance(cad, Mapping) else {}
    found = []
    for j in own:
        theta, own_theta = point.whole[10 * (j - 1) : 10 * j], urdf_body(model, j)
        size = body_size(own_theta)
        for i, (label, unit) in enumerate(zip(INERTIAL_NAMES, INERTIAL_UNITS, strict=True)):
            column, name = 10 * (j - 1) + i, f"{names[j - 1]}.{label}"
            value = point.inertial_value(column)
            nominal, sigma = value, relative * float(size[i])
            if name in stated:
                mean, sigma = stated.pop(name)
                nominal = mean + float(theta[i] - own_theta[i])  # what effects add to the body stays with it
            found.append(
                Unknown(name, "inertial", unit, nominal, sigma, min(float(size[i]), sigma), column=column)
            )
    if stated:
        raise DescriptionError(
            f"'{next(iter(stated))}' is no parameter of a body.",
            advice=f"Bodies: {', '.join(names[j - 1] for j in own)}.",
        )
    return found


def urdf_body(model: SpacecraftModel, joint: int) -> np.ndarray:
    """Return the inertial parameters (10,) of a joint's body as the URDF has it, wheels but no effects.

    Of a body without mass of its own, that of all it carries.
    """
    source = model.source.pin if model.source is not None else model.pin
    own = source.inertias[joint] if joint < source.njoints else model.pin.inertias[joint]
    return dynamic_parameters(own if own.mass > 0.0 else model.pin.inertias[joint])


def moving_bodies(model: SpacecraftModel) -> tuple[int, ...]:
    """Return the joints whose bodies are unknown: all with mass but wheels and what effects have added."""
    special = {int(j) for g in (model.wheels, model.modes, model.further_modes) for j in g.joints}
    special |= {s.joint for s in model.slosh}
    special |= {
        model.pin.getJointId(e.name) for e in model.description.effect if model.pin.existJointName(e.name)
    }
    own = [j for j in range(1, model.pin.njoints) if j not in special]
    return tuple(j for j in own if model.pin.inertias[j].mass > 0.0)


def _part_of_a_body(effect: Effect, model: SpacecraftModel) -> dict[str, str]:
    """Return the parameters that only say again what a body's own do, and why they are not estimated."""
    if effect.shifted_body is None:
        return {}
    name = getattr(effect, effect.shifted_body)
    if name is None:
        joint = 1
    elif model.pin.existJointName(name):
        joint = model.pin.getJointId(name)
    else:
        joint = model.pin.frames[model.pin.getFrameId(name)].parentJoint
    if joint not in moving_bodies(model):
        return {}
    body = body_names(model.pin)[joint - 1]
    why = f"part of '{body}', whose inertia is estimated; give it a prior to tell them apart"
    return {p.name: why for p in effect.unknowns() if p.sigma is None}


def _components(own: list[Unknown], amplitude: str, angle: str, prior: Mapping[str, float]) -> list[Unknown]:
    """Return an effect's unknowns, amplitude and angle as components along the described angle and across.

    What is known of the angle is known of the part across, at the described amplitude.
    """
    by_name = {u.name: u for u in own}
    size, turn = by_name[amplitude], by_name[angle]
    polar = Polar(amplitude, angle, turn.nominal)
    known = size.nominal * turn.sigma if angle.partition(".")[2] in prior else 0.0
    across = known if known > 0.0 else size.sigma
    parts = {
        amplitude: replace(size, lower=-np.inf, upper=np.inf, polar=polar),
        angle: replace(
            size,
            name=angle,
            nominal=0.0,
            sigma=across,
            scale=min(size.scale, across),
            lower=-np.inf,
            upper=np.inf,
            polar=polar,
        ),
    }
    return [parts.get(u.name, u) for u in own]


def effect_unknown(p: Parameter) -> Unknown:
    """Return a parameter of an effect as an unknown, with its prior or a wide one."""
    size = abs(p.value)
    if p.sigma is not None:
        sigma, scale = p.sigma, min(p.sigma, size) if size else p.sigma
    elif size:
        sigma, scale = EFFECT * size, size
    else:
        sigma, scale = MOST * DEFAULT_STEP, DEFAULT_STEP
    return Unknown.of_parameter(p, sigma, scale)
