"""Densities of panels as Exp. 1 tells them: of each, of sums of panels that bend alike; contradictions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from smsid.effects.appendage import Appendage
from smsid.identify.estimate import ParameterEstimate, classify
from smsid.identify.paper.combined import Combined
from smsid.identify.paper.exp1_panels import PanelShares, is_density, panels_of
from smsid.model.spacecraft import SpacecraftModel

Density = tuple[str, str, float]  # the parameter's name, unit and described value


def densities(
    model: SpacecraftModel, found: Combined, shares: Sequence[PanelShares], notes: list[str]
) -> list[ParameterEstimate]:
    """Return the densities of the appendages, and combinations of those that are not told apart.

    What comes out negative is noted in ``notes`` and stays as described.
    """
    of = {j.appendage.name: _density_of(j.appendage) for j in model.appendages}
    weights = {s.symbol: s.weights for s in shares}
    symbols = [s for s in found.names if is_density(s)]
    alone = {panels_of(s)[0] for s in symbols if len(panels_of(s)) == 1}
    out: list[ParameterEstimate] = []
    for symbol in symbols:
        factor, sigma = found[symbol]
        panels = panels_of(symbol) or tuple(of)
        if factor <= 0.0:
            notes.append(f"the density of {' + '.join(panels)} comes out negative: it stays as described")
        if len(panels) == 1:
            key, unit, nominal = of[panels[0]]
            out.append(
                refuse_nonpositive(
                    classify(key, factor * nominal, unit, sigma * nominal, "exp1", nominal=nominal)
                )
            )
            continue
        # a regression as printed has one factor for all, and does not say in which shares
        share = weights.get(symbol) or {p: 1.0 / len(panels) for p in panels}
        name, unit, size = combination({p: of[p] for p in panels}, share)
        out.append(
            refuse_nonpositive(classify(name, factor * size, unit, sigma * size, "exp1", nominal=size))
        )
        others = ", ".join(panels)
        for panel in panels:
            if panel not in alone:
                key, unit, nominal = of[panel]
                note = f"{others} bend alike: told only together, as '{name}'"
                value = factor * nominal
                one = classify(key, value, unit, math.inf, "exp1", nominal=nominal, note=note)
                out.append(refuse_nonpositive(one))
    return out


def _density_of(appendage: Appendage) -> Density:
    p = appendage.mass_parameter()
    return p.name, p.unit, p.value


def combination(densities: Mapping[str, Density], weights: Mapping[str, float]) -> Density:
    """Return name, unit and described value of the combination that a common factor measures.

    The factor is the mean of each panel's own with ``weights`` (sum one); in the panels' unit, the largest
    coefficient being one, or without unit where they differ in it.
    """
    units = {unit for _, unit, _ in densities.values()}
    coefficients = {p: weights[p] / nominal for p, (_, _, nominal) in densities.items()}
    largest = max(abs(c) for c in coefficients.values()) if len(units) == 1 else 1.0
    terms = []
    for panel, (key, _, _) in densities.items():
        c = coefficients[panel] / largest
        terms.append(key if abs(c - 1.0) < 5e-4 else f"{c:.3g} {key}")
    size = sum(coefficients[p] / largest * densities[p][2] for p in densities)
    return " + ".join(terms), units.pop() if len(units) == 1 else "1", size


def mark_contradictions(
    parameters: Sequence[ParameterEstimate], found: Combined, symbols: Mapping[str, str], notes: list[str]
) -> list[ParameterEstimate]:
    """Return the parameters, none identifiable in which axes contradict each other; ``notes`` say how.

    ``symbols``: the description's name of a symbol.
    """
    why: dict[str, str] = {}
    for name, test in found.contradictions.items():
        notes.append(str(test))
        panels = panels_of(name)
        if name == "M":
            keys = ["total.mass"]
        elif is_density(name):
            keys = [p.name for p in parameters if _about(p.name, panels)]
        else:
            keys = [symbols[name]] if name in symbols else []
        why |= dict.fromkeys(keys, str(test))
    return [
        replace(p, status="not_identifiable", note=why[p.name])
        if p.name in why and p.status == "identifiable"
        else p
        for p in parameters
    ]


def refuse_nonpositive(parameter: ParameterEstimate) -> ParameterEstimate:
    """Return it, not identifiable where its value is one that nothing can have, however small its sigma."""
    if parameter.value > 0.0:
        return parameter
    return replace(parameter, status="not_identifiable", note="not above zero, which is impossible: refused")


def _about(name: str, panels: Sequence[str]) -> bool:
    """Whether a parameter is the density of these panels: all of them, and no other."""
    ends = (".linear_density", ".participation_factor")
    own = [t.split(" ")[-1] for t in name.split(" + ") if t.endswith(ends)]
    return bool(own) and (not panels or {t.rsplit(".", 1)[0] for t in own} == set(panels))
