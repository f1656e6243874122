"""The experiment that tells two causes apart: what one leaves when the other and all nuisances are free.

For two candidates of `smsid.diagnose` the whitened signatures a and b are projected off the nominal
parameters (with their priors) and off each other. What is left of a, squared, is the noncentrality of the
test for it per unit of its parameter; the detection limit of `smsid diagnose` is a multiple of its inverse
root. The experiment sought has the least geometric mean of both limits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from smsid._short_repr import short_repr
from smsid._threads import single_threaded
from smsid.description.schema import Description
from smsid.design._limits import Limits
from smsid.design._minimum_time import Progress, Watch
from smsid.design._trials import Trials, families
from smsid.diagnose.diagnose import RATE
from smsid.diagnose.hypotheses import propose
from smsid.diagnose.priors import Nominal, nominal
from smsid.diagnose.score_test import Candidate, Score, correlation, score_candidates, signatures
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import ExperimentError, SmsidError
from smsid.estimation.input_hold import locked_coordinates
from smsid.estimation.map_estimate import MapFit, evaluate
from smsid.estimation.measurements import measurements_of
from smsid.estimation.problem import CommandTiming, Problem, ProcessNoise
from smsid.experiments import Experiment, LimitUse
from smsid.model import build_model
from smsid.recording import Recording

DURATION = 60.0  # [s]
SLOW = 8.0  # [Hz] of the search; the result is judged at diagnose's own rate
DRAWS, STEPS = 8, 24  # random experiments of each kind, and steps from the best
WIDTH, GROW, SHRINK = 0.4, 1.5, 1.5**-0.25
INSEPARABLE = 1e-6  # share of a signature's information left beside the other below which it is rounding


@dataclass(frozen=True)
class Discrimination:
    """One parameter of a cause: the least value that would be seen and told from the other cause."""

    cause: str
    parameter: str
    unit: str
    limit: float
    before: float


@short_repr
@dataclass(frozen=True)
class Separation:
    """An experiment that separates two causes. ``correlation`` is that of their signatures."""

    experiment: Experiment
    rows: tuple[Discrimination, ...]
    correlation: float
    reference: Experiment
    correlation_before: float
    limits: tuple[LimitUse, ...]
    evaluations: int
    interrupted: bool = False
    notes: tuple[str, ...] = ()

    def document(self) -> dict[str, Any]:
        """Return the separation as plain data."""
        return {
            "experiment": self.experiment.model_dump(mode="json", by_alias=True, exclude_none=True),
            "detection_limits": [asdict(r) for r in self.rows],
            "correlation": self.correlation,
            "correlation_before": self.correlation_before,
            "limits": [asdict(u) for u in self.limits],
            "evaluations": self.evaluations,
            "interrupted": self.interrupted,
            "notes": list(self.notes),
        }


@dataclass(frozen=True)
class CauseLimits:
    """Limits (parameters,) of both causes in an experiment, their units and correlation."""

    limits: tuple[np.ndarray, np.ndarray]
    units: tuple[tuple[str, ...], tuple[str, ...]]
    correlation: float

    @property
    def cost(self) -> float:
        """Logarithm of the geometric mean of both causes' limits, in units of their steps."""
        return float(np.mean([np.mean(np.log(x)) for x in self.limits]))


