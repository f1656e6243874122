"""Exact values of every channel a sensor could record, from a simulated motion."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from smsid.effects.assembly import AppendageJoints
from smsid.errors import DescriptionError
from smsid.inputs.inputs import PrescribedMotion
from smsid.inputs.signals import Signal, sample
from smsid.model.spacecraft import JointGroup, SpacecraftModel
from smsid.model.stations import find_appendage, station_indices
from smsid.sensing.sensor import Sensor

if TYPE_CHECKING:
    from smsid.simulate.trajectory import States, Trajectory


def truth_of(
    trajectory: Trajectory, sensors: Sequence[Sensor]
) -> Callable[[np.ndarray], dict[str, np.ndarray]]:
    """Return a function of times (N,) [s] that gives the exact channels of the sensors, commands and truth.

    Frames and units as in docs/design.md, section 3. The torque that holds the attitude counts as commanded.
    """

    held = PrescribedMotion.of(trajectory.model, trajectory.inputs).index

    def truth(times: np.ndarray) -> dict[str, np.ndarray]:
        states = trajectory.states(times)
        channels = commands(trajectory, states)
        channels.update(hidden_states(trajectory.model, states))
        for sensor in sensors:
            channels.update(exact_readings(trajectory.model, states, sensor, held))
        return channels

    return truth


def rotation_matrices(quaternion: np.ndarray) -> np.ndarray:
    """Return rotation matrices (..., 3, 3) of unit quaternions (..., 4), x y z w."""
    x, y, z, w = np.moveaxis(quaternion, -1, 0)
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)),
        (2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)),
        (2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)),
    )
    return np.stack([np.stack(row, -1) for row in rows], -2)


def exact_readings(
    model: SpacecraftModel,
    s: States,
    sensor: Sensor,
    held: np.ndarray | None = None,
    inverse: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Return the exact channels of one sensor by name, (N, ...) as in docs/design.md, section 3.

    ``held`` are coordinates (among the nv) whose motion is prescribed; ``inverse`` (N, nv, nv) are inverse
    mass matrices where these are known.
    """
    name, r = sensor.name, np.asarray(sensor.position, dtype=float)
    n = len(s.time)
    base_v = s.v[:, :6] if model.free else np.zeros((n, 6))
    base_a = s.a[:, :6] if model.free else np.zeros((n, 6))
    rotation = rotation_matrices(s.q[:, 3:7]) if model.free else np.tile(np.eye(3), (n, 1, 1))
    omega = base_v[:, 3:]
    match sensor.kind:
        case "pose":
            origin = s.q[:, :3] if model.free else np.zeros((n, 3))
            velocity = base_v[:, :3] + np.cross(omega, r)
            quaternion = s.q[:, 3:7] if model.free else np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))
            found = {
                "position": origin + rotation @ r,
                "attitude": quaternion,
                "velocity": np.einsum("nij,nj->ni", rotation, velocity),
            }
        case "imu":
            found = {
                "acceleration": _specific_force(model, rotation, base_v, base_a, np.tile(r, (n, 1))),
                "angular_rate": omega,
            }
        case "encoder":
            found = {
                "joint_position": _unwrap(model.encoder_angles(s.q)) + _twist(model, s, held, inverse),
                "joint_velocity": model.encoder_rates(s.v),
            }
        case "tachometer":
            found = {"wheel_rate": s.v[:, model.wheels.v]}
        case "accelerometers":
            panel = find_appendage(model, str(sensor.appendage))
            found = {"acceleration": _panel_acceleration(model, s, rotation, base_v, base_a, panel, sensor)}
    return {f"{name}.{k}": v for k, v in found.items() if k in sensor.quantities}


def _twist(
    model: SpacecraftModel, s: States, held: np.ndarray | None, inverse: np.ndarray | None
) -> np.ndarray | float:
    if not model.twists:
        return 0.0
    return model.encoder_twist(s.time, s.q, s.v, s.tau + s.reaction, s.a, held, inverse)


