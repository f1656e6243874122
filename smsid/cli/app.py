"""``smsid``: from a spacecraft's description and its recordings to an identified model."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

import smsid
from smsid.campaign.command import campaign_command
from smsid.cli.diagnose import diagnose_command
from smsid.control.command import control_command
from smsid.errors import SmsidError
from smsid.export.command import export_command
from smsid.lab.command import lab_app
from smsid.recording.inspect import inspect_command

app = typer.Typer(
    name="smsid",
    help="Identify the dynamics of space manipulator systems from measured data.\n\n"
    "A spacecraft is a URDF and a TOML beside it (DESC.toml). Start with `smsid demo`; then\n"
    "`smsid simulate` or `smsid import` to get recordings, `smsid identify` to identify the spacecraft from\n"
    "them, `smsid show` and `smsid view` to look at anything.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
# piped output is not squeezed into 80 columns
_width = None if sys.stdout.isatty() else 132
console = Console(width=_width)
errors = Console(stderr=True)

DescriptionPath = Annotated[
    Path, typer.Argument(help="description of the spacecraft: a TOML (or a bare URDF)")
]
Output = Annotated[Path, typer.Option("--output", "-o", help="file to write, whole or not at all")]
Seed = Annotated[int, typer.Option(help="seed of sensor noise and turn-on biases")]


@app.callback()
def _common(
    verbose: Annotated[bool, typer.Option("--verbose", "-v", help="log what the library does")] = False,
) -> None:
    logging.basicConfig(
        level=logging.INFO if verbose else logging.WARNING, format="%(levelname)s %(name)s: %(message)s"
    )


@app.command()
def version() -> None:
    """Print the version."""
    console.print(smsid.__version__)


@app.command()
def demo(
    output: Annotated[
        Path, typer.Option("--output", "-o", help="folder for recordings, estimate and view")
    ] = Path("demo-out"),
    seed: Seed = 1,
) -> None:
    """Fly both experiments of the paper, identify the spacecraft, print Tables 2 and 3 beside the paper's."""
    from smsid.cli.demo import run_demo

    run_demo(output, seed, console)


@app.command()
def simulate(
    description: DescriptionPath,
    experiment: Annotated[
        str, typer.Argument(help="exp1, exp1_x, exp1_z, exp1_xyz, exp2, exp2val, or a TOML")
    ],
    output: Output = Path("recording.nc"),
    seed: Seed = 1,
    role: Annotated[str, typer.Option(help="estimation or validation")] = "estimation",
    save_experiment_to: Annotated[
        Path | None, typer.Option("--save-experiment", help="also write the experiment as a TOML")
    ] = None,
) -> None:
    """Fly an experiment in simulation and record it with the description's sensors."""
    import numpy as np

    from smsid.cli.tables import limits_table
    from smsid.description import load_description
    from smsid.experiments import fly, momentum_condition, named_experiment, save_experiment
    from smsid.model import build_model
    from smsid.recording import save_recording

    if role not in ("estimation", "validation"):
        raise SmsidError(f"'{role}' is no role of a recording.", advice="Use estimation or validation.")
    model = build_model(load_description(description))
    plan = named_experiment(experiment, model)
    with _progress(f"simulating {plan.name}", plan.duration) as tell:
        flight = fly(model, plan, np.random.default_rng(seed), role=role, progress=tell)
    audit = flight.trajectory.audit()
    recording = flight.recording.with_provenance({"seed": seed})
    save_recording(recording, output)
    if save_experiment_to is not None:
        save_experiment(plan, save_experiment_to)
    console.print(limits_table(flight.limits))
    console.print(
        f"momentum drift {audit.momentum_drift:.1e} (largest {audit.momentum_scale:.3g}), energy drift "
        f"{audit.energy_drift:.1e} J (of {audit.energy_scale:.3g} J), {flight.trajectory.steps} steps"
    )
    if plan.force is None and len(model.arm_joints):
        times = np.arange(flight.trajectory.start, flight.trajectory.stop, 0.1)
        states = flight.trajectory.states(times)
        condition = momentum_condition(model, states.q, states.v)
        console.print(f"condition number of the column-scaled momentum regressor: {condition:.0f}")
    for use in flight.exceeded:
        errors.print(f"warning: {use} exceeded", style="yellow")
    console.print(f"wrote {output}")


@app.command(name="import")
def import_(
    file: Annotated[Path, typer.Argument(help="CSV, NPZ, MAT or HDF5 file")],
    mapping: Annotated[
        str,
        typer.Option("--map", help="mapping file (TOML), or oracle_exp1, oracle_exp2 for the bundled ones"),
    ],
    output: Output = Path("recording.nc"),
) -> None:
    """Turn a log into a recording: a mapping file says which column is which channel, unit and frame."""
    from smsid.cli.tables import recording_table
    from smsid.recording import import_recording, save_recording

    recording = import_recording(file, mapping)
    save_recording(recording, output)
    console.print(recording_table(recording))
    console.print(f"wrote {output}")


