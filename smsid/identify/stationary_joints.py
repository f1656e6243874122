"""Joints and wheels that stand still during Exp. 2: held, so that their sensors' noise is no excitation.

A joint that nothing moves reads as noise. In a regressor that noise tells the link beyond the joint apart
from the one before it, and what it says is wrong. Held at one angle the two are one body.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from smsid.identify.estimate import ParameterEstimate
from smsid.identify.momentum_rows import ParameterSplit, carried_by_bus, first_moments, skew
from smsid.identify.robust import white_sigma
from smsid.identify.sensor_roles import find_sensor
from smsid.model.identifiable import BaseParameters, base_parameters
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel, set_group_angles
from smsid.recording import Recording
from smsid.sensing import Sensor

BLOCK = 11  # samples whose median is looked at: single spikes do not count, nor missing samples
FAR = 2.0  # standard deviations of a sample; noise alone moves the medians of a long record by 1.5
UNSEEN = 1e-6  # [rad, rad/s] of motion that no encoder tells
STATES = 60  # random states that show what moving joints would tell
FEWEST = 4  # blocks


@dataclass(frozen=True)
class HiddenCombination:
    """A combination of inertial parameters: its ``row`` (10 bodies,) gives the value."""

    name: str
    unit: str
    row: np.ndarray


@dataclass(frozen=True)
class StationaryJoints:
    """Which arm joints and wheels stand still: indices into the model's groups."""

    joints: tuple[int, ...] = ()
    wheels: tuple[int, ...] = ()

    @classmethod
    def of(cls, model: SpacecraftModel, recording: Recording) -> StationaryJoints:
        """Return what stands still: readings that stay as near to one value as their noise lets them."""
        if not (len(model.arm_joints) or len(model.wheels)):
            return cls()
        joints, wheels = (np.ones(len(group), dtype=bool) for group in (model.arm_joints, model.wheels))
        encoder, tachometer = motion_sensors(model, recording)
        sources = [(joints, encoder, q) for q in ("joint_position", "joint_velocity")]
        for still, sensor, quantity in [*sources, (wheels, tachometer, "wheel_rate")]:
            if sensor is None:
                continue
            values = recording[f"{sensor.name}.{quantity}"]
            for k in range(min(len(still), values.shape[1])):
                still[k] &= is_constant(values[:, k])
        return cls(tuple(np.flatnonzero(joints).tolist()), tuple(np.flatnonzero(wheels).tolist()))

    def __bool__(self) -> bool:
        return bool(self.joints or self.wheels)

    def held(self, model: SpacecraftModel, recording: Recording) -> Recording:
        """Return the recording with what stands still at one value: joints without rate, wheels at theirs."""
        if not self:
            return recording
        (encoder, tachometer), channels = motion_sensors(model, recording), {}
        for chosen, sensor, quantity in (
            (self.joints, encoder, "joint_position"),
            (self.joints, encoder, "joint_velocity"),
            (self.wheels, tachometer, "wheel_rate"),
        ):
            if chosen and sensor is not None:
                values = np.array(recording[f"{sensor.name}.{quantity}"], dtype=float)
                for k in chosen:
                    values[:, k] = resting_value(values[:, k], quantity)
                channels[f"{sensor.name}.{quantity}"] = values
        return recording.with_channels(channels)

    def notes(self, model: SpacecraftModel) -> list[str]:
        """Return what is taken away by what stands still, in words."""
        names, found = Regressor(model).bodies, []
        alone = "(its readings show noise alone) and is held at one"
        for k in self.joints:
            j = int(model.arm_joints.joints[k])
            link, before = names[j - 1], names[int(model.pin.parents[j]) - 1]
            found.append(
                f"{model.arm_joints.names[k]} stands still {alone} angle: {link} is seen only together with "
                f"{before}, its own parameters stay as described"
            )
        for k in self.wheels:
            found.append(
                f"{model.wheels.names[k]} does not speed up {alone} rate: it exchanges no momentum, the "
                "scale comes from the others alone"
            )
        return found


