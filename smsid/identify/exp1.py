"""Exp. 1 from recording to parameters: which axes were excited, slosh and mass, appendage density, modes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from smsid.effects.appendage import BeamAppendage, Mode
from smsid.effects.slosh import Slosh
from smsid.errors import NotIdentifiableError, RecordingError
from smsid.identify.estimate import ParameterEstimate, judged
from smsid.identify.motion import Roles
from smsid.identify.panel_modes import PanelModes, panel_modes
from smsid.identify.robust import white_sigma
from smsid.identify.translation import AxisData, AxisEstimate, Combined, combine, identify_axis, panel_weights
from smsid.model.assembly import AppendageJoints
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.sensing import Sensor, zero_phase
from smsid.simulate.truth import station_indices

SMOOTHING = 5.0  # [Hz] cut-off of the low-pass; slosh and the first modes lie far below
HOLDING = 2e-3  # [rad/s] body rate up to which the attitude counts as held


def excited_axes(recording: Recording) -> str:
    """Return the body axes along which thrust acted, as letters of 'xyz'."""
    if "command.force" not in recording:
        return ""
    peak = np.abs(recording["command.force"]).max(axis=0)
    return "".join(
        a for a, f in zip("xyz", peak, strict=True) if f > 1e-6 * max(peak.max(), 1e-30) and f > 0.0
    )


def identify_translation(model: SpacecraftModel, recordings: list[Recording]) -> TranslationResult:
    """Identify M, slosh and appendages from recordings of Exp. 1 (several: one per axis, say).

    Raises `NotIdentifiableError` when no axis can be identified; axes that cannot are named in ``notes``.
    """
    axes: list[AxisEstimate] = []
    notes: list[str] = []
    modes: dict[str, PanelModes] = {}
    wanted: set[str] = set()
    for recording in recordings:
        _check_attitude_held(model, recording)
        for axis in excited_axes(recording):
            if axis in wanted:
                continue
            wanted.add(axis)
            try:
                axes.append(_one_axis(model, recording, axis))
            except NotIdentifiableError as error:
                notes.append(f"axis {axis}: {error}")
        for name, found in _modes(model, recording, notes).items():
            modes.setdefault(name, found)
    missing = sorted(set("xyz") - wanted)
    if missing:
        notes.append(f"no thrust along {', '.join(missing)}: stiffness and damping there stay as described")
    if not axes:
        raise NotIdentifiableError(
            "Exp. 1 identifies nothing: " + ("; ".join(notes) or "no recording has thrust") + ".",
            advice="Fly thrust along at least one body axis with the attitude held.",
        )
    return assemble(model, axes, modes, notes)


def _check_attitude_held(model: SpacecraftModel, recording: Recording) -> None:
    roles = Roles.of(model, recording, joints=False)
    rate = zero_phase(recording[f"{roles.imu.name}.angular_rate"], _rate(recording, roles.imu), SMOOTHING)
    worst = float(np.abs(rate - np.median(rate, axis=0)).max())
    if worst > HOLDING:
        raise NotIdentifiableError(
            f"'{recording.name}' rotates at up to {worst:.3g} rad/s, so it is no Exp. 1 (pure translation).",
            advice=f"Hold the attitude to {HOLDING:g} rad/s, or give it as Exp. 2 (no thrust).",
            rate=worst,
        )


def _rate(recording: Recording, sensor: Sensor) -> float:
    return 1.0 / float(np.median(np.diff(recording.time(sensor.channels[0]))))


def _one_axis(model: SpacecraftModel, recording: Recording, axis: str) -> AxisEstimate:
    roles = Roles.of(model, recording, joints=False)
    channel = f"{roles.imu.name}.acceleration"
    time = recording.time(channel)
    k = "xyz".index(axis)
    raw = recording[channel][:, k]
    force = recording["command.force"][:, k]
    if len(force) != len(raw):
        force = np.asarray(_held(recording.time("command.force"), recording["command.force"][:, k], time))
    fs = _rate(recording, roles.imu)

    def smooth(x: np.ndarray) -> np.ndarray:
        return zero_phase(x, fs, SMOOTHING)

    p, weights, panel_noise = None, None, 0.0
    moving = [a for a in model.appendages if _participates(a, k)]
    if moving:
        p, weights, panel_noise = _panel_force(model, recording, roles, moving, k, raw, time)
    return identify_axis(
        AxisData(
            axis=axis,
            time=time,
            force=smooth(force),
            acceleration=smooth(raw),
            noise=float(white_sigma(raw)),
            panel=None if p is None else smooth(p),
            panel_weights=weights,
            panel_noise=panel_noise,
            filtered=smooth,
        ),
        max(len(model.slosh), 1),
    )


def _held(source: np.ndarray, values: np.ndarray, time: np.ndarray) -> np.ndarray:
    return values[np.clip(np.searchsorted(source, time, side="right") - 1, 0, len(values) - 1)]


def _participates(joints: AppendageJoints, axis: int) -> bool:
    along = np.array(
        [joints.placement.rotation @ np.asarray(m.translation) for m in joints.appendage.modal_data()]
    )
    return bool(len(along)) and np.abs(along[:, axis]).max() > 1e-6 * np.abs(along).max()


def _panel_force(
    model: SpacecraftModel,
    recording: Recording,
    roles: Roles,
    moving: list[AppendageJoints],
    axis: int,
    base: np.ndarray,
    time: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, float]:
    """Inertia force of bending at the described density, its weights on the accelerometers, and their noise."""
    force, weights, noises = np.zeros(len(time)), [], []
    for joints in moving:
        name = joints.appendage.name
        sensor = roles.panels.get(name)
        if sensor is None:
            raise NotIdentifiableError(
                f"'{name}' bends along this axis but the recording has no accelerometers on it.",
                advice=f"Record a sensor of kind 'accelerometers' with appendage = \"{name}\".",
            )
        y = recording[f"{sensor.name}.acceleration"][:, :, axis]
        if len(y) != len(time):
            y = recording.resampled(time)[f"{sensor.name}.acceleration"][:, :, axis]
        chosen = station_indices(joints, sensor)
        data = joints.appendage.modal_data()
        rotation = joints.placement.rotation
        shapes = np.array([[(rotation @ np.asarray(m.shape[s]))[axis] for m in data] for s in chosen])
        along = np.array([(rotation @ np.asarray(m.translation))[axis] for m in data])
        if np.linalg.matrix_rank(shapes) < len(data):
            raise NotIdentifiableError(
                f"{len(chosen)} accelerometers cannot tell the {len(data)} modes of '{name}' apart.",
                advice="Describe fewer modes, or add stations.",
            )
        w = panel_weights(shapes, along)
        force += (y - base[:, None]) @ w
        weights.append(w)
        noises.append(float(np.sqrt(np.mean(white_sigma(y) ** 2))))
    return force, np.concatenate(weights), float(np.max(noises))


def _modes(model: SpacecraftModel, recording: Recording, notes: list[str]) -> dict[str, PanelModes]:
    """Clamped and coupled modes of every appendage that thrust excited."""
    roles = Roles.of(model, recording, joints=False)
    excited = excited_axes(recording)
    found: dict[str, PanelModes] = {}
    for joints in model.appendages:
        name = joints.appendage.name
        sensor = roles.panels.get(name)
        along = np.array(
            [joints.placement.rotation @ np.asarray(m.translation) for m in joints.appendage.modal_data()]
        )
        if sensor is None or not len(along):
            continue
        axis = int(np.argmax(np.abs(along).max(axis=0)))
        if "xyz"[axis] not in excited:
            continue
        channel = f"{roles.imu.name}.acceleration"
        time = recording.time(channel)
        y = recording[f"{sensor.name}.acceleration"][:, :, axis]
        if len(y) != len(time):
            y = recording.resampled(time)[f"{sensor.name}.acceleration"][:, :, axis]
        thrust = np.flatnonzero(np.abs(recording["command.force"]).max(axis=1) > 0.0)
        last = float(
            recording.time("command.force")[min(thrust[-1] + 1, len(recording.time("command.force")) - 1)]
        )
        try:
            found[name] = panel_modes(time, y, recording[channel][:, axis], free_from=last)
        except (NotIdentifiableError, RecordingError) as error:
            notes.append(f"modes of {name}: {error}")
    return found
