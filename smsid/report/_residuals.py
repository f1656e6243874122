"""Measured against simulated: what an estimate leaves of the recordings, and what the description left."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from smsid.description.schema import Description
from smsid.errors import SmsidError
from smsid.identify.paper.pipeline import Identification
from smsid.identify.robust import white_sigma
from smsid.likelihood.channels import Channel
from smsid.likelihood.fit import minimise
from smsid.likelihood.initial_guess import candidates
from smsid.likelihood.nuisance_parameters import Nuisance, NuisanceValues
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.point import Evaluation, SearchPoint
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import RecordingTerm, piece_of
from smsid.likelihood.refine import Refinement
from smsid.model import build_model
from smsid.recording import Recording
from smsid.report._traces import Trace, Traces, rotation_vectors, spark
from smsid.report.model import Cell, Figure, Table, Tone, cells
from smsid.report.numbers import number, unit

LOGGER = logging.getLogger(__name__)
UNITS = {
    "position": "m",
    "velocity": "m/s",
    "attitude": "rad",
    "angular_rate": "rad/s",
    "acceleration": "m/s^2",
}
EXPLAINED = 1.05
"""Residual over noise up to which a channel counts as explained."""


@dataclass(frozen=True)
class Residuals:
    """What is left of one recording, a trace per component, by channel; ``before``: by the description."""

    recording: str
    channels: dict[str, tuple[Trace, ...]]

    @property
    def traces(self) -> tuple[Trace, ...]:
        """All components."""
        return tuple(t for own in self.channels.values() for t in own)


def residuals_of(
    description: Description,
    recordings: Sequence[Recording],
    linear: Identification | None,
    refined: Refinement | None,
) -> tuple[Residuals, ...]:
    """Return measured, simulated and residual of every recording, by the refinement or the linear result.

    Initial poses and sensor biases are fitted in each case, the parameters held: described for ``before``.
    Recordings that cannot be predicted (an arm welded to the ground) raise `SmsidError`.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        if refined is not None:
            pieces, described, seen = refined.fit.pieces, refined.described, refined.fit.seen
            locals_ = seen.point.locals
        else:
            model = build_model(description)
            described = Parameters.of(model)
            pairs = [piece_of(model, r, Nuisance()) for r in recordings]
            pieces, locals_ = tuple(p for p, _ in pairs), tuple(local for _, local in pairs)
            seen = _evaluate_held(pieces, candidates(described, linear)[-1], locals_)
        try:
            before = _evaluate_held(pieces, described, locals_)
        except SmsidError as error:
            LOGGER.info("the description cannot be simulated beside: %s", error)
            before = None
    out = []
    for k, piece in enumerate(pieces):
        own = seen.residuals[k]
        was = before.residuals[k] if before is not None else [None] * len(own)
        pairs_ = zip(piece.channels, own, was, strict=True)
        local = seen.point.locals[k]
        out.append(
            Residuals(piece.name, {c.name: _channel(piece.name, c, local, r, b) for c, r, b in pairs_})
        )
    return tuple(out)


def _evaluate_held(
    pieces: Sequence[RecordingTerm], at: Parameters, locals_: Sequence[NuisanceValues]
) -> Evaluation:
    """What is seen with the parameters held and everything else fitted."""
    found = minimise(pieces, SearchPoint(at, tuple(locals_)), Prior(at), np.arange(at.size))
    return Evaluation.at(pieces, found.point)


def _channel(
    recording: str, c: Channel, local: NuisanceValues, residual: np.ndarray, before: np.ndarray | None
) -> tuple[Trace, ...]:
    if c.quantity == "attitude":
        values, simulated = rotation_vectors(c.values), rotation_vectors(c.values, residual)
    else:
        values, simulated = c.values, c.values - residual
    noise = np.asarray(white_sigma(residual), dtype=float)
    label = f"{recording}: {c.sensor.name} {c.quantity.replace('_', ' ')}"
    out = []
    for k in range(c.width):
        name = f"{label} {'xyz'[k % 3]}{f' at station {k // 3 + 1}' if c.width > 3 else ''}"
        own, was = (values[:, k], simulated[:, k], residual[:, k]), None if before is None else before[:, k]
        out.append(Trace(name, UNITS[c.quantity], c.times, *own, float(noise[k]) or None, was))
    return tuple(out)


WORDS = ("measured", "simulated", "residual", "residual before")
WHITE = (
    "Noise: the standard deviation of the part that is white, from third differences. A ratio of one means "
    "nothing but noise is left."
)


def trace_explorer(
    traces: Sequence[Trace],
    title: str,
    caption: str,
    labels: tuple[str, str, str, str] = WORDS,
    *,
    name: str = "traces",
    first: int | None = None,
    band: str = "± 2 σ of the noise",
    scale: str = "noise",
    note: str = WHITE,
    along: str = "time [s]",
) -> tuple[Figure, Table]:
    """Return the figure to look into every trace, and the table of what is left of each.

    Shown at once is the ``first``, or where most was left before. ``scale`` and ``note`` say what the traces'
    ``sigma`` is, ``band`` and ``along`` name the band and the axis.
    """
    if first is None:
        rms = [
            t.whitened_rms if t.before is None else replace(t, residual=t.before).whitened_rms for t in traces
        ]
        first = int(np.argmax(np.nan_to_num(rms)))
    body = Traces(traces, title, first, labels, band, along)
    return Figure(name, title, body, caption), residual_table(name, traces, scale, note)


def residual_table(target: str, traces: Sequence[Trace], scale: str = "noise", note: str = WHITE) -> Table:
    """Return one row per trace: residual, noise, their ratio, the correlation of neighbours, a small curve.

    ``scale`` and ``note`` say what the traces' ``sigma`` is.
    """
    rows = []
    for t in traces:
        r = t.residual
        assert r is not None
        x = r[np.isfinite(r)]
        rms = float(np.sqrt(np.mean(x**2)))
        centred = x - x.mean()
        lag = float(centred[1:] @ centred[:-1] / max(centred @ centred, 1e-300))
        ratio = t.whitened_rms
        tone: Tone = "good" if ratio <= EXPLAINED else "warn" if ratio <= 2.0 else "bad"
        tone = tone if np.isfinite(ratio) else "neutral"  # no noise to compare with
        curve = Cell(f"residual of {t.name}", spark=spark(x))
        known = cells((rms, 3), (t.sigma, 3), (ratio, 3, tone), Cell(number(round(lag, 3), 2), lag))
        rows.append(cells(t.name, unit(t.unit), *known, curve))
    columns = ("channel", "unit", "#residual, rms", f"#{scale}", "#ratio", "#neighbours' correlation",
               "residual")  # fmt: skip
    return Table("Every channel (choose one to see it above)", columns, rows, note, target)
