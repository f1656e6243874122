"""How a fit came to rest: its sum of squares and its steps, iteration by iteration."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from smsid.identify.estimate import Iteration
from smsid.report.axes import Axis
from smsid.report.model import Figure, Grid, Section
from smsid.report.numbers import number
from smsid.report.plot import Curve, Plot, Rule

TICKS = 8
WIDE = 10.0  # ratio of costs above which their axis is logarithmic
HEIGHT = 190


def convergence_section(prefix: str, history: Sequence[Iteration]) -> list[Section]:
    """Return the section "Convergence of the fit"; none for a method that does not iterate."""
    if len(history) < 2:
        return []
    cost = np.array([x.cost for x in history])
    # a start has no step, and what is exactly zero no place on a logarithmic axis
    step = np.array([x.step or math.nan for x in history])
    starts = [k for k, x in enumerate(history) if x.step is None][1:]
    rules = tuple(Rule("searched again", float(k), colour=2) for k in starts)
    n = np.arange(len(history), dtype=float)
    y = Axis.over("cost / samples", [cost], log=bool(cost.max() > WIDE * cost.min()), count=5)
    alt = f"cost by iteration, from {number(cost[0], 5)} to {number(cost[-1], 5)}"
    marks = (*rules, Curve("", n, cost), Curve("", n, cost, 0, "points"))
    body = Plot(_iterations(len(history)), y, marks, alt, HEIGHT)
    figures = [Figure(f"{prefix}fit-cost", "Sum of squares per sample", body)]
    if np.isfinite(step).any():
        y, alt = (
            Axis.over("step [σ]", [step, [1.0]], log=True, count=5),
            "largest step of a parameter by iteration",
        )
        marks = (*rules, Rule("one σ", 1.0, False, 2), Curve("", n, step), Curve("", n, step, 0, "points"))
        body = Plot(_iterations(len(history)), y, marks, alt, HEIGHT)
        figures.append(Figure(f"{prefix}fit-steps", "Largest step of a parameter", body))
    caption = (
        "Cost: residuals and priors in standard deviations of the noise, squared and summed. The noise is "
        "that of the residuals at the end, so that the cost ends near one, however good the fit. Step: how "
        "far the parameter that moved most went, in its own standard deviation. The search ends where the "
        "next step would gain next to nothing."
    )
    grid = Grid("The maximum-likelihood search, iteration by iteration", figures, caption)
    gist = f"{len(history) - 1} iterations"
    gist += "" if history[-1].step is None else f", last step {number(history[-1].step, 2)} σ"
    return [Section(f"{prefix}convergence", "Convergence of the fit", (grid,), gist)]


def _iterations(count: int) -> Axis:
    every = math.ceil((count - 1) / TICKS)
    room = 0.04 * (count - 1)
    ticks = tuple((float(k), str(k)) for k in range(0, count, every))
    return Axis("iteration", -room, count - 1 + room, ticks=ticks)
