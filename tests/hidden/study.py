"""A run from its draw to its judgement: simulate, write files, diagnose, read diagnosis.json."""

from __future__ import annotations

import json
import time
import traceback
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from .fisher import Named, cannot_separate, experiment
from .flight import Files, write_run
from .judge import Injected, Judgement, judge
from .plan import Run
from .truth import against_truth

FAST = 3.0  # [rad/s] rate of a joint that no recording of an arm in space goes beyond
UNPHYSICAL = ("inertia must satisfy", "must be positive")  # said by MuJoCo and by what changes a tank


def files_of(run: Run, folder: Path) -> Files:
    """Simulate a run and write what the diagnosis gets."""
    rng = np.random.default_rng([run.seed, 78])
    changes = [i.effect.make(i.value, i.onset, rng) for i in run.hidden]
    return write_run(run.world, folder, [run.seed, 79], changes, noise_factor=run.noise_factor)


def tamed(run: Run, folder: Path) -> tuple[Run, Files]:
    """Simulate a run; where the arm flies away, what is hidden is halved until it stays below `FAST`.

    An arm whose torques fit it so badly that it tumbles is no experiment that anybody would record; nor is
    one with a body that cannot exist, which MuJoCo refuses, or a spring or damper that drives.
    """
    from smsid.recording import load_recording

    for _ in range(8):
        try:
            files = files_of(run, folder)
        except ValueError as error:
            if not any(reason in str(error) for reason in UNPHYSICAL):
                raise
        else:
            flown = [load_recording(path) for path in (files.recording, files.validation)]
            if all(np.nanmax(np.abs(np.asarray(r["encoder.joint_velocity"]))) < FAST for r in flown):
                break
        weaker = [
            replace(i, value=i.value / 2.0, strength=i.strength / 2.0**i.effect.power) for i in run.hidden
        ]
        run = replace(run, hidden=tuple(weaker))
    return run, files


def diagnosis_of(files: Files, folder: Path) -> dict[str, Any]:
    """Diagnose the files; the document is what stands in diagnosis.json."""
    return diagnosed(files, folder)[1]


def diagnosed(files: Files, folder: Path) -> tuple[Any, dict[str, Any]]:
    """Diagnose the files; return what was made, and the document as it stands in diagnosis.json."""
    from smsid.description import load_description
    from smsid.diagnose import diagnose, save_diagnosis
    from smsid.identify.estimate import load_estimate
    from smsid.recording import load_recording

    found = diagnose(
        load_description(files.description),
        [load_recording(files.recording)],
        estimate=load_estimate(files.estimate),
        validation=[load_recording(files.validation)],
    )
    path = folder / "diagnosis.json"
    save_diagnosis(found.diagnosis, path)
    return found, json.loads(path.read_text(encoding="utf-8"))


def judged(run: Run, document: dict[str, Any]) -> Judgement:
    """Judge a document; aliases are confirmed by the run's own experiment."""

    def confirm(injected: Injected, kind: str, location: str, shape: str) -> bool:
        other = Named(kind, location, shape)
        return cannot_separate(experiment(run.world), injected.effect, injected.value, other, injected.onset)

    return judge(document, run.hidden, confirm)


def run_and_judge(run: Run, folder: Path) -> dict[str, Any]:
    """One row of the study."""
    marks = [time.process_time()]
    run, files = tamed(run, folder)
    marks.append(time.process_time())
    made = None
    try:
        made, document = diagnosed(files, folder)
    except Exception:  # it is to go on, and a diagnosis that crashed is one that failed
        document = {"verdict": "not_evaluated", "sentence": f"crashed: {traceback.format_exc()}"}
    marks.append(time.process_time())
    found = judged(run, document)
    gain = document.get("gain") or {}
    explained = gain.get("explained")
    truth = None if made is None else against_truth(run, files, folder, made, document, found)
    return {
        "seed": run.seed,
        "category": run.category,
        "world": run.world,
        "noise_factor": run.noise_factor,
        "hidden": [
            {
                "effect": i.effect.name,
                "family": list(i.effect.family),
                "value": i.value,
                "unit": i.effect.unit,
                "strength": i.strength,
                "onset": i.onset,
            }
            for i in run.hidden
        ],
        "verdict": document["verdict"],
        "outcome": found.outcome,
        "alone": found.alone,
        "deviation": found.deviation,
        "equation": found.equation,
        "named": list(found.named),
        "families": sorted({c["family"] for c in document.get("causes", ())}),
        "notes": list(found.notes),
        "gain_explained": explained,
        "gain_of_true": truth,
        "sentence": document.get("sentence", ""),
        "seconds": {"simulate": marks[1] - marks[0], "diagnose": marks[2] - marks[1]},
    }
