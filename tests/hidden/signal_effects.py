"""Hidden effects between command and plant, and between motion and reading."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from .effect import Hidden, plain
from .experiment import RATE, column_names
from .numbers import JOINTS, WHEELS, Numbers
from .plant import Change
from .sensors import NOISE, channel_names, turned

Array = np.ndarray
ACTUATOR, SENSOR = ("actuator",), ("sensor",)


def actuator_effects(n: Numbers) -> list[Hidden]:
    """Everything that may be hidden between the commands and a world."""
    motors = [c for c in column_names(n) if not c.startswith("thruster")]
    found = [
        Hidden(
            "torque_gain", ACTUATOR, m, "error", "1", lambda x, onset, rng, m=m: _gain(m, x, onset), 0.003,
            cap=0.5, signed=True, onset=True,
        )
        for m in motors
    ]  # fmt: skip
    groups = [*motors, *(["thruster"] if n.free else [])]
    for g in groups:
        found.append(
            Hidden(
                "actuator_delay", ACTUATOR, g, "delay", "s", plain(lambda x, g=g: Change(delay={g: x})), 2e-4,
                cap=0.04,
            )
        )  # fmt: skip
    if n.free:
        for k, axis in enumerate("xyz"):
            found.append(
                Hidden(
                    "thruster_gain", ACTUATOR, "thruster", f"gain.{axis}", "1",
                    lambda x, onset, rng, a=axis: _gain(f"thruster.{a}", x, onset), 0.005,
                    cap=0.5, signed=True, onset=True,
                )
            )  # fmt: skip
            found.append(
                Hidden(
                    "thruster_misalignment", ACTUATOR, "thruster", f"angles.{axis}", "rad",
                    plain(lambda x, k=k: _turn(np.eye(3)[k] * x)), 0.005, cap=0.4, signed=True,
                )
            )  # fmt: skip
    for joint in JOINTS:
        found.append(
            Hidden(
                None, ("actuator", "friction"), joint, "size", "1",
                lambda x, onset, rng, j=joint: _drift(j, x), 0.01, cap=0.8, label="temperature_drift",
            )
        )  # fmt: skip
        found.append(
            Hidden(
                None, ("actuator", "friction", "drivetrain"), joint, "size", "N m",
                lambda x, onset, rng, j=joint: _coloured(j, x, rng), 0.02, cap=20.0, label="random_torque",
            )
        )  # fmt: skip
    return found


def _columns(columns: tuple[str, ...], name: str) -> list[int]:
    return [i for i, c in enumerate(columns) if c == name or c.startswith(f"{name}.")]


def _scaled(name: str, factor: Callable[[Array], Array]) -> Change:
    def command(t: Array, values: Array, columns: tuple[str, ...]) -> Array:
        out = values.copy()
        out[:, _columns(columns, name)] *= factor(t)[:, None]
        return out

    return Change(command=command)


def _gain(name: str, error: float, onset: float | None) -> Change:
    return _scaled(name, lambda t: 1.0 + error * (t >= (onset or 0.0)))


def _drift(name: str, size: float) -> Change:
    """The torque constant falls as the motor warms up, and recovers a little."""
    return _scaled(name, lambda t: 1.0 - size * (1 - np.exp(-t / 25.0)) * (1 + 0.4 * np.sin(t / 9.0)))


def _turn(angles: Array) -> Change:
    angle = np.linalg.norm(angles)
    if angle == 0.0:
        return Change()
    x, y, z = angles / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    r = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k

    def command(t: Array, values: Array, columns: tuple[str, ...]) -> Array:
        out, i = values.copy(), _columns(columns, "thruster")
        out[:, i] = values[:, i] @ r.T
        return out

    return Change(command=command)


def _coloured(name: str, size: float, rng: np.random.Generator) -> Change:
    """First-order noise of standard deviation `size`, correlated over 0.5 s."""
    if not size:
        return Change()
    seed = int(rng.integers(2**32))

    def command(t: Array, values: Array, columns: tuple[str, ...]) -> Array:
        draws = np.random.default_rng(seed).standard_normal(len(t))
        keep = np.exp(-(t[1] - t[0]) / 0.5)
        noise = np.zeros(len(t))
        for k in range(len(t)):
            noise[k] = keep * noise[k - 1] + np.sqrt(1 - keep**2) * draws[k] if k else draws[0]
        out = values.copy()
        out[:, _columns(columns, name)] += size * noise[:, None]
        return out

    return Change(command=command)


SCALED = ("angular_rate", "acceleration", "wheel_rate", "joint_velocity")
TURNED = ("angular_rate", "acceleration")
LATE = ("joint_position", "angular_rate", "acceleration", "attitude", "position", "velocity")


def sensor_effects(n: Numbers, *, every: bool = False) -> list[Hidden]:
    """What may be wrong with a world's sensors; with ``every``, also what one channel shows for others."""
    found: list[Hidden] = []
    for channel in channel_names(n):
        source, quantity = channel.split(".")
        sigma, columns = NOISE[channel], 3
        if channel == "panel.acceleration":
            continue
        also = (source, channel)
        axes = range(columns)
        for k in axes:
            single = quantity in ("joint_position", "joint_velocity", "wheel_rate")
            index = "" if single else "." + "xyz"[k]
            place = f"{channel}[{(WHEELS if quantity == 'wheel_rate' else JOINTS)[k]}]" if single else channel
            turned = quantity == "attitude"  # by more than half a turn is by less the other way
            turn, most = (("sensor_misalignment",), np.pi) if turned else ((), np.inf)
            found.append(
                Hidden(
                    "sensor_bias", SENSOR, place, f"bias{index}", _unit(quantity),
                    lambda x, onset, rng, c=channel, k=k: _bias(c, k, x, onset), 0.3 * sigma,
                    cap=min(1e5 * sigma, most), signed=True, onset=True, also=also, others=turn,
                )
            )  # fmt: skip
            if quantity in SCALED or (every and quantity != "attitude"):
                found.append(
                    Hidden(
                        "sensor_scale", SENSOR, place, f"scale{index}", "1",
                        plain(lambda x, c=channel, k=k: _scale(c, k, x)), 0.002,
                        cap=0.5, signed=True, also=also,
                    )
                )  # fmt: skip
            if quantity in TURNED or (every and quantity in ("position", "velocity")):
                found.append(
                    Hidden(
                        "sensor_misalignment", SENSOR, channel, f"angles{index}", "rad",
                        plain(lambda x, c=channel, k=k: _misaligned(c, np.eye(3)[k] * x)), 0.003,
                        cap=0.4, signed=True, also=also,
                    )
                )  # fmt: skip
        if quantity in LATE or (every and quantity == "joint_velocity"):
            found.append(
                Hidden(
                    "sensor_delay", SENSOR, channel, "delay", "s",
                    plain(lambda x, c=channel: Change(shift={c: x}) if x else Change()), 5e-4,
                    cap=0.04, also=also,
                    others=("time_offset",),
                )
            )  # fmt: skip
        samples = 80.0 * RATE
        found += [
            Hidden(
                "quantisation", SENSOR, channel, "step", "1" if quantity == "attitude" else _unit(quantity),
                plain(lambda x, c=channel: _read(c, lambda t, y, rng, x=x: _round(y, x))), sigma,
                cap=100 * sigma, also=also, rule=sigma * (12 * 5.4 * (2 / (columns * samples)) ** 0.5) ** 0.5,
            ),
            Hidden(
                "outliers", SENSOR, channel, "rate", "1",
                plain(
                    lambda x, c=channel, s=sigma: _read(
                        c, lambda t, y, rng, x=x: _outliers(y, x, 12 * s, rng)
                    )
                ),
                0.01, cap=0.1, also=also, rule=3.0 / samples,
            ),
        ]  # fmt: skip
        if quantity != "attitude":
            found.append(
                Hidden(
                    "stuck", SENSOR, channel, "duration", "s",
                    plain(lambda x, c=channel: _read(c, lambda t, y, rng, x=x: _stuck(t, y, x))), 0.5,
                    cap=60.0, also=also, rule=0.6,
                )
            )  # fmt: skip
    if n.free:
        for source in ("pose", "imu"):
            for k, axis in enumerate("xyz"):
                found.append(
                    Hidden(
                        "lever_arm", SENSOR, source, f"offset.{axis}", "m",
                        plain(lambda x, s=source, k=k: Change(lever={s: np.eye(3)[k] * x})), 1e-3, cap=0.5,
                        signed=True,
                    )
                )  # fmt: skip
        for source in ("pose", "imu", "tachometer"):
            found.append(_time_offset(source))
    found.append(_time_offset("encoder"))
    return found


