"""The TOML beside a URDF: wheels, arms, effects, sensors. One frozen type, validated."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    ConfigDict,
    Field,
    SerializeAsAny,
    ValidationError,
    WrapValidator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from smsid._listing import did_you_mean
from smsid._short_repr import ShortRepr
from smsid.effects.base import Effect, Name, Vector3, parse_effect
from smsid.effects.table import StrictTable
from smsid.errors import DescriptionError, SmsidError
from smsid.inputs.pulses import Pulse
from smsid.sensing.sensor import Sensor

SCHEMA_VERSION = 1

Inertias = Literal["checked", "trusted"]


class Mount(StrictTable):
    """Where a part sits: a named frame of the spacecraft (default: the bus frame) and a pose in it."""

    frame: str | None = None
    xyz: Vector3 = (0.0, 0.0, 0.0)  # [m]
    rpy: Vector3 = (0.0, 0.0, 0.0)  # [rad]


class Wheel(StrictTable):
    """A reaction wheel.

    ``inertia`` is the spin inertia I_rw [kg m^2]; its mass is part of the bus, and so is its spin inertia
    unless ``inertia_in_bus = false``. Alternatively ``joint`` names a joint of the URDF that is the
    wheel; where the URDF gives its link no spin inertia, ``inertia`` does, beside what other links have.
    ``axis`` need not be a unit vector.
    """

    name: Name
    axis: Vector3 = (0.0, 0.0, 1.0)
    position: Vector3 = (0.0, 0.0, 0.0)  # [m], bus frame
    inertia: float = Field(default=0.0, ge=0.0)
    inertia_in_bus: bool = True
    joint: str | None = None
    max_torque: float | None = Field(default=None, gt=0.0)  # [N m]
    max_rate: float | None = Field(default=None, gt=0.0)  # [rad/s]

    @model_validator(mode="after")
    def _is_a_wheel(self) -> Wheel:
        if self.joint is None and self.inertia <= 0.0:
            raise ValueError(
                f"wheel '{self.name}' needs a positive `inertia`, or the `joint` of the URDF it is"
            )
        if sum(x * x for x in self.axis) < 1e-12:
            raise ValueError(f"wheel '{self.name}' has a zero `axis`")
        return self


class Arm(StrictTable):
    """An arm: joints of the spacecraft's own URDF, or another URDF mounted on the bus.

    Give ``joints`` (own URDF; default: every joint that is not a wheel), ``urdf`` (a file), or ``robot`` (a
    name of example-robot-data, see `smsid.description.robots`). Names of a mounted URDF get the prefix
    ``<name>/``.
    ``home`` gives joint positions by name (without prefix) [rad | m]; joints of the URDF listed in ``fixed``
    are welded there. ``arguments`` are those of a xacro file. ``inertias = "trusted"`` takes the
    inertias of a mounted URDF as they are, where ``"checked"`` refuses those no rigid body can have.
    """

    name: Name
    joints: tuple[str, ...] | None = None
    urdf: str | None = None
    robot: str | None = None
    mount: Mount = Mount()
    home: dict[str, float] = Field(default_factory=dict)
    fixed: tuple[str, ...] = ()
    arguments: dict[str, str] = Field(default_factory=dict)
    inertias: Inertias = "checked"

    @property
    def mounted(self) -> bool:
        """Whether the arm comes from a URDF of its own."""
        return self.urdf is not None or self.robot is not None

    @model_validator(mode="after")
    def _one_source(self) -> Arm:
        if sum(x is not None for x in (self.joints, self.urdf, self.robot)) > 1:
            raise ValueError(f"arm '{self.name}': give one of `joints`, `urdf`, `robot`")
        if not self.mounted and self.mount != Mount():
            raise ValueError(f"arm '{self.name}' has a `mount` but no `urdf` or `robot` to mount")
        both = sorted(set(self.fixed) & set(self.joints or ()))
        if both:
            raise ValueError(f"arm '{self.name}' lists {', '.join(both)} in both `joints` and `fixed`")
        if not self.mounted and self.inertias != "checked":
            raise ValueError(
                f"arm '{self.name}' is part of the spacecraft's own URDF: `inertias` goes to the file's top"
            )
        return self


class Thrust(StrictTable):
    """The net thrust: its point of application in the bus frame and its limit per axis."""

    point: Vector3 = (0.0, 0.0, 0.0)  # [m]
    max_force: float | None = Field(default=None, gt=0.0)  # [N]


class Thruster(StrictTable):
    """A single thruster: where it pushes, in which direction, and how hard at full thrust.

    ``direction`` is that of the force on the spacecraft, against the jet; it need not be a unit vector.
    Recordings say what share of ``force`` it gave (``command.thruster``), or the force itself
    (``command.thruster_force``). A share is ``spread`` over its sample, or of a ``pulse`` at full thrust at
    the beginning, in the middle or at the end of it.
    """

    name: Name
    position: Vector3  # [m], bus frame
    direction: Vector3  # bus axes
    force: float = Field(gt=0.0)  # [N]
    pulse: Pulse = "spread"

    @model_validator(mode="after")
    def _has_a_direction(self) -> Thruster:
        if sum(x * x for x in self.direction) < 1e-12:
            raise ValueError(f"thruster '{self.name}' has a zero `direction`")
        if self.name == "thruster":
            raise ValueError("'thruster' stands for the net thrust; give it another name")
        return self

    def full(self) -> tuple[float, ...]:
        """Return the force (3,) on the bus at full thrust, bus axes [N]."""
        size = sum(x * x for x in self.direction) ** 0.5
        return tuple(self.force * x / size for x in self.direction)


def _in_place(make: Callable[[Any], Any]) -> WrapValidator:
    """Let `SmsidError` take part in pydantic's report, so that it comes out with the place."""

    def validate(value: Any, handler: Callable[[Any], Any]) -> Any:
        try:
            return handler(make(value))
        except ValidationError:
            raise
        except SmsidError as cause:
            raise PydanticCustomError("smsid", "{text}", {"text": str(cause)}) from cause

    return WrapValidator(validate)