@single_threaded
def design_separation(
    description: Description,
    pair: str | tuple[str, str],
    *,
    limits: Limits | None = None,
    duration: float | None = None,
    seed: int = 0,
    effort: float = 1.0,
    name: str = "separate",
    progress: Progress | None = None,
) -> Separation:
    """Return the experiment that best separates two causes.

    ``pair``: both causes as `smsid diagnose` prints them ("viscous at joint2"), or by effect and place
    ("thruster_gain at thruster"); in one string with a comma between. Motions of the arm and thrusts are
    tried, whichever shows both causes.

    Raises `ExperimentError` for a name that fits none or several candidates, and when no experiment tried
    separates them.
    """
    known = nominal(description, None)
    model, rng = build_model(description), np.random.default_rng(seed)
    watch: Watch[tuple[Trials, np.ndarray]] = Watch(progress, "separating")
    kinds = families(model, limits or Limits(), DURATION if duration is None else duration)
    firsts = [(kind, kind.random(rng)) for kind in kinds]
    everything: dict[tuple[str, str, str], Candidate] = {}
    for kind, point in firsts:
        _, recording, _ = kind.flown(point)
        for c in candidates_of(known, recording):
            everything.setdefault(c.key, c)
    first, second = resolve_candidates(pair, list(everything.values()))

    def tried(kind: Trials, point: np.ndarray) -> float:
        try:
            _, recording, _ = kind.flown(point)
            cost = discriminate(known, recording, first, second, SLOW).cost
        except SmsidError:
            cost = np.inf
        watch.tried((kind, point), cost, float(np.exp(min(cost, 700.0))))
        return cost

    try:
        shown = [kind for kind, point in firsts if np.isfinite(tried(kind, point))]
        if not shown:
            raise ExperimentError(
                f"No experiment tried tells '{label(first)}' from '{label(second)}'.",
                advice="They may be the same seen from outside, or need an actuator this spacecraft lacks.",
            )
        for kind in shown:
            for _ in range(max(0, int(effort * DRAWS) - 1)):
                tried(kind, kind.random(rng))
        width = WIDTH
        for _ in range(int(effort * STEPS)):
            assert watch.best is not None
            (kind, point), cost = watch.best, watch.cost
            new = tried(kind, kind.random_step(point, width, rng))
            width *= GROW if new < cost else SHRINK
    except KeyboardInterrupt:
        if watch.best is None:
            raise
        watch.interrupted = True
    assert watch.best is not None
    kind, point = watch.best
    experiment, recording, uses = kind.flown(point, rate=RATE)
    reference, before, _ = kind.flown(dict(firsts)[kind], rate=RATE)
    now = discriminate(known, recording, first, second, RATE)
    then = discriminate(known, before, first, second, RATE)
    rows = [
        Discrimination(label(c), p.rpartition(".")[2] if c.effect else p, unit, float(limit), float(old))
        for c, own, other, units in zip((first, second), now.limits, then.limits, now.units, strict=True)
        for p, unit, limit, old in zip(c.free, units, own * c.steps, other * c.steps, strict=True)
    ]
    notes = ("interrupted: this is the best found so far",) if watch.interrupted else ()
    return Separation(
        experiment.model_copy(update={"name": name}),
        tuple(rows),
        now.correlation,
        reference,
        then.correlation,
        uses,
        watch.evaluations,
        watch.interrupted,
        notes,
    )


def discriminate(
    known: Nominal, recording: Recording, first: Candidate, second: Candidate, rate: float
) -> CauseLimits:
    """Return the limits of both causes, each told from the other, in units of their steps.

    Raises `ExperimentError` when the recording does not show one of them, or does not tell them apart.
    """
    found, candidates = _fit(known, recording, rate)
    by_key = {c.key: c for c in candidates}
    for c in (first, second):
        if c.key not in by_key:
            raise ExperimentError(f"'{label(c)}' cannot be seen in this experiment.")
    pair = [by_key[first.key], by_key[second.key]]
    columns = signatures(found, pair)
    if len(columns) < 2:
        raise ExperimentError("A cause has no signature in this experiment.")
    scores = score_candidates(found, pair, [columns[0], columns[1]])
    for c, s in zip(pair, scores, strict=True):
        if s.candidate.free != c.free:
            raise ExperimentError(f"'{label(c)}' is not excited in all that it frees.")
    needed = THRESHOLDS.detectable(len(candidates))
    limits = [needed * _sigma(a, b) for a, b in (scores, scores[::-1])]
    units = [tuple(u.unit for u in c.unknowns(found.unknowns)) for c in pair]
    return CauseLimits((limits[0], limits[1]), (units[0], units[1]), correlation(*scores))


