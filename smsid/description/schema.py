"""The TOML beside a URDF: wheels, arms, effects, sensors. One frozen type, validated."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, SerializeAsAny, field_validator, model_validator

from smsid.effects.base import Effect, Vector3, parse_effect
from smsid.sensing.sensor import Sensor

SCHEMA_VERSION = 1


class _Table(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class Mount(_Table):
    """Where a part sits: a named frame of the spacecraft (default: the bus frame) and a pose in it."""

    frame: str | None = None
    xyz: Vector3 = (0.0, 0.0, 0.0)  # [m]
    rpy: Vector3 = (0.0, 0.0, 0.0)  # [rad]


class Wheel(_Table):
    """A reaction wheel.

    ``inertia`` is the spin inertia I_rw [kg m^2]; its mass is part of the bus, and so is its spin inertia unless
    ``inertia_in_bus = false``. Alternatively ``joint`` names a joint of the URDF that is the wheel.
    """

    name: str
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
            raise ValueError(f"wheel '{self.name}' needs a positive `inertia`, or the `joint` of the URDF it is")
        if sum(x * x for x in self.axis) < 1e-12:
            raise ValueError(f"wheel '{self.name}' has a zero `axis`")
        return self


class Arm(_Table):
    """An arm: joints of the spacecraft's own URDF, or another URDF mounted on the bus.

    Give ``joints`` (own URDF; default: every joint that is not a wheel), ``urdf`` (a file), or ``robot`` (a name
    of example-robot-data). Names of a mounted URDF get the prefix ``<name>/``. ``home`` gives joint positions by
    name (without prefix) [rad].
    """

    name: str
    joints: tuple[str, ...] | None = None
    urdf: str | None = None
    robot: str | None = None
    mount: Mount = Mount()
    home: dict[str, float] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _one_source(self) -> Arm:
        if sum(x is not None for x in (self.joints, self.urdf, self.robot)) > 1:
            raise ValueError(f"arm '{self.name}': give one of `joints`, `urdf`, `robot`")
        return self


class Thrust(_Table):
    """The net thrust: its point of application in the bus frame and its limit per axis."""

    point: Vector3 = (0.0, 0.0, 0.0)  # [m]
    max_force: float | None = Field(default=None, gt=0.0)  # [N]


class Description(_Table):
    """A spacecraft: a URDF and everything a URDF cannot say.

    ``folder`` is where relative paths start; it is not part of the file.
    """

    schema_version: Literal[1] = Field(default=SCHEMA_VERSION, alias="schema")
    name: str
    urdf: str
    root: Literal["free", "fixed"] = "free"
    gravity: Vector3 = (0.0, 0.0, 0.0)  # [m/s^2], inertial frame
    meshes: Literal["required", "ignored"] = "required"
    package_dirs: tuple[str, ...] = ()
    thrust: Thrust = Thrust()
    wheel: tuple[Wheel, ...] = ()
    arm: tuple[Arm, ...] = ()
    effect: tuple[SerializeAsAny[Effect], ...] = ()
    sensor: tuple[Sensor, ...] = ()
    folder: Annotated[Path, Field(exclude=True)] = Path(".")

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)

    @field_validator("effect", mode="before")
    @classmethod
    def _effects_by_kind(cls, tables: Any) -> Any:
        return tuple(parse_effect(t) for t in tables) if isinstance(tables, list | tuple) else tables

    @model_validator(mode="after")
    def _names_are_unique(self) -> Description:
        for label in ("wheel", "arm", "effect", "sensor"):
            names = [item.name for item in getattr(self, label)]
            twice = sorted({n for n in names if names.count(n) > 1})
            if twice:
                raise ValueError(f"two {label}s are named {', '.join(map(repr, twice))}; names must be unique")
        return self

    def get_effect(self, name: str) -> Effect:
        """Return the effect of that name; raises KeyError."""
        return {e.name: e for e in self.effect}[name]

    def with_effects(self, *effects: Effect) -> Description:
        """Return a copy in which each effect replaces the one of its name, or is added."""
        known = {e.name: e for e in self.effect}
        known.update({e.name: e for e in effects})
        return self.model_copy(update={"effect": tuple(known.values())})

    def with_sensors(self, *sensors: Sensor) -> Description:
        """Return a copy with these sensors instead."""
        return self.model_copy(update={"sensor": tuple(sensors)})
