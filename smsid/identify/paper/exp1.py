"""Exp. 1 from recording to parameters: which axes were excited, slosh and mass, appendage density, modes."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from smsid.errors import NotIdentifiableError, RecordingError
from smsid.identify.appendage_modes import FEWEST_ROWS, MOST_ROWS, panel_modes
from smsid.identify.clocks import event_times, rate_of, sample_channel
from smsid.identify.commanded import excited_axes
from smsid.identify.paper._exp1_axis_data import SMOOTHING, axis_data
from smsid.identify.paper._exp1_described import check_length, check_possible, left_as_described
from smsid.identify.paper._exp1_panels import (
    PanelShares,
    identify_axis_of_panels,
)
from smsid.identify.paper._exp1_result import (
    SeenModes,
    TranslationResult,
    assemble,
    participation_along,
    tank_marks,
)
from smsid.identify.paper._translation import AxisEstimate
from smsid.identify.paper.motion import raw_rates
from smsid.identify.paper.noise_replicates import (
    REPLICATES,
    add_noise_replicate,
    covariance_of_moves,
    mode_sigmas,
)
from smsid.identify.paper.rest import check_at_rest
from smsid.identify.robust import white_sigma
from smsid.identify.sensor_roles import Roles
from smsid.model.column_order import order_columns
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.sensing import zero_phase

TANK_REPLICATES = 8  # of noise once more, where there are several tanks
FEW_STEPS = 1e-2  # of all samples: a thrust that changes more often has no steps
HOLDING = 2e-3  # [rad/s] body rate up to which the attitude counts as held
ARM_HELD = 0.02  # [rad, m] of an arm's joints up to which it counts as held
NOISE_SIGMAS = 5.0  # of the gyro's stated noise that are no rotation
REPLICATES_SEED = 0  # of the noise added to see how far it moves modes: the same data give the same interval


def identify_translation(
    model: SpacecraftModel, recordings: list[Recording], *, replicates: bool = True
) -> TranslationResult:
    """Identify M, slosh and appendages from recordings of Exp. 1 (several: one per axis, say).

    An axis is taken from the first recording that identifies it; axes that cannot be identified are named in
    ``notes``, and what they would tell stays as described. ``replicates``: whether noise added again shows
    how far it moves modes and several tanks. Raises `NotIdentifiableError` when a recording rotates or
    does not start at rest, or when no axis can be identified for another reason than noise.
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
        if replicates and len(model.slosh) > 1:
            _widen_several_tanks(model, recording, axes, notes)
        for name, seen in _modes(model, recording, notes, replicates).items():
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
    for channel in (c for c in recording.channels if c.partition(".")[2] == "joint_position"):
        low, high = np.nanpercentile(recording[channel], (1, 99), axis=0)
        if not channel.startswith("truth.") and (moved := float((high - low).max())) > ARM_HELD:
            raise NotIdentifiableError(
                f"The arm moves by {moved:.3g} rad (or m) in '{recording.name}', so it is no Exp. 1 (pure "
                "translation).",
                advice=f"Hold the joints to {ARM_HELD:g}.",
                moved=moved,
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


def _marks(model: SpacecraftModel, axis: int) -> list[str]:
    """Marks of the tanks by rising described frequency along an axis."""
    tanks = [s.tank for s in model.slosh]
    pairs = sorted(zip(tanks, tank_marks(tanks), strict=True), key=lambda x: x[0].stiffness[axis] / x[0].mass)
    return [mark for _, mark in pairs]


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


def _modes(
    model: SpacecraftModel, recording: Recording, notes: list[str], replicates: bool
) -> dict[str, SeenModes]:
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
            rows = MOST_ROWS if replicates else FEWEST_ROWS
            modes = panel_modes(time, y, base[:, axis], free_from=last, most_rows=rows)
            clamped, coupled = mode_sigmas(
                time,
                y,
                base[:, axis],
                modes,
                panel_noise=white_sigma(y),
                base_noise=float(white_sigma(base[:, axis])),
                free_from=last,
                rng=np.random.default_rng(REPLICATES_SEED),
                replicates=REPLICATES if replicates else 0,
            )
            found[name] = SeenModes(modes, clamped, coupled)
        except (NotIdentifiableError, RecordingError) as error:
            notes.append(f"modes of {name}: {error}")
    return found
