"""What Exp. 1 found, as parameters of the description."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from smsid._short_repr import short_repr
from smsid.effects.appendage import Appendage, Mode
from smsid.effects.assembly import AppendageJoints
from smsid.effects.slosh import Slosh
from smsid.identify.appendage_modes import PanelModes
from smsid.identify.estimate import ParameterEstimate, classify
from smsid.identify.modes import match_modes
from smsid.identify.paper._exp1_panels import PanelShares, is_density, panels_of
from smsid.identify.paper._translation import AxisEstimate
from smsid.identify.paper.combined import CombinedAxes, combine
from smsid.identify.paper.noise_replicates import ModeSigma
from smsid.model.spacecraft import SpacecraftModel

LEAST_MASS = 1e-3  # [kg]
LEAST_FACTOR = 1e-3
MERGED = "tanks not told apart: one estimate may stand for several"


@dataclass(frozen=True)
class SeenModes:
    """Modes of an appendage and the standard deviations that sensor noise gives them, in the same order."""

    modes: PanelModes
    clamped_sigma: tuple[ModeSigma, ...]
    coupled_sigma: tuple[ModeSigma, ...]


@short_repr
@dataclass(frozen=True)
class TranslationResult:
    """What Exp. 1 identified.

    ``combined``: parameters by symbol with their joint covariance; ``symbols``: the description's parameter
    name of a symbol (``tank.mass`` of ``m_s`` and so on); ``modes`` by appendage; ``panels``: the appendages
    as described.
    """

    axes: tuple[AxisEstimate, ...]
    combined: CombinedAxes
    symbols: dict[str, str]
    modes: dict[str, SeenModes]
    parameters: tuple[ParameterEstimate, ...]
    notes: tuple[str, ...] = ()
    conditions: dict[str, float] = field(default_factory=dict)
    panels: dict[str, Appendage] = field(default_factory=dict)

    @property
    def believed(self) -> bool:
        """Whether any axis gives a total mass to go on from."""
        return "M" in self.combined

    @property
    def mass(self) -> float:
        """Total mass M [kg], where the result is `believed`."""
        return self.combined["M"][0]

    def values(self, change: Mapping[str, float] | None = None) -> dict[str, float]:
        """Return values by the description's names, with a change by symbol added, kept physical.

        Damping and stiffness are not below zero, masses not below a gram.
        """
        out = {}
        for symbol, name in self.symbols.items():
            value = self.combined[symbol][0] + (change or {}).get(symbol, 0.0)
            out[name] = max(value, LEAST_MASS if name.endswith(".mass") else 0.0)
        return out

    def density_symbol(self, panel: str) -> str | None:
        """Return the symbol of what tells a panel's density: its own, or one it shares; None without."""
        about = [s for s in self.combined.names if is_density(s) and panel in (panels_of(s) or (panel,))]
        return min(about, key=lambda s: len(panels_of(s)), default=None)

    def density_factor(self, panel: str, change: Mapping[str, float] | None = None) -> float:
        """Return a panel's rho relative to the description's, 1 if it was not identified or is not physical.

        ``panel``: its name; ``change``: added, by symbol.
        """
        symbol = self.density_symbol(panel)
        if symbol is None or self.combined[symbol][0] <= 0.0:
            return 1.0
        return max(self.combined[symbol][0] + (change or {}).get(symbol, 0.0), LEAST_FACTOR)


def tank_marks(tanks: Sequence[Slosh]) -> list[str]:
    """Return what tells tanks apart in symbols, in the description's order: nothing for one, 1, 2, ..."""
    return [""] if len(tanks) == 1 else [str(i + 1) for i in range(len(tanks))]


def assemble(
    model: SpacecraftModel,
    axes: list[AxisEstimate],
    modes: dict[str, SeenModes],
    notes: list[str],
    shares: tuple[PanelShares, ...] = (),
) -> TranslationResult:
    """Bring axes and modes together as parameters of the description; what stays as described is noted.

    ``shares``: what common factors of several panels are made of.
    """
    notes = list(notes)
    found = combine(axes)
    parameters: list[ParameterEstimate] = []
    if "M" in found:
        value, sigma = found["M"]
        parameters.append(classify("total.mass", value, "kg", sigma, "exp1", nominal=model.mass))
    symbols: dict[str, str] = {}  # the description's parameter name of each symbol
    tanks = [s.tank for s in model.slosh] if axes else []
    marks = tank_marks(tanks)
    merged = len(tanks) > 1 and any(_is_lost(found, mark) for mark in marks)
    if merged:
        notes.append("the tanks cannot be told apart (one has no mass to speak of): they stay as described")
    for tank, mark in zip(tanks, marks, strict=True):
        own = _tank(tank, mark, found, symbols, notes)
        parameters += [replace(p, status="not_identifiable", note=MERGED) for p in own] if merged else own
    if merged:
        symbols.clear()
    parameters += densities(model, found, shares, notes)
    parameters = mark_contradictions(parameters, found, symbols, notes)
    appendages = {j.appendage.name: j.appendage for j in model.appendages}
    for name, seen in modes.items():
        described = appendages[name].modal_data()
        matched = match_modes(seen.modes.clamped, described)
        missing = [str(k + 1) for k in range(len(described)) if k not in matched]
        if missing:
            notes.append(
                f"{name}: {len(matched)} of {len(described)} described modes found; mode "
                f"{', '.join(missing)} stays as described. {seen.modes.status}"
            )
        parameters += _mode_parameters(name, seen, described)
    return TranslationResult(
        axes=tuple(axes),
        combined=found,
        symbols=symbols,
        modes=modes,
        parameters=tuple(parameters),
        notes=tuple(notes),
        conditions={f"Exp. 1, axis {e.axis}": e.condition for e in axes},
        panels=appendages,
    )


