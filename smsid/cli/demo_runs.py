"""The two halves of ``smsid demo``: the craft with something hidden, and the paper's experiments."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from smsid.datasets import Demonstration
    from smsid.description import Description
    from smsid.diagnose import Diagnosed
    from smsid.identify.estimate import Estimate
    from smsid.likelihood import Refinement
    from smsid.recording import Recording

MASSES = (1.04, 0.94, 1.05, 0.96)  # of the bodies in turn: by what the guess is off
EFFECTS = {
    "mass": 1.06, "stiffness": 0.94, "damping": 1.2, "density": 0.96, "youngs_modulus": 1.05,
}  # fmt: skip


@dataclass(frozen=True)
class PaperRun:
    """What came of the paper's experiments.

    ``estimate`` started from a guess that is off; ``truth`` are true values by name, ``notes`` of
    the flights.
    """

    estimate: Estimate
    truth: dict[str, float]
    notes: tuple[str, ...]
    seconds: float


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


def run_paper(folder: Path, seed: int) -> PaperRun:
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
    from smsid.paths import urdf_folder
    from smsid.recording import save_recording
    from smsid.report.truth import TrueWorld, described_bodies

    started = time.perf_counter()
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
    return PaperRun(
        estimate, world.values_of(estimate.parameters), tuple(notes), time.perf_counter() - started
    )


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


def write_extended(
    description: Description, estimate: Estimate, found: Diagnosed, folder: Path
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