def _time_offset(source: str) -> Hidden:
    return Hidden(
        "time_offset", SENSOR, source, "offset", "s",
        plain(lambda x, s=source: Change(shift={s: x}) if x else Change()), 5e-4, cap=0.04,
        signed=source != "imu",  # read early, it would be read after the command has changed
        others=("sensor_delay",),
    )  # fmt: skip


UNITS = {
    "position": "m", "attitude": "rad", "velocity": "m/s", "angular_rate": "rad/s", "acceleration": "m/s^2",
    "joint_position": "rad", "joint_velocity": "rad/s", "wheel_rate": "rad/s",
}  # fmt: skip


def _unit(quantity: str) -> str:
    return UNITS[quantity]


def _ideal(channel: str, fault: Callable[[Array, Array], Array]) -> Change:
    return Change(ideal=((channel, fault),))


def _read(channel: str, fault: Callable[..., Array]) -> Change:
    return Change(read=((channel, fault),))


def _bias(channel: str, axis: int, size: float, onset: float | None) -> Change:
    def fault(t: Array, x: Array) -> Array:
        error = np.zeros((len(t), 3))
        error[:, axis] = size * (t >= (onset or 0.0))
        return turned(x, error) if channel == "pose.attitude" else x + error

    return _ideal(channel, fault) if size else Change()


def _scale(channel: str, axis: int, size: float) -> Change:
    return _ideal(channel, lambda t, x: x * (1.0 + size * np.eye(3)[axis]))


def _misaligned(channel: str, angles: Array) -> Change:
    def fault(t: Array, x: Array) -> Array:
        return Rotation.from_rotvec(angles).apply(x, inverse=True)  # what the turned axes see of x

    return _ideal(channel, fault)


def _round(y: Array, step: float) -> Array:
    if not step:
        return y
    out = np.round(y / step) * step
    return out / np.linalg.norm(out, axis=1, keepdims=True) if y.shape[1] == 4 else out


def _outliers(y: Array, rate: float, size: float, rng: np.random.Generator) -> Array:
    hit = rng.uniform(size=len(y)) < rate
    jump = size * rng.standard_t(3, (len(y), 3))
    if y.shape[1] == 4:
        return turned(y, hit[:, None] * jump) if hit.any() else y
    return y + hit[:, None] * jump


def _stuck(t: Array, y: Array, duration: float) -> Array:
    """The last `duration` [s] repeat the first component's last good reading."""
    out = y.copy()
    held = t > t[-1] - duration
    if duration > 0.0 and held.any():
        out[held, 0] = y[np.argmax(held), 0]
    return out
