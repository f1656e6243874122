"""Torques of an arm in the report of a diagnosis: measured and predicted, and what is left."""

from __future__ import annotations

import numpy as np

from smsid.diagnose.torque.search import TorqueSearch
from smsid.report.model import Figure, Section
from smsid.report.residuals import residual_table
from smsid.report.spectra import spectrum_grid
from smsid.report.traces import Trace, Traces

BUDGET = 200_000
NOTE = "Noise: the torque's white noise within the band that is compared."


def torque_sections(found: TorqueSearch, recording: str) -> list[Section]:
    """Return measured against predicted torques, and the spectra of what is left."""
    traces = torque_traces(found)
    worst = int(np.nanargmax([t.whitened_rms if t.sigma else 0.0 for t in traces]))
    labels = ("measured", "predicted", "residual", "residual before any cause")
    body = Traces(traces, "measured and predicted torques", worst, labels, budget=BUDGET)
    figure = Figure("traces", "Measured and predicted torque", body, "Low-passed alike on both sides.")
    table = residual_table("traces", traces, note=NOTE)
    groups = {t.name: (t,) for t in traces}
    grid = spectrum_grid("spectrum", groups, labels=("before any cause", "with the causes"))
    return [
        Section("residuals", "Measured against predicted", (figure, table), recording),
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
