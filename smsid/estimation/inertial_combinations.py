"""Which combinations of inertial parameters the data tell apart, by name, and everything else reported.

Reported are the parameters of effects, the total mass, and base parameters of the rigid bodies: those of
bodies in the order from the bus to the tips, each with what cannot be told from it lumped in, as textbooks
do (Gautier, J. Robotic Systems 8 (1991) 485) - but by the information in the recordings at hand, not by the
structure alone: a direction of which they say less than is known beforehand is not told. "bus" includes its
wheels and undeformed appendages. Where nothing tells the bus's mass or centre of mass, what is told of the
centre is reported (``bus.cx``) and the inertia about it (``bus.Icxx``): in mass, first moments and inertia
about the origin both are products of what is not known.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.linalg import qr

from smsid.estimation._normal_equations import NormalEquations
from smsid.estimation.parameter_vector import Point, Unknown
from smsid.identify.momentum_rows import whole_bodies
from smsid.identify.paper.exp2_result import kind_of
from smsid.likelihood.combinations import Combination
from smsid.model.regressor import body_names

ELEMENTS = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))  # of inertias, as inertial parameters have them
AS_WELL = 2.0  # times a combination's standard deviation that may be that of what stands for it
STEP = 1e-4  # of a parameter's scale, for derivatives of inertias
NEGLIGIBLE = 0.05  # share of a combination's standard deviation that a term may bring and is left out below
SMALLEST = 1e-6  # of its prior's standard deviation, an amplitude below which an angle is none
ROUND = 1e-6  # a factor this near to 1 is 1
DIGITS, MOST_DIGITS = 4, 12  # of a factor in a name: as few as its effect on the value allows
TIPS = 0.1  # preference for lumping what is nearer to the tips
ARM_TIPS = 1e6  # times that the first part may be the last's, and the last is lumped, of a welded arm
CENTRE_FIRST = 3.0  # preference for lumping a lone bus's mass and first moments rather than its inertias
ROUND_OFF = 1e-14  # of the largest inertia, below which a described product of inertia is zero


def reported_parameters(found: NormalEquations, described: Point) -> list[Combination]:
    """Return what is reported at a point, apart from the biases of single recordings."""
    unknowns = found.unknowns
    weighed = described.base.free and any(u.kind == "inertial" for u in unknowns)
    out = [_total_mass(found, described)] if weighed else []
    for i, u in enumerate(unknowns):
        if u.kind == "effect" and u.polar is not None:
            out.append(_polar(found, i, described))
        elif u.kind == "effect":
            row = np.zeros(len(unknowns))
            row[i] = u.scale
            size = abs(u.nominal) or u.sigma
            reference = size if abs(found.point.value(u)) < 0.1 * size else None
            out.append(Combination(u.name, u.unit, found.point.value(u), row, u.nominal, reference))
    return out + _base_parameters(found, described)


def terms_of_total(rows: Sequence[Combination]) -> tuple[str, ...]:
    """Return the names of ``rows`` whose sum the total mass is; none where other masses are not reported."""
    total = next((r for r in rows if r.name == "total.mass"), None)
    masses = [r for r in rows if r.unit == "kg" and r is not total]
    if total is None or not masses:
        return ()
    matrix = np.array([r.gradient for r in masses]).T
    share = np.round(np.linalg.lstsq(matrix, total.gradient, rcond=None)[0])
    left = np.abs(matrix @ share - total.gradient).max()
    if left > ROUND * np.abs(total.gradient).max() or not np.isin(share, (0.0, 1.0)).all():
        return ()
    return tuple(r.name for r, one in zip(masses, share, strict=True) if one)


def _polar(found: NormalEquations, i: int, described: Point) -> Combination:
    """Return the amplitude or the angle that an unknown is a component of."""
    u = found.unknowns[i]
    assert u.polar is not None
    places = {v.name: k for k, v in enumerate(found.unknowns) if v.polar == u.polar}
    parts = {n: found.point.value(found.unknowns[k]) for n, k in places.items()}
    size = max(float(np.linalg.norm(list(parts.values()))), SMALLEST * u.sigma)
    along, across = parts[u.polar.amplitude] / size, parts[u.polar.angle] / size
    amplitude = u.name == u.polar.amplitude
    row = np.zeros(len(found.unknowns))
    row[places[u.polar.amplitude]] = along if amplitude else -across / size
    row[places[u.polar.angle]] = across if amplitude else along / size
    values, before = (
        {p.name: p for e in x.description.effect for p in e.parameters()} for x in (found.point, described)
    )
    own = values[u.name]
    reference = float(np.pi) if not amplitude else None
    return Combination(u.name, own.unit, own.value, row * found.scales, before[u.name].value, reference)


def _by_effects(found: NormalEquations) -> tuple[np.ndarray, np.ndarray]:
    """Return how the bodies' parameters (10 bodies, m) and the total mass (m,) change with the effects' ones.

    Per scale of the unknowns; the columns of others are zero.
    """
    point, unknowns = found.point, found.unknowns
    base = point.model()
    whole, mass = np.zeros((10 * (base.pin.njoints - 1), len(unknowns))), np.zeros(len(unknowns))
    for i, u in enumerate(unknowns):
        if u.kind != "effect":
            continue
        step = np.zeros(len(unknowns))
        step[i] = STEP * u.scale
        ends = [point.moved(unknowns, s) for s in (step, -step)]
        apart = ends[0].value(u) - ends[1].value(u)
        if apart == 0.0:
            continue
        models = [end.model() for end in ends]
        if models[0].nv != models[1].nv:
            continue
        whole[:, i] = (whole_bodies(models[0]) - whole_bodies(models[1])) / apart * u.scale
        mass[i] = (models[0].mass - models[1].mass) / apart * u.scale
    return whole, mass


def _total_mass(found: NormalEquations, described: Point) -> Combination:
    _, row = _by_effects(found)
    for i, u in enumerate(found.unknowns):
        if u.kind == "inertial" and u.name.endswith(".m"):
            row[i] = u.scale
    return Combination("total.mass", "kg", found.point.model().mass, row, described.model().mass)


def _base_parameters(found: NormalEquations, described: Point) -> list[Combination]:
    unknowns = found.unknowns
    own = [i for i, u in enumerate(unknowns) if u.kind == "inertial"]
    if not own:
        return []
    rest = [i for i in range(len(unknowns)) if i not in own]
    columns = [unknowns[i].column for i in own]
    moved, _ = _by_effects(found)
    # in terms of whole bodies: what is a body's and what an appendage's on it, the appendage tells
    change = np.eye(len(unknowns))
    scale = found.scales[own]
    change[np.ix_(own, rest)] = -moved[np.ix_(columns, rest)] / scale[:, None]
    information = change.T @ found.information @ change
    prior = np.diag((found.scales / np.array([u.sigma for u in unknowns])) ** 2)
    inside = information[np.ix_(own, own)]
    if rest:
        others = information[np.ix_(rest, rest)] + prior[np.ix_(rest, rest)]
        cross = information[np.ix_(own, rest)]
        inside = inside - cross @ np.linalg.solve(others, cross.T)
    width = np.array([unknowns[i].sigma for i in own])
    alone = described.base.free and max(columns) < 10
    before = [k for k, c in enumerate(columns) if alone and c < 4]
    units = None if described.base.free else width
    matrix, kept = combinations(inside * np.outer(width / scale, width / scale), before, units)
    matrix = matrix * width[kept][:, None] / width[None, :]  # from units of the prior to physical ones
    covariance = np.linalg.inv(found.gram)
    values, nominal = whole_bodies(found.point.model())[columns], whole_bodies(described.model())[columns]
    rows = []
    for factors, k in zip(matrix, kept, strict=True):
        rows.append(_combination(factors, int(k), unknowns, own, moved[columns], covariance, width))
    sizes: dict[tuple[str, str], float] = {}
    for factors, _ in rows:
        lead = unknowns[own[int(np.flatnonzero(factors == 1.0)[0])]].name
        sizes[kind_of(lead)] = max(sizes.get(kind_of(lead), 0.0), abs(float(factors @ values)))
    central = _central(found, described, rows, kept, own, moved, covariance)
    out = []
    for (factors, gradient), k in zip(rows, kept, strict=True):
        if int(k) in central:
            out.append(central[int(k)])
            continue
        value, size = float(factors @ values), sizes[kind_of(unknowns[own[k]].name)]
        name = combination_name(factors, int(k), [unknowns[i].name for i in own])
        reference = size if abs(value) < 0.1 * size else None
        unit = unknowns[own[k]].unit
        out.append(Combination(name, unit, value, gradient, float(factors @ nominal), reference))
    return out


def _central(
    found: NormalEquations,
    described: Point,
    rows: Sequence[tuple[np.ndarray, np.ndarray]],
    kept: np.ndarray,
    own: Sequence[int],
    moved: np.ndarray,
    covariance: np.ndarray,
) -> dict[int, Combination]:
    """Return what stands for combinations of the bus's own parameters, by the parameter those lead with.

    That is the centre of mass and the inertia about it, where mass or first moments are not all told: factors
    of a combination go by the centre's estimate, whose error times that of a mass which nothing tells may be
    more than the combination's standard deviation. Left out is what is not told about as well.
    """
    unknowns = [found.unknowns[i] for i in own]
    bus = [k for k, u in enumerate(unknowns) if u.column < 10]
    if not described.base.free or {unknowns[k].column for k in bus} != set(range(10)):
        return {}
    place = {unknowns[k].column: k for k in bus}
    if set(kept) >= {place[c] for c in range(4)}:
        return {}
    theta, before = (whole_bodies(x.model())[:10] for x in (found.point, described))
    slopes = moved[[place[c] for c in range(10)]].copy()
    for c, k in place.items():
        slopes[c, own[k]] += unknowns[k].scale
    steps = STEP * np.diag([abs(theta[0]), *3 * [abs(theta[0])], *6 * [1.0]])
    by_theta = np.array([about_centre(theta + s) - about_centre(theta - s) for s in steps]).T
    gradients = by_theta / (2.0 * np.diag(steps)) @ slopes
    values, nominal = about_centre(theta), about_centre(before)
    nominal[np.abs(nominal) < ROUND_OFF * np.abs(nominal[3:]).max()] = 0.0
    body, size = body_names(described.base.pin)[0], float(np.abs(values[3:]).max())
    out = {}
    for (_, combined), k in zip(rows, kept.tolist(), strict=True):
        u = unknowns[k]
        if not 0 < u.column < 10:
            continue
        i, moment = u.column - 1, u.column < 4
        row, scale = gradients[i], theta[0] if moment else 1.0
        if scale**2 * (row @ covariance @ row) > AS_WELL**2 * (combined @ covariance @ combined):
            continue
        symbol = u.name.rsplit(".", 1)[1]
        name, unit = (f"c{symbol[1:]}", "m") if moment else (f"Ic{symbol[1:]}", u.unit)
        reference = size if not moment and abs(values[i]) < 0.1 * size else None
        found_ = float(values[i]), row, float(nominal[i])
        out[k] = Combination(f"{body}.{name}", unit, *found_, reference)
    return out


def about_centre(theta: np.ndarray) -> np.ndarray:
    """Return the centre of mass (3,) and the inertia about it (6,), in the order of inertial parameters."""
    centre = theta[1:4] / theta[0]
    shift = [float((centre @ centre) * (i == j) - centre[i] * centre[j]) for i, j in ELEMENTS]
    return np.concatenate([centre, theta[4:] - theta[0] * np.array(shift)])


def combinations(
    information: np.ndarray, before: Sequence[int] = (), units: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return combinations (b, n) that data tell apart, and which parameters (b,) they are named after.

    ``information`` (n, n) is the data's, each parameter in units of the standard deviation that is known
    beforehand. Directions of which the data say less than that are not told; of each such direction the
    parameter that has the largest part in it, of equals that nearest to the tips, is lumped into the others.
    Those of ``before`` are lumped although others have a part up to three times as large: a bus's mass and
    first moments, so that its inertias are left, which are told about the centre of mass. With ``units`` (n,)
    of the parameters it is the nearest to the tips of those with any part worth the name: as base parameters
    of an arm, which are told by torques at any motion, have it.
    """
    size, basis = np.linalg.eigh(0.5 * (information + information.T))
    unseen = basis[:, size < 1.0]
    n = len(size)
    if not unseen.shape[1]:
        return np.eye(n), np.arange(n)
    place = np.arange(n) / n
    preference = 1.0 + TIPS * place if units is None else units * ARM_TIPS**place
    preference[list(before)] *= CENTRE_FIRST
    *_, pivots = qr((unseen * preference[:, None]).T, mode="r", pivoting=True)
    lumped = np.sort(pivots[: unseen.shape[1]])
    kept = np.setdiff1d(np.arange(n), lumped)
    matrix = np.zeros((len(kept), n))
    matrix[:, kept] = np.eye(len(kept))
    matrix[:, lumped] = -np.linalg.solve(unseen[lumped].T, unseen[kept].T).T
    return matrix, kept


