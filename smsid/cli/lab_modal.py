"""``smsid lab modal``: modes of a structure from its vibration alone."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from smsid.cli.lab_options import RecordingPath, print_estimate
from smsid.cli.manners import Outcome
from smsid.cli.options import JsonOutput, ReportPath
from smsid.cli.output import console, working
from smsid.errors import NotIdentifiableError, RecordingError


def modal(
    recording: RecordingPath,
    highest: Annotated[float, typer.Option(min=1e-9, help="highest frequency sought [Hz]")],
    channel: Annotated[str | None, typer.Option(help="channel of the outputs; default the only one")] = None,
    free: Annotated[
        bool,
        typer.Option(
            "--free-decay",
            help="let go and left alone: of one channel; taken anyway where nothing else is found",
        ),
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="of the resampling")] = 0,
    output: JsonOutput = Path("modes.json"),
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
    one = outputs.shape[1] == 1
    if free and not one:
        raise RecordingError(
            f"'{name}' has {outputs.shape[1]} columns.", advice="A free decay is of one; cut the others off."
        )
    with working("looking for modes"):
        try:
            found = (
                None
                if free
                else ambient_modes(outputs, rate, highest_frequency=highest, rng=np.random.default_rng(seed))
            )
            why = "no mode is the same over orders and windows."
        except NotIdentifiableError as error:
            found, why = None, error.message
            if not one:
                raise
    if found is None or not (found.modes or found.harmonics or not one):
        return _free_decay(outputs[:, 0], rate, highest, log.name, output, "" if free else why)
    if not found.modes:
        console().print(f"no modes up to {highest:g} Hz: {why} Record longer, or raise --highest.")
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


def _free_decay(signal: Any, rate: float, highest: float, name: str, output: Path, why: str) -> Outcome:
    """Take one channel for a free decay; ``why`` it is not ambient vibration, empty where that was asked."""
    from smsid.identify.estimate import save_estimate
    from smsid.lab.decay import free_decay

    try:
        found = free_decay(signal, rate, highest=highest)
    except NotIdentifiableError as error:
        reason = f"As ambient vibration: {why} As a free decay: {error.message}" if why else error.message
        raise NotIdentifiableError(reason, advice=error.advice) from error
    estimate = found.estimate(name)
    save_estimate(estimate, output)
    out = console()
    print_estimate(out, estimate)
    out.print(
        f"free decay; noise {found.noise:.3g}, amplitude "
        + ", ".join(f"{m.amplitude:.3g}" for m in found.modes)
    )
    out.print(f"wrote {output}", markup=False, highlight=False, soft_wrap=True)
    return Outcome({"estimate": json.loads(estimate.to_json()), "harmonics": []}, [output])