def motion_sensors(model: SpacecraftModel, recording: Recording) -> tuple[Sensor | None, Sensor | None]:
    """Return the encoder of the arm's joints and the tachometer of the wheels, as far as there are some."""
    encoder = find_sensor(model, recording, "encoder", ("joint_position", "joint_velocity"))
    return encoder, find_sensor(model, recording, "tachometer", ("wheel_rate",))


def resting_value(values: np.ndarray, quantity: str) -> float:
    """Return what readings (N,) of something still are taken for: their median, but no rate of a joint."""
    return 0.0 if quantity == "joint_velocity" else float(np.nanmedian(values))


def is_constant(values: np.ndarray) -> bool:
    """Return whether readings (N,) stay at one value; a coarse encoder may go to and fro between two."""
    good = values[np.isfinite(values)]
    if len(np.unique(good)) <= 2:
        return True
    count = len(good) // BLOCK
    if count < FEWEST:
        return False
    middle = np.median(good[: count * BLOCK].reshape(count, BLOCK), axis=1)
    allowed = max(FAR * float(white_sigma(good)), UNSEEN)
    return bool(np.abs(middle - np.median(good)).max() <= allowed)


def if_all_moved(model: SpacecraftModel) -> tuple[BaseParameters, ParameterSplit]:
    """Return Step B's base parameters if every joint moved, and what they are combinations of.

    From random states: what can be told apart then does not depend on the motion.
    """
    regressor = Regressor(model)
    parts = ParameterSplit.of(model, regressor, bus_first=True)
    rng = np.random.default_rng(0)
    q, v = np.tile(model.home, (STATES, 1)), rng.standard_normal((STATES, model.nv))
    for row in q:
        row[:] = set_group_angles(model.arm_joints, row, rng.uniform(-2, 2, len(model.arm_joints)))
    y, moments = regressor.momentum(q, v), first_moments(model, regressor, q)
    theta = regressor.parameters
    cm = moments @ theta / theta[::10].sum()
    bus = regressor.names.index(f"{regressor.bodies[0]}.m")
    rows = []
    for full in (y[:, 3:] - skew(cm) @ y[:, :3], moments):
        free = full[:, :, parts.unknown].copy()
        masses = [k for k, i in enumerate(parts.unknown) if regressor.names[i].endswith(".m")]
        free[:, :, masses] -= full[:, :, [bus]]
        rows.append(free.reshape(-1, len(parts.unknown)))
    return base_parameters(np.vstack(rows), parts.names, parts.units), parts


def taken_away(
    model: SpacecraftModel, joints: Sequence[int], found: BaseParameters
) -> list[HiddenCombination]:
    """Return what is not among the base parameters ``found`` of Step B because arm ``joints`` stand still."""
    if not joints:
        return []
    regressor = Regressor(model)
    links = {regressor.bodies[int(model.arm_joints.joints[k]) - 1] for k in joints}
    base, parts = if_all_moved(model)
    out = []
    for k, i in enumerate(base.independent.tolist()):
        if parts.names[i].rsplit(".", 1)[0] in links and i not in found.independent:
            row = np.zeros(regressor.columns)
            row[parts.unknown] = base.matrix[k]
            out.append(HiddenCombination(base.names[k], base.units[k], row))
    return out


def not_seen(model: SpacecraftModel, joints: Sequence[int], found: BaseParameters) -> list[ParameterEstimate]:
    """Return `taken_away` as parameters that stay as described, with no bound on their error."""
    regressor = Regressor(model)
    theta = regressor.parameters + carried_by_bus(model, regressor)
    names = ", ".join(model.arm_joints.names[k] for k in joints)
    stand = "stands" if len(joints) == 1 else "stand"
    note = f"{names} {stand} still: not seen on its own, stays as described"
    return [
        ParameterEstimate(
            c.name,
            float(c.row @ theta),
            c.unit,
            math.inf,
            "not_identifiable",
            "exp2.step_b",
            nominal=float(c.row @ theta),
            note=note,
        )
        for c in taken_away(model, joints, found)
    ]
