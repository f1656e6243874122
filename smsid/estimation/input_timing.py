"""How commands act between samples, and from which side of a jump accelerations are: told, or found."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from smsid.errors import SimulationError
from smsid.estimation.filter_run import FilterRun, log_likelihoods
from smsid.estimation.innovations import normalised_rmse
from smsid.estimation.input_hold import VARYING, Hold, bends_between_samples, has_jumps, is_mixed_hold
from smsid.estimation.kalman import run_filter
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import CommandTiming, Problem
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

LOGGER = logging.getLogger(__name__)
MISFIT_RATIO = 10.0  # times its noise that the model leaves, over all channels, before it does not follow
CLEAR_GAIN = 5.0  # of the log-likelihood, with which commands are taken to act otherwise
HOPELESS_LOSS = 50.0  # in log-likelihood over the first samples, by which a way is out: 10 times `CLEAR_GAIN`
PARTS = 4  # as many parts as the samples have, of which the first is filtered at first in a second look
FOLLOWED_RATIO = 1.5  # times its noise, below which that part tells: what is not followed prefers anything


def timings(recording: Recording) -> tuple[CommandTiming, ...]:
    """Return how the commands of a recording may act: one where it says so itself.

    It does by ``inputs`` ("held" or "linear") and ``acceleration`` in its provenance. Commands that jump
    beside others that do not may be both; those that vary may bend between slow samples. What jumps may do
    so between samples.
    """
    told = recording.provenance
    side = "left" if "left" in str(told.get("acceleration", "")) else "right"
    sides = (side,) if "acceleration" in told else ("right", "left")
    holds: tuple[Hold, ...] = ("linear", "held", *(("jumps",) if is_mixed_hold(recording) else ()))
    if told.get("inputs") in ("held", "linear"):
        holds = (told["inputs"],)
    if "linear" in holds and bends_between_samples(recording):
        holds = (*holds, "smooth")
    out = [CommandTiming(h, s) for h in holds for s in (sides[:1] if h in VARYING else sides)]
    if "inputs" not in told and has_jumps(recording):  # in its middle, a slow one has no side
        out += [CommandTiming(h, sides[0], anywhere=True) for h in holds if h not in VARYING]
    return tuple(out)


def timing_of(point: Point, problem: Problem, now: CommandTiming | None = None) -> CommandTiming:
    """Return how commands act between samples: as the recording says, else as its likelihood prefers.

    Where the model does not follow the recording, the likelihood is that with noise levels as large as the
    errors, component by component. That tells the side; what varies between samples it hardly does, and where
    commands jump beside others that do not, each is taken for what it looks like. What is taken ``now`` stays
    unless another is clearly better; in such a second look, ways far behind over the first samples go no
    further. The problem's sensors are as they are at the point.
    """
    choices = timings(problem.recording)
    if len(choices) == 1:
        return choices[0]
    model, data, left, likely = point.model(), problem.data, np.inf, dict[CommandTiming, float]()
    if now is not None:
        some = replace(problem, data=data.first(-(-len(data.times) // PARTS)))
        left, likely = _likelihoods(model, some, choices)
    ahead = [t for t in likely if likely[t] > max(likely.values()) - HOPELESS_LOSS]
    if left > FOLLOWED_RATIO or len(ahead) > 1:
        left, likely = _likelihoods(model, problem, ahead if left <= FOLLOWED_RATIO else choices)
    if not likely:  # lost: the search says what is wrong; commands are taken for what they look like
        return now or next((t for t in choices if t.hold == "jumps"), choices[0])
    best = max(likely, key=lambda t: likely[t])
    both = CommandTiming("jumps", best.side)
    if left > MISFIT_RATIO and both in likely:
        return both
    return now if now in likely and likely[best] - likely[now] < CLEAR_GAIN else best


def _likelihoods(
    model: SpacecraftModel, problem: Problem, choices: Sequence[CommandTiming]
) -> tuple[float, dict[CommandTiming, float]]:
    """Return what a model leaves at best, in noise, and how likely it is with commands as in each choice."""
    runs: dict[CommandTiming, FilterRun] = {}
    for timing in choices:
        try:
            runs[timing] = run_filter(model, replace(problem, timing=timing))
        except SimulationError as error:
            LOGGER.info("not %s, %s: %s", timing.words, timing.side, error)
    left = min((normalised_rmse(r) for r in runs.values()), default=np.inf)
    likely = {
        t: _after_the_first(r) if left <= MISFIT_RATIO else _with_own_levels(r) for t, r in runs.items()
    }
    LOGGER.info("%s", ", ".join(f"{t.words} {t.side}: {x:.1f}" for t, x in likely.items()))
    return left, likely


def _after_the_first(run: FilterRun) -> float:
    """Return the log-likelihood of all samples but the first, of which not every timing takes as much."""
    first = log_likelihoods(run.innovations[:1], run.whitening[:1], run.given)
    return run.log_likelihood - float(first[0])


def _with_own_levels(run: FilterRun) -> float:
    """Return the same, but for a constant, with the noise of every component as its errors are."""
    squares = np.where(run.used, run.normalised**2, 0.0)[1:].sum(axis=0)
    count = run.used[1:].sum(axis=0)
    seen = (count > 0) & (squares > 0.0)
    return -0.5 * float(count[seen] @ np.log(squares[seen] / count[seen]))
