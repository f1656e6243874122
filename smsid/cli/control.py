"""``smsid control``: design a controller for a description and an estimate, or repeat the paper's Table 4."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.manners import Outcome
from smsid.cli.options import JsonOutput, ReportPath
from smsid.cli.output import console, working
from smsid.errors import ControlError

if TYPE_CHECKING:
    from rich.table import Table

    from smsid.control.design import Design
    from smsid.description import Description
    from smsid.report import Provenance, Report


def control_command(
    description: Annotated[Path, typer.Argument(help="description of the spacecraft: a TOML")],
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
    rate: Annotated[float, typer.Option(help="of the controller [Hz]")] = 100.0,
    samples: Annotated[
        int, typer.Option(help="plants drawn from the estimate for the robust analysis")
    ] = 1000,
    seed: Annotated[int, typer.Option(min=0, help="of what is drawn")] = 0,
    output: JsonOutput = Path("controller.json"),
    study: Annotated[
        str | None, typer.Option(help="table4: fly the paper's cases instead of designing")
    ] = None,
    draws: Annotated[int, typer.Option(help="flights per case of the study")] = 5,
    report: ReportPath = None,
) -> Outcome:
    """Design model-based PD with an H-infinity term from what is identified, or repeat Table 4."""
    import numpy as np

    from smsid.description import load_description
    from smsid.identify.estimate import load_estimate

    if study is not None and study != "table4":
        raise ControlError(f"There is no study '{study}'.", advice="Use --study table4.")
    described = load_description(description)
    found = None if estimate is None else load_estimate(estimate)
    if study is not None:
        from smsid.cli.study import fly_study

        flown = fly_study(described, found, draws, output, console())
        if report is not None:
            from smsid.report.table4 import study_report

            _write(
                study_report(flown, described.name, _origin(described, description, estimate, seed)), report
            )
        return Outcome({"study": flown}, [output, *([report] if report else [])])
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

    pair = None if tune else _pair(gains)
    with working("designing and examining the loop"):
        made = design(
            described,
            found,
            DesignRequest(pair, uncertainty, crossover, rate, samples),
            np.random.default_rng(seed),
        )
    save_controller(made, output)
    if report is not None:
        from smsid.report.control import control_report

        _write(control_report(made, _origin(described, description, estimate, seed)), report)
    out = console()
    for part in _report(made):
        out.print(part)
    written = [output, *([report] if report else [])]
    out.print(f"wrote {', '.join(map(str, written))}")
    return Outcome({"controller": controller_document(made)}, written)


def _origin(described: Description, path: Path, estimate: Path | None, seed: int) -> Provenance:
    from smsid.report import files_of, provenance

    return provenance([*files_of(described, path), *([estimate] if estimate else [])], seed=seed)


def _write(report: Report, path: Path) -> None:
    from smsid.report import write_report

    write_report(report, path)


def _pair(text: str) -> tuple[float, float]:
    try:
        proportional, derivative = (float(x) for x in text.split(","))
    except ValueError as error:
        raise ControlError(
            f"'{text}' is no pair of gains.", advice="Give K_P,K_D, for instance --gains 4,4."
        ) from error
    return proportional, derivative


def _report(made: Design) -> list[Table | str]:
    from rich.table import Table

    parts: list[Table | str] = []
    if made.identified is not None:
        left = f"; as described: {', '.join(made.identified.left)}" if made.identified.left else ""
        parts.append(f"controller's model: {len(made.identified.applied)} parameters of the estimate{left}")
    if made.tuning is not None:
        bands = Table(
            "mode", "base and joints", "rad/s", "95 %", "gains keep out of", title="natural frequencies"
        )
        for m in made.tuning.modes:
            bands.add_row(
                m.name,
                "held" if m.held else "free",
                f"{m.frequency:.4g}",
                f"{m.low:.4g} .. {m.high:.4g}",
                f"{m.band[0]:.3g} .. {m.band[1]:.3g}",
            )
        joints = "" if math.isnan(made.tuning.joints) else f", joints {made.tuning.joints:.3g} rad/s"
        parts += [bands, f"gains: K_P = w^2, K_D = 2 w, attitude {made.tuning.attitude:.3g} rad/s{joints}"]
    parts.append(_blocks(made))
    parts += list(made.term.weights.origin)
    poles = Table("mode", "rad/s", "damping ratio", "", title="poles of the loop, slosh and panel inside")
    for p in made.poles:
        poles.add_row(p.name, f"{abs(p.value):.4g}", f"{p.damping:.4g}", p.flag)
    parts.append(poles)
    r = made.robustness
    if r is not None:
        worst = sorted(r.worst.items(), key=lambda x: -abs(x[1]))[:5]
        verdict = "robustly stable" if r.stable else "robust stability over the intervals is not shown"
        parts += [
            f"mu between {r.mu_lower:.3g} and {r.mu_upper:.3g} (at {r.frequency:.3g} rad/s): {verdict}",
            f"worst parameters found leave a damping ratio of {r.damping:.2g}: "
            + ", ".join(f"{name} {value:+.2f}" for name, value in worst),
            f"{r.unstable} of {r.samples} sampled plants unstable, least damping {r.sampled_damping:.2g}",
        ]
    return parts


def _blocks(made: Design) -> Table:
    from rich.table import Table

    table = Table(
        "coordinates",
        "gamma",
        "bound on e [rad]",
        "crossover",
        "S peak",
        "T peak",
        "gain margin",
        "phase margin",
    )
    for b in made.term.blocks:
        low, high = b.gain_margin
        table.add_row(
            ", ".join(made.coordinates[k] for k in b.coordinates),
            f"{b.synthesis.norm:.4f}",
            f"{b.error.max():.2e}",
            f"{b.crossover:.2g}",
            f"{b.sensitivity:.2f}",
            f"{b.complementary:.2f}",
            f"{low:.2f} to {high:.2f}",
            f"{b.phase_margin:.0f} deg",
        )
    return table
