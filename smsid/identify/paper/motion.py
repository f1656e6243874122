"""The measured motion of a free-floating spacecraft, prepared for regression: filtered, on one clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from smsid._short_repr import short_repr
from smsid.errors import RecordingError
from smsid.identify.clocks import common_times, event_times, rate_of, sample_channel
from smsid.identify.sensor_roles import Roles
from smsid.model.column_order import order_columns
from smsid.model.spacecraft import SpacecraftModel, set_group_angles
from smsid.model.stations import station_indices
from smsid.recording import Recording
from smsid.sensing import Sensor, differentiate

NOT_SAMPLED = ("panels", "stations", "pose_point", "imu_point", "again")
Rates = dict[str, tuple[np.ndarray, np.ndarray, str]]


@short_repr
@dataclass(frozen=True)
class MeasuredMotion:
    """Measured motion on a common clock (N,), body vectors in bus axes.

    ``position`` of P (N, 3) inertial [m]; ``rotation`` (N, 3, 3) bus to inertial; ``velocity`` of P (N, 3)
    bus axes [m/s]; ``rate``, ``rate_derivative`` [rad/s, rad/s^2]; ``acceleration`` of the IMU's point
    [m/s^2]; ``angles``, ``angle_rates`` of the arm joints; ``wheel_rates``; ``panels`` (N, stations, 3) by
    appendage. ``pose_point``, ``imu_point`` in the bus frame [m]. ``again``: the same from a recording with
    as much noise once more (`shaken`), for telling how accurate the parts of an equation are.
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
    again: MeasuredMotion | None = None

    def __len__(self) -> int:
        return len(self.time)

    @property
    def step(self) -> float:
        """Sampling time T_s [s]."""
        return float(self.time[1] - self.time[0])

    def thinned(self, factor: int) -> MeasuredMotion:
        """Return every ``factor``-th sample; what was low-passed for it loses nothing."""
        return self.only(slice(None, None, factor))

    def only(self, kept: slice | np.ndarray) -> MeasuredMotion:
        """Return some of the samples: a slice, or indices (k,)."""
        return self._map_arrays(lambda motion, name: _samples(motion, name)[kept])

    def followed_by(self, other: MeasuredMotion) -> MeasuredMotion:
        """Return this motion and then another of the same spacecraft."""
        pairs = {id(self): other} | ({id(self.again): other.again} if self.again else {})

        def joined(motion: MeasuredMotion, name: str) -> np.ndarray:
            after = pairs[id(motion)]
            assert after is not None
            return np.concatenate([_samples(motion, name), _samples(after, name)])

        return self._map_arrays(joined)

    def _map_arrays(self, make: Callable[[MeasuredMotion, str], np.ndarray]) -> MeasuredMotion:
        changed = {f.name: make(self, f.name) for f in fields(self) if f.name not in NOT_SAMPLED}
        panels = {k: make(self, k) for k in self.panels}
        return replace(
            self, **changed, panels=panels, again=self.again._map_arrays(make) if self.again else None
        )

    def rigid_acceleration(self, point: np.ndarray) -> np.ndarray:
        """Return the acceleration of a bus-fixed point (3,), or points (N, 3), in bus axes (N, 3)."""
        arm = point - self.imu_point
        swing = np.cross(self.rate, np.cross(self.rate, arm))
        return self.acceleration + np.cross(self.rate_derivative, arm) + swing

    def bus_velocity(self) -> np.ndarray:
        """Return the velocity of the bus origin in bus axes (N, 3)."""
        return self.velocity - np.cross(self.rate, self.pose_point)

    def states(self, model: SpacecraftModel) -> tuple[np.ndarray, np.ndarray]:
        """Return q (N, nq) and v (N, nv) of the model, slosh and modes at rest: fill those in yourself."""
        n = len(self)
        q, v = np.tile(model.home, (n, 1)), np.zeros((n, model.nv))
        arm = model.arm_joints
        if len(arm):
            q = set_group_angles(arm, q, self.angles)
            v[:, model.arm_joints.v] = self.angle_rates
        q[:, 0:3] = self.position - np.einsum("nij,j->ni", self.rotation, self.pose_point)
        q[:, 3:7] = Rotation.from_matrix(self.rotation).as_quat()
        v[:, 0:3], v[:, 3:6] = self.bus_velocity(), self.rate
        if len(model.wheels):
            v[:, model.wheels.v] = self.wheel_rates
        return q, v


