"""The one interface of every effect: anything a spacecraft may have beyond rigid links."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, TypeVar

import numpy as np
from pydantic import Field, ValidationError, model_validator

from smsid.effects.joint_state import JointStateOf, TorqueColumns
from smsid.effects.table import Table
from smsid.errors import DescriptionError
from smsid.parameter import Parameter

if TYPE_CHECKING:
    from smsid.description.schema import Description
    from smsid.effects.assembly import Assembly
    from smsid.inputs.inputs import Inputs
    from smsid.model.spacecraft import SpacecraftModel
    from smsid.sensing.sensor import Sensor

Vector3 = Annotated[tuple[float, ...], Field(min_length=3, max_length=3)]
Vector6 = Annotated[tuple[float, ...], Field(min_length=6, max_length=6)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")]

AXES = {3: ("x", "y", "z"), 6: ("xx", "xy", "yy", "xz", "yz", "zz")}
"""Names of the elements of a parameter, by how many it has."""


def physical(unit: str, *, lower: float = -math.inf, upper: float = math.inf, **kwargs: Any) -> Any:
    """Declare a field of an `Effect` as a physical parameter with unit and bounds.

    It is a scalar, a 3-vector, or the 6 elements of a symmetric matrix (xx, xy, yy, xz, yz, zz); ``None`` as
    value takes it out of the parameters.
    """
    return Field(json_schema_extra={"unit": unit, "lower": lower, "upper": upper}, **kwargs)


class Effect(Table):
    """An effect with its physical parameters.

    Subclasses declare their parameters as fields made with `physical`, and override what they do:

    - `attach` adds joints, inertia, springs or nonlinear forces to the model (see `Assembly`),
    - `drive` changes what the plant gets of what is commanded,
    - `adjust` changes a sensor: where it sits, and its errors.

    ``family`` groups effects that are alike, ``aliases`` are kinds that some experiments cannot tell from
    this one, ``strength`` names the fields that are zero when the effect is not there: with these at zero it
    changes nothing at all. ``point_mass`` are the fields of a mass (or what it grows by) and of its place,
    for an effect that is no more than that. ``polar`` names fields of amplitudes and the field of the angle
    [rad] that they share: a fit takes an amplitude and the angle as two components, either of any sign.

    ``prior`` gives standard deviations by parameter name (without the effect's own name), ``known`` the names
    of those that are not to be estimated (``["all"]``: none of it is).

    Identification estimates what `unknowns` returns. ``geometry`` names fields that are taken as known unless
    a prior is given for them; ``not_estimated`` says of fields which the likelihood has no derivative by,
    why. ``shifted_body`` names the field of the body whose inertial parameters are all that it changes: where
    these are estimated, its own are only with a prior. ``changes`` says in words what it means when a field's
    value is larger, and when it is smaller, than before. ``on_readings`` is ``True`` for one that changes
    what is measured of an arm, or commanded, and no torque of its joints.
    """

    summary: ClassVar[str] = ""
    family: ClassVar[str] = "other"
    aliases: ClassVar[tuple[str, ...]] = ()
    strength: ClassVar[tuple[str, ...]] = ()
    point_mass: ClassVar[tuple[str, str] | None] = None
    polar: ClassVar[tuple[tuple[str, ...], str] | None] = None
    geometry: ClassVar[tuple[str, ...]] = ()
    not_estimated: ClassVar[Mapping[str, str]] = {}
    shifted_body: ClassVar[str | None] = None
    changes: ClassVar[Mapping[str, tuple[str, str]]] = {}
    on_readings: ClassVar[bool] = False
    kind: str
    name: Name = Field(description="letters, digits, `_` and `-`; unique among the effects")
    prior: dict[str, Annotated[float, Field(gt=0.0)]] = Field(
        default_factory=dict, description="standard deviation by parameter, as in `{ mass = 2.0 }`"
    )
    known: tuple[str, ...] = Field(
        default=(), description='parameters that are not estimated, as in `["mass"]`; `["all"]` for none'
    )

    @model_validator(mode="after")
    def _within_bounds(self) -> Effect:
        for p in self.parameters():
            if not p.lower <= p.value <= p.upper:
                raise ValueError(f"{p.name} = {p.value} {p.unit} is outside [{p.lower}, {p.upper}]")
        own = [p.name.removeprefix(f"{self.name}.") for p in self.parameters()]
        fields = {part for name in own for part in _prefixes(name)}
        for table, given, allowed in (
            ("prior", set(self.prior), set(own)),
            ("known", set(self.known), {*own, *fields, "all"}),
        ):
            if given - allowed:
                raise ValueError(
                    f"{table} names {', '.join(map(repr, sorted(given - allowed)))}, no parameter of "
                    f"'{self.name}'; it has {', '.join(own)}"
                )
        return self

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the physical parameters, named ``<effect>.<field>`` or ``<effect>.<field>.<axis>``."""
        found: list[Parameter] = []
        for entry, info in type(self).model_fields.items():
            extra = info.json_schema_extra
            if not isinstance(extra, dict) or "unit" not in extra:
                continue
            value = getattr(self, entry)
            if value is None:
                continue
            for suffix, number in _flatten(value):
                key = f"{entry}{suffix}"
                found.append(
                    Parameter(
                        name=f"{self.name}.{key}",
                        value=number,
                        unit=str(extra["unit"]),
                        lower=float(extra["lower"]),  # type: ignore[arg-type]
                        upper=float(extra["upper"]),  # type: ignore[arg-type]
                        sigma=self.prior.get(key),
                    )
                )
        return tuple(found)

    def unknowns(self) -> tuple[Parameter, ...]:
        """Return the parameters that identification estimates: all but those `held` names."""
        held = self.held()
        return tuple(p for p in self.parameters() if p.name not in held)

    def polar_pair(self) -> tuple[str, str] | None:
        """Return the names of an amplitude and its angle that are to be estimated as a pair, if there are.

        Of several amplitudes the first that is not zero, or the first.
        """
        if self.polar is None:
            return None
        amplitudes, angle = self.polar
        unknown = {p.name.removeprefix(f"{self.name}."): p.value for p in self.unknowns()}
        free = sorted((a for a in amplitudes if a in unknown), key=lambda a: unknown[a] == 0.0)
        return (f"{self.name}.{free[0]}", f"{self.name}.{angle}") if free and angle in unknown else None

    def held(self) -> dict[str, str]:
        """Return why parameters are not estimated, by name."""
        found: dict[str, str] = {}
        for p in self.parameters():
            own = _prefixes(p.name.removeprefix(f"{self.name}."))
            if own & {*self.known} or "all" in self.known:
                found[p.name] = "marked `known`"
            elif own & set(self.not_estimated):
                found[p.name] = next(self.not_estimated[x] for x in own if x in self.not_estimated)
            elif own & set(self.geometry) and p.sigma is None:
                found[p.name] = "geometry, known unless a prior is given"
        return found

    def driven_joints(self) -> tuple[str, ...]:
        """Return the joints and wheels whose motor torque it has to do with.

        To estimate its parameters, these are driven by their torque and not by their measured motion.
        """
        return ()

    def biased_channels(self) -> tuple[str, ...]:
        """Return the channels (``<sensor>.<quantity>``) whose constant bias is a parameter of the effect."""
        return ()

    def with_values(self, values: Mapping[str, float]) -> Effect:
        """Return the effect with the named parameters replaced; names as in `parameters`.

        Raises `DescriptionError` for a name the effect does not have, or a value it cannot have.
        """
        self._check_names(values)
        update: dict[str, Any] = {}
        for name, value in values.items():
            field, _, axis = name.removeprefix(f"{self.name}.").partition(".")
            if axis:
                vector = list(update.get(field, getattr(self, field)))
                vector[AXES[len(vector)].index(axis)] = float(value)
                update[field] = tuple(vector)
            else:
                update[field] = float(value)
        return self._replaced(update)

    def _check_names(self, values: Mapping[str, float]) -> None:
        known = {p.name for p in self.parameters()}
        for name in values:
            if name not in known:
                raise DescriptionError(
                    f"Effect '{self.name}' has no parameter '{name}'.",
                    advice=f"It has: {', '.join(sorted(known))}.",
                )

    def _replaced(self, update: Mapping[str, Any]) -> Effect:
        try:
            return self._validated({**dict(self), **update})
        except ValidationError as cause:
            reasons = "; ".join(
                ".".join(str(part) for part in e["loc"]) + f" {e['msg'].removeprefix('Value error, ')}"
                for e in cause.errors()
            )
            raise DescriptionError(
                f"Effect '{self.name}' cannot take these values: {reasons}.",
                advice="Keep them within bounds.",
            ) from cause

    def _validated(self, data: Mapping[str, Any]) -> Effect:
        """Return the effect of other values; one that only a description must obey may relax here."""
        return type(self).model_validate(data)

    def without_strength(self) -> Effect:
        """Return the effect with its ``strength`` parameters at zero, where it changes nothing.

        Raises `DescriptionError` for an effect that names none.
        """
        if not self.strength:
            raise DescriptionError(f"An effect of kind '{self.kind}' names no strength.", kind=self.kind)
        update: dict[str, Any] = {}
        for entry in self.strength:
            value = getattr(self, entry)
            update[entry] = (0.0,) * len(value) if isinstance(value, tuple) else 0.0
        return self._replaced(update)

    def attach(self, assembly: Assembly) -> None:
        """Add the effect to the model being assembled."""

    def drive(self, inputs: Inputs, model: SpacecraftModel) -> Inputs:
        """Return what the plant gets when ``inputs`` are commanded; recordings keep the commands."""
        return inputs

    def adjust(self, sensor: Sensor) -> Sensor:
        """Return what the effect makes of a sensor."""
        return sensor

    def torque_columns(self, of: JointStateOf) -> TorqueColumns:
        """Return what motors must give for it, where that is linear in its parameters: an arm is identified
        from measured torques with these. None for an effect ``on_readings``.

        Raises:
            DescriptionError: it is not linear, or needs what is not known.
        """
        if self.on_readings:
            return {}
        raise DescriptionError(
            f"Effect '{self.name}' of kind '{self.kind}' does not enter joint torques linearly.",
            advice="Leave it out, or give its class a method `torque_columns`.",
            effect=self.name,
        )

    def torque_shapes(self) -> tuple[str, ...]:
        """Return the fields, rates [rad/s | m/s], that its torque columns are not linear in: widths of a
        sign (``smoothing``), Stribeck's rate. They are found beside the parameters.
        """
        return ()

    def joint_weights(self) -> dict[str, float]:
        """Return the joints its torque acts on, with their weights in the rate that it depends on."""
        return dict.fromkeys(self.driven_joints(), 1.0)

    def propellant_at(self) -> tuple[str | None, np.ndarray] | None:
        """Return frame and place (3,) [m] of propellant that it stands for, or ``None``."""
        return None

    def resolved(self, description: Description) -> Effect:
        """Return the effect with names that only the whole description explains put as numbers."""
        return self


class Starting(Effect):
    """An effect that may begin midway: nothing of it acts before ``start``.

    ``grows`` is ``True`` for one that begins from nothing, in proportion to the time since.
    """

    grows: ClassVar[bool] = False
    start: float | None = Field(
        default=None, description="time from which it acts [s]; always when not given"
    )

    def active(self, t: float) -> bool:
        """Whether it acts at t [s]."""
        return self.start is None or t >= self.start

    @property
    def onset(self) -> tuple[float, ...]:
        """The time at which it begins, if it does."""
        return () if self.start is None else (self.start,)


E = TypeVar("E", bound=type[Effect])
_CATALOGUE: dict[str, type[Effect]] = {}


def register(cls: E) -> E:
    """Class decorator: put an effect into the catalogue under the default of its ``kind``.

    Raises `DescriptionError` when the class has no ``kind`` of its own, or another class has taken it.
    """
    kind = cls.model_fields["kind"].default
    if not isinstance(kind, str):
        raise DescriptionError(
            f"Effect {cls.__name__} has no kind.", advice="Declare `kind: Literal['...'] = '...'`."
        )
    taken = _CATALOGUE.get(kind)
    if taken is not None and (taken.__module__, taken.__qualname__) != (cls.__module__, cls.__qualname__):
        raise DescriptionError(
            f"Effect kind '{kind}' of {cls.__module__}.{cls.__qualname__} is taken by "
            f"{taken.__module__}.{taken.__qualname__}.",
            advice="Give it another kind.",
        )
    _CATALOGUE[kind] = cls
    return cls


def catalogue() -> dict[str, type[Effect]]:
    """Return the catalogue by kind, with those that other packages offer at entry point ``smsid.effects``.

    Raises `DescriptionError` for an entry point that cannot be loaded, or whose name is not its effect's
    kind.
    """
    for entry in metadata.entry_points(group="smsid.effects"):
        if entry.name in _CATALOGUE:
            continue
        try:
            cls = entry.load()
        except (ImportError, AttributeError) as error:
            raise DescriptionError(
                f"The effect '{entry.name}' offered by '{entry.value}' cannot be loaded: {error}.",
                advice="Mend or remove the package that offers it.",
            ) from error
        if register(cls).model_fields["kind"].default != entry.name:
            raise DescriptionError(
                f"The entry point '{entry.name}' offers an effect of kind "
                f"'{cls.model_fields['kind'].default}'.",
                advice="Name the entry point after the kind.",
            )
    return dict(_CATALOGUE)


def known_effect(kind: str) -> type[Effect] | None:
    """Return the effect class of a kind, or ``None``."""
    return _CATALOGUE.get(kind) or catalogue().get(kind)


def parse_effect(table: Mapping[str, Any] | Effect) -> Effect:
    """Turn one ``[[effect]]`` table into an `Effect`.

    Raises `DescriptionError` for an unknown kind, and pydantic's ``ValidationError`` for what is in the table
    (which `load_description` turns into a `DescriptionError`).
    """
    if isinstance(table, Effect):
        return table
    kind = str(table.get("kind", ""))
    cls = known_effect(kind)
    if cls is None:
        kinds = sorted(catalogue())
        near = difflib.get_close_matches(kind, kinds, n=1)
        hint = f" Did you mean '{near[0]}'?" if near else ""
        raise DescriptionError(
            f"Unknown effect kind '{kind}'.{hint}", advice=f"Known kinds: {', '.join(kinds)}."
        )
    return cls.model_validate(dict(table))


def _prefixes(key: str) -> set[str]:
    """Return a parameter's name and those of what it is part of, as ``mode1.rotation`` is of its ``.y``."""
    parts = key.split(".")
    return {".".join(parts[: k + 1]) for k in range(len(parts))}


def _flatten(value: Any) -> list[tuple[str, float]]:
    if isinstance(value, tuple):
        return [(f".{axis}", float(x)) for axis, x in zip(AXES[len(value)], value, strict=True)]
    return [("", float(np.float64(value)))]


@dataclass(frozen=True)
class Twist:
    """A gear that gives at once: by ``angle(torque)`` [rad] under the torque handed on to the link.

    That is the motor's torque less ``inertia`` [kg m^2] of the rotor times its acceleration. The rotor's rate
    is the joint's, or ``turning(q, v)`` says what it is: its derivative by v (nv,), and what its acceleration
    is where v stays. ``gear`` is the effect it is of, which tells two of them apart. An encoder that is not
    on the motor's side (``read``) sees by how much the link is left behind, and not the twist.
    """

    gear: Effect
    angle: Callable[[np.ndarray], np.ndarray] = field(compare=False)
    inertia: float
    turning: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, float]] | None = field(
        default=None, compare=False
    )
    read: bool = True


Depends = tuple[Sequence[int], Sequence[int]]
"""What a term depends on: places and rates, as indices among the nv coordinates of the tangent space."""

ForceTerm = Callable[[float, np.ndarray, np.ndarray, np.ndarray], None]
"""Nonlinear generalised force: called with (t, q, v, tau), adds to tau (nv,) in place.

tau holds the applied forces and what terms before it added."""

InertiaTerm = Callable[[float, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Inertia that no body of the model has: called with (t, q, v), returns what it adds to the mass matrix
(nv, nv) and to the nonlinear effects (nv,) (Coriolis, centrifugal, weight)."""
