"""``smsid lab modal``: modes of a structure from its vibration alone."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from smsid.cli.lab_options import RecordingPath, print_estimate
from smsid.cli.manners import Outcome
from smsid.cli.options import Output, ReportPath
from smsid.cli.output import console, working
from smsid.errors import RecordingError


def modal(
    recording: RecordingPath,
    highest: Annotated[float, typer.Option(help="highest frequency sought [Hz]")],
    channel: Annotated[str | None, typer.Option(help="channel of the outputs; default the only one")] = None,
    seed: Annotated[int, typer.Option(help="of the resampling")] = 0,
    output: Output = Path("modes.json"),
    report: ReportPath = None,
) -> Outcome:
    """Modes of a structure from its vibration alone: no order to pick, harmonics told apart."""
    import numpy as np

    from smsid.identify.estimate import save_estimate
    from smsid.lab.modal import ambient_modes
    from smsid.recording import load_recording

    log = load_recording(recording)
    if channel is None and len(log.channels) != 1:
        raise RecordingError(
            f"The recording has {len(log.channels)} channels.",
            advice=f"Choose with --channel one of {', '.join(log.channels)}.",
        )
    name = channel or log.channels[0]
    log.require(name)
    times = log.time(name)
    rate = (times.size - 1) / (times[-1] - times[0])
    even = log.resampled(rate)[name]
    outputs = even.reshape(len(even), -1)
    with working("looking for modes"):
        found = ambient_modes(outputs, rate, highest_frequency=highest, rng=np.random.default_rng(seed))
    estimate = found.estimate(log.name)
    save_estimate(estimate, output)
    out, written = console(), [output]
    if report is not None:
        from smsid.report import provenance, write_report
        from smsid.report.modal import modal_report

        with working("writing the report"):
            origin = provenance([recording], seed=seed)
            made = modal_report(log.name, name, outputs, rate, highest, found, origin)
            written.append(write_report(made, report))
    print_estimate(out, estimate)
    for k, mode in enumerate(found.modes, start=1):
        if mode.impulsive:
            out.print(f"mode{k}: kurtosis {mode.kurtosis:.0f}: a few impacts carry the record")
    for f in found.harmonics:
        out.print(f"{f:.4g} Hz is a harmonic of the excitation, no mode")
    out.print(f"wrote {', '.join(map(str, written))}", markup=False, highlight=False, soft_wrap=True)
    harmonics = [{"value": float(f), "unit": "Hz"} for f in found.harmonics]
    return Outcome({"estimate": json.loads(estimate.to_json()), "harmonics": harmonics}, written)
