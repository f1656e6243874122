"""The signals of one axis of Exp. 1: thrust, acceleration and the panels' forces, low-passed, with errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from smsid.effects.assembly import AppendageJoints
from smsid.errors import NotIdentifiableError
from smsid.identify.clocks import common_times, event_times, rate_of, sample_channel
from smsid.identify.commanded import actual_thrust
from smsid.identify.paper._exp1_panels import symbol_of
from smsid.identify.paper._exp1_result import participates, participation_along
from smsid.identify.paper._translation import AxisData, PanelForce, panel_weights
from smsid.identify.paper.rest import with_rest_before
from smsid.identify.robust import white_sigma
from smsid.identify.sensor_roles import Roles
from smsid.model.spacecraft import SpacecraftModel
from smsid.model.stations import station_indices
from smsid.recording import Recording
from smsid.sensing import Sensor, settling_time, zero_phase, zero_phase_transposed

SMOOTHING = 5.0  # [Hz] cut-off of the low-pass; slosh and the first modes lie far below
ABOVE_MODES = 1.5  # times the highest described mode: a cantilever's next is at twice, and is not in its p
FEWEST_PERIODS = 20.0  # of the cut-off in a record: below, the filter's ends reach too far in
ROUND_OFF = 1e-9  # of the signal: the noise a noise-free recording is taken to have


def axis_data(model: SpacecraftModel, recording: Recording, axis: str) -> AxisData:
    """Return thrust, acceleration and the panel's force along an axis, low-passed, with the sensors' errors.

    Raises `RecordingError` for missing channels, `NotIdentifiableError` when a panel that bends along the
    axis has no accelerometers, or too few.
    """
    roles = Roles.of(model, recording, joints=False)
    imu, k = roles.imu, "xyz".index(axis)
    moving = [a for a in model.appendages if participates(a, k)]
    panels = [roles.panels[a.appendage.name] for a in moving if a.appendage.name in roles.panels]
    noise = _noise(recording[f"{imu.name}.acceleration"][:, k])
    own = event_times(recording, imu, "acceleration")
    begin = float(own[0])
    cutoff = _cut_off(moving, float(own[-1]) - begin)
    # a panel's clock may start later; a recording starts at rest, so what there is before is zero
    recording = with_rest_before(recording, [s.name for s in (imu, *panels)], settling_time(cutoff))
    own = event_times(recording, imu, "acceleration")
    time = common_times(recording, (imu, "acceleration"), [(s, "acceleration") for s in panels])
    kept = np.searchsorted(own, time)
    raw = recording[f"{imu.name}.acceleration"][kept, k]
    thrust = actual_thrust(model, recording)
    force = _hold_commands(thrust.times, thrust.values[:, k], time)
    force[time == begin] *= 0.5
    fs = rate_of(recording, imu, "acceleration")

    def smooth(x: np.ndarray) -> np.ndarray:
        return zero_phase(x, fs, cutoff)

    drift, drift_time = _drift(imu)
    data = AxisData(
        axis=axis,
        time=time,
        force=smooth(force),
        acceleration=smooth(raw),
        noise=noise,
        filtered=smooth,
        filter_transposed=lambda x: zero_phase_transposed(x, fs, cutoff),
        drift=drift,
        drift_time=drift_time,
        bias=_bias(imu),
        before=int(np.searchsorted(time, begin)),
        constant=smooth(np.heaviside(time - begin, 0.5)),
    )
    one = len(model.appendages) == 1
    return _with_panels(data, recording, roles, moving, k, fs, cutoff, one=one) if moving else data


def _cut_off(moving: list[AppendageJoints], duration: float) -> float:
    """Return the low-pass' cut-off [Hz]: below the first mode that a description of ``moving`` leaves out.

    The stations see every mode, the clamped shapes of the described ones turn what they see into p: modes
    beyond would count as more of these. ``duration`` of the record [s].
    """
    highest = [max((m.frequency for m in j.appendage.modal_data()), default=np.inf) for j in moving]
    lowest = min(highest, default=np.inf)
    return float(min(SMOOTHING, max(ABOVE_MODES * lowest, FEWEST_PERIODS / duration)))


def _noise(x: np.ndarray) -> float:
    return max(float(np.sqrt(np.mean(white_sigma(x) ** 2))), ROUND_OFF * float(np.std(x)))


def _bias(sensor: Sensor) -> float:
    """One sigma of a sensor's described constant error that a recording does not reveal [m/s^2]."""
    error = sensor.error("acceleration")
    return float(np.hypot(np.max(error.bias_sigma), np.max(error.bias_instability)))


def _drift(sensor: Sensor) -> tuple[float, float]:
    """One sigma [m/s^2] and correlation time [s] of a sensor's described wandering bias."""
    error = sensor.error("acceleration")
    return float(np.max(error.gauss_markov_sigma)), float(error.bias_correlation_time or 1.0)


def _hold_commands(source: np.ndarray, values: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Return commands held between their samples; none more than half a step of ``time`` before the first."""
    step = float(time[1] - time[0])  # a clock shifted by a delay may miss the command's by rounding
    held = values[np.clip(np.searchsorted(source, time + 1e-6 * step, side="right") - 1, 0, len(values) - 1)]
    return np.where(time < source[0] - 0.5 * step, 0.0, held)


def _with_panels(
    data: AxisData,
    recording: Recording,
    roles: Roles,
    moving: list[AppendageJoints],
    axis: int,
    fs: float,
    cutoff: float,
    *,
    one: bool,
) -> AxisData:
    """Add the inertia forces of bending at the described density, and their sensors' weights and errors.

    ``one``: the spacecraft's only appendage, whose density is just ``rho``.
    """
    forces = []
    for joints in moving:
        name = joints.appendage.name
        sensor = roles.panels.get(name)
        if sensor is None:
            raise NotIdentifiableError(
                f"'{name}' bends along this axis but the recording has no accelerometers on it.",
                advice=f"Record a sensor of kind 'accelerometers' with appendage = \"{name}\".",
            )
        y = sample_channel(recording, sensor, "acceleration", data.time, cutoff)[:, :, axis]
        chosen = station_indices(joints, sensor)
        modes = joints.appendage.modal_data()
        rotation = joints.placement.rotation
        shapes = np.array([[(rotation @ np.asarray(m.shape[s]))[axis] for m in modes] for s in chosen])
        along = participation_along(joints, axis)
        bends = np.abs(along) > 1e-6 * np.abs(along).max()
        seen = bends | (np.abs(shapes).max(axis=0, initial=0.0) > 1e-9 * np.abs(shapes).max(initial=0.0))
        if np.linalg.matrix_rank(shapes[:, seen]) < seen.sum():
            raise NotIdentifiableError(
                f"{len(chosen)} accelerometers cannot tell the {seen.sum()} modes of '{name}' apart.",
                advice="Describe fewer modes, or add stations.",
            )
        w = panel_weights(shapes[:, seen], along[seen])
        force = (y - data.acceleration[:, None]) @ w
        raw = recording[f"{sensor.name}.acceleration"][:, :, axis]
        noise = _noise(raw) * float(np.sqrt(fs / rate_of(recording, sensor, "acceleration")))
        symbol = symbol_of(() if one else (name,))
        forces.append(PanelForce(symbol, force, w, noise, *_drift(sensor), _bias(sensor)))
    return replace(data, panels=tuple(forces))
