"""``smsid diagnose``: does the simulation explain the recording, and if not, why?"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.manners import Outcome
from smsid.cli.options import Output, ReportPath, writable
from smsid.cli.output import console, working

if TYPE_CHECKING:
    from rich.table import Table

    from smsid.diagnose import Diagnosis

EXIT_CODES = {"adequate": 0, "explained": 0, "unexplained": 3, "not_evaluated": 4}


def diagnose_command(
    description: Annotated[Path, typer.Argument(help="description of the spacecraft or arm: a TOML")],
    recordings: Annotated[list[Path], typer.Argument(help="recordings with the commands that drove them")],
    estimate: Annotated[
        Path | None, typer.Option(help="estimate (JSON): how well the nominal parameters are known")
    ] = None,
    validate: Annotated[
        list[Path] | None, typer.Option(help="recordings the gain is measured on; may be given repeatedly")
    ] = None,
    output: Output = Path("diagnosis.json"),
    extended: Annotated[
        Path | None,
        typer.Option(
            callback=writable, help="description with the causes in it; by default extended.toml beside"
        ),
    ] = None,
    unchecked: Annotated[
        bool, typer.Option("--unchecked", help="go on although channels contradict each other")
    ] = False,
    report: ReportPath = None,
    cutoff: Annotated[
        float | None, typer.Option(help="low-pass of the motion of an arm whose torques were measured [Hz]")
    ] = None,
) -> Outcome:
    """Say what the simulation gets wrong, name the cause, extend the model and measure the gain.

    Exit code 0: adequate or explained, 3: unexplained, 4: not evaluated.
    """
    from smsid.description import load_description, save_description
    from smsid.diagnose.diagnose import diagnose
    from smsid.diagnose.result import save_diagnosis
    from smsid.identify.estimate import load_estimate
    from smsid.recording import load_recording

    described = load_description(description)
    loaded = [load_recording(path) for path in recordings]
    if unchecked:
        loaded = [recording.unchecked() for recording in loaded]
    judged = [load_recording(path) for path in validate or []]
    if unchecked:
        judged = [recording.unchecked() for recording in judged]
    known = load_estimate(estimate) if estimate is not None else None
    with working("diagnosing"):
        found = diagnose(described, loaded, estimate=known, validation=judged, cutoff=cutoff)
    save_diagnosis(found.diagnosis, output)
    written = [output]
    # causes in measured torques stand also where something else is left
    standing = found.torques is not None and bool(found.diagnosis.causes)
    if found.diagnosis.verdict == "explained" or standing:
        place = extended if extended is not None else output.with_name("extended.toml")
        save_description(found.extended, place)
        written.append(place)
    if report is not None:
        from smsid.report import files_of, provenance, write_report
        from smsid.report.diagnose import Asked, diagnose_report

        with working("writing the report"):
            inputs = [*files_of(described, description), *recordings, *(validate or [])]
            origin = provenance([*inputs, *([estimate] if estimate else [])])
            write_report(diagnose_report(found, Asked(described, loaded, known, judged), origin), report)
        written.append(report)
    out = console()
    for part in diagnosis_tables(found.diagnosis):
        out.print(part)
    out.print(f"wrote {', '.join(map(str, written))}")
    document = {"diagnosis": json.loads(found.diagnosis.to_json())}
    return Outcome(document, written, EXIT_CODES[found.diagnosis.verdict])


def diagnosis_tables(d: Diagnosis) -> list[Table | str]:
    """Return what to print of a diagnosis: the verdict, causes, gain and what remains."""
    from rich.table import Table

    parts: list[Table | str] = [f"{d.verdict.replace('_', ' ')}: {d.sentence}"]
    if d.causes:
        table = Table("cause", "where", "parameter", "value", "95 % interval", "unit", "not told from")
        for c in d.causes:
            others = "; ".join(f"{a.shape} at {a.location}" for a in c.aliases)
            for i, p in enumerate(c.parameters):
                low, high = p.interval
                table.add_row(
                    f"{c.effect} ({c.label})" if i == 0 else "",
                    c.location if i == 0 else "",
                    p.name.partition(".")[2],
                    f"{p.value:.5g}",
                    f"{low:.5g} ... {high:.5g}",
                    p.unit,
                    others if i == 0 else "",
                )
        parts.append(table)
    if d.gain is not None:
        g = d.gain
        table = Table(
            "channel", "unit", "as given, rms", "extended, rms", "noise", title=f"open loop on {g.recording}"
        )
        for c in g.channels:
            row = (f"{x:.3g}" for x in (c.given, c.extended, c.noise))
            table.add_row(c.channel, c.unit, *row)
        parts.append(table)
        parts.append(
            f"whitened rms: {g.whitened_given:.3f} as given, {g.whitened_nominal:.3f} refitted, "
            f"{g.whitened_extended:.3f} extended (noise: 1); {100 * g.explained:.1f} % of the excess gone"
            + (f"; {g.left_out} readings of faulty sensors left out" if g.left_out else "")
        )
    elif d.gain_reason:
        parts.append(f"gain not evaluated: {d.gain_reason}")
    if d.remaining:
        table = Table("what", "depends on", "chi-squared", "freedom", "p, corrected")
        for r in d.remaining[:8]:
            table.add_row(r.where, r.dependence, f"{r.ratio:.0f}", str(r.freedom), f"{r.p_value:.1e}")
        parts.append(table)
    if d.priors:
        parts.append(d.priors)
    return parts
