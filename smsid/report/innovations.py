"""What a diagnosis leaves of its recording, before and after."""

from __future__ import annotations

import numpy as np

from smsid.diagnose.stepwise import Search
from smsid.diagnose.torque.search import TorqueSearch
from smsid.recording import Recording
from smsid.report.model import Section
from smsid.report.residuals import explored
from smsid.report.spectra import spectrum_grid
from smsid.report.traces import Trace, rotation_vectors


def innovation_traces(found: Search, recording: Recording) -> dict[str, tuple[Trace, ...]]:
    """Return measured and predicted a sample ahead by channel, residuals after and before the causes."""
    data, run, before = found.last.problem.data, found.last.run, found.nominal.run
    out: dict[str, tuple[Trace, ...]] = {}
    for block in data.blocks:
        attitude = block.quantity == "attitude"
        turned = rotation_vectors(data.attitude[block.channel]) if attitude else np.zeros((0, 0))
        unit = "rad" if attitude else recording.units.get(block.channel, "")
        own = []
        for k, row in enumerate(range(block.rows.start, block.rows.stop)):
            values = (turned[:, k], None) if attitude else (data.values[:, row], run.predicted[:, row])
            error = np.where(run.used[:, row], run.errors[:, row], np.nan)
            # what a sample is expected to be off by: its noise and what the state is uncertain by
            used = run.used[:, row] & (np.abs(run.normalised[:, row]) > 1e-12)
            shares = np.abs(run.errors[used, row] / run.normalised[used, row])
            sigma = float(np.median(shares)) if used.any() else float(data.sigma[row])
            name = data.names[row].replace(".", " ", 1).replace("_", " ")
            own.append(Trace(name, unit, data.times, *values, error, sigma, before.errors[:, row]))
        out[block.channel] = tuple(own)
    return out


def whitened_groups(found: Search) -> dict[str, tuple[Trace, ...]]:
    """Return whitened innovations by channel, after and before the causes, for their spectra."""
    data = found.last.problem.data
    settle = len(data.times) // 50
    left, was = found.last.run.innovations[settle:], found.nominal.run.innovations[settle:]
    return {
        b.channel: tuple(
            Trace(data.names[k], "1", data.times[settle:], left[:, k], None, left[:, k], 1.0, was[:, k])
            for k in range(b.rows.start, b.rows.stop)
        )
        for b in data.blocks
    }


NOTE = "Noise: the torque's white noise within the band that is compared."


def torque_sections(found: TorqueSearch, recording: str) -> list[Section]:
    """Return measured against predicted torques, and the spectra of what is left."""
    traces = torque_traces(found)
    labels = ("measured", "predicted", "residual", "residual before any cause")
    caption = "Low-passed alike on both sides."
    parts = explored(traces, "Measured and predicted torque", caption, labels, note=NOTE)
    groups = {t.name: (t,) for t in traces}
    grid = spectrum_grid("spectrum", groups, labels=("before any cause", "with the causes"))
    return [
        Section("residuals", "Measured against predicted", parts, recording),
        Section("spectra", "Spectra of the residuals, before and after", (grid,)),
    ]


def torque_traces(found: TorqueSearch) -> tuple[Trace, ...]:
    """Return a trace per joint of the recording that was searched."""
    fit, before = found.last, found.nominal.residual if found.causes else None
    equations = fit.equations
    out = []
    for k, joint in enumerate(equations.names):
        measured, left = equations.torque[:, k], fit.residual[:, k]
        values, was = (measured, measured - left, left), None if before is None else before[:, k]
        out.append(
            Trace(f"torque of {joint}", "N m", equations.time, *values, float(equations.noise[k]), was)
        )
    return tuple(out)
