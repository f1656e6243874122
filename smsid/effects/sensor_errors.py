"""Sensors that read wrong: bias, scale, axes, place, clock, coarse steps, outliers, a stuck channel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from pydantic import model_validator
from scipy.spatial.transform import Rotation

from smsid.effects.base import Starting, Vector3, physical, register
from smsid.effects.sensor import (
    OF_QUANTITY,
    UNITS,
    VECTORS,
    ComponentEffect,
    QuantityEffect,
    SensorEffect,
    Value,
    VectorEffect,
)
from smsid.errors import DescriptionError
from smsid.parameter import Parameter
from smsid.sensing.component import ComponentError
from smsid.sensing.error_model import COARSEST_ATTITUDE, ErrorModel
from smsid.sensing.sensor import Sensor

_ZERO = (0.0, 0.0, 0.0)


@register
class SensorBias(VectorEffect, Starting):
    """A constant added to what a sensor reads, along its own axes; of an attitude, a rotation vector."""

    summary = "constant bias of a sensor, perhaps from some time on"
    aliases = ("external_wrench", "sensor_misalignment")
    strength = ("bias",)
    value_field = term = "bias"
    in_words = "{place} has a bias"
    kind: Literal["sensor_bias"] = "sensor_bias"
    bias: Value = physical(OF_QUANTITY, default=_ZERO, description="per axis, or of the component")

    def biased_channels(self) -> tuple[str, ...]:
        """Return its channel, where it biases all of it from the beginning."""
        whole = self.component is None and self.start is None
        return (f"{self.sensor}.{self.quantity}",) if whole else ()

    def with_error(self, error: ErrorModel) -> ErrorModel:
        """Return the error model with the bias; beside one of another time, every component has its own."""
        if self.key is None and np.any(error.bias) and np.any(self.bias) and error.bias_from != self.start:
            for axis, value in enumerate(np.asarray(self.bias)):
                one = self.model_copy(update={"component": axis, "bias": float(value)})
                error = one.with_error(error)
            return error
        return super().with_error(error)

    def update(self, error: ErrorModel | ComponentError) -> Mapping[str, Any]:
        """Return bias and beginning; raises `DescriptionError` beside a bias of another time."""
        if np.any(self.bias) and np.any(error.bias) and error.bias_from != self.start:
            raise DescriptionError(
                f"[[effect]] '{self.name}': component {self.key} of {self.sensor}.{self.quantity} has "
                "another bias, that begins at another time.",
                advice="Keep one of the two effects.",
            )
        return {**super().update(error), "bias_from": self.start} if np.any(self.bias) else {}


@register
class SensorScale(VectorEffect):
    """A reading of ``1 + error`` times the true one, along the sensor's own axes."""

    summary = "wrong scale of a sensor"
    aliases = ("thruster_gain", "torque_gain", "body_error")
    strength = ("error",)
    strong = {"error": (-2.0,)}
    quantities = tuple(q for q in UNITS if q != "attitude")
    value_field, term = "error", "scale_error"
    in_words = "{place} reads on another scale"
    kind: Literal["sensor_scale"] = "sensor_scale"
    error: Value = physical("1", default=_ZERO, description="relative, per axis or of the component")


@register
class ScaleByRate(VectorEffect):
    """A rate read as ``1 + slope |x|`` times the true x, along the sensor's own axes: the nonlinearity of a
    scale factor (IEEE Std 952), of the second order and odd.
    """

    summary = "scale of a rate sensor that depends on the rate"
    aliases = ("sensor_scale",)
    strength = ("slope",)
    quantities = ("angular_rate", "joint_velocity", "wheel_rate")
    value_field, term = "slope", "scale_slope"
    in_words = "{place} reads on a scale that depends on the rate"
    kind: Literal["scale_by_rate"] = "scale_by_rate"
    slope: Value = physical(
        "s/rad", default=_ZERO, description="relative, per rate; per axis or of the component"
    )


@register
class SensorMisalignment(QuantityEffect):
    """Axes turned by a rotation vector, in sensor axes, from where the description has them."""

    summary = "axes of a sensor that point elsewhere than stated"
    aliases = ("sensor_bias", "thruster_misalignment", "sensor_scale")
    strength = ("angles",)
    quantities = VECTORS
    in_words = "{place} is turned against where the description has it"
    kind: Literal["sensor_misalignment"] = "sensor_misalignment"
    angles: Vector3 = physical(
        "rad",
        lower=-np.pi,
        upper=np.pi,
        default=_ZERO,
        description="rotation vector from the stated to the true axes",
    )

    def with_error(self, error: ErrorModel) -> ErrorModel:
        """Return the error model with the misalignment, after what it has."""
        if not any(self.angles):
            return error
        turns = Rotation.from_rotvec(error.misalignment) * Rotation.from_rotvec(self.angles)
        return error.model_copy(update={"misalignment": tuple(turns.as_rotvec().tolist())})


