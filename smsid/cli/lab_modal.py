"""``smsid lab modal``: modes of a structure from its vibration alone."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.errors import Outcome
from smsid.cli.inputs import print_estimate, write_page
from smsid.cli.options import EstimateOutput, LabRecording, ReportPath
from smsid.cli.output import say, working
from smsid.errors import NotIdentifiableError, RecordingError

if TYPE_CHECKING:
    import numpy as np

    from smsid.recording import Recording
    from smsid.report import Provenance, Report


def modal(
    recording: LabRecording,
    highest: Annotated[float, typer.Option(min=1e-9, help="highest frequency sought [Hz]")],
    channel: Annotated[
        list[str] | None, typer.Option(help="channel of the outputs, several times; default: all, if alike")
    ] = None,
    free: Annotated[
        bool,
        typer.Option(
            "--free-decay",
            help="let go and left alone: of one channel; taken anyway where nothing else is found",
        ),
    ] = False,
    seed: Annotated[int, typer.Option(min=0, help="of the resampling")] = 0,
    output: EstimateOutput = Path("modes.json"),
    report: ReportPath = None,
) -> Outcome:
    """Modes of a structure from its vibration alone: no order to pick, harmonics told apart."""
    import numpy as np

    from smsid.identify.estimate import save_estimate
    from smsid.lab.modal import ambient_modes
    from smsid.recording import load_recording
    from smsid.recording.pieces import even_with_gaps

    log = load_recording(recording)
    names = tuple(channel or _alike(log))
    log.require(*names)
    outputs, rate = even_with_gaps(log, names)
    one = outputs.shape[1] == 1
    if free and not one:
        raise RecordingError(
            f"{', '.join(names)}: {outputs.shape[1]} columns.",
            advice="A free decay is of one; cut the others off.",
        )
    found, why = None, "no mode is stable over model orders and correlation windows."
    with working("looking for modes"):
        try:
            if not free:
                rng = np.random.default_rng(seed)
                found = ambient_modes(outputs, rate, highest_frequency=highest, rng=rng)
        except NotIdentifiableError as error:
            if not one:
                raise
            why = error.message
    if found is None or not (found.modes or found.harmonics or not one):
        decay = max(_finite_runs(outputs), key=len)[:, 0]
        return _free_decay(decay, rate, highest, log.name, output, "" if free else why)
    estimate = found.estimate(log.name)
    save_estimate(estimate, output)

    def page(origin: Provenance) -> Report:
        from smsid.report.modal import modal_report

        longest = max(_finite_runs(outputs), key=len)
        return modal_report(log.name, ", ".join(names), longest, rate, highest, found, origin)

    written = [output, *write_page(report, page, [recording], seed=seed)]
    print_estimate(estimate)
    for k, mode in enumerate(found.modes, start=1):
        if mode.impulsive:
            say(f"mode{k}: kurtosis {mode.kurtosis:.0f}: a few impacts carry the record")
    for f in found.harmonics:
        say(f"{f:.4g} Hz is a harmonic of the excitation, no mode")
    for f in found.faint:
        say(f"{f:.4g} Hz is stable too, but faint: less than a tenth of the covariance")
    if not found.modes:
        say("no mode: none is stable over model orders and correlation windows")
    if found.drift > 0.5:
        say(
            f"{100 * found.drift:.0f} % of the variance moves fewer than 20 times in the record: a drift, "
            "which hides modes; high-pass it"
        )
    gaps = len(_finite_runs(outputs)) - 1
    if gaps:
        say(f"{gaps} {'gap' if gaps == 1 else 'gaps'} left out; no correlation reaches across")
    harmonics = [{"value": float(f), "unit": "Hz"} for f in found.harmonics]
    faint = [{"value": float(f), "unit": "Hz"} for f in found.faint]
    told = {"harmonics": harmonics, "faint": faint, "drift": found.drift, "gaps": gaps}
    return Outcome({"estimate": json.loads(estimate.to_json()), **told}, written)


def _free_decay(
    signal: np.ndarray, rate: float, highest: float, name: str, output: Path, why: str
) -> Outcome:
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
    print_estimate(estimate)
    amplitudes = ", ".join(f"{m.amplitude:.3g}" for m in found.modes)
    say(f"free decay; noise {found.noise:.3g}, amplitude {amplitudes}")
    return Outcome({"estimate": json.loads(estimate.to_json()), "harmonics": []}, [output])


def _alike(log: Recording) -> tuple[str, ...]:
    """Return all channels, if they are one quantity on one clock; else raise `RecordingError`."""
    names = log.channels
    units = {log.dataset[name].attrs.get("unit") for name in names}
    if len(names) == 1 or (len(units) == 1 and len({len(log.time(name)) for name in names}) == 1):
        return tuple(names)
    raise RecordingError(
        f"The recording has {len(names)} channels of several kinds.",
        advice=f"Choose with --channel one or more of {', '.join(names)}.",
    )


def _finite_runs(outputs: np.ndarray) -> list[np.ndarray]:
    """Return the runs of finite rows of outputs (N, l)."""
    import numpy as np

    bad = ~np.isfinite(outputs).all(axis=1)
    pieces = np.split(outputs, np.flatnonzero(np.diff(bad.astype(int))) + 1)
    return [piece for piece in pieces if len(piece) and np.isfinite(piece).all()]
