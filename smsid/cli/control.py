"""``smsid control``: design a controller for a description and an estimate, or repeat the paper's Table 4."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from smsid.cli.errors import CommandResult
from smsid.cli.inputs import read_estimate, write_page
from smsid.cli.options import DescriptionPath, Output, ReportPath, ShowAll
from smsid.cli.output import print_parts, show_spinner
from smsid.cli.places import Writes
from smsid.errors import ControlError

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from typing import Any

    from rich.console import RenderableType


CONTROLLER_RATE = 100.0  # [Hz] of a controller's calls


def control_command(
    description: DescriptionPath,
    estimate: Annotated[
        Path | None, typer.Argument(help="estimate (JSON) that `smsid identify` wrote")
    ] = None,
    gains: Annotated[str, typer.Option(help="K_P,K_D, the same for all coordinates [1/s^2, 1/s]")] = "4,4",
    tune: Annotated[
        bool, typer.Option("--tune", help="choose gains that keep clear of the identified frequencies")
    ] = False,
    uncertainty: Annotated[
        float | None, typer.Option(help="stated uncertainty level, 0.05 for 5 %, instead of the estimate's")
    ] = None,
    crossover: Annotated[
        float, typer.Option(help="where delay and unmodelled dynamics take over [rad/s]")
    ] = 10.0,
    rate: Annotated[
        float | None, typer.Option(help="of the controller [Hz]; 100, with --study table4 20, if left out")
    ] = None,
    samples: Annotated[
        int, typer.Option(help="plants drawn from the estimate for the robust analysis")
    ] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="of what is drawn")] = 0,
    output: Annotated[Output, Writes((".json",), kind="controller")] = Path("controller.json"),
    study: Annotated[
        Literal["table4"] | None, typer.Option(help="fly the paper's cases instead of designing")
    ] = None,
    draws: Annotated[int, typer.Option(help="flights per case of the study")] = 5,
    integrated_gyro: Annotated[
        bool,
        typer.Option(
            "--integrated-gyro",
            help="--study table4: attitude from an integrated gyro, as in the paper, instead of the sensors",
        ),
    ] = False,
    report: ReportPath = None,
    show_all: ShowAll = False,
) -> CommandResult:
    """Design model-based PD with an H-infinity term from what is identified, or repeat Table 4."""
    import numpy as np

    from smsid.description import load_description

    described = load_description(description)
    found, files = read_estimate(estimate), [description, estimate]
    if study is not None:
        from smsid._files import atomic_write
        from smsid.paper.table4 import Variant
        from smsid.paper.table4_study import fly_study, study_report

        how: dict[str, Any] = {"rate": Variant().rate if rate is None else rate, "crossover": crossover}
        with show_spinner("flying") as tell:
            flown = fly_study(described, found, draws, **how, integrated_gyro=integrated_gyro, tell=tell)
        atomic_write(output, json.dumps(flown, indent=1, allow_nan=False) + "\n")
        print_parts(study_parts(flown))
        made = write_page(
            report, lambda o: study_report(flown, described.name, o), files, described, seed=seed
        )
        return CommandResult({"study": flown}, [output, *made])
    if found is None and uncertainty is None:
        raise ControlError(
            "Neither an estimate nor an uncertainty is given.",
            advice="Pass the JSON that `smsid identify` wrote, or --uncertainty 0.05.",
        )
    if tune and found is None:
        raise ControlError(
            "Gains are tuned to identified natural frequencies, and no estimate is given.",
            advice="Pass the JSON that `smsid identify` wrote.",
        )
    from smsid.control.controller_file import controller_document, save_controller
    from smsid.control.design import DesignRequest, design
    from smsid.report.control import control_report

    own = CONTROLLER_RATE if rate is None else rate
    request = DesignRequest(None if tune else _pair(gains), uncertainty, crossover, own, samples)
    with show_spinner("designing and examining the loop"):
        made = design(described, found, request, np.random.default_rng(seed))
    save_controller(made, output)
    page = write_page(report, lambda o: control_report(made, o), files, described, seed=seed)
    document = controller_document(made)
    print_parts(document_parts(document, everything=show_all))
    return CommandResult({"controller": document}, [output, *page])


def study_parts(d: Mapping[str, Any], *, everything: bool = True) -> Iterator[RenderableType]:
    """Yield what to print of a study of Table 4: which is smaller, by how much, every case (always)."""
    from smsid.cli.tables import plain_table
    from smsid.paper.table4_study import COLUMNS, study_cells, study_lines

    yield from study_lines(d)
    table = plain_table(*COLUMNS, left=COLUMNS[:2])
    for row in study_cells(d):
        table.add_row(*row)
    yield table
    yield "The paper's numbers have no unit in print: they are read in degrees, which fits (docs: Control)."


def _pair(text: str) -> tuple[float, float]:
    try:
        proportional, derivative = (float(x) for x in text.split(","))
    except ValueError as error:
        raise ControlError(
            f"'{text}' is no pair of gains.", advice="Give K_P,K_D, for instance --gains 4,4."
        ) from error
    return proportional, derivative


def document_parts(d: Mapping[str, Any], *, everything: bool = False) -> Iterator[RenderableType]:
    """Yield what to print of a controller as it stands in its file: promise, gains, blocks, poles."""
    from rich.text import Text

    from smsid.cli.output import clip_line
    from smsid.cli.tables import ROWS, cut_tables, report_table
    from smsid.report.control import blocks_table, model_lines, modes_table, poles_table

    r = d.get("robustness")
    if r is not None:
        shown = r["mu_upper"] < 1.0 and r["unstable"] == 0  # as Robustness.stable
        verdict = "robustly stable" if shown else "robust stability over the intervals is not shown"
        yield Text(
            f"{verdict}: mu between {r['mu_lower']:.3g} and {r['mu_upper']:.3g} "
            f"(at {r['frequency']:.3g} rad/s)",
            style="bold",
        )
        worst = sorted(r["worst"].items(), key=lambda x: -abs(x[1]))[:3]
        sampled = f"{r['unstable']} of {r['samples']} sampled plants unstable"
        yield f"{sampled}, least damping {r['sampled_damping']:.2g}"
        listed = ", ".join(f"{name} {value:+.2f}" for name, value in worst)
        text = f"worst parameters found leave a damping ratio of {r['damping']:.2g}: {listed}"
        yield Text(text if everything else clip_line(text))
    proportional, derivative = d["K_P"]["value"], d["K_D"]["value"]
    yield f"gains: K_P {_range(proportional)} 1/s^2, K_D {_range(derivative)} 1/s"
    modes = modes_table(d)
    if modes.rows:
        yield report_table(modes)
    yield report_table(blocks_table(d))
    for text in model_lines(d):
        yield Text(text if everything else clip_line(text))
    poles = report_table(poles_table(d), everything=everything)
    yield from cut_tables([poles], everything, ROWS - len(modes.rows) - 6)


def _range(matrix: Sequence[Any]) -> str:
    """Return the gain of every coordinate where they agree, else the least and the largest."""
    own = [row[k] if isinstance(row, list) else row for k, row in enumerate(matrix)]
    low, high = min(own), max(own)
    return f"{low:.3g}" if low == high else f"{low:.3g} to {high:.3g}"
