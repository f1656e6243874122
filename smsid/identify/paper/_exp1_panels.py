"""Several panels that bend along one axis of Exp. 1: a density each where the data can tell, else a sum.

Panels that only translate with the bus and are alike bend alike, whatever each weighs: their inertia forces
are then one signal, and the thrust tells what the panels weigh together. Panels that differ in frequency or
damping bend differently once they ring, and the regression (27) has a column for each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from smsid.errors import NotIdentifiableError
from smsid.identify.estimate import IDENTIFIABLE_BELOW
from smsid.identify.paper._translation import AxisData, AxisEstimate, PanelForce, identify_axis
from smsid.identify.paper._translation_tied import identify_axis_tied

PREFIX, JOIN = "rho.", "+"
AS_PRINTED = "the tanks are not told apart: taken as printed, accelerometer biases not estimated"
ALIKE = 0.02  # of a signal: what two panels' forces may differ by and still count as one where needed
NOISY = 3.0  # times the noise: a difference below is not seen


@dataclass(frozen=True)
class PanelShares:
    """What a common factor of several panels is the mean of: ``weights`` (sum one) by panel name."""

    symbol: str
    weights: Mapping[str, float]


def symbol_of(names: Sequence[str]) -> str:
    """Return the symbol of the density that panels ``names`` share; ``rho`` without any."""
    return PREFIX + JOIN.join(names) if names else "rho"


def panels_of(symbol: str) -> tuple[str, ...]:
    """Return the panels a density's symbol is about; nothing for the only one's ``rho``."""
    return tuple(symbol.removeprefix(PREFIX).split(JOIN)) if symbol.startswith(PREFIX) else ()


def is_density(symbol: str) -> bool:
    """Return whether a symbol is that of a density: ``rho`` or of a panel by name."""
    return symbol == "rho" or symbol.startswith(PREFIX)


def identify_axis_of_panels(
    data: AxisData, tanks: int, marks: Sequence[str] | None = None
) -> tuple[AxisEstimate, tuple[PanelShares, ...]]:
    """Identify an axis as `identify_axis_tied` does, with a density for every panel that can be told apart.

    Two panels whose forces differ by less than noise are one from the start. Of the rest, those whose density
    comes out worse than `IDENTIFIABLE_BELOW`, or not at all, are joined with the panel that bends most alike,
    to 2 %; what bends otherwise keeps its own column and its wide interval. Several tanks that are not told
    apart are taken as printed, and noted. Returns the estimate and what its common factors are made of.

    Raises `NotIdentifiableError` as `identify_axis_tied`.
    """
    alone = {p.name: p for p in data.panels}
    groups: list[tuple[str, ...]] = [(name,) for name in alone]
    while (pair := _most_alike(data, alone, groups, by_noise=True)) is not None:
        groups = _join_groups(groups, pair)
    while True:
        joined = replace(data, panels=tuple(_sum(alone, g) for g in groups))
        try:
            found = identify_axis_tied(joined, tanks, marks)
        except NotIdentifiableError:
            pair = _most_alike(data, alone, groups)
            if pair is None:
                if tanks < 2:
                    raise
                # tanks that are alike do not settle, and leave the total mass as it is
                found = replace(identify_axis(joined, tanks, marks), note=AS_PRINTED)
                return found, _shares_of(alone, groups)
        else:
            poor = [g for g in groups if not _is_identified(found, _sum(alone, g).name)]
            pair = _most_alike(data, alone, groups, among=poor)
            if pair is None:
                return found, _shares_of(alone, groups)
        groups = _join_groups(groups, pair)


def _is_identified(found: AxisEstimate, name: str) -> bool:
    value, sigma = found[name]
    return bool(value > 0.0 and sigma < IDENTIFIABLE_BELOW * value)


def _most_alike(
    data: AxisData,
    alone: Mapping[str, PanelForce],
    groups: Sequence[tuple[str, ...]],
    *,
    by_noise: bool = False,
    among: Sequence[tuple[str, ...]] | None = None,
) -> tuple[int, int] | None:
    """Return the two groups whose forces differ least, if by less than `ALIKE` of themselves.

    ``by_noise``: by less than `NOISY` times the noise instead. ``among``: one of the two has to be in it.
    """
    gain, limit = _gain(data), NOISY if by_noise else ALIKE
    best: tuple[float, tuple[int, int]] | None = None
    for i in range(len(groups)):
        for j in range(i + 1, len(groups)):
            if among is not None and groups[i] not in among and groups[j] not in among:
                continue
            one, other = _sum(alone, groups[i]), _sum(alone, groups[j])
            size = float(one.force @ one.force)
            if size == 0.0:
                continue
            ratio = float(one.force @ other.force) / size
            left = float(np.std(other.force - ratio * one.force))
            scale = float(np.std(other.force))
            if by_noise:
                noise = [p.noise * float(np.linalg.norm(p.weights)) for p in (one, other)]
                shared = data.noise * abs(float(other.weights.sum() - ratio * one.weights.sum()))
                scale = gain * float(np.sqrt(noise[1] ** 2 + (ratio * noise[0]) ** 2 + shared**2))
            if ratio > 0.0 and left <= limit * scale and (best is None or left / scale < best[0]):
                best = left / scale, (i, j)
    return None if best is None else best[1]


def _gain(data: AxisData) -> float:
    """What the filter of the signals leaves of white noise's standard deviation."""
    if data.filtered is None:
        return 1.0
    unit = np.zeros(len(data.time))
    unit[len(unit) // 2] = 1.0
    return float(np.linalg.norm(data.filtered(unit)))


def _join_groups(groups: Sequence[tuple[str, ...]], pair: tuple[int, int]) -> list[tuple[str, ...]]:
    i, j = pair
    rest = [g for k, g in enumerate(groups) if k not in pair]
    return [*rest[:i], groups[i] + groups[j], *rest[i:]]


def _sum(alone: Mapping[str, PanelForce], group: tuple[str, ...]) -> PanelForce:
    """The force of several panels that share one factor; its noise level fits all their stations."""
    if len(group) == 1:
        return alone[group[0]]
    parts = [alone[name] for name in group]
    sizes = [float(np.linalg.norm(p.weights)) for p in parts]
    weights = np.concatenate([p.weights for p in parts])
    norm = float(np.linalg.norm(weights))
    return PanelForce(
        symbol_of([x for name in group for x in panels_of(name)]),
        sum((p.force for p in parts), start=np.zeros(len(parts[0].force))),
        weights,
        float(np.linalg.norm([p.noise * s for p, s in zip(parts, sizes, strict=True)])) / norm,
        float(np.linalg.norm([p.drift * s for p, s in zip(parts, sizes, strict=True)])) / norm,
        max(p.drift_time for p in parts),
        max(p.bias for p in parts),
    )


def _shares_of(alone: Mapping[str, PanelForce], groups: Sequence[tuple[str, ...]]) -> tuple[PanelShares, ...]:
    """Return what the factors that several panels share are the means of."""
    out = []
    for group in groups:
        if len(group) > 1:
            whole = _sum(alone, group)
            size = float(whole.force @ whole.force)
            parts = {panels_of(n)[0]: float(alone[n].force @ whole.force) / size for n in group}
            out.append(PanelShares(whole.name, parts))
    return tuple(out)