def _is_lost(found: CombinedAxes, mark: str) -> bool:
    """Whether a tank's mass is not different from zero."""
    if f"m_s{mark}" not in found:
        return True
    value, sigma = found[f"m_s{mark}"]
    return not value > 2.0 * sigma


def _tank(
    tank: Slosh, mark: str, found: CombinedAxes, symbols: dict[str, str], notes: list[str]
) -> list[ParameterEstimate]:
    if f"m_s{mark}" not in found:
        notes.append(f"{tank.name}: no axis separates it from the other tanks; it stays as described")
        return []
    value, sigma = found[f"m_s{mark}"]
    key = f"{tank.name}.mass"
    parameters = [refuse_nonpositive(classify(key, value, "kg", sigma, "exp1", nominal=tank.mass))]
    if value <= 0.0:
        notes.append(f"{key} comes out as {value:.3g} kg, which no tank has: it stays as described")
    else:
        symbols[f"m_s{mark}"] = key
    for k, axis in enumerate("xyz"):
        for symbol, field_name, unit in (("k_s", "stiffness", "N/m"), ("b_s", "damping", "N s/m")):
            name = f"{symbol}{mark}.{axis}"
            if name not in found:
                continue
            value, sigma = found[name]
            key = f"{tank.name}.{field_name}.{axis}"
            nominal = getattr(tank, field_name)[k]
            found_one = classify(key, value, unit, sigma, "exp1", nominal=nominal)
            parameters.append(refuse_nonpositive(found_one) if field_name == "stiffness" else found_one)
            if field_name == "stiffness" and value <= 0.0:
                notes.append(f"{key} comes out as {value:.3g} N/m: it stays as described")
            elif f"m_s{mark}" in symbols:
                symbols[name] = key
    return parameters


def participation_along(joints: AppendageJoints, axis: int) -> np.ndarray:
    """Return the translational participation of the modes along a bus axis, (modes,) [kg^.5]."""
    rotation = joints.placement.rotation
    return np.array([(rotation @ np.asarray(m.translation))[axis] for m in joints.appendage.modal_data()])


def participates(joints: AppendageJoints, axis: int) -> bool:
    """Return whether translation along a bus axis bends the appendage."""
    size = [np.abs(participation_along(joints, k)).max(initial=0.0) for k in range(3)]
    return bool(size[axis] > 1e-6 * max(size))


def _mode_parameters(name: str, seen: SeenModes, described: tuple[Mode, ...]) -> list[ParameterEstimate]:
    """Frequencies and damping; their variance adds sensor noise and the spread over model orders."""
    out = []
    numbers = {j: k + 1 for k, j in match_modes(seen.modes.clamped, described).items()}
    for j, number in sorted(numbers.items(), key=lambda pair: pair[1]):
        mode, noise, nominal = seen.modes.clamped[j], seen.clamped_sigma[j], described[number - 1]
        for what, unit, spread in (
            ("frequency", "Hz", np.hypot(mode.frequency_order_spread, noise.frequency)),
            ("damping", "1", np.hypot(mode.damping_order_spread, noise.damping)),
        ):
            key, value = f"{name}.mode{number}.{what}", float(getattr(mode, what))
            was = float(getattr(nominal, what))
            out.append(classify(key, value, unit, float(spread), "modes", nominal=was))
    partners = {i: numbers[j] for j, i in seen.modes.partners().items() if j in numbers}
    others = 0
    for i, (mode, noise) in enumerate(zip(seen.modes.coupled, seen.coupled_sigma, strict=True)):
        if i in partners:
            key, note = f"coupled{partners[i]}", "coupled to the spacecraft"
        else:
            others += 1
            key, note = f"seen{others}", "seen on the panel, no bending mode of it: slosh, or control"
        spread = float(np.hypot(mode.frequency_order_spread, noise.frequency))
        out.append(
            ParameterEstimate(
                f"{name}.{key}.frequency", mode.frequency, "Hz", spread, "by_product", "modes", note=note
            )
        )
    return out


Density = tuple[str, str, float]  # the parameter's name, unit and described value


def densities(
    model: SpacecraftModel, found: CombinedAxes, shares: Sequence[PanelShares], notes: list[str]
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
    parameters: Sequence[ParameterEstimate], found: CombinedAxes, symbols: Mapping[str, str], notes: list[str]
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