AnyEffect = Annotated[
    SerializeAsAny[Effect], _in_place(lambda t: parse_effect(t) if isinstance(t, dict) else t)
]
AnySensor = Annotated[Sensor, _in_place(lambda t: t)]


class Description(ShortRepr, StrictTable):
    """A spacecraft: a URDF and everything a URDF cannot say.

    ``folder`` is where relative paths start; it is not part of the file. Made in Python, a description (like
    its parts) raises pydantic's ``ValidationError`` for what `load_description` reports as
    `DescriptionError`.
    """

    schema_version: Literal[1] = Field(default=SCHEMA_VERSION, alias="schema")
    name: str
    urdf: str
    root: Literal["free", "fixed"] = "free"
    gravity: Vector3 = (0.0, 0.0, 0.0)  # [m/s^2], inertial frame
    meshes: Literal["required", "optional", "ignored"] = "required"
    inertias: Inertias = "checked"
    package_dirs: tuple[str, ...] = ()
    arguments: dict[str, str] = Field(default_factory=dict)  # of the URDF, if it is a xacro
    thrust: Thrust = Thrust()
    thruster: tuple[Thruster, ...] = ()
    wheel: tuple[Wheel, ...] = ()
    arm: tuple[Arm, ...] = ()
    effect: tuple[AnyEffect, ...] = ()
    sensor: tuple[AnySensor, ...] = ()
    folder: Annotated[Path, Field(exclude=True)] = Path(".")

    model_config = ConfigDict(populate_by_name=True)

    @model_validator(mode="after")
    def _names_are_unique(self) -> Description:
        for label in ("thruster", "wheel", "arm", "effect", "sensor"):
            names = [item.name for item in getattr(self, label)]
            twice = sorted({n for n in names if names.count(n) > 1})
            if twice:
                named = ", ".join(map(repr, twice))
                raise ValueError(f"two {label}s are named {named}; names must be unique, rename one")
        return self

    @model_validator(mode="after")
    def _thrusters_push_something(self) -> Description:
        if self.thruster and self.root != "free":
            raise ValueError('thrusters do nothing to a bus with root = "fixed"; remove them')
        return self

    @model_validator(mode="after")
    def _sensors_find_their_appendage(self) -> Description:
        names = [e.name for e in self.effect]
        for sensor in self.sensor:
            if sensor.appendage is not None and sensor.appendage not in names:
                raise ValueError(
                    f"sensor '{sensor.name}' sits on appendage '{sensor.appendage}', which is no effect"
                    + did_you_mean(sensor.appendage, names)
                )
        return self

    def _title_and_rows(self) -> tuple[str, list[tuple[str, str]]]:
        rows = [("urdf", self.urdf)]
        rows += [(f"arm {a.name}", a.robot or a.urdf or "joints of the URDF") for a in self.arm]
        rows += [("wheels", ", ".join(w.name for w in self.wheel))] if self.wheel else []
        rows += [("thrusters", ", ".join(t.name for t in self.thruster))] if self.thruster else []
        rows += [(f"effect {e.name}", e.kind) for e in self.effect]
        rows += [("sensors", ", ".join(s.name for s in self.sensor))] if self.sensor else []
        return f"{'spacecraft' if self.root == 'free' else 'fixed machine'} {self.name!r}", rows

    def get_effect(self, name: str) -> Effect:
        """Return the effect of that name; raises `DescriptionError`."""
        found = {e.name: e for e in self.effect}
        if name not in found:
            raise DescriptionError(
                f"There is no effect '{name}'." + did_you_mean(name, list(found)),
                advice=f"Effects: {', '.join(found) or 'none'}.",
            )
        return found[name]

    def effective_sensors(self) -> tuple[Sensor, ...]:
        """Return the sensors after every effect's `adjust`, in order: what records, as far as is known.

        Raises `DescriptionError` for an effect that does not fit the sensor it names.
        """
        sensors = self.sensor
        for effect in self.effect:
            resolved = effect.resolved(self)
            sensors = tuple(resolved.adjust(sensor) for sensor in sensors)
        return sensors

    def with_effects(self, *effects: Effect) -> Description:
        """Return a copy in which each effect replaces the one of its name, or is added."""
        known = {e.name: e for e in self.effect}
        alike = all(type(known.get(e.name)) is type(e) for e in effects)
        known.update({e.name: e for e in effects})
        if alike:  # other values of effects that are there: all names stay what they are
            return self.model_copy(update={"effect": tuple(known.values())})
        return self._with("effect", tuple(known.values()))

    def with_sensors(self, *sensors: Sensor) -> Description:
        """Return a copy with these sensors instead; raises `DescriptionError` if two have one name."""
        return self._with("sensor", sensors)

    def _with(self, field: str, items: tuple[Any, ...]) -> Description:
        try:
            return type(self).model_validate({**dict(self), field: items})
        except ValidationError as cause:
            reasons = "; ".join(e["msg"].removeprefix("Value error, ") for e in cause.errors())
            raise DescriptionError(
                f"Description '{self.name}' cannot take this {field}: {reasons}."
            ) from cause