def _samples(motion: MeasuredMotion, name: str) -> np.ndarray:
    return motion.panels[name] if name in motion.panels else getattr(motion, name)


def prepare(
    model: SpacecraftModel,
    recording: Recording,
    *,
    cutoff: float | None = 2.0,
    rate: float | None = 20.0,
) -> MeasuredMotion:
    """Return the measured motion, low-passed without phase at ``cutoff`` [Hz], on one clock.

    The clock is the IMU's, thinned to ``rate`` [Hz]; channels on other clocks are interpolated after their
    own filter, and delays that the description states are taken out. ``cutoff = None`` leaves the samples as
    they are. Raises `RecordingError` for missing or unusable channels, or columns that do not fit the model.
    """
    recording = order_columns(recording, model)
    roles = Roles.of(model, recording)
    assert roles.pose is not None and roles.attitude is not None
    sources = [(roles.pose, "position"), (roles.pose, "velocity"), (roles.attitude, "attitude")]
    sources.append((roles.imu, "angular_rate"))
    sources += [(roles.encoder, q) for q in ("joint_position", "joint_velocity") if roles.encoder]
    sources += [(roles.tachometer, "wheel_rate")] if roles.tachometer else []
    sources += [(s, "acceleration") for s in roles.panels.values()]
    full = common_times(recording, (roles.imu, "acceleration"), sources)
    fs = rate_of(recording, roles.imu, "acceleration")
    times = full[:: max(1, round(fs / rate)) if rate else 1]

    def get(sensor: Sensor | None, quantity: str, width: int | None = None) -> np.ndarray:
        if sensor is None:
            return np.zeros((len(times), width or 0))
        found = sample_channel(recording, sensor, quantity, times, cutoff)
        if width is not None and found.shape[1] != width:
            raise RecordingError(
                f"'{sensor.name}.{quantity}' has {found.shape[1]} columns, the description {width}.",
                advice="Recording and description must be of the same spacecraft.",
                columns=found.shape[1],
                expected=width,
            )
        return found

    stations = {
        a.appendage.name: station_indices(a, roles.panels[a.appendage.name])
        for a in model.appendages
        if a.appendage.name in roles.panels
    }
    rotation = Rotation.from_quat(get(roles.attitude, "attitude")).as_matrix()
    gyro = event_times(recording, roles.imu, "angular_rate")
    slope = differentiate(
        recording[f"{roles.imu.name}.angular_rate"], fs, cutoff if cutoff is not None else 0.2 * fs
    )
    return MeasuredMotion(
        time=times,
        position=get(roles.pose, "position"),
        rotation=rotation,
        velocity=np.einsum("nji,nj->ni", rotation, get(roles.pose, "velocity")),
        rate=get(roles.imu, "angular_rate"),
        rate_derivative=_at(gyro, slope, times),
        acceleration=get(roles.imu, "acceleration"),
        angles=get(roles.encoder, "joint_position", len(model.arm_joints)),
        angle_rates=get(roles.encoder, "joint_velocity", len(model.arm_joints)),
        wheel_rates=get(roles.tachometer, "wheel_rate", len(model.wheels)),
        panels={n: get(roles.panels[n], "acceleration", len(chosen)) for n, chosen in stations.items()},
        stations=stations,
        pose_point=np.asarray(roles.pose.position),
        imu_point=np.asarray(roles.imu.position),
    )


def _at(own: np.ndarray, values: np.ndarray, times: np.ndarray) -> np.ndarray:
    index = np.clip(np.searchsorted(own, times), 0, len(own) - 1)
    if np.array_equal(own[index], times):
        return values[index]
    return np.asarray(CubicSpline(own, values, axis=0)(times))


def raw_rates(model: SpacecraftModel, recording: Recording, *, joints: bool = True) -> Rates:
    """Return every measured rate, unfiltered, by what it is: (times (N,) [s], samples (N, k), unit).

    ``joints``: as in `Roles.of`.
    """
    roles = Roles.of(model, recording, joints=joints)
    wanted = [
        ("the velocity of the tracked point", roles.pose, "velocity", "m/s"),
        ("the body rate", roles.imu, "angular_rate", "rad/s"),
        ("a joint's rate", roles.encoder, "joint_velocity", "rad/s"),
        ("a wheel's rate", roles.tachometer, "wheel_rate", "rad/s"),
    ]
    return {
        label: (recording.time(f"{s.name}.{q}"), recording[f"{s.name}.{q}"], unit)
        for label, s, q, unit in wanted
        if s is not None
    }