def _combination(
    factors: np.ndarray,
    kept: int,
    unknowns: Sequence[Unknown],
    own: Sequence[int],
    moved: np.ndarray,
    covariance: np.ndarray,
    width: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return a combination's factors (n,) without what does not matter, and its gradient (m,).

    Factors are rounded to the digits that its name shows: whoever adds up what the name says gets the value.
    """

    def gradient_of(x: np.ndarray) -> np.ndarray:
        row = x @ moved
        row[list(own)] += x * np.array([unknowns[i].scale for i in own])
        return row

    gradient = gradient_of(factors)
    sigma = float(np.sqrt(gradient @ covariance @ gradient))
    small = np.abs(factors) * width < NEGLIGIBLE * sigma
    small[kept] = False
    factors = np.where(small, 0.0, factors)
    factors = np.where(np.abs(np.abs(factors) - 1.0) < ROUND, np.sign(factors), factors)
    factors[kept] = 1.0
    factors = np.array(
        [rounded_factor(f, NEGLIGIBLE * sigma / w) for f, w in zip(factors, width, strict=True)]
    )
    return factors, gradient_of(factors)


def rounded_factor(factor: float, within: float) -> float:
    """Return a factor rounded to four digits, or as many more as keep the error ``within`` a limit."""
    rounded = (float(f"{factor:.{n}g}") for n in range(DIGITS, MOST_DIGITS))
    return next((x for x in rounded if abs(x - factor) <= within), factor)


def combination_name(factors: np.ndarray, first: int, names: Sequence[str]) -> str:
    """Return the name of a combination of factors (n,), its own first: ``bus.mx + 2 link1.m``."""
    text = names[first]
    for i in np.flatnonzero(factors).tolist():
        if i != first:
            size = abs(float(factors[i]))
            term = names[i] if size == 1.0 else f"{size:.{MOST_DIGITS}g} {names[i]}"
            text += f" {'+' if factors[i] > 0.0 else '-'} {term}"
    return text
