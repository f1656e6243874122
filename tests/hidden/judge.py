"""What a diagnosis was worth, from `diagnosis.json` and the hidden truth alone.

| outcome | one effect of the catalogue was hidden, and the diagnosis |
|---|---|
| right | names it: kind, place and shape; at most two others stand beside it as aliases |
| right_by_alias | has it among at most two aliases, and the experiment cannot tell it from what is named |
| right_family | names its family at its place, no more, or another shape of it |
| extra | names it and something that is not there |
| unexplained | says that nothing in the catalogue explains the recording |
| missed | finds the recording adequate |
| wrong_family | names something of another family or another place |
| false_alarm | (nothing hidden) names a cause or finds the recording unexplained |
| not_evaluated | did not judge |

What is one base parameter (a link's inertia, that of links it carries) is one alias, wherever it is said.
Outside the catalogue, `unexplained` is right, with or without its equation among what remains, and so is a
family alone. Of a pair, both must be found: `partial` is one of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from .effect import Hidden

ALIASES = 2  # beside the name itself: a set of three
OUTCOMES = (
    "right", "right_by_alias", "right_family", "extra", "partial", "unexplained", "missed", "wrong_family",
    "false_alarm", "not_evaluated",
)  # fmt: skip


@dataclass(frozen=True)
class Injected:
    """What a run hid: an effect and its value [unit of the effect]; strength is the value over the limit."""

    effect: Hidden
    value: float
    strength: float
    onset: float | None = None


@dataclass(frozen=True)
class Judgement:
    """Outcome of a run. alone: right without any alias. deviation: hidden parameter in reported sigmas, where
    the diagnosis reports it under its name. equation: the first of what remains, or else a cause, is at the
    place of what is hidden (its torque, its channel).
    """

    outcome: str
    alone: bool = False
    deviation: float | None = None
    equation: bool = False
    named: tuple[str, ...] = ()
    notes: tuple[str, ...] = field(default=())


Confirm = Callable[[Injected, str, str, str], bool]
"""Whether the experiment cannot tell what was hidden from a kind at a location with a shape."""


def judge(document: Mapping[str, Any], truth: Sequence[Injected], confirm: Confirm) -> Judgement:
    """Class a run. `document` is diagnosis.json; `confirm` is the test's own Fisher information."""
    verdict, causes = document["verdict"], list(document.get("causes", ()))
    named = tuple(f"{c['effect']}:{c.get('shape')}@{c['location']}" for c in causes)
    if verdict == "not_evaluated":
        return Judgement("not_evaluated", named=named)
    if not truth:
        quiet = verdict == "adequate" and not causes
        return Judgement("right" if quiet else "false_alarm", alone=quiet, named=named)
    equation = _equation(document, truth)
    if verdict == "adequate" and not causes:
        return Judgement("missed", named=named)
    if truth[0].effect.kind is None:
        return Judgement(_outside(verdict, causes, truth[0]), equation=equation, named=named)
    return _catalogued(verdict, causes, truth, confirm, equation, named)


def _equation(document: Mapping[str, Any], truth: Sequence[Injected]) -> bool:
    remaining = document.get("remaining", ())
    places = [remaining[0]["where"]] if remaining else [c["location"] for c in document.get("causes", ())]
    return any(_same_place(p.removeprefix("torque of "), i.effect) for p in places for i in truth)


def _outside(verdict: str, causes: Sequence[Mapping[str, Any]], truth: Injected) -> str:
    for cause in causes:
        if not _same_family(cause, truth.effect):
            return "wrong_family"
    if verdict == "unexplained":
        return "unexplained"
    return "right_family"


