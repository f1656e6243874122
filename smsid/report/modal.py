"""The report of ``smsid lab modal``: modes of a structure from its vibration alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.signal import correlate, welch

from smsid._statistics import NORMAL95
from smsid.identify.ssi_decimate import decimate
from smsid.lab.modal import AmbientModes
from smsid.report._residuals import trace_explorer
from smsid.report._traces import Trace
from smsid.report.axes import Axis
from smsid.report.model import Cell, Figure, Grid, Provenance, Report, Section, Table, Tone, cells
from smsid.report.numbers import number, share
from smsid.report.parameters import identifiability, parameter_table
from smsid.report.plot import Curve, Plot, Rule
from smsid.report.stabilisation import Diagram, stabilisation_figures

SEGMENTS = 8
NOTE = (
    "Scatter: the standard deviation of a correlation of so long a record about zero. A ratio of one or less "
    "means that modes and harmonics explain the correlations; shares and phases are fitted to each output."
)
ALONE = 1.5  # residual over scatter up to which the modes explain an output


def modal_report(
    name: str,
    channel: str,
    outputs: np.ndarray,
    rate: float,
    highest: float,
    found: AmbientModes,
    origin: Provenance,
) -> Report:
    """Return the report of a test under ambient vibration.

    Args:
        name: of the recording.
        channel: of the outputs.
        outputs: (N, l) at even times [any unit].
        rate: of them [Hz].
        highest: frequency sought [Hz].
        found: the modes.
        origin: versions, command, files.
    """
    traces = correlation_traces(outputs, rate, found)
    parameters = found.estimate(name).parameters
    sections = []
    if found.modes:
        chart = identifiability("known", parameters)
        table = parameter_table("Frequencies, damping ratios, distances of neighbours", parameters)
        gist = f"{len(found.modes)} modes, 95 % intervals"
        sections.append(Section("parameters", "Modes", (chart, table, _shapes(found)), gist))
    ratio = traces[0].whitened_rms
    labels = ("measured", "fitted", "residual", "")
    caption = (
        "Autocorrelations relative to the variance: what free decay would look like. Frequencies and damping "
        "are those identified. The strongest output is shown first."
    )
    parts = trace_explorer(traces, "Correlations, measured and fitted", caption, labels, first=0,
                     band="± 2 σ of its scatter", scale="scatter", note=NOTE, along="lag [s]")  # fmt: skip
    gist = f"{channel}, {outputs.shape[1]} outputs"
    d = found.diagram
    state = f"past and future of {number(d.window, 3)} s"
    made = Diagram(name, found.rate, d.poles, d.stable, found.modes, state, 1.1 * highest)
    caption = (
        "Poles of SSI-COV by model order, with one of the lengths of past and future that resolve most "
        "modes. A ring has the same frequency, damping and shape one order below. No order is picked."
    )
    diagram = Grid("Poles over model orders", stabilisation_figures([made]), caption)
    sections += [
        Section("residuals", "Measured against fitted", parts, gist),
        Section("spectrum", "Spectrum of the outputs", (_spectrum(outputs, rate, highest, found),)),
        Section("diagram", "Stabilisation diagram", (diagram,), "over model orders"),
    ]
    sentence, tone = verdict(found, ratio)
    glance = [("modes", str(len(found.modes))), ("harmonics", str(len(found.harmonics)))]
    glance += [("residual / scatter, strongest output", number(ratio, 3))]
    glance += [("record", f"{number(len(outputs) / rate, 4)} s at {number(rate, 4)} Hz")]
    return Report("Modes from ambient vibration", name, sentence, tone, sections, origin, glance)


def verdict(found: AmbientModes, ratio: float) -> tuple[str, Tone]:
    """Return one sentence on the modes, and what it is worth; ``ratio``: residual over scatter they leave."""
    other = f" {_list_numbers(found.harmonics)} Hz: harmonics, no modes." if found.harmonics else ""
    if not found.modes:
        return f"No mode is stable over model orders and correlation windows.{other}", "neutral"
    weak = [f"mode {k}" for k, m in enumerate(found.modes, 1) if m.damping_sigma > 0.5 * m.damping]
    sigma = max(m.frequency_sigma / m.frequency for m in found.modes)
    plural = "modes are" if len(found.modes) > 1 else "mode is"
    sentence = (
        f"{len(found.modes)} {plural} found at {_list_numbers([m.frequency for m in found.modes])} Hz, every "
        f"frequency to {share(NORMAL95 * sigma)} (95 %)."
    )
    if any(m.impulsive for m in found.modes):
        return f"{sentence} A few impacts carry the record; it is short of lasting excitation.{other}", "warn"
    if weak:
        return f"{sentence} The damping of {', '.join(weak)} is hardly known.{other}", "warn"
    if ratio > ALONE:
        text = f"They leave {number(ratio, 2)} times the scatter of the strongest output's correlations."
        return f"{sentence} {text}{other}", "warn"
    return sentence + other, "good"


def _list_numbers(values: Sequence[float]) -> str:
    texts = [number(x, 4) for x in values]
    return " and ".join([", ".join(texts[:-1]), texts[-1]] if len(texts) > 1 else texts)


def _shapes(found: AmbientModes) -> Table:
    width = len(found.modes[0].shape)
    outputs = (f"#{k + 1}" for k in range(width))
    columns = ("mode", "#Hz", "#response", "#windows", "#kurtosis", "excited", *outputs)
    rows = []
    for k, m in enumerate(found.modes, 1):
        excited = Cell("by a few impacts", tone="warn") if m.impulsive else Cell("by lasting noise")
        shape = m.shape / m.shape[int(np.argmax(np.abs(m.shape)))]
        shares = Cell(share(m.contribution), m.contribution), Cell(share(m.windows, 3), m.windows)
        known = (m.frequency, 5), *shares, (m.kurtosis, 3), excited
        rows.append(cells(f"mode {k}", *known, *((float(x), 3) for x in shape)))
    note = (
        "Response: share of the covariance. Windows: share of the lengths of past and future used that have "
        "the mode. Kurtosis of its band: 3 for lasting noise, 1.5 for a sine, much more for impacts. Then "
        "the shape by output, largest entry one."
    )
    return Table("Shapes and how they were excited", columns, rows, note)


def _spectrum(outputs: np.ndarray, rate: float, highest: float, found: AmbientModes) -> Figure:
    slow, slow_rate = decimate(outputs - outputs.mean(axis=0), rate, max(1, round(rate / found.rate)))
    slow = slow / np.maximum(slow.std(axis=0), 1e-300)
    f, density = welch(slow, slow_rate, nperseg=max(len(slow) // SEGMENTS, 64), axis=0)
    kept = (f > 0.0) & (f <= 1.1 * highest)
    mean = density[kept].mean(axis=1)
    marks: list[Curve | Rule] = [Rule(f"{number(m.frequency, 4)} Hz", m.frequency) for m in found.modes]
    marks += [Rule(f"{number(x, 4)} Hz, harmonic", x, colour=1) for x in found.harmonics]
    marks.append(Curve("all outputs, each by its variance", f[kept], mean, 2, "thin"))
    x = Axis.over("frequency [Hz]", [[0.0, 1.1 * highest]], room=0.0, count=8)
    y = Axis.over("density [1/Hz]", [mean], log=True, count=4)
    body = Plot(x, y, marks, "power spectral density of the outputs with the modes found", 230)
    return Figure("psd", "Power spectral density", body, "Upright lines: modes, and harmonics if any.")


MOST = 12  # outputs shown


def correlation_traces(y: np.ndarray, rate: float, found: AmbientModes) -> tuple[Trace, ...]:
    """Return the autocorrelation of outputs over lag, measured and as modes and harmonics make it.

    ``y`` (N, l) at ``rate`` [Hz]. Frequencies and damping are those identified; the share and phase of each
    mode in each output are fitted here, by least squares. The noise is the scatter of a correlation of so
    long a record about zero (Bartlett 1946). The strongest output is first, `MOST` are returned.
    """
    slow, slow_rate = decimate(y - y.mean(axis=0), rate, max(1, round(rate / found.rate)))
    slow = slow - slow.mean(axis=0)
    count = min(max(int(found.window * slow_rate), 8), len(slow) // 4)
    lags = np.arange(1, count + 1) / slow_rate  # the first holds white noise too
    basis = _basis(found, lags)
    strongest = np.argsort(-np.var(slow, axis=0), kind="stable")[:MOST]
    out = []
    for k in strongest.tolist():
        x = slow[:, k]
        full = correlate(x, x, method="fft")[len(x) - 1 :]
        measured = full[1 : count + 1] / full[0]
        fitted = basis @ np.linalg.lstsq(basis, measured, rcond=None)[0]
        scatter = float(np.sqrt((1.0 + 2.0 * np.sum(measured**2)) / len(slow)))
        out.append(Trace(f"output {k + 1}", "1", lags, measured, fitted, measured - fitted, scatter))
    return tuple(out)


def _basis(found: AmbientModes, lags: np.ndarray) -> np.ndarray:
    """Decaying cosines and sines (lags, columns) of the modes, lasting ones of the harmonics."""
    columns = [np.zeros_like(lags)]
    lasting = [(f, 0.0) for f in found.harmonics]
    for frequency, damping in [(m.frequency, m.damping) for m in found.modes] + lasting:
        w = 2.0 * np.pi * frequency
        fade = np.exp(-damping * w * lags)
        turn = w * np.sqrt(1.0 - damping**2) * lags
        columns += [fade * np.cos(turn), fade * np.sin(turn)]
    return np.stack(columns, axis=1)
