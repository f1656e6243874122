"""What every effect on a sensor shares: which sensor, quantity and component, and in what unit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

import numpy as np
from pydantic import Field, model_validator

from smsid.effects.base import AXES, Effect, Vector3
from smsid.errors import DescriptionError
from smsid.parameter import Parameter
from smsid.sensing.component import ComponentError

if TYPE_CHECKING:
    from smsid.description.schema import Description
    from smsid.sensing.error_model import ErrorModel
    from smsid.sensing.sensor import Sensor

OF_QUANTITY = "unit of the quantity"
UNITS = {
    "position": "m",
    "velocity": "m/s",
    "attitude": "rad",
    "angular_rate": "rad/s",
    "acceleration": "m/s^2",
    "joint_position": "rad",
    "joint_velocity": "rad/s",
    "wheel_rate": "rad/s",
}
"""Unit of an error of each quantity; that of an attitude is a rotation vector."""

VECTORS = ("position", "velocity", "attitude", "angular_rate", "acceleration")
Value = Vector3 | float
S = TypeVar("S", bound="ComponentEffect")


class SensorEffect(Effect):
    """An effect on one sensor."""

    family = "sensor"
    sensor: str = Field(description="name of the sensor")

    def resolved(self, description: Description) -> Effect:
        """Return itself; raises `DescriptionError` when the description has no such sensor."""
        names = [s.name for s in description.sensor]
        if self.sensor not in names:
            raise DescriptionError(
                f"[[effect]] '{self.name}': there is no sensor '{self.sensor}'.",
                advice=f"Sensors: {', '.join(names) or 'none'}.",
                sensor=self.sensor,
            )
        return self

    def adjust(self, sensor: Sensor) -> Sensor:
        """Return the sensor with the effect, if it is the one."""
        return sensor if sensor.name != self.sensor else self.changed(sensor)

    def changed(self, sensor: Sensor) -> Sensor:
        """Return what the effect makes of its sensor."""
        raise NotImplementedError


class QuantityEffect(SensorEffect):
    """An effect on the error model of one quantity of a sensor.

    ``term`` names what the field ``value_field`` adds to of the error model; others override `update`.
    """

    value_field: ClassVar[str] = ""
    term: ClassVar[str] = ""
    quantities: ClassVar[tuple[str, ...]] = tuple(UNITS)
    quantity: str = Field(description="quantity it measures, such as `angular_rate`")

    @model_validator(mode="after")
    def _makes_sense(self) -> QuantityEffect:
        if self.quantity not in self.quantities:
            raise ValueError(f"`quantity` is one of {', '.join(self.quantities)}, not '{self.quantity}'")
        return self

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the parameters, in the unit of the quantity where they have it."""
        unit = UNITS.get(self.quantity, "")
        return tuple(replace(p, unit=unit) if p.unit == OF_QUANTITY else p for p in super().parameters())

    def changed(self, sensor: Sensor) -> Sensor:
        """Return the sensor with another error model for the quantity.

        Raises `DescriptionError` for a quantity it does not measure.
        """
        if self.quantity not in sensor.quantities:
            raise DescriptionError(
                f"[[effect]] '{self.name}': sensor '{sensor.name}' does not measure {self.quantity}.",
                advice=f"It measures {', '.join(sensor.quantities)}.",
            )
        errors = {**sensor.errors, self.quantity: self.with_error(sensor.error(self.quantity))}
        return sensor.model_copy(update={"errors": errors})

    def with_error(self, error: ErrorModel) -> ErrorModel:
        """Return the error model with the effect."""
        return error.model_copy(update=self.update(error))

    def update(self, error: ErrorModel | ComponentError) -> Mapping[str, Any]:
        """Return what changes of the errors there are, by name; nothing where it has no strength."""
        value = getattr(self, self.value_field)
        return {self.term: plus(getattr(error, self.term), value)} if np.any(value) else {}


