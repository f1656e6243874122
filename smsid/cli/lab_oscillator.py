"""``smsid lab oscillator``: one that is driven or was let go, whose spring need not be linear."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from smsid.cli.errors import Outcome
from smsid.cli.inputs import print_estimate, write_diagnosis
from smsid.cli.options import EstimateOutput, LabDiagnosis, LabRecording
from smsid.cli.output import say, working
from smsid.errors import RecordingError


def oscillator(
    recording: LabRecording,
    frequency: Annotated[
        float | None, typer.Option(min=1e-9, help="first guess [Hz]; of a free decay the largest if left out")
    ] = None,
    drive: Annotated[
        str, typer.Option("--input", help="channel of the drive; if there is none, it was let go")
    ] = "extra.input",
    answer: Annotated[str, typer.Option("--output-channel", help="channel of the output")] = "extra.output",
    terms: Annotated[str, typer.Option(help="beyond linear: quadratic,cubic,quintic,damping_growth")] = "",
    damping: Annotated[float, typer.Option(help="first guess")] = 0.05,
    validate: Annotated[Path | None, typer.Option(help="recording to judge by, free-running")] = None,
    diagnose: LabDiagnosis = None,
    output: EstimateOutput = Path("oscillator.json"),
) -> Outcome:
    """Oscillator, driven or let go, with a spring that need not be linear, by the error of its simulation."""
    import numpy as np

    from smsid.identify.estimate import save_estimate
    from smsid.lab.decay import free_decay
    from smsid.lab.oscillator import Oscillator, fit_oscillator
    from smsid.recording import load_recording

    log = load_recording(recording)
    log.require(answer)
    free = drive == "extra.input" and drive not in log.channels
    log.require(*(() if free else (drive,)))
    times = log.time(answer)
    rate = (times.size - 1) / (times[-1] - times[0])
    chosen = tuple(t for t in terms.split(",") if t)
    unit = log.unit(answer)
    y = np.asarray(log[answer], dtype=float).reshape(times.size, -1)
    if y.shape[1] != 1:
        raise RecordingError(f"'{answer}' has {y.shape[1]} columns; one oscillates.", advice="Cut it.")
    y = y[:, 0]
    u = None if free or not np.any(log[drive]) else np.asarray(log[drive], dtype=float).reshape(times.size)
    if u is None and (diagnose is not None or validate is not None):
        raise RecordingError(
            "The oscillator was let go, not driven.", advice="Leave --diagnose and --validate out."
        )
    if u is None:
        modes = free_decay(y, rate).modes
        guess = frequency or max(modes, key=lambda m: m.amplitude).frequency
        near = min(modes, key=lambda m: abs(m.frequency / guess - 1.0))
        frequency, damping, pieces = near.frequency, near.damping, 1
    elif frequency is None:
        raise RecordingError("A driven oscillator takes a first guess.", advice="Give --frequency.")
    else:
        memory = 8.0 / (2 * np.pi * frequency * damping) * rate  # samples
        pieces = int(np.clip(times.size / (5.0 * memory), 1, 10))
    start = Oscillator(frequency, damping, 1.0)
    written = [output]
    with working("fitting the oscillator"):
        if diagnose is not None and u is not None:
            from smsid.lab.oscillator_diagnosis import diagnose_oscillator

            held = None
            if validate is not None:
                judge = load_recording(validate)
                held = judge.name, judge[drive], judge[answer]
            told = diagnose_oscillator(u, y, rate, start, unit=unit, pieces=pieces, validation=held)
            found = told.best
            written.append(write_diagnosis(told.diagnosis, diagnose))
        else:
            found = fit_oscillator(u, y, rate, start, unit=unit, pieces=pieces)
        if chosen and diagnose is None:
            found = fit_oscillator(u, y, rate, found.oscillator, terms=chosen, unit=unit, pieces=pieces)
    save_estimate(found.estimate, output)
    print_estimate(found.estimate)
    say(f"simulation error {found.rmse:.5g} {unit} on '{log.name}'")
    errors = {"simulation": {"recording": log.name, "value": found.rmse, "unit": unit}}
    if validate is not None:
        other = load_recording(validate)
        error = other[answer] - found.oscillator.simulate(other[drive], rate)
        free = float(np.sqrt(np.mean(error**2)))
        say(f"free-running error {free:.5g} {unit} on '{other.name}'")
        errors["free_running"] = {"recording": other.name, "value": free, "unit": unit}
    return Outcome({"estimate": json.loads(found.estimate.to_json()), "errors": errors}, written)
