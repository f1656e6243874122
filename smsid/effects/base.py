"""The one interface of every effect: anything a spacecraft may have beyond rigid links."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from importlib import metadata
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self, TypeVar

import numpy as np
from pydantic import Field, ValidationError, model_validator

from smsid._listing import did_you_mean
from smsid.effects.assembly import Assembly
from smsid.effects.fields import AXES, numbers_of, prefixes
from smsid.effects.fields import physical as physical  # where effects of other packages import it
from smsid.effects.joint_state import Counterpart, JointStateOf, TorqueColumns
from smsid.effects.table import StrictTable
from smsid.errors import DescriptionError
from smsid.parameter import Parameter

if TYPE_CHECKING:
    from smsid.description.schema import Description
    from smsid.effects.appendage import Appendage
    from smsid.effects.assembly import Assembly
    from smsid.inputs.inputs import Inputs
    from smsid.model.spacecraft import SpacecraftModel
    from smsid.sensing.sensor import Sensor


Vector3 = Annotated[tuple[float, ...], Field(min_length=3, max_length=3)]
Vector6 = Annotated[tuple[float, ...], Field(min_length=6, max_length=6)]
SigmaOf = Callable[[str], float]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")]


class Effect(StrictTable):
    """An effect with its physical parameters.

    Subclasses declare their parameters as fields made with `physical`, and override what they do:

    - `attach` adds joints, inertia, springs or nonlinear forces to the model (see `Assembly`),
    - `drive` changes what the plant gets of what is commanded,
    - `adjust` changes a sensor: where it sits, and its errors.

    ``prior`` gives standard deviations by parameter name (without the effect's own name), ``known`` the names
    of those that are not to be estimated (``["all"]``: none of it is). Identification estimates what
    `unknowns` returns.
    """

    summary: ClassVar[str] = ""  # for the reference
    in_words: ClassVar[str] = "{place} has an effect that the description lacks ({kind})"  # of a diagnosis
    family: ClassVar[str] = "other"  # groups effects that are alike
    # fields of the shape of a law that is nature's in size and in what it depends on only
    open_shape: ClassVar[tuple[str, ...]] = ()
    aliases: ClassVar[tuple[str, ...]] = ()  # kinds that some experiments cannot tell from it
    # fields that are zero when it is not there: with these at zero it changes nothing at all
    strength: ClassVar[tuple[str, ...]] = ()
    # fields of a mass (or what it grows by) and of its place, of an effect that is no more than that
    point_mass: ClassVar[tuple[str, str] | None] = None
    # fields of amplitudes, and of the angle [rad] they share: a fit takes one and the angle as two components
    polar: ClassVar[tuple[tuple[str, ...], str] | None] = None
    geometry: ClassVar[tuple[str, ...]] = ()  # fields taken as known unless a prior is given for them
    not_estimated: ClassVar[Mapping[str, str]] = {}  # fields the likelihood has no derivative by, and why
    # field of the body whose inertial parameters are all that it changes: where these are estimated, its own
    # are only with a prior
    shifted_body: ClassVar[str | None] = None
    changes: ClassVar[Mapping[str, tuple[str, str]]] = {}  # what a larger, a smaller value of a field means
    needs_beam: ClassVar[str] = ""  # what it takes of a `beam_appendage`; the panel is identified as a beam
    in_modes: ClassVar[bool] = False  # whether `Appendage.described_modes` holds all that it does
    by_batch: ClassVar[bool] = False  # whether the batch likelihood knows all its parameters
    # its parameters are the spacecraft's as designed: uncertain also where something else is looked for
    nominal: ClassVar[bool] = False
    may_begin: ClassVar[bool] = False  # whether it has a time from which it acts
    grows: ClassVar[bool] = False  # whether it begins from nothing, in proportion to the time since
    # values by field from which a diagnosis fits a strong one, where nothing else follows a recording
    strong: ClassVar[Mapping[str, tuple[float, ...]]] = {}
    # whether it changes what is measured of an arm, or commanded, and no torque of its joints
    on_readings: ClassVar[bool] = False
    adds_to_body: ClassVar[bool] = False  # whether all it does is to add inertial parameters to a body
    shifts_time: ClassVar[bool] = False  # whether all it does is that something comes early or late
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
        fields = {part for name in own for part in prefixes(name)}
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

    def with_dynamics(self) -> tuple[tuple[Effect, float], ...]:
        """Return it with motions of its own that it may have where it is taken at rest, slow and quick ones,
        each with the longest step [s] that integrates it.
        """
        return ()

    def why_unresolved(self, fields: Collection[str]) -> str:
        """Return in words what of some ``fields``, as its values are, is within what its law does not
        resolve; else nothing.
        """
        return ""

    def has_fast_dynamics(self) -> bool:
        """Whether it has a motion of its own that may come to rest between two samples."""
        return False

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the physical parameters, named ``<effect>.<field>`` or ``<effect>.<field>.<axis>``.

        Those of the k-th table in a list are ``<effect>.<field>k.<field of the table>``.
        """
        return tuple(
            Parameter(
                name=f"{self.name}.{key}",
                value=number,
                unit=str(extra["unit"]),
                lower=float(extra["lower"]),
                upper=float(extra["upper"]),
                sigma=self.prior.get(key),
                may_vanish=bool(extra["may_vanish"]),
            )
            for key, number, extra in numbers_of(self)
        )

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
            own = prefixes(p.name.removeprefix(f"{self.name}."))
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

    def lasting_joints(self) -> tuple[str, ...]:
        """Return its joints whose rates go on where a motion is begun anew: what was used up stays so."""
        return ()

    def with_values(self, values: Mapping[str, float]) -> Self:
        """Return the effect with the named parameters replaced; names as in `parameters`.

        Raises `DescriptionError` for a name the effect does not have, or a value it cannot have.
        """
        data, known = dict(self), {p.name for p in self.parameters()}
        for name, value in values.items():
            if name not in known:
                raise DescriptionError(
                    f"Effect '{self.name}' has no parameter '{name}'.",
                    advice=f"It has: {', '.join(sorted(known))}.",
                )
            own, (field, *rest) = data, name.removeprefix(f"{self.name}.").split(".")
            while field not in own:  # of a table in a list, whose number ends the name
                entry = field.rstrip("0123456789")
                own[entry] = [dict(table) for table in own[entry]]
                own, (field, *rest) = own[entry][int(field.removeprefix(entry)) - 1], rest
            if rest:
                vector = list(own[field])
                vector[AXES[len(vector)].index(rest[0])] = float(value)
                own[field] = tuple(vector)
            else:
                own[field] = float(value)
        try:
            return self._validate(data)
        except ValidationError as cause:
            reasons = "; ".join(
                ".".join(str(part) for part in e["loc"]) + f" {e['msg'].removeprefix('Value error, ')}"
                for e in cause.errors()
            )
            raise DescriptionError(
                f"Effect '{self.name}' cannot take these values: {reasons}.",
                advice="Keep them within bounds.",
            ) from cause

    def _validate(self, data: Mapping[str, Any]) -> Self:
        """Return the effect of other values; one that only a description must obey may relax here."""
        return type(self).model_validate(data)

    @property
    def onset(self) -> float | None:
        """The time before which its forces do not act [s]; ``None``: it is there always."""
        return None

    def attach(self, assembly: Assembly) -> None:
        """Add the effect to the model being assembled."""

    def drive(self, inputs: Inputs, model: SpacecraftModel) -> Inputs:
        """Return what the plant gets when ``inputs`` are commanded; recordings keep the commands."""
        return inputs

    def adjust(self, sensor: Sensor) -> Sensor:
        """Return what the effect makes of a sensor."""
        return sensor

    @property
    def on_signals(self) -> bool:
        """Whether it acts on commands or readings."""
        own = type(self)
        hooks = ((own.drive, Effect.drive), (own.adjust, Effect.adjust), (own.resolved, Effect.resolved))
        return any(mine is not plain for mine, plain in hooks)

    def urdf_dynamics(self) -> Mapping[str, tuple[float, float]]:
        """Return viscous [N m s/rad | N s/m] and Coulomb friction [N m | N] by joint that always act.

        It is what a URDF can say in ``<dynamics>``, and it stands instead of what the URDF says of the joint.
        """
        return {}

    def counterpart(self, limits: Mapping[str, float]) -> Counterpart | str:
        """Return what other simulators have of its forces, or why there is nothing: exporters then refuse it.

        ``limits``: largest rates [rad/s | m/s] by joint, not finite where there is none.
        """
        return "its forces follow a law of their own"

    def part_of(self) -> str | None:
        """Return the name of the effect before it that it says more of, if there is one."""
        return None

    def estimated_as(self, effects: Sequence[Effect]) -> Effect | None:
        """Return it in the parameters that a likelihood takes, among the effects of its description.

        ``None``: another of them takes it in.
        """
        return self

    def described_as(self) -> Effect:
        """Return it as a description has it, where it is what `estimated_as` made."""
        return self

    def reported_as(self) -> Mapping[str, tuple[str, float]]:
        """Return name and size of the physical parameter that another, by name, is a factor on."""
        return {}

    def estimated_sigmas(self, sigma: SigmaOf, relative: SigmaOf) -> Mapping[str, float]:
        """Return by field how well it is known where an estimate has it in another form.

        ``sigma`` gives an estimate's standard deviation of a parameter by its name, ``relative`` the same
        over its value; not a number where the estimate does not have it.
        """
        return {}

    def moved_with(self, old: Effect, new: Effect) -> Effect:
        """Return it as it is said of the effect it is part of, where that has changed from old to new."""
        return self

    def shifted_by(self, body: str | None, shift: np.ndarray) -> Effect | None:
        """Return it with a shift (10,) of a body's inertial parameters more, where that is all it is."""
        return None

    def without_share(self, described: np.ndarray) -> Effect:
        """Return it with what is a share of a body's ``described`` parameters (10,), in the axes of the
        effect's frame, as numbers: they stay where the body becomes another.
        """
        return self

    def as_appendage(self) -> Appendage | None:
        """Return it as an appendage: rigid body, modes, stations; ``None`` where it is none."""
        return None

    def asked(self) -> tuple[str, ...]:
        """Return the fields that its torque columns are of."""
        return tuple(p.name.removeprefix(f"{self.name}.") for p in self.parameters())

    def torque_columns(self, of: JointStateOf) -> TorqueColumns:
        """Return what motors must give for it, where that is linear in its parameters: an arm is identified
        from measured torques with these. None for an effect ``on_readings``, nor for one that
        ``adds_to_body``, which is part of a link.

        Raises:
            DescriptionError: it is not linear, or needs what is not known.
        """
        if self.on_readings or self.adds_to_body:
            return {}
        raise DescriptionError(
            f"Effect '{self.name}' of kind '{self.kind}' does not enter joint torques linearly.",
            advice="Identify by the motion under commanded torques (--method filter), or leave it out; a "
            "class of your own may have a method `torque_columns`.",
            effect=self.name,
        )

    @property
    def by_torques(self) -> bool:
        """Whether equations of torques know it; what they do not needs the likelihood of motion."""
        linear = type(self).torque_columns is not Effect.torque_columns
        return linear or self.on_readings or self.adds_to_body

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

    def later(self, shift: float) -> Effect:
        """Return the effect on a clock that shows ``shift`` [s] more."""
        start = getattr(self, "start", None)
        return self if start is None else self.model_copy(update={"start": start + shift})

    def resolved(self, description: Description) -> Effect:
        """Return the effect with names that only the whole description explains put as numbers."""
        return self


class Starting(Effect):
    """An effect that may begin midway: nothing of it acts before ``start``."""

    may_begin: ClassVar[bool] = True
    start: float | None = Field(
        default=None, description="time from which it acts [s]; always when not given"
    )

    @property
    def onset(self) -> float | None:
        """The time at which it begins [s], if it does."""
        return self.start

    def later(self, shift: float) -> Effect:
        """Return the effect on a clock that shows ``shift`` [s] more; what grows does so from 0 s."""
        if self.start is None and self.grows:
            return self.model_copy(update={"start": shift})
        return super().later(shift)


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
        raise DescriptionError(
            f"Unknown effect kind '{kind}'." + did_you_mean(kind, kinds),
            advice=f"Known kinds: {', '.join(kinds)}.",
        )
    return cls.model_validate(dict(table))


class JointEffect(Effect):
    """An effect at a joint."""

    family = "drivetrain"
    joint: str = Field(description="joint of the model: `joint2`, `left/joint2` of a mounted arm, or a wheel")

    def driven_joints(self) -> tuple[str, ...]:
        """Return the joint, whose motor torque it has to do with."""
        return (self.joint,)

    def attach(self, assembly: Assembly) -> None:
        """Check that the joint is there; nothing acts on the motion."""
        assembly.joint_id(self.joint)
