"""``smsid demo``: a craft with something hidden, found; and the paper's experiments, identified."""

from __future__ import annotations

import json
import logging
import re
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from smsid.cli.errors import CommandResult
from smsid.cli.options import Seed
from smsid.cli.output import console, say, show_spinner
from smsid.cli.places import Writes
from smsid.errors import MissingDependencyError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from smsid.datasets import Demonstration
    from smsid.description import Description
    from smsid.diagnose import DiagnosisRun
    from smsid.identify.estimate import Estimate
    from smsid.likelihood import Refinement
    from smsid.paper.tables import IdentifiedExperiments
    from smsid.recording import Recording
    from smsid.report.demo import DemoCraft
    from smsid.report.model import Frame


def demo_command(
    output: Annotated[
        Path,
        typer.Option("--output", "-o", help="folder for the page and all that it is made from"),
        Writes(folder=True),
    ] = Path("demo-out"),
    seed: Seed = 1,
) -> CommandResult:
    """Show what smsid is for: from a recording to the cause that the simulation lacks, and what it gains."""
    from smsid.cli.tables import report_table
    from smsid.datasets import demonstration
    from smsid.diagnose import diagnose, save_diagnosis
    from smsid.identify.estimate import save_estimate
    from smsid.paper.tables import table_2
    from smsid.report.demo import DemoCraft
    from smsid.report.diagnosis_tables import plain_words

    out = console()
    started = time.perf_counter()
    output.mkdir(parents=True, exist_ok=True)
    which = demonstration()
    # the paper's part and the replay have a process of their own: neither waits for the other on two cores
    with ProcessPoolExecutor(1, get_context("spawn"), initializer=_silent) as pool:
        paper, replay = pool.submit(run_paper, output, seed), pool.submit(_draw, which, output)
        say(f"1. Measured: a flight of {which.engine}, with something that the description lacks.")
        with show_spinner("identifying by maximum likelihood"):
            description, estimation, validation, refinement, spent = identify_craft(which)
        estimate = refinement.estimate
        save_estimate(estimate, output / "estimate.json")
        good = sum(p.status == "identifiable" for p in estimate.parameters)
        say(
            f"2. Identified from a guess that is off: {good} parameters to 10 % and better, in {spent:.0f} s."
        )
        with show_spinner("diagnosing"):
            found = diagnose(description, [estimation], estimate=estimate, validation=[validation])
        save_diagnosis(found.diagnosis, output / "diagnosis.json")
        extended = write_extended_description(description, estimate, found, output)
        words = plain_words(found.diagnosis) or found.diagnosis.sentence
        say(f"3. {words}")
        hidden = f"{which.hidden['value']:g} {which.hidden['unit']}"
        say(f"   Hidden was: {which.hidden['parameter']} = {hidden} at {which.hidden['location']}.")
        world = which.engine, which.hidden, which.parameters
        craft = DemoCraft(description, estimation, validation, estimate, found, extended, *world)
        with show_spinner("flying and identifying the paper's experiments"):
            done = paper.result()
            picture, drawn = replay.result()
    with show_spinner("writing the page"):
        page, told = _page(which, craft, done, output, seed, picture)
    for step in told[-1:]:
        say(f"4. {step}")
    say("5. The paper's Table 2, from a guess that is off:")
    out.print(report_table(table_2(done.estimate)))
    names = ("estimate.json", "diagnosis.json", "extended.toml", "extended.urdf", "exp1.nc", "exp2.nc",
             "paper_guess.urdf", "paper_guess.toml", "paper_estimate.json")  # fmt: skip
    written = [*(output / n for n in names), *drawn, page]
    for file in drawn:
        say(f"replay: {file}")
    if not drawn:
        say("no replay: the extra 'view' is not installed (pip install 'smsid[view]')")
    say(f"\nOpen in a browser: {page} ({time.perf_counter() - started:.0f} s in all)")
    document = {
        "estimate": json.loads(estimate.to_json()),
        "diagnosis": json.loads(found.diagnosis.to_json()),
        "paper_estimate": json.loads(done.estimate.to_json()),
    }
    return CommandResult(document, written, untold=True)