def commands(trajectory: Trajectory, s: States) -> dict[str, np.ndarray]:
    """Return the commanded force, torque (with the torque that holds the attitude), wheel and joint torques.

    (N, ...) as in docs/design.md, section 3. Effects on actuators are between these and what the plant gets.
    Torques that enforce prescribed motion count as commanded as they act.
    """
    model, inputs = trajectory.model, trajectory.inputs
    found: dict[str, np.ndarray] = {}
    n = len(s.time)
    if model.free:
        found["command.force"] = sample(inputs.force, s.time) if inputs.force else np.zeros((n, 3))
        torque = sample(inputs.torque, s.time) if inputs.torque else np.zeros((n, 3))
        if inputs.hold_attitude:
            torque = torque + s.reaction[:, 3:6]
        found["command.torque"] = torque
    if model.description.thruster:
        size = len(model.description.thruster)
        found["command.thruster"] = (
            sample(inputs.thruster, s.time) if inputs.thruster else np.zeros((n, size))
        )
    if len(model.wheels):
        found["command.wheel_torque"] = _with_reaction(inputs.wheel_torque, s, model.wheels.v)
    if len(model.arm_joints):
        found["command.joint_torque"] = _with_reaction(inputs.joint_torque, s, model.arm_joints.v)
    return found


def _with_reaction(signal: Signal | None, s: States, index: np.ndarray) -> np.ndarray:
    reaction = s.reaction[:, index]
    return reaction if signal is None else sample(signal, s.time) + reaction


def hidden_states(model: SpacecraftModel, s: States) -> dict[str, np.ndarray]:
    """Return what no sensor sees: slosh and modal states (several tanks: sources ``truth_<tank>``).

    (N, 3) of a tank, (N, modes) of an appendage.
    """
    found: dict[str, np.ndarray] = {}
    for joint in model.slosh:
        source = "truth" if len(model.slosh) == 1 else f"truth_{joint.name}"
        found[f"{source}.slosh_position"] = s.q[:, joint.q]
        found[f"{source}.slosh_velocity"] = s.v[:, joint.v]
    if len(model.modes):
        found["truth.modal_position"] = s.q[:, model.modes.q] * model.mode_scale
        found["truth.modal_velocity"] = s.v[:, model.modes.v] * model.mode_scale
    return found


def _specific_force(
    model: SpacecraftModel, rotation: np.ndarray, v: np.ndarray, a: np.ndarray, r: np.ndarray
) -> np.ndarray:
    """Acceleration less gravity of bus-fixed points r (N, 3), body axes (N, 3)."""
    omega, alpha = v[:, 3:], a[:, 3:]
    linear = a[:, :3] + np.cross(omega, v[:, :3])
    linear = linear + np.cross(alpha, r) + np.cross(omega, np.cross(omega, r))
    gravity = model.pin.gravity.linear
    return linear - np.einsum("nji,j->ni", rotation, gravity) if gravity.any() else linear


def _panel_acceleration(
    model: SpacecraftModel,
    s: States,
    rotation: np.ndarray,
    v: np.ndarray,
    a: np.ndarray,
    panel: AppendageJoints,
    sensor: Sensor,
) -> np.ndarray:
    """Specific force of material points at the stations, bus axes (N, stations, 3), deflection included."""
    if panel.parent > 1:
        raise DescriptionError(
            f"'{panel.appendage.name}' sits on a moving link; accelerometers need the bus."
        )
    chosen = station_indices(panel, sensor)
    seen = JointGroup.of(model.pin, panel.seen)
    bent, bending, bends = s.q[:, seen.q], s.v[:, seen.v], s.a[:, seen.v]
    own = len(panel.joints)
    delta, rate, acc = (x[:, :own] * panel.scale for x in (bent, bending, bends))
    omega = v[:, 3:]
    out = np.empty((len(s.time), len(chosen), 3))
    for k, station in enumerate(chosen):
        rest = panel.placement.act(panel.appendage.station_positions()[station])
        shape = panel.moved(station)
        r, dr, ddr = rest + bent @ shape, bending @ shape, bends @ shape
        if panel.drawn is not None:
            axis, drawn = panel.placement.rotation[:, 0], panel.drawn[station]
            pull = delta @ drawn
            r = r - 0.5 * np.outer(np.sum(pull * delta, axis=1), axis)
            dr = dr - np.outer(np.sum(pull * rate, axis=1), axis)
            ddr = ddr - np.outer(np.sum(pull * acc + (rate @ drawn) * rate, axis=1), axis)
        out[:, k] = _specific_force(model, rotation, v, a, r) + ddr + 2 * np.cross(omega, dr)
    return out


def _unwrap(angles: np.ndarray) -> np.ndarray:
    return np.unwrap(angles, axis=0) if len(angles) > 1 else angles
