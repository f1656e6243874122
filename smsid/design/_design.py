"""Experiment design: the thrust or motion whose data tell most about what is asked, within limits."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

import numpy as np

from smsid._given import PathLike, given_spacecraft
from smsid._short_repr import short_repr
from smsid._threads import single_threaded
from smsid.description.schema import Description
from smsid.design._forecast import exact_information
from smsid.design._goal import CRITERIA, Criterion, Goal, needs_motion
from smsid.design._limits import Limits, experiment_use
from smsid.design._minimum_time import Progress, Watch, minimum_time_design
from smsid.design._moving import FoundMotion, design_motion, within_limits
from smsid.design._thrusting import (
    FoundThrust,
    axes_of,
    design_thrust,
    intervals_of,
    limit_share,
    paper_thrust,
    scale_thrust,
)
from smsid.errors import ExperimentError
from smsid.experiments import Experiment, LimitUse
from smsid.likelihood.parameters import Parameters
from smsid.model import build_model
from smsid.model.spacecraft import SpacecraftModel

LOGGER = logging.getLogger(__name__)
Mode = Literal["auto", "thrust", "motion"]
DURATION = {"thrust": 120.0, "motion": 80.0}  # [s], the paper's
LONGEST = 3600.0  # [s] when a precision is asked for
FULL = 0.99  # share of what may be used at which a limit counts as what holds the design back
QUICK = 0.4  # effort for a motion while its duration is sought


@single_threaded
def design_experiment(
    description: Description | PathLike,
    wanted: Sequence[str],
    *,
    mode: Mode = "auto",
    criterion: Criterion = "worst",
    limits: Limits | None = None,
    duration: float | None = None,
    to: float | None = None,
    axes: str | None = None,
    seed: int = 0,
    effort: float = 1.0,
    name: str = "design",
    progress: Progress | None = None,
) -> Design:
    """Return the experiment that tells most about what is wanted.

    Args:
        description: the spacecraft with its sensors and their noise, or the path of its file; predictions
            are for its values.
        wanted: what is to be found out, see `smsid.design._goal.goal_of`.
        mode: ``thrust``: attitude held, arm and wheels locked (the paper's Exp. 1); ``motion``: joints and
            wheels move, free floating (Exp. 2); ``auto``: motion if anything asked for needs it.
        criterion: the ``worst`` relative standard deviation, or A (their mean square), or D (the volume).
        limits: beside those the description states.
        duration: of the experiment [s]; with ``to`` the longest allowed.
        to: relative standard deviation the worst parameter is to reach, in the shortest time.
        axes: along which thrust may act, letters of ``xyz``; by default those that move what is asked for.
        seed: of the search.
        effort: how long to search for a motion; 1 is about 300 tries.
        name: of the experiment.
        progress: hears of every try.

    The limits are checked on the simulated motion of the described spacecraft, with their margin. An
    interrupt (KeyboardInterrupt) ends the search with the best so far.

    Raises `ExperimentError` for a goal that stands for nothing, limits that cannot be kept, or a precision
    out of reach; it names the limit in the way.
    """
    description, limits = given_spacecraft(description), limits or Limits()
    if criterion not in CRITERIA:
        raise ExperimentError(f"There is no criterion '{criterion}'.", advice=f"Use {', '.join(CRITERIA)}.")
    if duration is not None and not (np.isfinite(duration) and duration > 0.0):
        raise ExperimentError(f"A duration of {duration} s is none.", advice="Give seconds.")
    if to is not None and not (np.isfinite(to) and to > 0.0):
        raise ExperimentError(f"A precision of {to} cannot be reached.", advice="Give a share such as 10%.")
    if axes is not None and (not axes or set(axes) - set("xyz") or len(set(axes)) < len(axes)):
        raise ExperimentError(f"Thrust axes are letters of 'xyz', not '{axes}'.")
    if not wanted:
        raise ExperimentError("Nothing is asked for.", advice="For instance: slosh, inertia, b_s.")
    model, kind = build_model(description), mode
    if kind == "auto":
        kind = "motion" if needs_motion(Parameters.of(model), wanted) else "thrust"
    watch: Watch[Any] = Watch(progress)
    last: list[np.ndarray] = []  # what the search for another duration ended with
    first: list[FoundMotion] = []

    def designed(length: float) -> FoundThrust | FoundMotion:
        rng = np.random.default_rng(seed)
        if kind == "thrust":
            used = axes if axes is not None or not last else axes_of(last[0])  # the same for all durations
            return design_thrust(model, wanted, criterion, limits, length, rng, watch, last, used)
        start, work = last[0] if last else None, effort if to is None else QUICK * effort
        made, origin = design_motion(model, wanted, criterion, limits, length, rng, watch, start, work)
        first[:] = [origin]
        return made

    def search(length: float) -> tuple[float, FoundThrust | FoundMotion]:
        watch.restart(f"{kind} of {length:.4g} s")
        try:
            made = designed(length)
        except KeyboardInterrupt:
            if watch.best is None:
                raise
            watch.interrupted, made = True, watch.best
        last[:] = [made.thrust if isinstance(made, FoundThrust) else made.point]
        return float(made.goal.relative(made.covariance).max()), made

    def whole(length: float) -> float:
        ticks = intervals_of(60.0)
        return ticks * round(length / ticks, 2) if kind == "thrust" else round(length, 1)

    def held_back(made: FoundThrust | FoundMotion) -> str:
        if isinstance(made, FoundMotion):
            return _active_limits(within_limits(model, made, limits)[1], limits)
        return _active_limits(experiment_use(model, made.experiment, limits), limits)

    if to is None:
        _, made = search(duration or DURATION[kind])
    else:
        most = duration or LONGEST
        made = minimum_time_design(search, to, DURATION[kind], most, whole, watch, held_back)
    made = replace(made, experiment=made.experiment.model_copy(update={"name": name}))
    if isinstance(made, FoundMotion):
        made, uses = within_limits(model, made, limits)
        before = within_limits(model, first[0] if first else made, limits)[0].experiment
        return _with_exact_bounds(model, made, uses, before, watch, to, limits)
    uses = experiment_use(model, made.experiment, limits)
    over = limit_share(uses, limits)
    if over > 1.0 + 1e-6:
        made = scale_thrust(made, 0.9999 / over)
        uses = experiment_use(model, made.experiment, limits)
    return _with_exact_bounds(model, made, uses, paper_thrust(model, made, limits), watch, to, limits)


def _with_exact_bounds(
    model: SpacecraftModel,
    made: FoundThrust | FoundMotion,
    uses: tuple[LimitUse, ...],
    reference: Experiment,
    watch: Watch,
    to: float | None,
    limits: Limits,
) -> Design:
    """Return the design with exact bounds of what was found and of the reference."""
    watch.stage = "predicting"
    goal = made.goal
    sigma, before = (
        goal.relative_of(exact_information(model.description, e)) * goal.scales
        for e in (made.experiment, reference)
    )
    notes = []
    if watch.interrupted:
        notes.append("interrupted: this is the best found so far")
    used_up = _active_limits(uses, limits)
    if used_up:
        notes.append(used_up.removeprefix(", "))
    if to is not None and (sigma / goal.scales).max() > to:
        reached = float((sigma / goal.scales).max())
        notes.append(f"asked for {100 * to:.4g} %, predicted {100 * reached:.4g} %")
    return Design(
        made.experiment,
        goal,
        sigma,
        reference,
        before,
        uses,
        watch.evaluations,
        watch.interrupted,
        tuple(notes),
    )


def _active_limits(uses: tuple[LimitUse, ...], limits: Limits) -> str:
    """Return the limits that are used up, in words."""
    full = [str(u) for u in uses if limits.share(u) > FULL]
    return f", held back by {'; '.join(full)}" if full else ""


@short_repr
@dataclass(frozen=True)
class Design:
    """A designed experiment.

    ``sigma`` (k,) are the Cramer-Rao bounds of the goal's parameters, ``before`` (k,) those of ``reference``:
    the paper's excitation of the same duration within the same limits. ``limits`` are what the simulated
    motion uses of every limit. ``evaluations`` counts experiments tried; ``interrupted``: the search was
    stopped, this is the best it had.
    """

    experiment: Experiment
    goal: Goal
    sigma: np.ndarray
    reference: Experiment
    before: np.ndarray
    limits: tuple[LimitUse, ...]
    evaluations: int
    interrupted: bool = False
    notes: tuple[str, ...] = ()

    @property
    def relative(self) -> np.ndarray:
        """The bounds relative to the goal's scales (k,)."""
        return self.sigma / self.goal.scales

    @property
    def relative_before(self) -> np.ndarray:
        """Those of the reference (k,)."""
        return self.before / self.goal.scales

    def document(self) -> dict[str, Any]:
        """Return the design as plain data."""
        rows = zip(self.goal.names, self.goal.units, self.goal.values, self.sigma, self.before, strict=True)
        return {
            "experiment": self.experiment.model_dump(mode="json", by_alias=True, exclude_none=True),
            "criterion": self.goal.criterion,
            "parameters": [
                {"name": n, "unit": u, "value": float(v), "sigma": float(s), "sigma_before": float(b)}
                for n, u, v, s, b in rows
            ],
            "relative": self.relative.tolist(),
            "relative_before": self.relative_before.tolist(),
            "before": self.reference.note,
            "limits": [asdict(u) for u in self.limits],
            "evaluations": self.evaluations,
            "interrupted": self.interrupted,
            "notes": list(self.notes),
        }

    @property
    def gain(self) -> float:
        """By how much the worst parameter is better known than after the reference experiment."""
        return float(self.relative_before.max() / self.relative.max())
