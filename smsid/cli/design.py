"""``smsid design``: the experiment whose data tell most, within limits."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from smsid.cli.errors import INTERRUPTED, CommandResult
from smsid.cli.inputs import write_page
from smsid.cli.options import DescriptionPath, Output, ReportPath, ShowAll
from smsid.cli.output import print_parts, say, show_spinner
from smsid.cli.places import Writes

if TYPE_CHECKING:
    from rich.console import RenderableType

    from smsid.design import Design
    from smsid.design.model_discrimination import Separation
    from smsid.report import Provenance, Report

SHARE = re.compile(r"\s*([0-9.eE+-]+)\s*(%?)\s*")


def design_command(
    description: DescriptionPath,
    wanted: Annotated[
        str | None,
        typer.Option(
            "--for",
            help="what to find out: slosh, panel, mass, inertia, b_s, k_s, m_s, an effect's name, names of "
            "parameters as identify prints them, or patterns of names; several with commas",
        ),
    ] = None,
    separate: Annotated[
        str | None,
        typer.Option(help="two causes as diagnose prints them, e.g. 'viscous at joint2,coulomb at joint2'"),
    ] = None,
    output: Annotated[Output, Writes((".toml",), kind="experiment")] = Path("experiment.toml"),
    mode: Annotated[
        Literal["auto", "thrust", "motion"],
        typer.Option(help="thrust: attitude held; motion: arm and wheels, free floating"),
    ] = "auto",
    criterion: Annotated[
        Literal["worst", "A", "D"],
        typer.Option(help="worst relative standard deviation; A: their mean square; D: the volume"),
    ] = "worst",
    to: Annotated[
        str | None, typer.Option(help="precision the worst parameter is to reach (10%), in the shortest time")
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="of the experiment [s]; with --to the longest allowed")
    ] = None,
    stroke: Annotated[float | None, typer.Option(help="limit: slosh mass from its rest [m]")] = None,
    tip: Annotated[float | None, typer.Option(help="limit: deflection of an appendage's tip [m]")] = None,
    root_moment: Annotated[
        float | None, typer.Option(help="limit: elastic moment at an appendage's root [N m]")
    ] = None,
    force: Annotated[float | None, typer.Option(help="limit: thrust per axis [N]")] = None,
    axes: Annotated[str | None, typer.Option(help="along which thrust may act, e.g. xz")] = None,
    swing: Annotated[float | None, typer.Option(help="limit: a joint about home [rad]")] = None,
    joint_rate: Annotated[float | None, typer.Option(help="limit: rate of a joint [rad/s]")] = None,
    joint_torque: Annotated[float | None, typer.Option(help="limit: torque of a joint [N m]")] = None,
    wheel_rate: Annotated[float | None, typer.Option(help="limit: rate of a wheel [rad/s]")] = None,
    wheel_torque: Annotated[float | None, typer.Option(help="limit: torque of a wheel [N m]")] = None,
    pointing: Annotated[float | None, typer.Option(help="limit: how far the bus turns [rad]")] = None,
    margin: Annotated[float, typer.Option(help="share of every limit to leave unused")] = 0.02,
    seed: Annotated[int, typer.Option(min=0, help="of the search")] = 0,
    effort: Annotated[float, typer.Option(help="how long to search; 1 is some 300 motions")] = 1.0,
    report: ReportPath = None,
    show_all: ShowAll = False,
) -> CommandResult:
    """Design an experiment: `smsid simulate DESC EXPERIMENT.toml` flies it.

    The limits of the description count in any case. Interrupted (Ctrl-C), the best so far is written.
    """
    from smsid.cli.output import note_lines
    from smsid.description import load_description
    from smsid.design import Limits, design_experiment
    from smsid.design.model_discrimination import design_separation
    from smsid.errors import ExperimentError
    from smsid.experiments import save_experiment

    if (wanted is None) == (separate is None):
        raise ExperimentError(
            "Say what the experiment is for.",
            advice="Give either --for or --separate; see `smsid design --help`.",
        )
    limits = Limits(
        stroke=stroke, tip=tip, root_moment=root_moment, force=force, swing=swing, joint_rate=joint_rate,
        joint_torque=joint_torque, wheel_rate=wheel_rate, wheel_torque=wheel_torque, pointing=pointing,
        margin=margin,
    )  # fmt: skip
    described, precision = load_description(description), None if to is None else share(to)
    search: dict[str, Any] = {"limits": limits, "duration": duration, "seed": seed, "effort": effort}
    with show_spinner("designing") as tell:
        search |= {"name": output.stem}
        search |= {"progress": lambda stage, tried, best: tell(f"{stage}: {tried} tried, best {best:.3g}")}
        if separate is not None:
            found = design_separation(described, separate, **search)
        else:
            search |= {"mode": mode, "criterion": criterion, "to": precision, "axes": axes}
            found = design_experiment(
                described, [w for w in (wanted or "").split(",") if w.strip()], **search
            )
    save_experiment(found.experiment, output)

    def page(origin: Provenance) -> Report:
        from smsid.model import build_model
        from smsid.report.design import design_report

        return design_report(found, build_model(described), limits, precision, origin)

    written = [output, *write_page(report, page, [description], described, seed=seed)]
    print_parts(_tables(found, show_all))
    for line in note_lines(found.notes, everything=show_all):
        say(line)
    say(f"{found.evaluations} experiments tried")
    return CommandResult({"design": found.document()}, written, INTERRUPTED if found.interrupted else 0)


def share(text: str) -> float:
    """Return a share given as ``10%`` or ``0.1``; raises `ExperimentError` for anything else."""
    from smsid.errors import ExperimentError

    match = SHARE.fullmatch(text)
    try:
        value = float(match[1]) if match else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ExperimentError(f"'{text}' is no precision.", advice="Write it as 10% or 0.1.")
    return value / 100.0 if match and match[2] else value


def _tables(found: Design | Separation, everything: bool) -> Iterator[RenderableType]:
    from smsid.cli.tables import cut_tables, limits_table, report_table
    from smsid.design import Design
    from smsid.report.design import result_table

    experiment = found.experiment
    yield f"{experiment.note}; {experiment.duration:.6g} s"
    if isinstance(found, Design):
        yield (
            f"worst parameter {found.gain:.3g} times better known than 'before', the paper's kind of "
            f"excitation within the same limits ({found.reference.note})"
        )
    else:
        yield f"correlation of the two: {found.correlation:.4f} (before: {found.correlation_before:.4f})"
    table = report_table(result_table(found), everything=everything)
    yield from cut_tables([table, limits_table(found.limits)], everything, 36)