class ComponentEffect(QuantityEffect):
    """An effect on a quantity as a whole, axis by axis, or on one component of it."""

    component: int | str | None = Field(
        default=None,
        description="axis (`x`, `y`, `z`), joint or wheel, by name or counted from 0; "
        "with it, the effect is on this one alone",
    )
    station: int | None = Field(
        default=None, ge=0, description="accelerometer of an appendage, counted from 0; all when not given"
    )

    def resolved(self: S, description: Description) -> S:
        """Return the effect with its component as a number.

        Raises `DescriptionError` for a component there is not.
        """
        super().resolved(description)
        if not isinstance(self.component, str):
            return self
        known: tuple[str, ...] = AXES[3]
        if self.quantity == "wheel_rate":
            known = tuple(w.name for w in description.wheel)
        elif self.quantity not in VECTORS:
            known = joint_names(description)
        if self.component not in known:
            raise DescriptionError(
                f"[[effect]] '{self.name}': {self.quantity} has no component '{self.component}'.",
                advice=f"Components: {', '.join(known)}.",
                component=self.component,
            )
        return self.model_copy(update={"component": known.index(self.component)})

    @property
    def key(self) -> str | None:
        """Key of the component in `ErrorModel.components`; ``None`` for the whole quantity.

        Raises `DescriptionError` for a name that needs the description, see `resolved`.
        """
        if self.component is None and self.station is None:
            return None
        component = self.component
        if isinstance(component, str):
            if component not in AXES[3]:
                raise DescriptionError(
                    f"[[effect]] '{self.name}': '{component}' is a name only the description explains.",
                    advice="Use Description.effective_sensors, or give the number.",
                )
            component = AXES[3].index(component)
        place = "" if component is None else str(component)
        return place if self.station is None else f"{self.station},{place}"

    def with_error(self, error: ErrorModel) -> ErrorModel:
        """Return the error model with the effect, on the whole quantity or on one component."""
        key = self.key
        if key is None:
            return super().with_error(error)
        own = error.components.get(key, ComponentError())
        update = self.update(own)
        changed = {**error.components, key: own.model_copy(update=update)}
        return error.model_copy(update={"components": changed}) if update else error


class VectorEffect(ComponentEffect):
    """A component effect with a value per axis: a 3-vector for the whole, a number for a component."""

    @model_validator(mode="after")
    def _value_fits(self) -> VectorEffect:
        whole = isinstance(getattr(self, self.value_field), tuple)
        if whole and (self.component is not None or self.quantity not in VECTORS):
            raise ValueError(f"`{self.value_field}` of a single component is one number")
        if not whole and self.component is None:
            raise ValueError(
                f"`{self.value_field}` has one number per axis"
                if self.quantity in VECTORS
                else f"name the `component`: {self.quantity} has one per joint or wheel"
            )
        return self


def plus(one: Value, other: Value) -> Value:
    """Return the sum of numbers, or values per axis."""
    both = np.asarray(one) + np.asarray(other)
    return float(both) if both.ndim == 0 else tuple(both.tolist())


def joint_names(description: Description) -> tuple[str, ...]:
    """Return the names of the arm joints, in the order of the channels; reads the URDFs if it must."""
    arms = description.arm
    if arms and all(arm.joints is not None for arm in arms):
        return tuple(name for arm in arms for name in arm.joints or ())
    bare = description.model_copy(update={"effect": (), "sensor": ()})
    return _joint_names(bare.model_dump_json(by_alias=True), str(description.folder))


@cache
def _joint_names(description: str, folder: str) -> tuple[str, ...]:
    from smsid.description.schema import Description
    from smsid.model import build_model
    from smsid.model.rigid_bodies import rigid_model

    found = Description.model_validate_json(description).model_copy(update={"folder": Path(folder)})
    # an arm whose links take no inertia is identified by torques all the same
    return (rigid_model(found) if found.root == "fixed" else build_model(found)).arm_joints.names
