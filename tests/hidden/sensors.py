"""What the sensors of a hidden world read: exact channels of a motion, then noise and faults."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from .numbers import JOINTS, WHEELS, Numbers
from .plant import Change, Motion, States
from .shortening import drawn

Array = np.ndarray

NOISE = {  # one sigma per sample; an attitude's is a rotation vector in body axes
    "pose.position": 1e-3,
    "pose.attitude": 1e-4,
    "pose.velocity": 1e-3,
    "imu.angular_rate": 1e-5,
    "imu.acceleration": 1e-4,
    "encoder.joint_position": 1e-5,
    "encoder.joint_velocity": 1e-4,
    "tachometer.wheel_rate": 1e-3,
    "panel.acceleration": 1e-4,
}


def channel_names(n: Numbers) -> tuple[str, ...]:
    """Channels that a world's sensors record."""
    keep = {"encoder"} if not n.free else {"pose", "imu", "encoder", "tachometer"}
    keep |= {"panel"} if n.plate else set()
    return tuple(c for c in NOISE if c.split(".")[0] in keep)


def rotations(quaternion: Array) -> Array:
    """(N, 3, 3) rotations, body to inertial, of quaternions w x y z (N, 4)."""
    w, x, y, z = quaternion.T / np.linalg.norm(quaternion, axis=1)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def quaternion_product(a: Array, b: Array) -> Array:
    """Product (N, 4) of quaternions x y z w."""
    av, aw, bv, bw = a[:, :3], a[:, 3:], b[:, :3], b[:, 3:]
    vector = aw * bv + bw * av + np.cross(av, bv)
    return np.hstack([vector, aw * bw - np.sum(av * bv, axis=1, keepdims=True)])


def turned(quaternion: Array, vector: Array) -> Array:
    """Quaternions x y z w (N, 4) turned by rotation vectors (N, 3) or (3,) of the body."""
    vector = np.broadcast_to(vector, (len(quaternion), 3))
    angle = np.linalg.norm(vector, axis=1, keepdims=True)
    small = np.where(angle < 1e-12, 0.5, np.sin(angle / 2) / np.where(angle < 1e-12, 1.0, angle))
    return quaternion_product(quaternion, np.hstack([vector * small, np.cos(angle / 2)]))


def exact(motion: Motion, s: States, lever: Mapping[str, Array]) -> dict[str, Array]:
    """Exact channels of states; `lever` (3,) [m] displaces a sensor."""
    plant, n = motion.plant, motion.plant.numbers
    out: dict[str, Array] = {
        "encoder.joint_position": s.qpos[:, [plant.q_of(j) for j in JOINTS]],
        "encoder.joint_velocity": s.qvel[:, [plant.v_of(j) for j in JOINTS]],
    }
    if not n.free:
        return out
    out["tachometer.wheel_rate"] = s.qvel[:, [plant.v_of(w) for w in WHEELS]]
    r, w, alpha = rotations(s.qpos[:, 3:7]), s.qvel[:, 3:6], s.qacc[:, 3:6]
    pose, imu = (np.array(n.point) + lever.get(k, 0.0) for k in ("pose", "imu"))
    turn = np.cross(w, pose)
    out["pose.position"] = s.qpos[:, :3] + r @ pose
    out["pose.velocity"] = s.qvel[:, :3] + np.einsum("nij,nj->ni", r, turn)
    out["pose.attitude"] = np.roll(s.qpos[:, 3:7], -1, axis=1)
    out["imu.angular_rate"] = w.copy()
    base = np.einsum("nji,nj->ni", r, s.qacc[:, :3] - np.array(n.gravity))
    out["imu.acceleration"] = base + np.cross(alpha, imu) + np.cross(w, np.cross(w, imu))
    if n.plate is not None:
        out["panel.acceleration"] = _panel(motion, s, base, w, alpha)
    return out