@register
class LeverArm(SensorEffect):
    """A pose sensor or IMU that sits ``offset`` from where the description has it."""

    summary = "sensor that sits elsewhere than stated"
    aliases = ("body_error", "sensor_misalignment")
    strength = ("offset",)
    in_words = "{place} sits elsewhere than the description says"
    kind: Literal["lever_arm"] = "lever_arm"
    offset: Vector3 = physical("m", default=_ZERO, description="true minus stated position, bus frame")

    def changed(self, sensor: Sensor) -> Sensor:
        """Return the sensor where it is; raises `DescriptionError` for a kind without a place."""
        if sensor.kind not in ("pose", "imu"):
            raise DescriptionError(
                f"[[effect]] '{self.name}': a sensor of kind {sensor.kind} has no lever arm.",
                advice="Name a pose sensor or an IMU.",
            )
        if not any(self.offset):
            return sensor
        place = tuple(float(a + b) for a, b in zip(sensor.position, self.offset, strict=True))
        return sensor.model_copy(update={"position": place})


@register
class SensorDelay(QuantityEffect):
    """One quantity of a sensor that is older than stated."""

    summary = "one quantity of a sensor that comes late"
    aliases = ("time_offset", "actuator_delay")
    strength = ("delay",)
    in_words = "{place} reports late"
    kind: Literal["sensor_delay"] = "sensor_delay"
    value_field = term = "delay"
    shifts_time = True
    delay: float = physical("s", lower=0.0, may_vanish=True, default=0.0, description="beyond the stated one")


@register
class TimeOffset(SensorEffect):
    """A sensor's clock that is off: what is stamped t happened at ``t - offset``, for all its quantities."""

    summary = "clock of a sensor that is off"
    aliases = ("sensor_delay", "actuator_delay")
    strength = ("offset",)
    shifts_time = True
    in_words = "the clock of {place} is off"
    kind: Literal["time_offset"] = "time_offset"
    offset: float = physical("s", default=0.0, description="positive when it reports late")

    def changed(self, sensor: Sensor) -> Sensor:
        """Return the sensor with its clock off."""
        if not self.offset:
            return sensor
        errors = {
            q: sensor.error(q).model_copy(update={"time_offset": sensor.error(q).time_offset + self.offset})
            for q in sensor.quantities
        }
        return sensor.model_copy(update={"errors": errors})


OF_NOISE = "a property of the readings that no motion depends on; `smsid diagnose` finds it"


@register
class Quantisation(ComponentEffect):
    """Readings rounded to a step coarser than stated; an attitude's is of its quaternion's components."""

    summary = "readings rounded to coarser steps than stated"
    strength = ("step",)
    not_estimated = dict.fromkeys(("step",), OF_NOISE)
    in_words = "{place} is read in coarse steps"
    kind: Literal["quantisation"] = "quantisation"
    step: float = physical(
        OF_QUANTITY,
        lower=0.0,
        default=0.0,
        description="of the output; of an attitude that of its quaternion's components [1]",
    )

    @model_validator(mode="after")
    def _of_the_whole_attitude(self) -> Quantisation:
        if self.quantity == "attitude" and (self.component is not None or self.station is not None):
            raise ValueError(
                "an attitude's quaternion is rounded as a whole: leave out `component` and `station`"
            )
        if self.quantity == "attitude" and self.step >= COARSEST_ATTITUDE:
            raise ValueError(f"the step of a quaternion's components is below {COARSEST_ATTITUDE}")
        return self

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the step, of an attitude without unit."""
        found = super().parameters()
        return tuple(replace(p, unit="1") for p in found) if self.quantity == "attitude" else found

    def update(self, error: ErrorModel | ComponentError) -> Mapping[str, Any]:
        """Return the coarser step."""
        return {"quantisation": self.step} if self.step > error.quantisation else {}


@register
class Outliers(ComponentEffect):
    """A share of samples with a large error on top, drawn for every component apart."""

    summary = "single samples far off"
    strength = ("share", "size")
    not_estimated = dict.fromkeys(("share", "size"), OF_NOISE)
    in_words = "{place} has outliers"
    kind: Literal["outliers"] = "outliers"
    share: float = physical("1", lower=0.0, upper=1.0, default=0.0, description="of the samples")
    size: float = physical(
        OF_QUANTITY, lower=0.0, default=0.0, description="standard deviation of what is added to them"
    )

    def update(self, error: ErrorModel | ComponentError) -> Mapping[str, Any]:
        """Return the outliers; raises `DescriptionError` when there are some."""
        if not (self.share and self.size):
            return {}
        if error.outlier_rate and error.outlier_size:
            raise DescriptionError(
                f"[[effect]] '{self.name}': {self.sensor}.{self.quantity} has outliers already.",
                advice="Describe them once.",
            )
        return {"outlier_rate": self.share, "outlier_size": self.size}


@register
class StuckChannel(ComponentEffect):
    """A channel that repeats its last value from ``start`` on; it never sticks when that is not given."""

    summary = "channel that repeats its last value from some time on"
    not_estimated = dict.fromkeys(("start",), OF_NOISE)
    in_words = "{place} is stuck for a while"
    kind: Literal["stuck"] = "stuck"
    start: float | None = physical("s", default=None, description="time from which it is stuck")

    def update(self, error: ErrorModel | ComponentError) -> Mapping[str, Any]:
        """Return the time from which it is stuck; the earliest counts."""
        if self.start is None:
            return {}
        return {"stuck_from": self.start if error.stuck_from is None else min(self.start, error.stuck_from)}
