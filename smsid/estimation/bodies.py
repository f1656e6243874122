"""Rigid bodies that agree with an estimate of combinations, and can exist.

An estimate knows combinations such as ``link2.mx + 2 link3.m`` with standard deviations; a URDF wants ten
numbers a body. Those handed out minimise the combinations' errors in units of their standard deviations plus
a weak pull towards the described bodies, over log-Cholesky coordinates: what the data say is met, what they
leave open stays as described, and every body is physical. How the mass of a combination is shared out among
its bodies is therefore the description's.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from smsid._short_repr import short_repr
from smsid.description import Description
from smsid.effects import Effect
from smsid.effects.appendage import Appendage, ModalAppendage
from smsid.effects.inertial_parameters import matrix_to_parameters, pseudo_inertia
from smsid.errors import DescriptionError
from smsid.identify.appendages import as_described
from smsid.identify.estimate import BY_PRODUCT_GROUPS, Estimate
from smsid.identify.momentum_rows import whole_bodies
from smsid.identify.parameter_estimate import parse_combination
from smsid.likelihood.pseudo_inertia import SIZE, factor, is_body, parameters_at
from smsid.model import SpacecraftModel
from smsid.model.regressor import Regressor
from smsid.model.rigid_bodies import urdf_bodies

GROUPS = ("maximum_likelihood", "exp2.step_b", "arm")
"""Groups of an estimate that hold inertial combinations linear in ordinary parameters."""

PULL_SIGMA = 1.0
"""Standard deviation of the pull towards the described body: a factor of e in size."""

ROUNDING = 5e-5
"""Combinations are named with factors of four digits."""

THINNEST = 1e-3
"""Smallest second moment a start may have, relative to the largest."""

_CENTRAL = re.compile(r"(?P<body>.+)\.(?:c(?P<axis>[xyz])|Ic(?P<i>[xyz])(?P<j>[xyz]))")


@short_repr
@dataclass(frozen=True)
class IdentifiedBodies:
    """Inertial parameters (10,) by joint, in the joint's frame, of what the URDFs hold.

    ``misfit`` is the root mean square error of the ``combinations`` that there were, by name, in standard
    deviations, ``notes`` say what was left as it was. ``directions`` (k, 10 bodies) are by how much the
    parameters of all bodies of the model, ordered as `Regressor.names`, move for one standard deviation of
    each combination.
    """

    parameters: dict[str, np.ndarray]
    misfit: float
    combinations: tuple[str, ...]
    notes: tuple[str, ...]
    directions: np.ndarray


def linear_terms(estimate: Estimate, described: np.ndarray) -> dict[str, tuple[dict[str, float], float]]:
    """Return the factors of ordinary parameters, and the value, of every combination of an estimate, by name.

    Of a centre of mass and the inertia about it those are the first derivatives at the estimated centre, or
    at that of ``described`` (10,), the bus, where it is not told. In mass, first moments and inertia, the one
    about the centre is homogeneous of first degree, the centre of degree zero: values are its own, and zero.
    """
    out = {}
    for p in estimate.parameters:
        terms, value, central = parse_combination(p.name), p.value, _CENTRAL.fullmatch(p.name)
        if central is not None:
            body, axis = central["body"], central["axis"]
            names = [f"{body}.m", *(f"{body}.c{a}" for a in "xyz")]
            guess = [described[0], *(described[1:4] / described[0])]
            known = [estimate[n].value if n in estimate else x for n, x in zip(names, guess, strict=True)]
            mass, c = known[0], np.array(known[1:])
            if axis:
                terms, value = {f"{body}.m{axis}": 1.0 / mass, f"{body}.m": -c["xyz".index(axis)] / mass}, 0.0
            else:
                i, j = ("xyz".index(central[k]) for k in "ij")
                own = np.eye(3)
                slope = own[i] * c[j] + own[j] * c[i] - 2.0 * c * (i == j)
                terms = {f"{body}.I{central['i']}{central['j']}": 1.0}
                terms[f"{body}.m"] = float((c @ c) * (i == j) - c[i] * c[j])
                terms |= {f"{body}.m{a}": float(x) for a, x in zip("xyz", slope, strict=True)}
        if terms is not None:
            out[p.name] = terms, value
    return out


def identified_bodies(model: SpacecraftModel, estimate: Estimate) -> IdentifiedBodies:
    """Return bodies that agree with an estimate.

    Args:
        model: built from the description whose effects are at the estimate's values.
        estimate: of the same description.

    Raises:
        DescriptionError: the estimate has no inertial combination of this model, or the search fails.
    """
    own = urdf_bodies(model.description)
    joints = {name: k for k, name in enumerate(list(model.pin.names)[1:])}
    free = {name: theta for name, theta in own.items() if theta[0] > 0.0 and name in joints}  # none held
    starts = {name: factor(_with_extent(theta)) for name, theta in free.items()}
    notes = [f"'{n}' has no mass in the URDF and none in the export" for n in own if not own[n][0] > 0.0]
    rows, target, sigma, told = inertial_equations(model, estimate)
    of_effects = {p.name for e in model.description.effect for p in e.parameters()}
    if not len(target) and all(p.name in of_effects for p in estimate.parameters):
        notes.append("no body was estimated: they stay as described")
        return IdentifiedBodies(own, 0.0, (), tuple(notes), rows)
    if not len(target):
        raise DescriptionError(
            f"The estimate '{estimate.description}' has no inertial combination of "
            f"'{model.description.name}'.",
            advice="Is it of another description, or of Exp. 1 alone? Then export the description by itself.",
        )
    # rows act on all bodies of the model; of these, what the URDFs hold can move
    columns = {n: rows[:, SIZE * joints[n] : SIZE * (joints[n] + 1)] / sigma[:, None] for n in free}
    fixed = np.asarray(target, dtype=float) / sigma
    names = list(free)
    across = np.hstack([columns[n] for n in names])
    described = np.concatenate([free[n] for n in names])

    def bodies(phi: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
        return [parameters_at(starts[n], phi[SIZE * k : SIZE * (k + 1)]) for k, n in enumerate(names)]

    def errors(phi: np.ndarray) -> np.ndarray:
        change = np.concatenate([theta for theta, _ in bodies(phi)]) - described
        return np.concatenate([across @ change - fixed, phi / PULL_SIGMA])

    def slopes(phi: np.ndarray) -> np.ndarray:
        of_rows = [columns[n] @ slope for n, (_, slope) in zip(names, bodies(phi), strict=True)]
        return np.vstack([np.hstack(of_rows), np.eye(len(phi)) / PULL_SIGMA])

    result = least_squares(errors, np.zeros(SIZE * len(names)), jac=slopes, max_nfev=200)  # type: ignore[arg-type]
    if not result.success:
        raise DescriptionError(
            f"No physical bodies were found that agree with the estimate: {result.message}.",
            advice="Start from a description nearer to the estimate.",
        )
    ends = dict(zip(names, bodies(result.x), strict=True))
    misfit = float(np.sqrt(np.mean(errors(result.x)[: len(fixed)] ** 2)))
    moved = np.linalg.solve(result.jac.T @ result.jac, result.jac[: len(fixed)].T)  # for a sigma of each
    directions = np.zeros_like(rows)
    for k, (n, (_, slope)) in enumerate(ends.items()):
        own_columns = slice(SIZE * joints[n], SIZE * (joints[n] + 1))
        directions[:, own_columns] = moved[SIZE * k : SIZE * (k + 1)].T @ slope.T
    found = {n: theta for n, (theta, _) in ends.items()}
    return IdentifiedBodies({**own, **found}, misfit, told, tuple(notes), directions)


def inertial_equations(
    model: SpacecraftModel, estimate: Estimate
) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return what an estimate says of bodies: rows on all of the model's (n, 10 bodies), what they are to
    change by (n,), standard deviations (n,), and names.
    """
    regressor = Regressor(model)
    place = {name: k for k, name in enumerate(regressor.names)}
    theta = regressor.parameters
    whole = whole_bodies(model)
    effects = {p.name: p.value for e in model.description.effect for p in e.parameters()}
    rows: list[np.ndarray] = []
    target: list[float] = []
    sigma: list[float] = []
    names: list[str] = []
    known = linear_terms(estimate, whole[:10])
    for p in estimate.parameters:
        if not (np.isfinite(p.value) and np.isfinite(p.sigma) and p.sigma > 0.0):
            continue
        told = p.name in known and p.group not in BY_PRODUCT_GROUPS
        terms, value = known[p.name] if told else (None, p.value)
        values = whole
        if p.name == "total.mass":
            terms, values = {f"{body}.m": 1.0 for body in regressor.bodies}, theta
        if not terms or not any(n in place for n in terms) or any(n not in place | effects for n in terms):
            continue
        row = np.zeros(len(theta))
        for name, size in terms.items():
            if name in place:
                row[place[name]] = size
        beyond = sum(size * effects[n] for n, size in terms.items() if n not in place)
        scale = np.abs(row) @ np.abs(values)
        rows.append(row)
        names.append(p.name)
        target.append(value - float(row @ values) - beyond)
        sigma.append(float(np.hypot(p.sigma, ROUNDING * scale if len(terms) > 1 else 0.0)))
    return np.array(rows).reshape(-1, len(theta)), np.array(target), np.array(sigma), tuple(names)