@app.command()
def identify(
    description: DescriptionPath,
    recordings: Annotated[
        list[Path],
        typer.Argument(
            help="recordings of Exp. 1 (thrust) and Exp. 2 (no thrust); of an arm that is welded to the "
            "ground: one to identify from, and any in the role validation to judge by"
        ),
    ],
    output: Output = Path("estimate.json"),
    method: Annotated[
        str,
        typer.Option(
            help="ml: maximum likelihood started from the paper's method; paper: the linear method alone"
        ),
    ] = "ml",
    cutoff: Annotated[
        float | None, typer.Option(help="welded arm: low-pass of angles and torques [Hz]")
    ] = None,
    gains: Annotated[
        bool,
        typer.Option(
            "--gains", help="welded arm: first find the gain of every torque signal from the described links"
        ),
    ] = False,
    show_all: Annotated[
        bool, typer.Option("--all", help="print nuisance parameters and Step B as printed as well")
    ] = False,
) -> None:
    """Identify a spacecraft from recordings; the description's values are only the starting guess."""
    from smsid.cli.tables import comparison_table, estimate_table
    from smsid.description import load_description
    from smsid.identify.estimate import save_estimate
    from smsid.identify.pipeline import identify as run
    from smsid.recording import load_recording

    if method not in ("ml", "paper"):
        raise SmsidError(f"There is no method '{method}'.", advice="Use --method ml or --method paper.")
    described = load_description(description)
    loaded = [load_recording(path) for path in recordings]
    if described.root == "fixed":
        from smsid.arm.command import identify_and_judge

        identify_and_judge(described, loaded, output, cutoff, console, gains=gains)
        return
    if cutoff is not None or gains:
        option = "--gains" if gains else "--cutoff"
        raise SmsidError(f"{option} is for welded arms.", advice='Leave it out, or set root = "fixed".')
    with console.status("identifying by the paper's method"):
        linear = run(described, loaded)
    estimate = linear.estimate
    tables = list(estimate_table(estimate, everything=show_all))
    if method == "ml":
        from smsid.likelihood import refine

        with console.status("refining by maximum likelihood"):
            estimate = refine(described, loaded, linear).estimate
        tables = [comparison_table(estimate, linear.estimate, everything=show_all)]
    save_estimate(estimate, output)
    for table in tables:
        console.print(table)
    for note in dict.fromkeys((*linear.estimate.notes, *estimate.notes)):
        console.print(f"note: {note}", markup=False, highlight=False)
    console.print(f"{estimate.timing['total']:.1f} s; wrote {output}")


@app.command()
def show(
    file: Annotated[Path, typer.Argument(help="a recording, estimate, description or experiment")],
) -> None:
    """Show what is in a file."""
    from smsid.cli.show import show_file

    for part in show_file(file):
        console.print(part)


@app.command()
def view(
    description: DescriptionPath,
    recording: Annotated[Path | None, typer.Argument(help="recording to replay")] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="self-contained HTML to write")] = Path(
        "view.html"
    ),
) -> None:
    """Write a 3-D view of a spacecraft, or the replay of a recording, as one HTML file (extra: view)."""
    from smsid.view import view_main

    view_main(description, recording, output)
    console.print(f"wrote {output}")


app.command(name="inspect")(inspect_command)
app.command(name="campaign")(campaign_command)
app.command(name="control")(control_command)
app.command(name="diagnose")(diagnose_command)
app.command(name="export")(export_command)
app.add_typer(lab_app, name="lab")


@contextmanager
def _progress(label: str, total: float) -> Iterator:  # type: ignore[type-arg]
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f} s"),
        TimeRemainingColumn(),
        console=errors,
        transient=True,
    )
    with bar:
        task = bar.add_task(label, total=total)
        yield lambda t: bar.update(task, completed=t)


def main() -> None:
    """Run the command line; errors of smsid are told in one line, without a traceback."""
    try:
        code = app(standalone_mode=False)
        if isinstance(code, int) and code:
            sys.exit(code)
    except SmsidError as error:
        errors.print(f"error: {error}", style="red", markup=False, highlight=False, soft_wrap=True)
        sys.exit(1)
    except typer.Abort:
        sys.exit(130)
    except KeyboardInterrupt:
        errors.print("interrupted; nothing was written")
        sys.exit(130)
    except Exception as error:
        if hasattr(error, "format_message"):  # click's usage errors
            errors.print(f"error: {error.format_message()} See `smsid --help`.", style="red", markup=False)
            sys.exit(2)
        raise