def _silent() -> None:
    """Keep what the library logs in another process off the terminal."""
    logging.getLogger("smsid").addHandler(logging.NullHandler())


def _draw(which: Demonstration, output: Path) -> tuple[Frame | None, list[Path]]:
    """Write the replay of the flight that was not used, measured and simulated; the page shows the same."""
    from smsid.description import load_description
    from smsid.recording import load_recording
    from smsid.report.model import Frame
    from smsid.view import build_replay, export_html

    described, flight = load_description(which.description), load_recording(which.validation)
    try:
        view = build_replay(described, [flight], [which.validation.stem], simulated=True)
        path = export_html(view, output / "flight.html", title="The flight not used")
    except MissingDependencyError:
        return None, []
    caption = (
        "The flight that was not used: as measured, and as a ghost what the description makes of the same "
        "commands. Drag to turn, scroll to come nearer."
    )
    html = path.read_text(encoding="utf-8")
    return Frame(html, "the craft in motion, measured and as described", 430, caption), [path]


def _page(
    which: Demonstration,
    craft: DemoCraft,
    paper: IdentifiedExperiments,
    output: Path,
    seed: int,
    picture: Frame | None,
) -> tuple[Path, Sequence[str]]:
    from smsid.paper.tables import paper_section
    from smsid.report import files_of, provenance, write_report
    from smsid.report.demo import demo_report
    from smsid.report.diagnose import DiagnosisInputs, diagnose_report
    from smsid.report.diagnosis_shares import shares_of
    from smsid.report.model import Link, Text

    inputs = [*files_of(craft.description, which.description), which.estimation, which.validation]
    asked = DiagnosisInputs(craft.description, [craft.estimation], craft.estimate, [craft.validation])
    origin = provenance(inputs, seed=seed)
    shares = None if craft.found.search is None else shares_of(craft.found.search)
    write_report(diagnose_report(craft.found, asked, origin, shares), output / "diagnosis.html")
    made_with = "identified bodies, and the cause: what the curves above are simulated with"
    links = [
        Link("diagnosis.html", "The diagnosis in full", "tests, candidates, spectra, detection limits"),
        Link("extended.toml", "The extended description", made_with),
        Link("estimate.json", "The estimate", "every parameter with its interval"),
    ]
    if picture is not None:
        replay = Link("flight.html", "The replay on a page of its own", "measured, described as a ghost")
        links.insert(0, replay)
    tables = paper_section(paper)
    report = demo_report(craft, tables, links, provenance(inputs, seed=seed), picture, shares)
    told = next(part.lines for part in report.sections[0].parts if isinstance(part, Text))
    return write_report(report, output / "report.html"), told


MASSES = (1.04, 0.94, 1.05, 0.96)  # of the bodies in turn: by what the guess is off
EFFECTS = {
    "mass": 1.06, "stiffness": 0.94, "damping": 1.2, "density": 0.96, "youngs_modulus": 1.05,
}  # fmt: skip


def identify_craft(which: Demonstration) -> tuple[Description, Recording, Recording, Refinement, float]:
    """Identify the bundled craft by the default method; return it all with the seconds it took."""
    from smsid.description import load_description
    from smsid.identify.paper.pipeline import identify
    from smsid.likelihood import refine
    from smsid.recording import load_recording

    started = time.perf_counter()
    description = load_description(which.description)
    estimation, validation = load_recording(which.estimation), load_recording(which.validation)
    linear = identify(description, [estimation])
    refinement = refine(description, [estimation], linear)
    return description, estimation, validation, refinement, time.perf_counter() - started


