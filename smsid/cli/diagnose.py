"""``smsid diagnose``: does the simulation explain the recording, and if not, why?"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.errors import CommandResult
from smsid.cli.inputs import read_estimate, read_recordings, write_page
from smsid.cli.options import DescriptionPath, Output, ReportPath, ShowAll, Unchecked
from smsid.cli.output import print_parts, show_spinner
from smsid.cli.places import Writes, is_ours

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from typing import Any

    from rich.console import RenderableType

    from smsid.diagnose import Diagnosis
    from smsid.report import Provenance, Report


def _extended_path(output: Path) -> tuple[Path, ...]:
    """Return where the extended description stands when --extended does not say.

    One that smsid wrote is another diagnosis's where this one was never written, and stays.
    """
    plain, own = output.with_name("extended.toml"), output.with_suffix(".extended.toml")
    return (own if own.exists() or (is_ours(plain) and not output.exists()) else plain,)


DiagnosisOutput = Annotated[
    Output, Writes((".json",), kind="diagnosis", beside=_extended_path, beside_kind="description")
]
EXIT_CODES = {"adequate": 0, "explained": 0, "unexplained": 3, "not_evaluated": 4}


def diagnose_command(
    description: DescriptionPath,
    recordings: Annotated[list[Path], typer.Argument(help="recordings with the commands that drove them")],
    estimate: Annotated[
        Path | None, typer.Option(help="estimate (JSON): how well the nominal parameters are known")
    ] = None,
    validate: Annotated[
        list[Path] | None, typer.Option(help="recordings the gain is measured on; may be given repeatedly")
    ] = None,
    output: DiagnosisOutput = Path("diagnosis.json"),
    extended: Annotated[
        Path | None,
        typer.Option(
            help="description with the causes in it; by default extended.toml beside, or, where that is "
            "another diagnosis's, <output>.extended.toml"
        ),
        Writes((".toml",)),
    ] = None,
    unchecked: Unchecked = False,
    report: ReportPath = None,
    show_all: ShowAll = False,
    cutoff: Annotated[
        float | None, typer.Option(help="low-pass of the motion of an arm whose torques were measured [Hz]")
    ] = None,
) -> CommandResult:
    """Say what the simulation gets wrong, name the cause, extend the model and measure the gain.

    Exit code 0: adequate or explained, 3: unexplained, 4: not evaluated.
    """
    from smsid.arm.setup import arm_description, is_of_an_arm
    from smsid.description import load_description, save_description
    from smsid.diagnose.diagnose import diagnose
    from smsid.diagnose.result import save_diagnosis

    described = load_description(description)
    loaded, judged = read_recordings(recordings, unchecked), read_recordings(validate or (), unchecked)
    if description.suffix == ".urdf" and is_of_an_arm(loaded):
        described = arm_description(description)
    known = read_estimate(estimate)
    place = extended if extended is not None else _extended_path(output)[0]
    with show_spinner("diagnosing"):
        found = diagnose(described, loaded, estimate=known, validation=judged, cutoff=cutoff)
    save_diagnosis(found.diagnosis, output)
    written = [output]
    if found.diagnosis.extends:
        save_description(found.extended, place)
        written.append(place)

    def page(origin: Provenance) -> Report:
        from smsid.report.diagnose import DiagnosisInputs, diagnose_report

        return diagnose_report(found, DiagnosisInputs(described, loaded, known, judged), origin)

    written += write_page(report, page, [description, *recordings, *(validate or ()), estimate], described)
    print_parts(diagnosis_parts(found.diagnosis, everything=show_all))
    document = {"diagnosis": json.loads(found.diagnosis.to_json())}
    return CommandResult(document, written, EXIT_CODES[found.diagnosis.verdict])


def diagnosis_parts(diagnosis: Diagnosis, *, everything: bool = False) -> Iterator[RenderableType]:
    """Yield what to print of a diagnosis: the verdict, causes, gain and what remains."""
    from rich.text import Text

    from smsid.cli.output import note_lines
    from smsid.cli.tables import cut_tables, plain_table

    d = json.loads(diagnosis.to_json())
    yield Text(f"{d['verdict'].replace('_', ' ')}: {d['sentence']}", style="bold")
    if d["causes"]:
        yield from _causes(d["causes"], everything)
    gain = d["gain"]
    if gain["status"] == "evaluated":
        columns = ("channel", "unit", "as given, rms", "refitted, rms", "extended, rms", "noise")
        table = plain_table(*columns, title=f"open loop on {gain['recording']}", left=("channel", "unit"))
        for c in gain["channels"]:
            sizes = (_number_text(c.get(k)) for k in ("given", "refitted", "extended", "noise"))
            table.add_row(c["channel"], c["unit"], *sizes)
        yield table
        left_out, gone = gain.get("left_out"), gain["explained"]
        yield (
            f"whitened rms (noise: 1): {_number_text(gain['whitened_given'])} as given, "
            f"{_number_text(gain['whitened_nominal'])} refitted, "
            f"{_number_text(gain['whitened_extended'])} extended; "
            + ("nothing exceeds the noise" if gone is None else f"{100 * gone:.1f} % of the excess gone")
            + (f"; {left_out} readings of faulty sensors left out" if left_out else "")
        )
    elif gain.get("reason"):
        yield f"gain not evaluated: {gain['reason']}"
    if d["remaining"]:
        columns = ("what", "depends on", "chi-squared", "freedom", "p, corrected")
        table = plain_table(*columns, title="what is left", left=columns[:2])
        for r in d["remaining"]:
            p = "-" if r["p_value"] is None else f"{r['p_value']:.1e}"
            table.add_row(r["where"], r["dependence"], _number_text(r["ratio"]), str(r["freedom"]), p)
        yield from cut_tables([table], everything, 8)
    if everything and d["limits"]:
        columns = ("effect", "where", "shape", "parameter", "least seen", "unit")
        title = "what would have been seen with 95 % chance"
        table = plain_table(*columns, title=title, left=(*columns[:4], "unit"))
        for x in d["limits"]:
            own = (
                x["effect"],
                x["location"],
                x["shape"],
                x["parameter"],
                _number_text(x["value"]),
                x["unit"],
            )
            table.add_row(*own)
        yield table
    if d["priors"]:
        yield d["priors"]
    yield from (Text(line) for line in note_lines(d["notes"], everything=everything))


def _causes(causes: Sequence[Mapping[str, Any]], everything: bool) -> Iterator[RenderableType]:
    from smsid.cli.tables import plain_table

    columns = ("cause", "where", "parameter", "value", "95 % interval", "unit")
    table = plain_table(*columns, left=(*columns[:3], "unit"))
    for c in causes:
        label = c["shape"] or (f"{c['family']}, fitted as {c['fitted']}" if c["fitted"] else c["family"])
        for k, p in enumerate(c["parameters"]):
            low, high = p["interval"]
            cause = (f"{c['effect']} ({label})", c["location"]) if k == 0 else ("", "")
            numbers = _number_text(p["value"], 5), f"{_number_text(low, 5)} ... {_number_text(high, 5)}"
            table.add_row(*cause, p["name"].partition(".")[2], *numbers, p["unit"])
    yield table
    for c in causes:
        others = [f"{a['shape']} at {a['location']}" for a in c["aliases"]]
        shown = others if everything else others[:3]
        if shown:
            more = f" and {len(others) - len(shown)} more" if len(others) > len(shown) else ""
            yield f"{c['effect']} at {c['location']} is not told from {'; '.join(shown)}{more}"


def _number_text(x: float | None, digits: int = 3) -> str:
    """Return a number; a dash for what is not known."""
    return "-" if x is None else f"{x:.{digits}g}"
