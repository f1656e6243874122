"""A sensor: what it measures, where it sits, how often and how badly; presets of real instruments."""

from __future__ import annotations

import copy
import tomllib
from collections.abc import Mapping
from functools import cache, partial
from importlib import resources
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BaseModel, ConfigDict, Field, model_validator
from scipy.spatial.transform import Rotation

from smsid._listing import did_you_mean
from smsid.errors import DescriptionError, RecordingError
from smsid.sensing.error_model import COARSEST_ATTITUDE, ErrorModel, Magnitude, Positive, Triple
from smsid.sensing.signals import FloatArray, compose

Kind = Literal["pose", "imu", "encoder", "tachometer", "accelerometers"]
Station = Annotated[int, Field(ge=0, strict=True)]

MEASURES: dict[str, tuple[str, ...]] = {
    "pose": ("position", "attitude", "velocity"),
    "imu": ("acceleration", "angular_rate"),
    "encoder": ("joint_position", "joint_velocity"),
    "tachometer": ("wheel_rate",),
    "accelerometers": ("acceleration",),
}
"""What each kind of sensor measures (section 3 of the design gives units, frames and shapes)."""

RESERVED = ("command", "truth", "extra", "start")
"""Sources that are no sensor's."""

_BODY = ("acceleration", "angular_rate")
_PER_JOINT = ("joint_position", "joint_velocity", "wheel_rate")


