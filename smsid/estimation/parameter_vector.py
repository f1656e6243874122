"""Where a search stands: a description, shifts of bodies' inertial parameters, and biases of sensors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
import pinocchio as pin

from smsid.description.schema import Description
from smsid.effects.base import Effect
from smsid.effects.inertial_parameters import pinocchio_inertia
from smsid.errors import DescriptionError
from smsid.estimation.measurements import component_labels
from smsid.identify.momentum_rows import whole_bodies
from smsid.model import build_model, rebuild
from smsid.model.regressor import dynamic_parameters
from smsid.model.spacecraft import SpacecraftModel
from smsid.parameter import Parameter
from smsid.sensing import Sensor
from smsid.sensing.component import ComponentError

Kind = Literal["inertial", "effect", "bias", "sensor", "start", "trend"]
DEGENERATE = 1e-10  # eigenvalue of a correlation below which it is rounding


@dataclass(frozen=True)
class Polar:
    """An amplitude and its angle by name, and the angle of the reference [rad].

    The unknown that is called like the amplitude is its part along the reference, that called like the angle
    the part across.
    """

    amplitude: str
    angle: str
    reference: float

    def parts(self, amplitude: float, angle: float) -> dict[str, float]:
        """Return both components by name."""
        turned = angle - self.reference
        return {self.amplitude: amplitude * np.cos(turned), self.angle: amplitude * np.sin(turned)}

    def polar(self, parts: Mapping[str, float], angle: float) -> dict[str, float]:
        """Return amplitude and angle by name; of no amplitude, the ``angle`` given."""
        along, across = parts[self.amplitude], parts[self.angle]
        size = float(np.hypot(along, across))
        turned = self.reference + float(np.arctan2(across, along)) if size > 0.0 else angle
        return {self.amplitude: size, self.angle: turned}


@dataclass(frozen=True)
class Unknown:
    """A parameter of the search.

    ``name`` is ``<body>.<m|mx|...|Izz>``, ``<effect>.<parameter>``, ``<channel>.bias.<axis>`` (or ``scale``,
    ``misalignment``, which are of the kind ``sensor``), ``start.<state>``, how a motion begins, or that of
    another with ``.trend``: by how much it changes in a second, where a filter follows that. ``column`` is
    where an inertial one stands among those of the model, the component of a sensor's error, or the place in
    the state. ``sigma`` is the prior's standard deviation (infinite: none), ``nominal`` its mean; ``scale`` a
    typical size of a change. ``polar``
    makes it a component of an amplitude: along a reference, or across it (`Polar`). One that
    ``may_vanish`` can go to zero in one step.
    """

    name: str
    kind: Kind
    unit: str
    nominal: float
    sigma: float
    scale: float
    column: int = -1
    lower: float = -np.inf
    upper: float = np.inf
    polar: Polar | None = None
    may_vanish: bool = False

    @classmethod
    def of_parameter(cls, p: Parameter, sigma: float, scale: float) -> Unknown:
        """Return a parameter of an effect as an unknown, with its bounds."""
        bounds = p.lower, p.upper
        return cls(p.name, "effect", p.unit, p.value, sigma, scale, -1, *bounds, may_vanish=p.may_vanish)

    @property
    def of_recording(self) -> bool:
        """Whether every recording has its own: errors of sensors, and how the motion begins."""
        return self.kind in ("bias", "sensor", "start")

    @property
    def positive(self) -> bool:
        """Whether it is a mass or a spring, without which the effect is none; friction may vanish."""
        return self.kind == "effect" and 0.0 <= self.lower < self.nominal and not self.may_vanish

    def unbound(self) -> Unknown:
        """Return the parameter without its prior."""
        return replace(self, sigma=np.inf)


@dataclass(frozen=True)
class JointPrior:
    """What is known of sums of parameters together: the factors of each by name, and their covariance (n, n).

    A parameter that is such a sum by itself has its prior here and not in its own ``sigma``.
    """

    factors: tuple[Mapping[str, float], ...] = ()
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    @classmethod
    def independent(cls, factors: Sequence[Mapping[str, float]], sigmas: Sequence[float]) -> JointPrior:
        """Return the prior of sums whose errors do not go together."""
        return cls(tuple(factors), np.diag(np.square(np.asarray(sigmas, dtype=float))))

    def single(self, unknown: Unknown) -> bool:
        """Whether a parameter is one of the sums."""
        return any(f == {unknown.name: 1.0} for f in self.factors)

    def rows(self, unknowns: Sequence[Unknown]) -> np.ndarray:
        """Return whitened rows (m, unknowns): times a change of the unknowns, of unit variance each.

        A sum with a parameter that has no prior, or with none of the unknowns, is left out, and nothing is
        said of it: the others keep their marginal covariance.
        """
        place = {u.name: i for i, u in enumerate(unknowns)}
        free = {u.name for u in unknowns if not np.isfinite(u.sigma)}
        kept = [
            i
            for i, f in enumerate(self.factors)
            if not free.intersection(f) and not place.keys().isdisjoint(f)
        ]
        rows = np.zeros((len(kept), len(unknowns)))
        for row, i in zip(rows, kept, strict=True):
            for name, factor in self.factors[i].items():
                if name in place:
                    row[place[name]] = factor
        if not kept:
            return rows
        own = self.covariance[np.ix_(kept, kept)]
        sigma = np.sqrt(np.diag(own))
        size, basis = np.linalg.eigh(own / np.outer(sigma, sigma))
        return (basis / np.sqrt(np.maximum(size, DEGENERATE))).T @ (rows / sigma[:, None])


@dataclass(frozen=True)
class Point:
    """One point: the description with its effects, shifts of inertial parameters by column, sensor biases.

    A body's parameters are called as an estimate calls them: ``whole`` (10 bodies,) is what the ``base`` has,
    the bus with its wheels and undeformed appendages. ``biases``, and other errors of sensors, by unknown's
    name: channel, term and component are read from the name. ``within`` names, by effect, the only one of
    several recordings that it acts in.
    """

    base: SpacecraftModel
    description: Description
    whole: np.ndarray
    inertial: Mapping[int, float] = field(default_factory=dict)
    biases: Mapping[str, float] = field(default_factory=dict)
    within: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, description: Description) -> Point:
        """Return the description as it is."""
        base = build_model(description)
        return cls(base, description, whole_bodies(base))

    def value(self, unknown: Unknown) -> float:
        """Return the value of a parameter here."""
        if unknown.kind == "inertial":
            return self.inertial_value(unknown.column)
        if unknown.of_recording:
            return self.biases.get(unknown.name, 0.0)
        effect = self._owner(unknown.name)
        values = {p.name: p.value for p in effect.parameters()}
        if unknown.polar is not None:
            parts = unknown.polar.parts(values[unknown.polar.amplitude], values[unknown.polar.angle])
            return float(parts[unknown.name])
        return values[unknown.name]

    def bounds(self, unknown: Unknown) -> tuple[float, float]:
        """Return between what values a step may take a parameter."""
        value, low, high = self.value(unknown), unknown.lower, unknown.upper
        if unknown.positive and value > 0.0:  # it stays what it is, and may go back to what it was
            low = max(low, min(0.5 * value, unknown.nominal))
            high = min(high, max(2.0 * value, unknown.nominal))
        return low, high

    def moved(self, unknowns: Sequence[Unknown], step: np.ndarray) -> Point:
        """Return the point a step (unknowns,) away, each value kept within its bounds."""
        inertial, biases = dict(self.inertial), dict(self.biases)
        values: dict[str, dict[str, float]] = {}
        for unknown, d in zip(unknowns, step, strict=True):
            new = float(np.clip(self.value(unknown) + d, *self.bounds(unknown)))
            if unknown.kind == "inertial":
                inertial[unknown.column] = new - float(self.whole[unknown.column])
            elif unknown.of_recording:
                biases[unknown.name] = new
            else:
                values.setdefault(unknown.name.partition(".")[0], {})[unknown.name] = new
        for polar in {u.polar: None for u in unknowns if u.polar is not None}:
            own = values[polar.amplitude.partition(".")[0]]
            before = {p.name: p.value for p in self._owner(polar.amplitude).parameters()}
            parts = polar.parts(before[polar.amplitude], before[polar.angle])
            parts |= {n: own[n] for n in parts if n in own}
            own |= polar.polar(parts, before[polar.angle])
        description = self.description
        if values:
            changed = [description.get_effect(name).with_values(v) for name, v in values.items()]
            description = description.with_effects(*changed)
        return replace(self, description=description, inertial=inertial, biases=biases)

    def _owner(self, name: str) -> Effect:
        return self.description.get_effect(name.partition(".")[0])

    def inertial_value(self, column: int) -> float:
        """Return an inertial parameter here, by its place among those of all bodies."""
        return float(self.whole[column]) + self.inertial.get(column, 0.0)

    def for_recording(self, label: str) -> Point:
        """Return the point with the biases of one recording, ``<label>: <channel>.bias.<axis>`` by name."""
        start = f"{label}: "
        own = {n.removeprefix(start): x for n, x in self.biases.items() if n.startswith(start)}
        return replace(self, biases=own)

    def seen_in(self, label: str) -> Point:
        """Return the point with the effects that act in a recording alone."""
        kept = tuple(e for e in self.description.effect if self.within.get(e.name, label) == label)
        return replace(self, description=self.description.model_copy(update={"effect": kept}), within={})

    def with_effect(self, effect: Effect, recording: str = "") -> Point:
        """Return the point with an effect more, perhaps in one recording alone, or with another instance of
        one it has, which acts where it did.
        """
        within = dict(self.within)
        if effect.name not in {e.name for e in self.description.effect}:
            within.pop(effect.name, None)
            within |= {effect.name: recording} if recording else {}
        return replace(self, description=self.description.with_effects(effect), within=within)

    def model(self) -> SpacecraftModel:
        """Return the model here. Raises `DescriptionError` where no such spacecraft can be."""
        model = rebuild(self.base, self.description)
        for j in sorted({c // 10 + 1 for c in self.inertial}):
            theta = dynamic_parameters(model.pin.inertias[j]).copy()
            for c, shift in self.inertial.items():
                if c // 10 + 1 == j:
                    theta[c % 10] += shift
            model.pin.inertias[j] = pinocchio_inertia(theta)
        return model

    def physical(self) -> bool:
        """Whether such a spacecraft can be: masses are positive, and so is the whole mass matrix at home.

        How inertia is shared out between bodies is known in combinations only; that a single body could exist
        is not asked, as the motion does not tell.
        """
        try:
            model = self.model()
        except DescriptionError:  # a panel takes more from its body than that has
            return False
        if any(model.pin.inertias[c // 10 + 1].mass <= 0.0 for c in self.inertial):
            return False
        mass = pin.crba(model.pin, model.pin.createData(), model.home)
        mass = np.triu(mass) + np.triu(mass, 1).T
        return bool(np.linalg.eigvalsh(mass)[0] > 0.0)

    def sensors(self) -> tuple[Sensor, ...]:
        """Return the sensors as effects and biases leave them."""
        sensors = {s.name: s for s in self.description.effective_sensors()}
        for name, value in self.biases.items():
            if ": " in name or name.startswith("start."):  # of another recording, or none of a sensor's
                continue
            source, quantity, term, component = name.split(".", 3)
            labels = component_labels(self.base, sensors[source], quantity)
            place = labels.index(component), len(labels)
            sensors[source] = _with_error(sensors[source], quantity, TERMS[term], place, value)
        return tuple(sensors.values())


TERMS = {"bias": "bias", "scale": "scale_error", "misalignment": "misalignment"}
"""Errors of sensors as they are called in the names of unknowns, and in an error model."""


def _with_error(sensor: Sensor, quantity: str, term: str, place: tuple[int, int], value: float) -> Sensor:
    """Return a sensor with ``value`` more in a term of one component: its number in the channel, and of how
    many; of accelerometers, every station has its own.
    """
    errors, (index, count) = sensor.error(quantity), place
    update: dict[str, object]
    if sensor.kind == "accelerometers":
        key = f"{index // 3},{index % 3}"
        own = errors.components.get(key, ComponentError())
        own = own.model_copy(update={term: getattr(own, term) + value})
        update = {"components": {**errors.components, key: own}}
    else:
        whole = np.zeros(count) + np.asarray(getattr(errors, term), dtype=float)
        whole[index] += value
        update = {term: tuple(whole.tolist())}
    changed = errors.model_copy(update=update)
    return sensor.model_copy(update={"errors": {**sensor.errors, quantity: changed}})
