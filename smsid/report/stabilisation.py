"""The stabilisation diagram: poles of the clamped panel over model orders, at each sampling rate used."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from smsid.errors import SmsidError
from smsid.identify.appendage_modes import FEWEST_ROWS, MODE_SHARE, MOST_ROWS, ORDERS, panel_modes
from smsid.identify.clocks import event_times, rate_of, sample_channel
from smsid.identify.commanded import excited_axes
from smsid.identify.modes import IdentifiedMode, Poles
from smsid.identify.sensor_roles import Roles
from smsid.identify.ssi_decimate import decimate
from smsid.identify.ssi_input import ssi_cov_input
from smsid.identify.stabilisation import stable_poles
from smsid.lab.modal import AmbientMode
from smsid.model.column_order import order_columns
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.report.axes import Axis
from smsid.report.model import Figure
from smsid.report.plot import Curve, Plot, Rule


@dataclass(frozen=True)
class Diagram:
    """Poles of an appendage at one sampling rate [Hz] by model order, which are stable, the modes read.

    ``state`` says how it was held, ``highest`` [Hz] ends the axis; by default where modes are read.
    """

    appendage: str
    rate: float
    poles: tuple[Poles, ...]
    stable: tuple[np.ndarray, ...]
    modes: tuple[IdentifiedMode | AmbientMode, ...]
    state: str = "clamped"
    highest: float | None = None

    def points(self, stable: bool) -> tuple[np.ndarray, np.ndarray]:
        """Return frequencies (k,) [Hz] and orders (k,) of the poles that are stable, or that are not."""
        pairs = list(zip(self.poles, self.stable, strict=True))
        f = [p.frequency[m if stable else ~m] for p, m in pairs]
        order = [np.full(len(x), p.order) for x, (p, _) in zip(f, pairs, strict=True)]
        return np.concatenate(f), np.concatenate(order)


def diagrams(
    model: SpacecraftModel, recording: Recording, known: Mapping[str, Sequence[IdentifiedMode]] | None = None
) -> tuple[Diagram, ...]:
    """Return the diagrams of every appendage that thrust bent, at the rates its modes were read at.

    ``known``: modes by appendage, as identified; without them they are identified here. Recordings without
    thrust or panel accelerometers have none. Uneven samples raise `RecordingError`.
    """
    if not excited_axes(recording):
        return ()
    recording = order_columns(recording, model)
    roles = Roles.of(model, recording, joints=False)
    time = event_times(recording, roles.imu, "acceleration")
    base = recording[f"{roles.imu.name}.acceleration"]
    rate = rate_of(recording, roles.imu, "acceleration")
    out = []
    for joints in model.appendages:
        name = joints.appendage.name
        sensor = roles.panels.get(name)
        modal = joints.appendage.modal_data()
        along = joints.placement.rotation @ np.array([m.translation for m in modal]).T  # (3, modes)
        axis = int(np.argmax(np.abs(along).max(axis=1)))
        if sensor is None or "xyz"[axis] not in excited_axes(recording):
            continue
        y = sample_channel(recording, sensor, "acceleration", time, None)[:, :, axis]
        root = base[:, axis : axis + 1]
        modes = known.get(name, ()) if known is not None else panel_modes(time, y, root[:, 0]).clamped
        for own in sorted({m.rate for m in modes}, reverse=True):
            made = _at(np.hstack([y - root, root]), rate, own)
            if made:
                kept = tuple(m for m in modes if m.rate == own)
                out.append(Diagram(name, own, made, stable_poles(made), kept))
    return tuple(out)


def _at(x: np.ndarray, rate: float, own: float) -> tuple[Poles, ...]:
    slow, slow_rate = decimate(x, rate, max(1, round(rate / own)))
    rows = min((len(slow) + 1) // (2 * (x.shape[1] + 1)), MOST_ROWS)
    if rows < FEWEST_ROWS:
        return ()
    try:
        return ssi_cov_input(slow[:, :-1], slow[:, -1:], slow_rate, block_rows=rows, orders=ORDERS)
    except SmsidError:
        return ()


def stabilisation_figures(found: Sequence[Diagram]) -> tuple[Figure, ...]:
    """Return a figure per diagram."""
    out = []
    for k, d in enumerate(found):
        top = d.highest or min(0.5 * d.rate, 1.6 * MODE_SHARE * d.rate)
        x = Axis.over("frequency [Hz]", [[0.0, top]], room=0.0, count=7)
        orders = [p.order for p in d.poles]
        y = Axis.over("model order", [[0, max(orders) + 1]], room=0.0, count=6)
        marks = (
            *(Rule(f"{m.frequency:.4g} Hz", m.frequency, colour=1) for m in d.modes if m.frequency <= top),
            Curve("not stable", *d.points(False), 2, "ticks"),
            Curve("stable pole", *d.points(True), 0, "rings"),
        )
        read = ", ".join(f"{m.frequency:.4g} Hz (damping {m.damping:.3g})" for m in d.modes)
        body = Plot(x, y, marks, f"poles of {d.appendage} over model orders; modes at {read}", 240)
        title = f"{d.appendage}, {d.state}, sampled at {d.rate:.3g} Hz"
        out.append(Figure(f"stabilisation-{k}", title, body, f"Read here: {read or 'none'}."))
    return tuple(out)
