"""The report of ``smsid design``: what is commanded, what it will tell, what it uses of the limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from smsid.design import Design, Limits
from smsid.design.model_discrimination import Separation
from smsid.experiments import Experiment, LimitUse
from smsid.experiments.schema import Profile
from smsid.identify.estimate import IDENTIFIABLE_BELOW
from smsid.inputs.signals import Signal, sample
from smsid.model.spacecraft import SpacecraftModel
from smsid.report.axes import Axis
from smsid.report.model import (
    Cell,
    Figure,
    Grid,
    Provenance,
    Report,
    Section,
    Table,
    Text,
    Tone,
    cells,
    notes_section,
)
from smsid.report.numbers import number, share, unit
from smsid.report.plot import Curve, Plot
from smsid.report.rows import Bar, ChartRow, Mark, RowChart

NEAR = 0.99  # share of what may be used at which a limit holds the design back


def design_report(
    found: Design | Separation, model: SpacecraftModel, limits: Limits, to: float | None, origin: Provenance
) -> Report:
    """Return the report of a designed experiment.

    Args:
        found: the design, or the experiment that separates two causes.
        model: the described spacecraft, for the names of what moves.
        limits: within which it was designed, with their margin.
        to: relative precision asked for, if any.
        origin: versions, command, files, seed.
    """
    experiment = found.experiment
    chart = _precision(found, to) if isinstance(found, Design) else _separation(found)
    told = (chart, result_table(found, to))
    title = "Predicted precision" if isinstance(found, Design) else "Detection limits"
    facts = [
        f"{label}: {e.note.removeprefix('designed: ')}; {number(e.duration, 6)} s"
        for label, e in (("designed", experiment), ("before", found.reference))
    ]
    drawn = (Text(facts, bullets=True), *signal_grids(model, experiment, found.reference))
    sections = [
        Section("precision", title, told, "Cramér-Rao bounds" if isinstance(found, Design) else ""),
        Section("signals", "Designed signals", drawn, f"{number(experiment.duration, 6)} s"),
        Section("limits", "Limits", _limits(found.limits, limits), _tightest(found.limits, limits)),
        *notes_section(found.notes, open=True),
    ]
    sentence, tone = verdict(found, limits, to)
    glance = [("duration", f"{number(experiment.duration, 5)} s")]
    if isinstance(found, Design):
        glance.append(("worst relative σ", share(float(found.relative.max()))))
        glance.append(("better than before", f"{number(found.gain, 3)} times"))
    else:
        glance.append(("correlation of the two", number(found.correlation, 3)))
        glance.append(("before", number(found.correlation_before, 3)))
    glance.append(("experiments tried", str(found.evaluations)))
    name = model.description.name
    return Report("Designed experiment", name, sentence, tone, sections, origin, glance)


def verdict(found: Design | Separation, limits: Limits, to: float | None = None) -> tuple[str, Tone]:
    """Return one sentence on a design, and what it is worth."""
    stopped = " The search was interrupted." if found.interrupted else ""
    broken = limits.violations(found.limits)
    if broken:
        return f"The experiment passes a limit: {'; '.join(map(str, broken))}.{stopped}", "bad"
    if isinstance(found, Separation):
        better = max(r.before / r.limit for r in found.rows)
        sentence = (
            f"In {number(found.experiment.duration, 5)} s the two causes leave signatures that correlate by "
            f"{number(found.correlation, 3)} (before: {number(found.correlation_before, 3)}); the least "
            f"value that is told from the other cause is up to {number(better, 3)} times smaller."
        )
        return sentence + stopped, "warn" if found.interrupted else "good"
    worst = int(found.relative.argmax())
    reached = float(found.relative[worst])
    sentence = (
        f"In {number(found.experiment.duration, 5)} s every parameter asked for becomes known to "
        f"{share(reached, 3)} or better (one standard deviation; worst: {found.goal.names[worst]}), the "
        f"worst {number(found.gain, 3)} times better than before, within all limits."
    )
    if to is not None and reached > to:
        return f"{sentence} Asked for were {share(to, 3)}: out of reach.{stopped}", "warn"
    good = reached <= (to or IDENTIFIABLE_BELOW) and not found.interrupted
    return sentence + stopped, "good" if good else "warn"


def _precision(found: Design, to: float | None) -> Figure:
    goal, rows = found.goal, []
    wanted = IDENTIFIABLE_BELOW if to is None else to
    for i, name in enumerate(goal.names):
        now, then = float(found.relative[i]), float(found.relative_before[i])
        met = now <= wanted
        items = (
            Bar(now, 0 if met else 1, tip=f"σ {share(now)}"),
            Mark(then, series=2, shape="ring", tip=f"before: {share(then)}"),
        )
        rows.append(ChartRow(name, items, share(now), tone="neutral" if met else "warn"))
    label = "wanted" if to is not None else "limit of identifiable"
    legend = [("σ predicted", 0, "bar"), ("before", 2, "ring")]
    legend += [(f"σ predicted, above {label}", 1, "bar")] if any(r.tone == "warn" for r in rows) else []
    values = [found.relative, found.relative_before, [wanted]]
    axis = Axis.over("σ, share of the parameter's size", values, log=True)
    alt = "predicted standard deviations relative to the parameters' size"
    chart = RowChart(axis, rows, alt, legend, ((wanted, f"{label}: {share(wanted, 3)}"),))
    caption = (
        "Left is better. Bounds of Cramér and Rao on one standard deviation, of the experiment as simulated, "
        "for the described values; biases and initial pose unknown. Before: the paper's kind of excitation "
        "of the same duration within the same limits."
    )
    return Figure("sigmas", "Standard deviations to be expected", chart, caption)


def result_table(found: Design | Separation, to: float | None = None) -> Table:
    """Return what a design predicts beside what was before: standard deviations, or detection limits."""
    if isinstance(found, Separation):
        rows = [cells(r.cause, r.parameter, (r.limit, 3), (r.before, 3), unit(r.unit)) for r in found.rows]
        columns = ("cause", "parameter", "#told from the other", "#before", "unit")
        return Table("Detection limits", columns, rows)
    goal, rows = found.goal, []
    for i, name in enumerate(goal.names):
        now, then = float(found.relative[i]), float(found.relative_before[i])
        met = now <= (IDENTIFIABLE_BELOW if to is None else to)
        known = (goal.values[i], 6), (found.sigma[i], 3), (found.before[i], 3), unit(goal.units[i])
        relative = Cell(share(now), now, "good" if met else "warn"), Cell(share(then), then)
        rows.append(cells(name, *known, *relative, (then / now, 3)))
    columns = ("parameter", "#described", "#σ", "#σ before", "unit", "#relative", "#before", "#times better")
    return Table("Predicted standard deviations", columns, rows)


def _separation(found: Separation) -> Figure:
    rows = []
    for r in found.rows:
        name = r.cause if r.cause.startswith(r.parameter) else f"{r.cause}: {r.parameter}"
        bar = Bar(r.limit / r.before, 0, 1.0, tip=f"{number(r.limit, 3)} {r.unit}")
        rows.append(ChartRow(name, (bar,), f"{number(r.limit, 3)} {unit(r.unit)}"))
    ratios = [r.limit / r.before for r in found.rows]
    axis = Axis.over("detection limit, share of that before", [ratios, [1.0]], log=True)
    alt = "least values told from the other cause, relative to before"
    chart = RowChart(axis, rows, alt, rules=((1.0, "before"),))
    caption = "The least value that would be seen and told from the other cause. Left is better."
    return Figure("detection", "What is told apart", chart, caption)


def _limits(uses: tuple[LimitUse, ...], limits: Limits) -> list[Figure | Table | Text]:
    uses = tuple(sorted(uses, key=lambda u: (u.limit is None, -limits.share(u))))
    stated = [u for u in uses if u.limit is not None]
    parts: list[Figure | Table | Text] = []
    if stated:
        rows, values = [], [[0.0, 1.0]]
        for u in stated:
            used = limits.share(u) * limits.usable_share
            over = used > limits.usable_share * (1 + 1e-6)
            bar = Bar(used, int(over), 0.0)
            rows.append(ChartRow(u.quantity, (bar,), share(used, 3), tone="bad" if over else "neutral"))
            values.append([used, used])
        axis = Axis.over("largest value, share of the limit", values, room=0.02, count=6)
        rules = ((limits.usable_share, f"{share(limits.margin, 3)} left unused"),)
        chart = RowChart(axis, rows, "share of every limit that the simulated motion uses", rules=rules)
        caption = "From the simulated motion of the described spacecraft. To the left of the line: within."
        parts.append(Figure("limit-chart", "How much of every limit is used", chart, caption))
    else:
        parts.append(Text(("No limit is stated, in the description or by options.",)))
    table = []
    for u in uses:
        own = cells("none stated", None, None)
        if u.limit is not None:
            tone: Tone = (
                "bad" if u in limits.violations((u,)) else "good" if limits.share(u) <= NEAR else "neutral"
            )
            used = Cell(share(u.value / u.limit, 3), u.value / u.limit, tone)
            own = cells((u.limit, 5), used, (u.limit - u.value, 3))
        table.append(cells(u.quantity, (u.value, 4), *own, unit(u.unit)))
    columns = ("quantity", "#largest", "#limit", "#used", "#margin left", "unit")
    note = f"Of every limit {share(limits.margin, 3)} is to be left unused."
    parts.append(Table("Limits and what is left of them", columns, table, note))
    return parts


def _tightest(uses: tuple[LimitUse, ...], limits: Limits) -> str:
    stated = [u for u in uses if u.limit is not None]
    if not stated:
        return "none stated"
    full = [u.quantity for u in stated if limits.share(u) > NEAR]
    return f"held back by {', '.join(full)}" if full else "none used up"


POINTS = 1200
HEIGHT = 150


def signal_grids(model: SpacecraftModel, experiment: Experiment, reference: Experiment) -> tuple[Grid, ...]:
    """Return a grid of small figures per kind of command; components that stay zero in both are left out."""
    out = []
    for key, title, unit_, names in _kinds(model):
        now, then = getattr(experiment, key), getattr(reference, key)
        figures = _figures(key, names, unit_, (now, experiment.duration), (then, reference.duration))
        if figures:
            out.append(Grid(title, figures))
    return tuple(out)


def signal_points(signal: Signal, duration: float) -> tuple[np.ndarray, np.ndarray]:
    """Return times (N,) and values (N, size) to draw a signal from 0 to ``duration`` [s], jumps upright."""
    jumps = np.array([t for t in signal.breakpoints if 0.0 < t < duration])
    before = jumps - 1e-12 * duration  # what is within rounding of a jump counts as after it
    times = np.unique(np.concatenate([np.linspace(0.0, duration, POINTS), before, jumps]))
    return times, sample(signal, times)


def _kinds(model: SpacecraftModel) -> Iterator[tuple[str, str, str, Sequence[str]]]:
    axes = [f"along {a}" for a in "xyz"]
    yield "force", "Thrust, body axes", "N", axes
    yield "torque", "Torque on the bus, body axes", "N m", [f"about {a}" for a in "xyz"]
    yield "wheel_torque", "Torques of the wheels", "N m", model.wheels.names
    yield "joint_torque", "Torques of the joints", "N m", model.arm_joints.names
    yield "joint_motion", "Angles of the joints", "rad", model.arm_joints.names


Timed = tuple[Profile | None, float]


def _figures(key: str, names: Sequence[str], unit: str, now: Timed, then: Timed) -> tuple[Figure, ...]:
    curves = []
    kinds = ((then, "before", 2, "thin"), (now, "designed", 0, "line"))
    for (profile, duration), label, colour, style in kinds:
        if profile is not None:
            curves.append((label, colour, style, *signal_points(profile.signal(), duration)))
    out = []
    for k, name in enumerate(names):
        own = [Curve(name_, t, x[:, k], hue, style) for name_, hue, style, t, x in curves if x[:, k].any()]
        if not own:
            continue
        x = Axis.over("time [s]", [c.x for c in own], room=0.0, count=6)
        y = Axis.over(unit, [c.y for c in own], count=4)
        body = Plot(x, y, own, f"{name} over time, designed and before", HEIGHT)
        out.append(Figure(f"{key}-{k}", name, body))
    return tuple(out)
