"""The measured motion of a free-floating spacecraft, prepared for regression: filtered, on one clock."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.spatial.transform import Rotation

from smsid.errors import RecordingError
from smsid.model.spacecraft import SpacecraftModel, set_group_angles
from smsid.recording import Recording
from smsid.sensing import Sensor, differentiate, zero_phase
from smsid.simulate.truth import station_indices


@dataclass(frozen=True)
class Roles:
    """Which sensor of the description plays which part. ``panels`` by appendage."""

    pose: Sensor | None
    imu: Sensor
    encoder: Sensor | None
    tachometer: Sensor | None
    panels: dict[str, Sensor]

    @classmethod
    def of(cls, model: SpacecraftModel, recording: Recording, *, joints: bool = True) -> Roles:
        """Find the sensors whose channels the recording has; ``joints``: encoders and tachometers are needed.

        Raises `RecordingError` naming what is missing.
        """

        def find(kind: str, quantities: tuple[str, ...], needed: bool) -> Sensor | None:
            sensors = [s for s in model.description.sensor if s.kind == kind and set(quantities) <= set(s.quantities)]
            for s in sensors:
                if all(f"{s.name}.{q}" in recording for q in quantities):
                    return s
            if needed:
                wanted = [f"{s.name}.{q}" for s in sensors for q in quantities]
                raise RecordingError(
                    f"Recording '{recording.name}' has no {kind} with {', '.join(quantities)}.",
                    advice=f"It needs the channels {', '.join(wanted)}."
                    if wanted
                    else f"The description needs a sensor of kind '{kind}'.",
                    missing=wanted,
                    present=list(recording.channels),
                )
            return None

        pose = find("pose", ("position", "attitude", "velocity"), joints)
        imu = find("imu", ("acceleration", "angular_rate"), True)
        assert imu is not None
        panels = {
            str(s.appendage): s
            for s in model.description.sensor
            if s.kind == "accelerometers" and f"{s.name}.acceleration" in recording
        }
        return cls(
            pose,
            imu,
            find("encoder", ("joint_position", "joint_velocity"), joints and len(model.arm_joints) > 0),
            find("tachometer", ("wheel_rate",), joints and len(model.wheels) > 0),
            panels,
        )


@dataclass(frozen=True)
class Motion:
    """Measured motion on a common clock (N,), body vectors in bus axes.

    ``position`` of P (N, 3) inertial [m]; ``rotation`` (N, 3, 3) bus to inertial; ``velocity`` of P (N, 3) bus
    axes [m/s]; ``rate``, ``rate_derivative`` [rad/s, rad/s^2]; ``acceleration`` of the IMU's point [m/s^2];
    ``angles``, ``angle_rates`` of the arm joints; ``wheel_rates``; ``panels`` (N, stations, 3) by appendage.
    ``pose_point``, ``imu_point`` in the bus frame [m].
    """

    time: np.ndarray
    position: np.ndarray
    rotation: np.ndarray
    velocity: np.ndarray
    rate: np.ndarray
    rate_derivative: np.ndarray
    acceleration: np.ndarray
    angles: np.ndarray
    angle_rates: np.ndarray
    wheel_rates: np.ndarray
    panels: dict[str, np.ndarray]
    stations: dict[str, np.ndarray]
    pose_point: np.ndarray
    imu_point: np.ndarray

    def __len__(self) -> int:
        return len(self.time)

    @property
    def step(self) -> float:
        """Sampling time T_s [s]."""
        return float(self.time[1] - self.time[0])

    def thinned(self, factor: int) -> Motion:
        """Return every ``factor``-th sample; what was low-passed for it loses nothing."""
        changed = {
            f.name: getattr(self, f.name)[::factor]
            for f in fields(self)
            if f.name not in ("panels", "stations", "pose_point", "imu_point")
        }
        return replace(self, **changed, panels={k: x[::factor] for k, x in self.panels.items()})

    def rigid_acceleration(self, point: np.ndarray) -> np.ndarray:
        """Return the acceleration of a bus-fixed point (3,), or points (N, 3), in bus axes (N, 3)."""
        arm = point - self.imu_point
        swing = np.cross(self.rate, np.cross(self.rate, arm))
        return self.acceleration + np.cross(self.rate_derivative, arm) + swing

    def bus_velocity(self) -> np.ndarray:
        """Return the velocity of the bus origin in bus axes (N, 3)."""
        return self.velocity - np.cross(self.rate, self.pose_point)

    def states(self, model: SpacecraftModel) -> tuple[np.ndarray, np.ndarray]:
        """Return q (N, nq) and v (N, nv) of the model with slosh and modes at rest; fill those in yourself."""
        n = len(self)
        q, v = np.tile(model.home, (n, 1)), np.zeros((n, model.nv))
        if len(model.arm_joints):
            q = np.array([set_group_angles(model.pin, model.arm_joints, a, b) for a, b in zip(q, self.angles, strict=True)])
            v[:, model.arm_joints.v] = self.angle_rates
        q[:, 0:3] = self.position - np.einsum("nij,j->ni", self.rotation, self.pose_point)
        q[:, 3:7] = Rotation.from_matrix(self.rotation).as_quat()
        v[:, 0:3], v[:, 3:6] = self.bus_velocity(), self.rate
        if len(model.wheels):
            v[:, model.wheels.v] = self.wheel_rates
        return q, v


def prepare(
    model: SpacecraftModel,
    recording: Recording,
    *,
    cutoff: float | None = 2.0,
    rate: float | None = 20.0,
) -> Motion:
    """Return the measured motion, low-passed without phase at ``cutoff`` [Hz], thinned to about ``rate`` [Hz].

    ``cutoff = None`` leaves the samples as they are. Raises `RecordingError` for missing or unusable channels.
    """
    roles = Roles.of(model, recording)
    assert roles.pose is not None
    used = [*roles.pose.channels, *roles.imu.channels]
    used += [c for s in (roles.encoder, roles.tachometer, *roles.panels.values()) if s for c in s.channels]
    clock = recording.time(roles.imu.channels[0])
    if any(not np.array_equal(recording.time(c), clock) for c in used):
        start = max(float(recording.time(c)[0]) for c in used)
        stop = min(float(recording.time(c)[-1]) for c in used)
        recording = recording.resampled(clock[(clock >= start) & (clock <= stop)])
        clock = recording.time(roles.imu.channels[0])
    fs = 1.0 / float(np.median(np.diff(clock)))
    thin = max(1, round(fs / rate)) if rate else 1

    def smooth(x: np.ndarray) -> np.ndarray:
        return zero_phase(x, fs, cutoff) if cutoff is not None and x.size else np.asarray(x)

    def get(sensor: Sensor | None, quantity: str, width: int) -> np.ndarray:
        if sensor is None:
            return np.zeros((len(clock[::thin]), width))
        return smooth(recording[f"{sensor.name}.{quantity}"])[::thin]

    attitude = recording[f"{roles.pose.name}.attitude"]
    flips = np.cumprod(np.where(np.sum(attitude[1:] * attitude[:-1], axis=1) < 0, -1.0, 1.0))
    attitude = smooth(attitude * np.concatenate([[1.0], flips])[:, None])[::thin]
    rotation = Rotation.from_quat(attitude).as_matrix()
    gyro = recording[f"{roles.imu.name}.angular_rate"]
    derivative = differentiate(gyro, fs, cutoff if cutoff is not None else 0.2 * fs)[::thin]
    velocity = get(roles.pose, "velocity", 3)
    panels = {name: get(s, "acceleration", 3) for name, s in roles.panels.items()}
    stations = {
        a.appendage.name: station_indices(a, roles.panels[a.appendage.name])
        for a in model.appendages
        if a.appendage.name in roles.panels
    }
    return Motion(
        time=clock[::thin],
        position=get(roles.pose, "position", 3),
        rotation=rotation,
        velocity=np.einsum("nji,nj->ni", rotation, velocity),
        rate=get(roles.imu, "angular_rate", 3),
        rate_derivative=derivative,
        acceleration=get(roles.imu, "acceleration", 3),
        angles=get(roles.encoder, "joint_position", len(model.arm_joints)),
        angle_rates=get(roles.encoder, "joint_velocity", len(model.arm_joints)),
        wheel_rates=get(roles.tachometer, "wheel_rate", len(model.wheels)),
        panels=panels,
        stations=stations,
        pose_point=np.asarray(roles.pose.position),
        imu_point=np.asarray(roles.imu.position),
    )
