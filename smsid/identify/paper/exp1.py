"""Exp. 1 from recording to parameters: which axes were excited, slosh and mass, appendage density, modes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from smsid.effects.assembly import AppendageJoints
from smsid.errors import NotIdentifiableError, RecordingError
from smsid.identify.clocks import common_times, event_times, rate_of, sample_channel
from smsid.identify.commanded import actual_thrust, excited_axes
from smsid.identify.panel_modes import panel_modes
from smsid.identify.paper.exp1_described import check_length, check_possible, left_as_described
from smsid.identify.paper.exp1_panels import (
    PanelShares,
    identify_axis_of_panels,
    symbol_of,
)
from smsid.identify.paper.exp1_result import (
    SeenModes,
    TranslationResult,
    assemble,
    participates,
    participation_along,
    tank_marks,
)
from smsid.identify.paper.mode_noise import mode_sigmas
from smsid.identify.paper.motion import raw_rates
from smsid.identify.paper.noise_replicates import add_noise_replicate, covariance_of_moves
from smsid.identify.paper.rest import check_at_rest, with_rest_before
from smsid.identify.paper.translation import AxisData, AxisEstimate, PanelForce, panel_weights
from smsid.identify.robust import white_sigma
from smsid.identify.sensor_roles import Roles
from smsid.model.column_order import order_columns
from smsid.model.spacecraft import SpacecraftModel
from smsid.model.stations import station_indices
from smsid.recording import Recording
from smsid.sensing import Sensor, settling_time, zero_phase, zero_phase_transposed

SMOOTHING = 5.0  # [Hz] cut-off of the low-pass; slosh and the first modes lie far below
ABOVE_MODES = 1.5  # times the highest described mode: a cantilever's next is at twice, and is not in its p
FEWEST_PERIODS = 20.0  # of the cut-off in a record: below, the filter's ends reach too far in
TANK_REPLICATES = 8  # of noise once more, where there are several tanks
FEW_STEPS = 1e-2  # of all samples: a thrust that changes more often has no steps
HOLDING = 2e-3  # [rad/s] body rate up to which the attitude counts as held
NOISE_SIGMAS = 5.0  # of the gyro's stated noise that are no rotation
REPLICATES_SEED = 0  # of the noise added to see how far it moves modes: the same data give the same interval
ROUND_OFF = 1e-9  # of the signal: the noise a noise-free recording is taken to have


def identify_translation(model: SpacecraftModel, recordings: list[Recording]) -> TranslationResult:
    """Identify M, slosh and appendages from recordings of Exp. 1 (several: one per axis, say).

    An axis is taken from the first recording that identifies it; axes that cannot be identified are named in
    ``notes``, and what they would tell stays as described. Raises `NotIdentifiableError` when a recording
    rotates or does not start at rest, or when no axis can be identified for another reason than noise.
    """
    axes: dict[str, AxisEstimate] = {}
    notes: list[str] = []
    modes: dict[str, SeenModes] = {}
    wanted: set[str] = set()
    reasons: dict[str, str] = {}  # why an axis gave nothing
    hidden = False  # whether that was for noise, or a slosh that the record is too short for
    shares: dict[str, PanelShares] = {}  # what panels that are not told apart have in common
    for recording in [order_columns(r, model) for r in recordings]:
        _check_attitude_held(model, recording)
        notes += _check_start(model, recording)
        for axis in excited_axes(recording):
            wanted.add(axis)
            if axis in axes:
                continue
            try:
                data = axis_data(model, recording, axis)
                found, own = identify_axis_of_panels(data, len(model.slosh), _marks(model, "xyz".index(axis)))
                check_possible(found)
                check_length(model, data, found)
            except NotIdentifiableError as error:
                notes.append(f"axis {axis} of '{recording.name}': {error}")
                reasons[axis] = str(error.message).rstrip(".")
                hidden = hidden or bool(error.evidence.get("hidden"))
                continue
            axes[axis] = found
            notes += [f"axis {axis}: {found.note}"] if found.note else []
            shares |= {s.symbol: s for s in own}
        if len(model.slosh) > 1:
            _widen_several_tanks(model, recording, axes, notes)
        for name, seen in _modes(model, recording, notes).items():
            modes.setdefault(name, seen)
    missing = sorted(set("xyz") - wanted)
    reasons = {a: r for a, r in reasons.items() if a not in axes}
    reasons |= {a: f"no thrust along {a}" for a in missing}
    if missing:
        notes.append(f"no thrust along {', '.join(missing)}: stiffness and damping there stay as described")
    if not axes and not hidden:
        raise NotIdentifiableError(
            "Exp. 1 identifies nothing: " + ("; ".join(notes) or "no recording has thrust") + ".",
            advice="Fly thrust along at least one body axis with the attitude held.",
            reasons=reasons,
        )
    result = assemble(model, list(axes.values()), modes, notes, tuple(shares.values()))
    left = left_as_described(model, {p.name for p in result.parameters}, reasons)
    return replace(result, parameters=(*result.parameters, *left))


def _widen_several_tanks(
    model: SpacecraftModel, recording: Recording, axes: dict[str, AxisEstimate], notes: list[str]
) -> None:
    """Widen what axes say of several tanks until noise once more moves it by no more.

    Tanks of nearly one frequency are told apart by little, and how the estimate answers noise is no longer
    linear there: the Gaussian intervals of their split are too narrow. Where noise once more leaves no
    estimate in half of the replicates, the tanks' intervals are not known.
    """
    moves: dict[str, list[np.ndarray]] = {a: [] for a in excited_axes(recording) if a in axes}
    sensors = model.description.effective_sensors()
    for k in range(TANK_REPLICATES):
        noisier = add_noise_replicate(recording, sensors, np.random.default_rng([REPLICATES_SEED, k]))
        for axis, own in moves.items():
            try:
                marks = _marks(model, "xyz".index(axis))
                found, _ = identify_axis_of_panels(axis_data(model, noisier, axis), len(model.slosh), marks)
            except NotIdentifiableError:
                continue
            if found.names == axes[axis].names:
                own.append(found.values - axes[axis].values)
    for axis, own in moves.items():
        before = axes[axis]
        known = np.isfinite(before.values) & np.isfinite(np.diag(before.covariance))
        covariance = before.covariance.copy()
        if 2 * len(own) > TANK_REPLICATES:
            at = np.ix_(known, known)
            covariance[at] = covariance_of_moves(covariance[at], [m[known] for m in own])
        else:
            tanks = np.array([n[:3] in ("m_s", "k_s", "b_s") for n in before.names])
            covariance[tanks, :] = covariance[:, tanks] = np.nan
            notes.append(f"axis {axis}: with as much noise once more the tanks are not told apart")
        axes[axis] = replace(before, covariance=covariance)
    notes.append("tanks are named by the order of their described frequencies, along each axis")


def _check_attitude_held(model: SpacecraftModel, recording: Recording) -> None:
    imu = Roles.of(model, recording, joints=False).imu
    fs = rate_of(recording, imu, "angular_rate")
    rate = zero_phase(recording[f"{imu.name}.angular_rate"], fs, SMOOTHING)
    turning = np.abs(rate - np.median(rate, axis=0)).max(axis=0)
    white = imu.error("angular_rate").white_sigma(fs)  # of which the low-pass leaves its share
    held = HOLDING + NOISE_SIGMAS * white * math.sqrt(min(2.0 * SMOOTHING / fs, 1.0))
    worst = float(turning.max())
    if (turning > held).any():
        raise NotIdentifiableError(
            f"'{recording.name}' rotates at up to {worst:.3g} rad/s, so it is no Exp. 1 (pure translation).",
            advice=f"Hold the attitude to {HOLDING:g} rad/s; if it is the gyro's noise, state noise_sigma of "
            f"'{imu.name}'.",
            rate=worst,
            other_flight=True,
        )


def _check_start(model: SpacecraftModel, recording: Recording) -> list[str]:
    """Refuse a record cut out of a longer one; a steady drift would do no harm but looks the same."""
    rates = raw_rates(model, recording, joints=False)
    label = "the velocity of the tracked point"
    if label not in rates:
        return [f"'{recording.name}' has no velocity: that it starts at rest is taken on trust"]
    check_at_rest(recording.name, {label: rates[label]})
    return []


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
    force = _held(thrust.times, thrust.values[:, k], time)
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


def _marks(model: SpacecraftModel, axis: int) -> list[str]:
    """Marks of the tanks by rising described frequency along an axis."""
    tanks = [s.tank for s in model.slosh]
    pairs = sorted(zip(tanks, tank_marks(tanks), strict=True), key=lambda x: x[0].stiffness[axis] / x[0].mass)
    return [mark for _, mark in pairs]


def _held(source: np.ndarray, values: np.ndarray, time: np.ndarray) -> np.ndarray:
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


def averaged_at_steps(time: np.ndarray, values: np.ndarray, steps: np.ndarray) -> np.ndarray:
    """Return ``values`` with samples at a step of thrust replaced by the mean of their neighbours.

    ``values`` (N, ...) at ``time`` (N,) [s], ``steps`` (k,) [s].

    That is what an anti-aliased accelerometer reads there. One that has the whole step already has it half a
    sample early, and damping ratios come out high by half a sample's phase: 0.8 % in the paper's Exp. 1. Only
    few steps are meant: of a thrust that changes with every sample nothing is replaced.
    """
    step = float(time[1] - time[0])
    nearest = np.round((steps - time[0]) / step).astype(int)
    inside = (nearest > 0) & (nearest < len(time) - 1)
    at = nearest[inside][np.abs(time[nearest[inside]] - steps[inside]) < 1e-2 * step]
    if not len(at) or len(at) > FEW_STEPS * len(time):
        return values
    out = np.array(values, dtype=float)
    out[at] = 0.5 * (out[at - 1] + out[at + 1])
    return out


def _modes(model: SpacecraftModel, recording: Recording, notes: list[str]) -> dict[str, SeenModes]:
    """Clamped and coupled modes of every appendage that thrust excited, and how far noise moves them."""
    roles = Roles.of(model, recording, joints=False)
    excited = excited_axes(recording)
    found: dict[str, SeenModes] = {}
    time = event_times(recording, roles.imu, "acceleration")
    base = recording[f"{roles.imu.name}.acceleration"]
    force, clock = recording["command.force"], recording.time("command.force")
    thrust = np.abs(force).max(axis=1) > 0.0
    steps = clock[1:][np.any(np.diff(force, axis=0) != 0.0, axis=1)]
    base = averaged_at_steps(time, base, steps)
    last = float(clock[min(np.flatnonzero(thrust)[-1] + 1, len(clock) - 1)])
    for joints in model.appendages:
        name = joints.appendage.name
        sensor = roles.panels.get(name)
        size = [np.abs(participation_along(joints, k)).max(initial=0.0) for k in range(3)]
        axis = int(np.argmax(size))
        if sensor is None or max(size) == 0.0 or "xyz"[axis] not in excited:
            continue
        try:
            y = averaged_at_steps(time, sample_channel(recording, sensor, "acceleration", time, None), steps)
            y = y[:, :, axis]
            modes = panel_modes(time, y, base[:, axis], free_from=last)
            clamped, coupled = mode_sigmas(
                time,
                y,
                base[:, axis],
                modes,
                panel_noise=white_sigma(y),
                base_noise=float(white_sigma(base[:, axis])),
                free_from=last,
                rng=np.random.default_rng(REPLICATES_SEED),
            )
            found[name] = SeenModes(modes, clamped, coupled)
        except (NotIdentifiableError, RecordingError) as error:
            notes.append(f"modes of {name}: {error}")
    return found