def _panel(motion: Motion, s: States, base: Array, w: Array, alpha: Array) -> Array:
    """Specific force (N, stations, 3) of the panel's points: across by its modes, along as it is drawn in."""
    plant, n = motion.plant, motion.plant.numbers
    assert n.plate is not None
    moving = []
    for k, mode in enumerate(n.plate_modes(), start=1):
        iq, iv = plant.q_of(f"mode{k}"), plant.v_of(f"mode{k}")
        q, v, a = s.qpos[:, iq], s.qvel[:, iv], s.qacc[:, iv]
        moving.append(np.sqrt(mode.mass) * np.array([q, v, a]))
    own = n.plate.shape(np.array(n.stations))
    further = [mode.seen or np.zeros(len(own)) for mode in n.plate_modes()[n.plate.modes :]]
    shapes = np.column_stack([own, *further])
    modal = np.array(moving)
    u, du, ddu = np.einsum("sk,kdn->dsn", shapes, modal)
    along = np.zeros((len(own), len(moving), len(moving)))
    if n.bend:  # of the plate's own modes, and no others
        along = n.bend * drawn(n, np.array(n.stations))
    eta, rate, rise = modal.transpose(1, 0, 2)
    x0 = -0.5 * np.einsum("kn,skl,ln->sn", eta, along, eta)
    x1 = -np.einsum("kn,skl,ln->sn", eta, along, rate)
    x2 = -np.einsum("kn,skl,ln->sn", eta, along, rise) - np.einsum("kn,skl,ln->sn", rate, along, rate)
    rows = []
    for i, x in enumerate(n.stations):
        point = np.tile(np.add(n.plate_root, (x, 0, 0)), (len(s.time), 1))
        point[:, 0] += x0[i]
        point[:, 2] += u[i]
        relative, extra = np.zeros_like(point), np.zeros_like(point)
        relative[:, 0], relative[:, 2], extra[:, 0], extra[:, 2] = x1[i], du[i], x2[i], ddu[i]
        swing = np.cross(alpha, point) + np.cross(w, np.cross(w, point)) + 2 * np.cross(w, relative)
        rows.append(base + swing + extra)
    return np.stack(rows, axis=1)


def phases_of(changes: Sequence[Change], period: float) -> dict[str, tuple[int, float]]:
    """By source, how many samples and which phase within a sampling time hold what it reports late."""
    out = {}
    for change in changes:
        for source, delay in change.shift.items():
            back = int(np.ceil(delay / period - 1e-12))
            out[source] = (back, back * period - delay)
    return out


def channels(motion: Motion, changes: Sequence[Change] = ()) -> dict[str, Array]:
    """Noise-free channels at the sampling times with the systematic faults of the sensors.

    A source that is late reports what was `delay` ago, at first what was at the start; one that is early
    reports at the end what it reported last.
    """
    lever = {k: v for c in changes for k, v in c.lever.items()}
    now = motion.states[0.0]
    period = float(now.time[1] - now.time[0])
    shifted = phases_of(changes, period)
    by_phase = {p: exact(motion, s, lever) for p, s in motion.states.items()}
    out = {}
    for name in channel_names(motion.plant.numbers):
        source = name.split(".")[0]
        back, phase = shifted.get(name, shifted.get(source, (0, 0.0)))
        nearest = min(by_phase, key=lambda p: abs(p - phase))
        index = np.arange(len(now.time)) - back
        values = by_phase[nearest][name][np.clip(index, 0, len(now.time) - 1)]
        if back > 0 and phase > 0.0:
            values[index < 0] = by_phase[0.0][name][0]
        out[name] = values
    for change in changes:
        for name, fault in change.ideal:
            out[name] = fault(now.time, out[name])
    return out


def measured(
    exact_channels: Mapping[str, Array],
    time: Array,
    rng: np.random.Generator,
    changes: Sequence[Change] = (),
    noise: Mapping[str, float] | None = None,
) -> dict[str, Array]:
    """Channels with white noise of `noise` (default `NOISE`) and the faults that come after it."""
    sigma = {**NOISE, **(noise or {})}
    draws = dict(zip(NOISE, rng.spawn(len(NOISE)), strict=True))
    out = {}
    for name, x in exact_channels.items():
        if name == "pose.attitude":
            out[name] = turned(x, sigma[name] * draws[name].standard_normal((len(x), 3)))
        else:
            out[name] = x + sigma[name] * draws[name].standard_normal(x.shape)
    faults = rng.spawn(1)[0]
    for change in changes:
        for name, fault in change.read:
            out[name] = fault(time, out[name], faults)
    return out


def whitened(channels_: Mapping[str, Array], reference: Mapping[str, Array]) -> Array:
    """Difference of noise-free channels in standard deviations of the noise, one vector."""
    parts = []
    for name in reference:
        a, b = channels_[name], reference[name]
        if name == "pose.attitude":
            conjugate = b * np.array([-1.0, -1.0, -1.0, 1.0])
            d = quaternion_product(conjugate, a)
            difference = 2 * d[:, :3] * np.sign(d[:, 3:])
        else:
            difference = a - b
        parts.append((difference / NOISE[name]).ravel())
    return np.concatenate(parts)