def run_paper(folder: Path, seed: int) -> IdentifiedExperiments:
    """Fly both experiments of the paper in smsid's own simulation and identify them from a wrong guess.

    Writes ``exp1.nc``, ``exp2.nc``, guess and estimate into the folder. Meant for a process of its own.
    """
    import numpy as np

    from smsid.description import load_description
    from smsid.experiments import fly, named_experiment
    from smsid.identify.estimate import save_estimate
    from smsid.identify.paper.pipeline import identify
    from smsid.likelihood import refine
    from smsid.model import build_model
    from smsid.paper.tables import IdentifiedExperiments
    from smsid.paths import urdf_folder
    from smsid.recording import save_recording
    from smsid.report.demo import TrueWorld, described_bodies

    true = load_description(urdf_folder() / "paper_sms.toml")
    model = build_model(true)
    rng = np.random.default_rng(seed)
    recordings, notes = [], []
    for name in ("exp1", "exp2"):
        flight = fly(model, named_experiment(name, model), rng)
        audit = flight.trajectory.audit()
        notes.append(
            f"{name}: {flight.trajectory.stop:g} s, momentum drift {audit.momentum_drift:.0e}, "
            f"energy drift {audit.energy_drift:.0e} J"
        )
        notes += [f"{name}: limit exceeded: {u}" for u in flight.exceeded]
        save_recording(flight.recording, folder / f"{name}.nc")
        recordings.append(flight.recording)
    guess = wrong_guess(true, folder)
    estimate = refine(guess, recordings, identify(guess, recordings)).estimate
    save_estimate(estimate, folder / "paper_estimate.json")
    values = {p.name: p.value for effect in true.effect for p in effect.parameters()}
    values |= {"total.mass": float(model.mass)}
    # combinations with the bus carry the panel, whose density is off as well
    world = TrueWorld(described_bodies(true), described_bodies(guess), values, unsaid=("bus",))
    return IdentifiedExperiments(estimate, world.values_of(estimate.parameters), notes)


def wrong_guess(description: Description, folder: Path) -> Description:
    """Write a description whose masses, inertias and effects are off by several per cent; return it."""
    from smsid._files import atomic_write
    from smsid.description import load_description, save_description

    source = Path(description.folder, description.urdf)
    count = iter(range(10_000))

    def scaled(found: re.Match[str]) -> str:
        factor = MASSES[next(count) % len(MASSES)]
        return re.sub(
            r'((?:mass value|i[xyz]{2})=")([^"]+)(")',
            lambda m: f"{m[1]}{factor * float(m[2])!r}{m[3]}",
            found[0],
        )

    text = source.read_text(encoding="utf-8")
    urdf = folder / "paper_guess.urdf"
    atomic_write(urdf, re.sub(r"<inertial>.*?</inertial>", scaled, text, flags=re.DOTALL))
    effects = []
    for effect in description.effect:
        values = {
            p.name: p.value * EFFECTS[field]
            for p in effect.parameters()
            if (field := p.name.removeprefix(f"{effect.name}.").split(".")[0]) in EFFECTS
        }
        effects.append(effect.with_values(values))
    guess = description.with_effects(*effects).model_copy(
        update={"urdf": urdf.name, "folder": folder.resolve()}
    )
    save_description(guess, folder / "paper_guess.toml")
    return load_description(folder / "paper_guess.toml")


def write_extended_description(
    description: Description, estimate: Estimate, found: DiagnosisRun, folder: Path
) -> Description:
    """Write ``extended.toml`` with ``extended.urdf``: identified bodies that can exist, and the causes.

    Returns it loaded: what is shown of it is what the file does. The diagnosis's own extension keeps the
    described bodies where the fit's are no bodies that can exist.
    """
    import shutil
    import tempfile

    from smsid._files import atomic_write
    from smsid.description import load_description, save_description
    from smsid.export import export_folder

    place = Path(tempfile.mkdtemp(prefix=".extended-", dir=folder))
    try:
        export_folder(description, place / "identified", estimate, mujoco=False)
        identified = load_description(place / "identified" / f"{description.name}.toml")
        text = Path(identified.folder, identified.urdf).read_text(encoding="utf-8")
        atomic_write(folder / "extended.urdf", text)
        known = {e.name for e in description.effect}
        more = [e for e in found.extended.effect if e.name not in known and e.shifted_body is None]
        moved = identified.model_copy(update={"urdf": "extended.urdf", "folder": folder.resolve()})
        save_description(moved.with_effects(*more), folder / "extended.toml")
    finally:
        shutil.rmtree(place, ignore_errors=True)
    return load_description(folder / "extended.toml")