def _sigma(one: Score, other: Score) -> np.ndarray:
    """Standard deviations (parameters,) of a cause with the other free, in units of its steps."""
    basis, _ = np.linalg.qr(other.columns)
    left = one.columns - basis @ (basis.T @ one.columns)
    left -= basis @ (basis.T @ left)
    size = np.linalg.norm(one.columns, axis=0)
    there = size > 0.0  # a gear's rotor does nothing where the gear does not give: only its prior tells it
    if not there.any():
        raise ExperimentError(f"'{label(one.candidate)}' is not excited.")
    raw, left = size[there], left[:, there]
    values, vectors = np.linalg.eigh((left.T @ left) / np.outer(raw, raw))
    if values.min() < INSEPARABLE:
        raise ExperimentError(f"'{label(one.candidate)}' is not told from '{label(other.candidate)}'.")
    sigma = np.full(len(size), np.inf)
    sigma[there] = np.sqrt(((vectors**2) / values).sum(axis=1)) / raw
    return sigma


def _fit(known: Nominal, recording: Recording, rate: float) -> tuple[MapFit, list[Candidate]]:
    force = "command.force" in recording and bool(np.any(recording["command.force"]))
    problem = _problem(known, recording, CommandTiming("held" if force else "linear", "right"), rate)
    return evaluate(known.point, known.unknowns, problem), propose(known.point, problem, known.unknowns)


def _problem(known: Nominal, recording: Recording, timing: CommandTiming, rate: float = np.inf) -> Problem:
    point = known.point
    data = measurements_of(point.base, recording, point.description.effective_sensors())
    data = data.thinned(rate) if rate < np.inf else data
    return Problem(
        recording, data, locked_coordinates(point.base, recording), timing, ProcessNoise(), known.joint
    )


def candidates_of(known: Nominal, recording: Recording) -> list[Candidate]:
    """Return what `smsid diagnose` would try on a recording."""
    return propose(known.point, _problem(known, recording, CommandTiming()), known.unknowns)


def label(candidate: Candidate) -> str:
    """Return a candidate as `smsid diagnose` prints it."""
    return f"{candidate.shape} at {candidate.location}"


def spellings(c: Candidate) -> set[str]:
    """Return the ways to write a candidate, in lower case."""
    ways = {
        f"{c.shape} at {c.location}",
        f"{c.kind} at {c.location}",
        f"{c.shape} ({c.kind}) at {c.location}",
        f"{c.kind} ({c.shape}) at {c.location}",
        f"{c.kind}_{c.location}",
        ":".join(c.key),
    }
    return {w.lower() for w in ways}


def resolve_candidates(
    pair: str | tuple[str, str], candidates: Sequence[Candidate]
) -> tuple[Candidate, Candidate]:
    """Return the two candidates that names stand for; raises `ExperimentError` when they do not."""
    splits = [pair] if not isinstance(pair, str) else _splits(pair)
    trouble: ExperimentError | None = None
    for names in splits:
        try:
            first, second = (_one(n, candidates) for n in names)
        except ExperimentError as error:
            trouble = trouble or error
            continue
        if first.key == second.key:
            raise ExperimentError(f"'{label(first)}' is given twice.", advice="Name two different causes.")
        return first, second
    raise trouble or ExperimentError(
        f"'{pair}' names no two causes.", advice="Write --separate 'viscous at joint2,coulomb at joint2'."
    )


def _splits(text: str) -> list[tuple[str, str]]:
    """All ways to cut a string in two at a comma: names may hold one."""
    parts = text.split(",")
    return [(",".join(parts[:i]).strip(), ",".join(parts[i:]).strip()) for i in range(1, len(parts))]


def _one(name: str, candidates: Sequence[Candidate]) -> Candidate:
    found = [c for c in candidates if name.lower() in spellings(c)]
    if len(found) == 1:
        return found[0]
    listed = sorted(label(c) for c in (found or candidates))
    if found:
        raise ExperimentError(
            f"'{name}' fits {len(found)} causes.", advice=f"Say which: {', '.join(listed)}.", known=listed
        )
    import difflib

    near = difflib.get_close_matches(name, [w for c in candidates for w in spellings(c)], n=3)
    raise ExperimentError(
        f"No cause is named '{name}'.",
        advice=f"Did you mean {', '.join(near)}?" if near else f"Causes: {', '.join(listed[:40])}, ...",
        known=listed,
    )
