"""The catalogue of quantities a recording may hold, and the names of channels."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from smsid._listing import did_you_mean
from smsid.errors import RecordingError

Frame = Literal[
    "inertial", "body", "body to inertial", "joint axis", "wheel axis", "mode", "thruster", "unspecified"
]

AXES = ("x", "y", "z")
QUATERNION_ORDER = ("x", "y", "z", "w")
FIXED_LABELS = MappingProxyType({"axis": AXES, "quaternion": QUATERNION_ORDER})
"""Dimensions whose size and labels never vary."""

LABELLED_DIMS = ("joint", "wheel", "mode", "thruster", "station")
"""Dimensions whose labels a recording states."""

SLIDING = MappingProxyType(
    {
        "rad": "m",
        "rad/s": "m/s",
        "rad/s^2": "m/s^2",
        "N m": "N",
        "N m s/rad": "N s/m",
        "N m s^2/rad^2": "N s^2/m^2",
        "N m s^3/rad^3": "N s^3/m^3",
        "rad/(N m)": "m/N",
        "N m/rad": "N/m",
        "N m/K": "N/K",
        "N m s/(rad K)": "N s/(m K)",
        "kg m^2": "kg",
    }
)
"""Units of a joint that turns, and of the same quantity of one that slides."""

EXTRA = "extra"
"""The source of channels that are outside the catalogue; they state their own unit."""


@dataclass(frozen=True)
class Quantity:
    """What a channel measures: its unit, its frame and the dimensions after time.

    ``dims`` holds the admissible trailing dimensions: ``(("axis",), ("station", "axis"))`` means (N, 3) or
    (N, stations, 3). An empty ``dims`` admits any trailing shape (user channels only).
    """

    name: str
    unit: str
    frame: Frame
    dims: tuple[tuple[str, ...], ...]
    meaning: str = ""

    @property
    def is_quaternion(self) -> bool:
        """Whether the samples are unit quaternions (x, y, z, w)."""
        return self.dims == (("quaternion",),)

    @property
    def is_vector(self) -> bool:
        """Whether the last dimension is x, y, z in the inertial or the body frame."""
        return bool(self.dims) and self.dims[0][-1] == "axis"

    def shapes(self) -> str:
        """Describe the admissible shapes: ``(N, 3) or (N, station, 3)``."""
        if not self.dims:
            return "(N, ...)"
        texts = []
        for dims in self.dims:
            sizes = [str(len(FIXED_LABELS[dim])) if dim in FIXED_LABELS else dim for dim in dims]
            texts.append(f"({', '.join(['N', *sizes])})")
        return " or ".join(texts)

    def dims_of(self, trailing: tuple[int, ...]) -> tuple[str, ...] | None:
        """Find the dimensions that fit the trailing shape, or None."""
        if not self.dims:
            return tuple(f"{EXTRA}.{self.name}.{k}" for k in range(len(trailing)))
        for dims in self.dims:
            if len(dims) == len(trailing) and all(
                size > 0 and (dim not in FIXED_LABELS or size == len(FIXED_LABELS[dim]))
                for dim, size in zip(dims, trailing, strict=True)
            ):
                return dims
        return None


def _catalogue() -> dict[str, Quantity]:
    vector, joints, wheels, modes = (("axis",),), (("joint",),), (("wheel",),), (("mode",),)
    rows = (
        Quantity("position", "m", "inertial", vector, "position of the sensor"),
        Quantity("velocity", "m/s", "inertial", vector, "velocity of the sensor"),
        Quantity("attitude", "1", "body to inertial", (("quaternion",),), "unit quaternion x, y, z, w"),
        Quantity("angular_rate", "rad/s", "body", vector, "angular velocity of the bus"),
        Quantity("angular_acceleration", "rad/s^2", "body", vector, "angular acceleration of the bus"),
        Quantity("acceleration", "m/s^2", "body", (("axis",), ("station", "axis")), "specific force"),
        Quantity("joint_position", "rad", "joint axis", joints, "joint angle"),
        Quantity("joint_velocity", "rad/s", "joint axis", joints, "joint rate"),
        Quantity("joint_acceleration", "rad/s^2", "joint axis", joints, "joint acceleration"),
        Quantity("joint_torque", "N m", "joint axis", joints, "motor torque on the child"),
        Quantity("joint_temperature", "degC", "joint axis", joints, "temperature of the joint or its motor"),
        Quantity("wheel_rate", "rad/s", "wheel axis", wheels, "wheel speed relative to the bus"),
        Quantity("wheel_torque", "N m", "wheel axis", wheels, "motor torque on the wheel"),
        Quantity("thruster", "1", "thruster", (("thruster",),), "share of full thrust: on-time or throttle"),
        Quantity("thruster_force", "N", "thruster", (("thruster",),), "force along each thruster"),
        Quantity("force", "N", "body", vector, "force on the bus"),
        Quantity("torque", "N m", "body", vector, "torque on the bus"),
        Quantity("slosh_position", "m", "body", vector, "slosh mass from its rest point `c_s`"),
        Quantity("slosh_velocity", "m/s", "body", vector, "rate of `slosh_position`, in body axes"),
        Quantity("modal_position", "kg^0.5 m", "mode", modes, "mass-normalised modal coordinate"),
        Quantity("modal_velocity", "kg^0.5 m/s", "mode", modes, "rate of `modal_position`"),
    )
    return {row.name: row for row in rows}


QUANTITIES = MappingProxyType(_catalogue())
"""Every known quantity by its name."""


def split_channel(channel: str) -> tuple[str, str]:
    """Split ``imu.acceleration`` into source and quantity name.

    Raises:
        RecordingError: the name is not ``<source>.<quantity>``, or the quantity is ``time``, which is
            a clock and no channel.
    """
    source, dot, name = channel.partition(".")
    if not (source and dot and name):
        raise RecordingError(
            f"'{channel}' is not a channel name.",
            advice="Channels are called <source>.<quantity>, as in 'imu.acceleration'.",
            channel=channel,
        )
    if name == "time":
        raise RecordingError(
            f"'{channel}' is the clock of '{source}', not a channel.",
            advice="Give a source its own clock by passing (time, array) for its channels.",
            channel=channel,
        )
    return source, name


def quantity_of(channel: str, *, unit: str | None = None) -> Quantity:
    """Look up the quantity of a channel: ``quantity_of("imu.acceleration").unit == "m/s^2"``.

    A channel ``extra.<anything>`` is outside the catalogue and takes its ``unit`` from the caller; for every
    other channel a ``unit`` must be the one of the catalogue.

    Raises:
        RecordingError: malformed name, unknown quantity (the known ones are listed), an extra channel without
            unit, or another unit than the catalogue's.
    """
    source, name = split_channel(channel)
    if source == EXTRA:
        if not unit:
            raise RecordingError(
                f"The user channel '{channel}' has no unit.",
                advice=f"State it: units={{'{channel}': 'K'}} ('1' for a pure number).",
                channel=channel,
            )
        return Quantity(name, unit, "unspecified", ())
    if name not in QUANTITIES:
        meant = did_you_mean(channel, [f"{source}.{known}" for known in QUANTITIES])
        raise RecordingError(
            f"Channel '{channel}': unknown quantity '{name}'.{meant}",
            advice=f"Known quantities: {', '.join(QUANTITIES)}. "
            f"Anything else goes to '{EXTRA}.{name}' with a unit of its own.",
            channel=channel,
            known=tuple(QUANTITIES),
        )
    quantity = QUANTITIES[name]
    if unit is not None and unit != quantity.unit:
        raise RecordingError(
            f"Channel '{channel}' is in '{quantity.unit}', not in '{unit}'.",
            advice="Convert the array first, or import the file with a mapping, which converts units.",
            channel=channel,
            unit=unit,
            expected=quantity.unit,
        )
    return quantity