class Sensor(BaseModel):
    """One sensor of the spacecraft; its ``name`` is the source of its channels, ``<name>.<quantity>``.

    A star tracker is a ``pose`` sensor with ``quantities = ["attitude"]``.

    Attributes:
        name: source of the channels; letters, digits, ``_`` and ``-``.
        kind: ``pose`` (position, attitude, velocity), ``imu`` (acceleration, angular_rate), ``encoder``
            (joint_position, joint_velocity), ``tachometer`` (wheel_rate), or ``accelerometers`` on an
            appendage (acceleration at its stations).
        rate: samples per second [Hz].
        position: of the sensor in the bus frame [m]; what it measures is the motion of this point.
        orientation: roll, pitch, yaw [rad] (URDF's: fixed axes x, y, z) of the sensor in the bus frame.
            Channels are in the bus frame all the same; the errors act along the sensor's own axes.
        appendage: name of the appendage that carries the accelerometers.
        stations: where on the appendage: indices of its stations (integers), or distances from its root [m]
            (numbers with a point). All its stations when not given.
        quantities: which of the kind's quantities are measured; all when not given.
        errors: error model by quantity; a quantity without one is measured perfectly.
        preset: name of a preset (`preset_names`) that supplies ``rate``, ``errors``, perhaps ``quantities``.
            Keys given here override it one by one, down to the keys of each error model.

    Raises:
        pydantic.ValidationError: unknown key, missing rate, or fields that do not fit the kind.
        DescriptionError: unknown preset (with the closest names), or one for another kind.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")]
    kind: Kind
    rate: Positive
    position: Triple = (0.0, 0.0, 0.0)
    orientation: Triple = (0.0, 0.0, 0.0)
    appendage: str | None = None
    stations: (
        Annotated[tuple[Station, ...], Field(min_length=1)]
        | Annotated[tuple[Magnitude, ...], Field(min_length=1)]
        | None
    ) = None
    quantities: tuple[str, ...] = ()
    errors: dict[str, ErrorModel] = Field(default_factory=dict)
    preset: str | None = None

    @model_validator(mode="before")
    @classmethod
    def _fill_from_preset(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            return data
        fields = dict(data)
        if isinstance(fields.get("preset"), str):  # anything else is refused as its field is
            fields = _overlay(preset(fields["preset"], fields.get("kind")), fields)
        if not fields.get("quantities"):
            fields["quantities"] = MEASURES.get(str(fields.get("kind")), ())
        return fields

    @model_validator(mode="after")
    def _fits_kind(self) -> Sensor:
        if self.name in RESERVED:
            raise ValueError(f"'{self.name}' is not free as the name of a sensor")
        allowed = MEASURES[self.kind]
        strange = [q for q in self.quantities if q not in allowed]
        if strange or len(set(self.quantities)) != len(self.quantities):
            raise ValueError(
                f"quantities of a sensor of kind {self.kind} are of {', '.join(allowed)}, each once"
            )
        for quantity, model in self.errors.items():
            if quantity not in self.quantities:
                raise ValueError(
                    f"errors are given for '{quantity}', which '{self.name}' does not measure; it measures "
                    f"{', '.join(self.quantities)}"
                )
            if quantity in _PER_JOINT and model.misaligned:
                raise ValueError(f"misalignment has no meaning for {quantity}")
            if quantity == "attitude" and model.not_of_attitude:
                raise ValueError(f"{', '.join(model.not_of_attitude)} has no meaning for an attitude")
            if quantity == "attitude" and model.quantisation >= COARSEST_ATTITUDE:
                raise ValueError(f"the step of a quaternion's components is below {COARSEST_ATTITUDE}")
        if self.kind == "accelerometers" and self.appendage is None:
            raise ValueError(f"accelerometers '{self.name}' need the name of their appendage")
        if self.kind != "accelerometers" and (self.appendage is not None or self.stations is not None):
            raise ValueError(f"appendage and stations belong to kind accelerometers, not {self.kind}")
        if self.stations is not None and len(set(self.stations)) != len(self.stations):
            raise ValueError("stations repeat")
        return self

    @property
    def channels(self) -> tuple[str, ...]:
        """The channels it records, ``<name>.<quantity>``."""
        return tuple(f"{self.name}.{q}" for q in self.quantities)

    @property
    def rotation(self) -> FloatArray:
        """(3, 3) matrix that takes sensor axes to bus axes."""
        return Rotation.from_euler("xyz", self.orientation).as_matrix()

    def error(self, quantity: str) -> ErrorModel:
        """Return the error model of a quantity; a perfect one when none is given.

        Raises:
            DescriptionError: the sensor does not measure it.
        """
        if quantity not in self.quantities:
            raise DescriptionError(
                f"The sensor '{self.name}' does not measure {quantity}.",
                advice=f"It measures {', '.join(self.quantities)}.",
                sensor=self.name,
                quantity=quantity,
            )
        return self.errors.get(quantity, ErrorModel())

    def measure(
        self,
        quantity: str,
        times: ArrayLike,
        ideal: ArrayLike,
        rng: np.random.Generator | None,
        *,
        delayed: bool = False,
    ) -> FloatArray:
        """Return what the sensor reports of one quantity.

        Body vectors are turned to the sensor's axes, given its errors, and turned back; an attitude is that
        of the sensor while the errors act.

        Args:
            quantity: one of ``quantities``.
            times: (N,) sampling times [s].
            ideal: (N, ...) true values, shape, frame and unit of the quantity; body vectors are in the bus
                frame, at the sensor's position.
            rng: source of every draw; ``None``: nothing is drawn, saturated or rounded.
            delayed: ``ideal`` is already the truth at ``t`` less delay and time offset.

        Raises:
            DescriptionError: the sensor does not measure it, or an error term does not fit its shape.
            RecordingError: the shape is not that of the quantity, or times or values are unusable (see
                `ErrorModel.apply`).
        """
        model, attitude = self.error(quantity), quantity == "attitude"
        x = np.asarray(ideal, dtype=float)
        self._check_shape(quantity, x.shape)
        rate = None if np.size(times) > 1 else self.rate
        report = partial(model.apply, times, rng=rng, attitude=attitude, rate=rate, delayed=delayed)
        if not any(self.orientation) or not (attitude or quantity in _BODY):
            return report(ideal=x)
        if attitude:
            mount = Rotation.from_euler("xyz", self.orientation)
            return compose(report(ideal=compose(x, mount)), mount.inv())
        to_bus = self.rotation
        return report(ideal=x @ to_bus) @ to_bus.T

    def _check_shape(self, quantity: str, shape: tuple[int, ...]) -> None:
        if self.kind == "accelerometers":
            fits = len(shape) == 3 and shape[2] == 3 and len(self.stations or range(shape[1])) == shape[1]
            wanted = f"(N, {'stations' if self.stations is None else len(self.stations)}, 3)"
        elif quantity in _PER_JOINT:
            fits, wanted = len(shape) == 2, "(N, joints)"
        else:
            columns = 4 if quantity == "attitude" else 3
            fits, wanted = len(shape) == 2 and shape[1] == columns, f"(N, {columns})"
        if not fits:
            raise RecordingError(
                f"'{self.name}.{quantity}' has shape {shape}, not {wanted}.",
                advice="See the table of quantities.",
                sensor=self.name,
                quantity=quantity,
                shape=shape,
            )


def _overlay(base: dict[str, Any], explicit: dict[str, Any]) -> dict[str, Any]:
    """Return the preset's fields with the explicit ones on top, error models merged key by key."""
    merged = {**base, **{k: v for k, v in explicit.items() if v is not None}}
    errors = dict(explicit.get("errors") or {})
    quantities = explicit.get("quantities") or base.get("quantities")
    for quantity, supplied in base["errors"].items():
        given = errors.get(quantity)
        if quantities and quantity not in quantities and given is None:
            continue
        if given is None:
            errors[quantity] = supplied
        elif isinstance(given, Mapping):
            kept = dict(supplied)
            # Noise by density and noise by sigma exclude each other: what is given displaces the other.
            for one, other in (("noise_sigma", "noise_density"), ("noise_density", "noise_sigma")):
                if given.get(one) is not None:
                    kept.pop(other, None)
            errors[quantity] = {**kept, **given}
    merged["errors"] = errors
    return merged


