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


@dataclass(frozen=True)
class TranslationResult:
    """What Exp. 1 identified.

    ``combined``: parameters by symbol with their joint covariance; ``symbols``: the description's parameter name of
    a symbol (``tank.mass`` of ``m_s`` and so on); ``modes`` by appendage.
    """

    axes: tuple[AxisEstimate, ...]
    combined: Combined
    symbols: dict[str, str]
    modes: dict[str, PanelModes]
    parameters: tuple[ParameterEstimate, ...]
    notes: tuple[str, ...] = ()
    conditions: dict[str, float] = field(default_factory=dict)

    @property
    def mass(self) -> float:
        """Total mass M [kg]."""
        return self.combined["M"][0]

    def values(self, change: Mapping[str, float] | None = None) -> dict[str, float]:
        """Return values by the description's names, with a change by symbol added; damping is never negative."""
        out = {}
        for symbol, name in self.symbols.items():
            value = self.combined[symbol][0] + (change or {}).get(symbol, 0.0)
            out[name] = max(value, 0.0)
        return out

    def density_factor(self, change: Mapping[str, float] | None = None) -> float:
        """Return rho relative to the description's, 1 when it was not identified."""
        if "rho" not in self.combined:
            return 1.0
        return self.combined["rho"][0] + (change or {}).get("rho", 0.0)


def excited_axes(recording: Recording) -> str:
    """Return the body axes along which thrust acted, as letters of 'xyz'."""
    if "command.force" not in recording:
        return ""
    peak = np.abs(recording["command.force"]).max(axis=0)
    return "".join(a for a, f in zip("xyz", peak, strict=True) if f > 1e-6 * max(peak.max(), 1e-30) and f > 0.0)


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
    return _assemble(model, axes, modes, notes)


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
    along = np.array([joints.placement.rotation @ np.asarray(m.translation) for m in joints.appendage.modal_data()])
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
        along = np.array([joints.placement.rotation @ np.asarray(m.translation) for m in joints.appendage.modal_data()])
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
        last = float(recording.time("command.force")[min(thrust[-1] + 1, len(recording.time("command.force")) - 1)])
        try:
            found[name] = panel_modes(time, y, recording[channel][:, axis], free_from=last)
        except (NotIdentifiableError, RecordingError) as error:
            notes.append(f"modes of {name}: {error}")
    return found


def _assemble(
    model: SpacecraftModel, axes: list[AxisEstimate], modes: dict[str, PanelModes], notes: list[str]
) -> TranslationResult:
    found = combine(axes)
    value, sigma = found["M"]
    parameters = [judged("total.mass", value, "kg", sigma, "exp1", nominal=model.mass)]
    symbols: dict[str, str] = {}  # the description's parameter name of each symbol
    tanks = [e for e in model.description.effect if isinstance(e, Slosh)]
    for i, tank in enumerate(sorted(tanks, key=lambda t: min(t.stiffness) / t.mass)):
        mark = f"{i + 1}" if len(tanks) > 1 else ""
        if f"m_s{mark}" not in found:
            notes.append(f"{tank.name}: no axis separates it from the other tanks; it stays as described")
            continue
        symbols[f"m_s{mark}"] = f"{tank.name}.mass"
        value, sigma = found[f"m_s{mark}"]
        parameters.append(judged(f"{tank.name}.mass", value, "kg", sigma, "exp1", nominal=tank.mass))
        for k, axis in enumerate("xyz"):
            for symbol, field_name, unit in (("k_s", "stiffness", "N/m"), ("b_s", "damping", "N s/m")):
                if f"{symbol}{mark}.{axis}" not in found:
                    continue
                key = f"{tank.name}.{field_name}.{axis}"
                symbols[f"{symbol}{mark}.{axis}"] = key
                value, sigma = found[f"{symbol}{mark}.{axis}"]
                nominal = getattr(tank, field_name)[k]
                parameters.append(judged(key, value, unit, sigma, "exp1", nominal=nominal))
    if "rho" in found:
        parameters += _densities(model, *found["rho"])
    for name, panel in modes.items():
        described = {j.appendage.name: j.appendage for j in model.appendages}[name].modal_data()
        if len(panel.clamped) < len(described):
            notes.append(f"{name}: {len(panel.clamped)} of {len(described)} described modes found. {panel.status}")
        parameters += _mode_parameters(name, panel, described)
    conditions = {f"Exp. 1, axis {e.axis}": e.condition for e in axes}
    return TranslationResult(
        tuple(axes), found, symbols, modes, tuple(parameters), tuple(notes), conditions
    )


def _densities(model: SpacecraftModel, factor: float, sigma: float) -> list[ParameterEstimate]:
    out = []
    note = "" if len(model.appendages) == 1 else "one common factor for all appendages along the axis"
    for joints in model.appendages:
        part = joints.appendage
        if isinstance(part, BeamAppendage):
            key, unit, nominal = f"{part.name}.linear_density", "kg/m", part.linear_density
        else:
            key, unit, nominal = f"{part.name}.participation_factor", "1", 1.0
        out.append(judged(key, factor * nominal, unit, sigma * nominal, "exp1", nominal=nominal, note=note))
    return out


def _mode_parameters(name: str, panel: PanelModes, described: tuple[Mode, ...]) -> list[ParameterEstimate]:
    out = []
    for k, (mode, nominal) in enumerate(zip(panel.clamped, described, strict=False), start=1):
        note = "clamped; sigma is the spread over model orders"
        out.append(judged(f"{name}.mode{k}.frequency", mode.frequency, "Hz", mode.frequency_order_spread, "modes",
                          nominal=nominal.frequency, note=note))
        out.append(judged(f"{name}.mode{k}.damping", mode.damping, "1", mode.damping_order_spread, "modes",
                          nominal=nominal.damping, note=note))
    for k, mode in enumerate(panel.coupled, start=1):
        out.append(ParameterEstimate(f"{name}.coupled{k}.frequency", mode.frequency, "Hz",
                                     mode.frequency_order_spread, "by_product", "modes",
                                     note="coupled to the spacecraft; sigma is the spread over model orders"))
    return out
