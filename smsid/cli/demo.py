"""``smsid demo``: both experiments of the paper, identified, beside the paper's tables."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.manners import Outcome
from smsid.cli.options import Seed
from smsid.cli.output import console, counting, working
from smsid.cli.places import Writes
from smsid.errors import MissingDependencyError

if TYPE_CHECKING:
    import numpy as np
    from rich.console import Console

    from smsid.description import Description
    from smsid.identify.estimate import Estimate
    from smsid.identify.pipeline import Identification
    from smsid.recording import Recording


def demo_command(
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="folder for recordings, estimate, report and view"),
        Writes(folder=True),
    ] = Path("demo-out"),
    seed: Seed = 1,
) -> Outcome:
    """Fly both experiments of the paper, identify the spacecraft, print Tables 2 and 3 beside the paper's."""
    import numpy as np

    from smsid.description import load_description
    from smsid.experiments import fly, named_experiment
    from smsid.model import build_model
    from smsid.paths import oracle_folder, urdf_folder
    from smsid.recording import import_recording, save_recording

    out = console()
    started = time.perf_counter()
    written = []
    output.mkdir(parents=True, exist_ok=True)
    description = load_description(urdf_folder() / "paper_sms.toml")
    model = build_model(description)
    out.print(
        f"The paper's spacecraft: {model.mass:.1f} kg, "
        f"{model.nv} degrees of freedom, from {description.urdf}.\n\n"
        "1. Simulated by smsid itself, with sensor noise: shows the path of the data, proves little."
    )
    recordings = []
    rng = np.random.default_rng(seed)
    for name in ("exp1", "exp2"):
        plan = named_experiment(name, model)
        with counting(f"simulating {name}", plan.duration, "s") as tell:
            flight = fly(model, plan, rng, progress=tell)
        audit = flight.trajectory.audit()
        out.print(
            f"   {name}: {flight.trajectory.stop:g} s, momentum drift {audit.momentum_drift:.0e}, energy "
            f"drift {audit.energy_drift:.0e} J"
            + "".join(f"\n   limit exceeded: {u}" for u in flight.exceeded)
        )
        save_recording(flight.recording, output / f"{name}.nc")
        written.append(output / f"{name}.nc")
        recordings.append(flight.recording)
    found = _identify(description, recordings, output / "estimate.json")
    estimate = found.estimate
    shown = [("own", "own simulation", recordings, found)]
    _print(estimate, out)
    written.append(output / "estimate.json")
    document = {"estimate": json.loads(estimate.to_json())}
    folder = oracle_folder()
    if folder is None:
        out.print("\n2. Recordings of an independent engine: SMSID_ORACLE is not set or no folder; left out.")
    else:
        out.print("\n2. Recordings of an independent engine (MuJoCo), with the same sensor noise.")
        described = load_description(urdf_folder() / "paper_sms.toml")
        foreign = [
            _noisy(import_recording(folder / f"{name}.npz", mapping), described, rng)
            for name, mapping in (("exp1_xyz_modal3", "oracle_exp1"), ("exp2_modal3", "oracle_exp2"))
        ]
        found = _identify(described, foreign, output / "estimate_oracle.json")
        estimate = found.estimate
        shown.append(("mujoco", "MuJoCo", foreign, found))
        _print(estimate, out)
        written.append(output / "estimate_oracle.json")
        document["estimate_oracle"] = json.loads(estimate.to_json())
    with working("writing the report"):
        _report(description, shown, seed, output)
    written.append(output / "report.html")
    out.print(f"\nReport, to be opened in a browser: {output / 'report.html'}")
    try:
        from smsid.view import view_main

        with working("drawing"):
            view_main(urdf_folder() / "paper_sms.toml", output / "exp2.nc", output / "exp2.html")
        written.append(output / "exp2.html")
        out.print(f"\n3-D replay of Exp. 2: {output / 'exp2.html'}")
    except MissingDependencyError as error:
        out.print(f"\nno 3-D replay: {error}", markup=False)
    out.print(f"recordings and estimates are in {output}; {time.perf_counter() - started:.0f} s in all")
    return Outcome(document, written)


def _noisy(recording: Recording, description: Description, rng: np.random.Generator) -> Recording:
    from smsid.sensing import add_noise

    sensors = [s for s in description.sensor if all(c in recording for c in s.channels)]
    return add_noise(recording, sensors, rng)


def _report(
    description: Description,
    shown: list[tuple[str, str, list[Recording], Identification]],
    seed: int,
    output: Path,
) -> None:
    from smsid.cli.paper_tables import TABLE_2
    from smsid.paths import urdf_folder
    from smsid.report import files_of, provenance, write_report
    from smsid.report.demo import Shown, demo_report

    inputs = [*files_of(description, urdf_folder() / "paper_sms.toml"), *sorted(output.glob("exp?.nc"))]
    origin = provenance(inputs, seed=seed)
    page = demo_report(description, [Shown(*s) for s in shown], TABLE_2, origin)
    write_report(page, output / "report.html")


def _identify(description: Description, recordings: list[Recording], path: Path) -> Identification:
    from smsid.identify.estimate import save_estimate
    from smsid.identify.pipeline import identify

    with working("identifying"):
        found = identify(description, recordings)
    save_estimate(found.estimate, path)
    return found


def _print(estimate: Estimate, out: Console) -> None:
    from smsid.cli.paper_tables import table_2, table_3

    out.print(table_2(estimate))
    out.print(table_3(estimate))
    parts = ", ".join(f"{k} {v:.2f}" for k, v in estimate.timing.items() if k != "total")
    out.print(f"identified in {estimate.timing['total']:.2f} s (paper: 7 s in Matlab); {parts}")