@cache
def _table() -> dict[tuple[str, str], dict[str, Any]]:
    text = resources.files("smsid.sensing").joinpath("presets.toml").read_text(encoding="utf-8")
    return {(p["name"], p["kind"]): p for p in tomllib.loads(text)["preset"]}


def preset_names(kind: str | None = None) -> tuple[str, ...]:
    """Return the names of the presets, of one ``kind`` of sensor or all of them, sorted."""
    return tuple(sorted({name for name, of in _table() if kind is None or of == kind}))


def preset(name: str, kind: str | None = None) -> dict[str, Any]:
    """Return the fields a preset gives a `Sensor`: ``kind``, ``rate``, ``errors``, perhaps ``quantities``.

    ``Sensor(name="imu", kind="imu", preset="stim300")`` is the usual way; this is for reading the numbers.

    Args:
        name: one of `preset_names`.
        kind: kind of the sensor; needed for a preset that covers several (``reference``).

    Raises:
        DescriptionError: no such preset, or ``kind`` is missing or wrong.
    """
    entry = dict(_entry(name, kind))
    del entry["name"], entry["source"]
    return copy.deepcopy(entry)


def _entry(name: str, kind: str | None) -> dict[str, Any]:
    table = _table()
    kinds = [of for known, of in table if known == name]
    if not kinds:
        raise DescriptionError(
            f"There is no sensor preset '{name}'.{did_you_mean(name, preset_names())}",
            advice=f"Known: {', '.join(preset_names())}.",
            name=name,
            known=preset_names(),
        )
    if kind is None and len(kinds) == 1:
        return table[name, kinds[0]]
    if kind not in kinds:
        raise DescriptionError(
            f"The sensor preset '{name}' is for {', '.join(kinds)}"
            + (f", not {kind}." if kind is not None else "; kind is not given."),
            advice="Give the sensor one of these kinds"
            + (f", or one of the presets for {kind}: {', '.join(preset_names(kind))}." if kind else "."),
            name=name,
            kind=kind,
            kinds=kinds,
        )
    return table[name, kind]