def _with_extent(theta: np.ndarray) -> np.ndarray:
    """Return the nearest body with extent in three directions: a start for one that cannot exist."""
    if is_body(theta):
        return theta
    centre = theta[1:4] / theta[0]
    second = pseudo_inertia(theta)[:3, :3] - theta[0] * np.outer(centre, centre)
    size, vectors = np.linalg.eigh(second)
    floor = max(THINNEST * float(size[-1]), theta[0] * 1e-4)  # a centimetre
    second = vectors * np.maximum(size, floor) @ vectors.T + theta[0] * np.outer(centre, centre)
    return np.concatenate([theta[:4], matrix_to_parameters(np.trace(second) * np.eye(3) - second)])


def with_estimate(description: Description, estimate: Estimate) -> tuple[Description, list[str]]:
    """Return the description with its effects at the estimate's values, and notes on what was not taken.

    With them go the rates its friction is not linear in, as found (``smoothing``).
    A parameter that is not identifiable keeps the described value unless its 95 % interval excludes that; one
    beyond a bound goes to the bound.
    Appendages become modal ones with the identified density, frequencies and damping, but for a beam that an
    effect needs as such (`smsid.identify.appendages`).

    Raises:
        DescriptionError: a value an effect cannot have.
    """
    effects: list[Effect] = []
    panels: list[ModalAppendage] = []
    notes: list[str] = []
    for effect in description.effect:
        appendage = effect.as_appendage()
        if appendage is not None:
            panel = _appendage(description, appendage, estimate, notes)
            panels += [panel] if panel is not None else []
            continue
        own = {}
        for p in effect.parameters():
            value = _value_to_take(p.name, p.value, estimate, notes)
            if value is None:
                continue
            own[p.name] = float(np.clip(value, p.lower, p.upper))
            if own[p.name] != value:
                notes.append(f"{p.name} = {value:.4g} {p.unit} is beyond its bound: {own[p.name]:g}")
        effect = effect.with_values(own) if own else effect
        shaped = {f: estimate.shapes.get(f"{effect.name}.{f}") for f in effect.torque_shapes()}
        effects.append(effect.model_copy(update={f: x for f, x in shaped.items() if x is not None}))
    return as_described(description.with_effects(*effects), panels), notes