def _catalogued(
    verdict: str,
    causes: list[Mapping[str, Any]],
    truth: Sequence[Injected],
    confirm: Confirm,
    equation: bool,
    named: tuple[str, ...],
) -> Judgement:
    left, levels, notes, alone = list(causes), [], [], True
    deviation = None
    for injected in truth:
        level = None
        for cause in left:
            level, note = _match(cause, injected, confirm)
            notes += [note] if note else []
            if level is not None:
                alone = alone and level == "right" and not (cause.get("aliases") or cause.get("also_at"))
                deviation = _deviation(cause, injected) if level == "right" else None
                left.remove(cause)
                break
        levels.append(level)
    found = [x for x in levels if x in ("right", "right_by_alias")]
    foreign = [c for c in left if not any(_same_family(c, i.effect) for i in truth)]
    outcome = levels[0] or "missed"
    if len(found) == len(truth) and not left and verdict == "explained":
        outcome = "right" if set(found) == {"right"} else "right_by_alias"
    elif foreign:
        outcome = "extra" if len(found) == len(truth) else "wrong_family"
    elif verdict == "unexplained":
        outcome = "unexplained"
    elif len(found) == len(truth):
        outcome = "extra"
    elif len(truth) > 1 and any(levels):
        outcome = "partial"
    elif not any(levels):
        outcome = "right_family"
    else:
        outcome = next(x for x in levels if x)
    return Judgement(outcome, alone and outcome == "right", deviation, equation, named, tuple(notes))


def _match(cause: Mapping[str, Any], injected: Injected, confirm: Confirm) -> tuple[str | None, str]:
    """How well a cause names what was hidden: right, right_by_alias, right_family or None; with a note."""
    effect, aliases = injected.effect, list(cause.get("aliases", ()))
    few = len(aliases) <= ALIASES
    own_shape = cause.get("shape")
    if own_shape is None and not effect.shapes:
        named = any(p["name"].endswith(f".{effect.parameter}") for p in cause.get("parameters", ()))
    else:
        named = not effect.shapes or (own_shape or cause["fitted"]) in effect.shapes
    if _is(cause, effect) and named:
        return ("right", "") if few else ("right_family", f"{len(aliases)} aliases")
    told = {**cause, "shape": own_shape or cause["fitted"]}
    one = [{**x, "location": p} for x in (told, *aliases) for p in x.get("also_at", ())]  # base parameter
    for alias in (*aliases, *one):
        shape = alias.get("shape")
        if _is(alias, effect) and (shape is None or not effect.shapes or shape in effect.shapes):
            if few and confirm(injected, cause["effect"], cause["location"], own_shape or cause["fitted"]):
                return "right_by_alias", ""
            why = "alias not confirmed by the Fisher information" if few else f"{len(aliases)} aliases"
            return ("right_family" if _same_family(cause, effect) else None), why
    return ("right_family" if _same_family(cause, effect) else None), ""


def _is(entry: Mapping[str, Any], effect: Hidden) -> bool:
    kinds = (effect.kind, *effect.others)
    return entry["effect"] in kinds and _same_place(entry["location"], effect)


def _same_family(entry: Mapping[str, Any], effect: Hidden) -> bool:
    source = effect.location.split(".")[0] if "sensor" in effect.family else effect.location
    near = entry["location"].split(".")[0] == source
    return entry.get("family") in effect.family and (near or _same_place(entry["location"], effect))


def _same_place(location: str, effect: Hidden) -> bool:
    """Whether a location names the place: the same, one that means the same, or a component of it."""
    own = effect.location
    return location in (own, *effect.also) or location.startswith((f"{own}[", f"{own}.", f"{own} "))


def _deviation(cause: Mapping[str, Any], injected: Injected) -> float | None:
    if cause.get("shape") is not None and injected.effect.kind != cause["effect"]:
        return None
    for p in cause.get("parameters", ()):
        stated = p["name"].endswith(f".{injected.effect.parameter}") and p.get("nominal") is None
        if stated and p["unit"] == injected.effect.unit and p["sigma"]:
            off, ends = p["value"] - injected.value, p.get("profile")
            if ends is None:
                return float(off / p["sigma"])
            end = ends[0 if off > 0.0 else 1]  # none: open on that side, and nothing is outside there
            return 0.0 if end is None else float(1.96 * off / abs(p["value"] - end))
    return None
