"""What the true model gains on the held-out flight: the measure of what an extended one gains there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .description import write_description
from .flight import Files
from .judge import Injected, Judgement
from .numbers import WORLDS, draw
from .plan import Run

NOTHING = 5.0  # standard deviations of a sum of squares that a true model may leave


def against_truth(
    run: Run, files: Files, folder: Path, found: Any, document: dict[str, Any], judgement: Judgement
) -> dict[str, float] | None:
    """Return what the extended model gains over what the true one does, for a cause that was named rightly.

    ``excess``: squares of whitened innovations that the refitted nominal model leaves more than the extended
    one, over those it leaves more than the true one. ``open_loop``: errors of the extended model's simulation
    over those of the true one's, both in the noise of their channels and from the state they find in the
    first seconds. Both are of the document, the true model's by the same filter. ``None`` where the true
    model cannot be said in the words of the description: it leaves nothing but noise, or it is another one.
    """
    gained = document.get("gain") or {}
    if judgement.outcome != "right" or len(run.hidden) != 1 or gained.get("status") != "evaluated":
        return None
    (injected,) = run.hidden
    point = _true_point(run, injected, folder, found, judgement)
    if point is None:
        return None
    from smsid.diagnose.diagnose import RATE
    from smsid.diagnose.validation import gain
    from smsid.errors import SmsidError
    from smsid.recording import load_recording

    try:
        true = gain(point, point, point, load_recording(files.validation), found.search.last.problem, RATE)
    except SmsidError:
        return None
    noise = {c.channel: c.noise for c in true.channels}
    own = [c["extended"] / noise[c["channel"]] for c in gained["channels"]]
    best = [c.extended / c.noise for c in true.channels]
    if abs(true.excess_extended) > NOTHING * np.sqrt(2.0 * true.samples):
        return None
    return {
        "excess": (gained["excess_nominal"] - gained["excess_extended"])
        / (gained["excess_nominal"] - true.excess_extended),
        "nominal": gained["excess_nominal"] - true.excess_extended,
        "open_loop": float(np.linalg.norm(own) / np.linalg.norm(best)),
    }


def _true_point(run: Run, injected: Injected, folder: Path, found: Any, judgement: Judgement) -> Any:
    """Return the true numbers with the true effect: as other numbers, or as the named effect's true value."""
    from smsid.description import load_description
    from smsid.estimation.parameter_vector import Point

    numbers = draw(WORLDS[run.world], np.random.default_rng([run.seed, 79]))
    change = injected.effect.make(injected.value, injected.onset, np.random.default_rng([run.seed, 78]))
    if change.numbers is not None:
        numbers = change.numbers(numbers)
    place = folder / "true"
    place.mkdir(exist_ok=True)
    point = Point.of(load_description(write_description(numbers, place)))
    if change.numbers is not None:
        return point if injected.onset is None else None
    candidate = found.search.causes[0].score.candidate if found.search.causes else None
    if judgement.deviation is None or candidate is None or candidate.effect is None:
        return None
    effect = found.search.last.point.description.get_effect(candidate.effect.name)
    names = [p.name for p in effect.parameters() if p.name.endswith(f".{injected.effect.parameter}")]
    if len(names) != 1:
        return None
    if injected.onset is not None:
        effect = effect.model_copy(update={"start": injected.onset})
    return point.with_effect(effect.with_values({names[0]: injected.value}))