def left_note(name: str) -> str:
    """Return what is said of a parameter that an estimate does not tell."""
    return f"{name} is not identifiable and stays as described"


def _value_to_take(name: str, described: float, estimate: Estimate, notes: list[str]) -> float | None:
    if name not in estimate:
        return None
    found = estimate[name]
    low, high = found.interval
    # written so that what is not finite counts as within
    if found.status == "not_identifiable" and not (described < low or described > high):
        notes.append(left_note(name))
        return None
    return found.value


def _appendage(
    description: Description, effect: Appendage, estimate: Estimate, notes: list[str]
) -> ModalAppendage | None:
    """Return an appendage as identified, with all its modes; ``None`` where nothing was."""
    factor = _value_to_take(f"{effect.name}.participation_factor", 1.0, estimate, notes)
    heavy = effect.mass_parameter()
    density = None if heavy.unit == "1" else _value_to_take(heavy.name, heavy.value, estimate, notes)
    factor = factor if density is None else density / heavy.value
    modes = {}
    described = effect.described_modes(description.effect)
    for k, mode in enumerate(described, start=1):
        for field in ("frequency", "damping"):
            name = f"{effect.name}.mode{k}.{field}"
            value = _value_to_take(name, getattr(mode, field), estimate, notes)
            if value is not None:
                modes[name] = max(value, 0.0)
    if factor is None and not modes:
        return None
    return effect.as_modal(1.0 if factor is None else factor, described).with_values(modes)
