"""``smsid identify``: from recordings to an identified spacecraft or arm."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from smsid.cli.manners import Outcome
from smsid.cli.options import DescriptionPath, JsonOutput, ReportPath, ShowAll
from smsid.cli.output import console, working
from smsid.errors import SmsidError


def identify_command(
    description: DescriptionPath,
    recordings: Annotated[
        list[Path],
        typer.Argument(
            help="recordings of Exp. 1 (thrust) and Exp. 2 (no thrust); of an arm that is welded to the "
            "ground: one to identify from, and any in the role validation to judge by"
        ),
    ],
    output: JsonOutput = Path("estimate.json"),
    method: Annotated[
        str,
        typer.Option(
            help="ml: maximum likelihood started from the paper's method; paper: the linear method alone"
        ),
    ] = "ml",
    cad: Annotated[
        float | None,
        typer.Option(
            metavar="SIGMA",
            min=1e-6,
            help="how well the URDF's masses, first moments and inertias are known beforehand: standard "
            "deviation relative to the body's size (0.05: 5 %); only as wide priors if left out",
        ),
    ] = None,
    cutoff: Annotated[
        float | None, typer.Option(min=1e-6, help="welded arm: low-pass of angles and torques [Hz]")
    ] = None,
    gains: Annotated[
        bool,
        typer.Option(
            "--gains", help="welded arm: first find the gain of every torque signal from the described links"
        ),
    ] = False,
    show_all: ShowAll = False,
    unchecked: Annotated[
        bool, typer.Option("--unchecked", help="go on although channels contradict each other")
    ] = False,
    report: ReportPath = None,
) -> Outcome:
    """Identify a spacecraft from recordings; the description's values are only the starting guess."""
    from smsid.cli.notes import told
    from smsid.cli.tables import estimate_parts
    from smsid.description import load_description
    from smsid.identify.estimate import save_estimate
    from smsid.identify.pipeline import identify
    from smsid.recording import load_recording

    if method not in ("ml", "paper"):
        raise SmsidError(f"There is no method '{method}'.", advice="Use --method ml or --method paper.")
    out = console()
    described = load_description(description)
    loaded = [load_recording(path) for path in recordings]
    if unchecked:
        loaded = [recording.unchecked() for recording in loaded]
    if cad is not None and (method != "ml" or described.root == "fixed"):
        raise SmsidError(
            "--cad is for maximum likelihood of a spacecraft.",
            advice='Leave it out, or use --method ml with root = "free".',
        )
    if described.root == "fixed":
        from smsid.arm.command import identify_and_judge

        inputs = (description, *recordings)
        judged = identify_and_judge(
            described,
            loaded,
            output,
            cutoff,
            out,
            gains=gains,
            report=report,
            inputs=inputs,
            everything=show_all,
        )
        document = {"estimate": json.loads(output.read_text(encoding="utf-8")), "torque_errors": judged}
        return Outcome(document, [output, *([report] if report else [])])
    if cutoff is not None or gains:
        option = "--gains" if gains else "--cutoff"
        raise SmsidError(f"{option} is for welded arms.", advice='Leave it out, or set root = "fixed".')
    with working("identifying by the paper's method"):
        linear = identify(described, loaded)
    estimate = linear.estimate
    seconds, refined = estimate.timing["total"], None
    if method == "ml":
        from smsid.likelihood import refine

        with working("refining by maximum likelihood"):
            refined = refine(described, loaded, linear, cad=cad)
        estimate = refined.estimate
        seconds += estimate.timing["total"]
    save_estimate(estimate, output)
    if report is not None:
        from smsid.report import files_of, provenance, write_report
        from smsid.report.identify import identify_report

        with working("writing the report"):
            origin = provenance([*files_of(described, description), *recordings])
            write_report(identify_report(described, loaded, linear, refined, origin), report)
    other = linear.estimate if refined is not None else None
    for part in estimate_parts(estimate, other=other, everything=show_all):
        out.print(part, highlight=False)
    for line in told((*linear.estimate.notes, *estimate.notes), everything=show_all):
        out.print(line, markup=False, highlight=False)
    written = [output, *([report] if report else [])]
    out.print(f"identified in {seconds:.1f} s; wrote {', '.join(map(str, written))}", soft_wrap=True)
    return Outcome({"estimate": json.loads(estimate.to_json())}, written)
