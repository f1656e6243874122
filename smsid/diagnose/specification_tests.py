"""Generic tests of what is left: does any equation or channel still depend on anything?"""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.special import gammaln
from scipy.stats import chi2

from smsid.diagnose.score_test import EXCITED, least_squares
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.effects.friction_law import SMOOTHING
from smsid.errors import SmsidError
from smsid.estimation.filter_run import FilterRun
from smsid.estimation.joint_problem import at_point
from smsid.estimation.kalman import run_filter
from smsid.estimation.map_estimate import MapFit
from smsid.estimation.sensitivities import Sensitivities, Sensitivity, propagate
from smsid.simulate.trajectory import States

LOGGER = logging.getLogger(__name__)
TIME_TERMS = 6
RIPPLE = range(3, 13)
LAGS = 8
PAST = "its own past"
BANDS = (0.0, 1 / 64, 1 / 16, 1 / 4, 1.0)  # of the highest frequency
TOGETHER = 128  # columns that are carried at once: nearly as fast as all of them, in a fraction of the memory

Named = tuple[str, str, str, list[Sensitivity]]  # where, location and dependence of a test, and its columns


@dataclass(frozen=True)
class SpecificationTest:
    """One test: an equation or channel against what it may depend on, by ``freedom`` columns.

    ``grid`` counts the variants of which the best is taken. ``location`` is that of the equation or channel
    as candidates have it, empty: the bus, on which anything may act.
    """

    where: str
    dependence: str
    ratio: float
    freedom: int
    grid: int = 1
    location: str = ""

    @property
    def p_value(self) -> float:
        """Chance of as much when nothing is left."""
        return min(1.0, self.grid * float(chi2.sf(self.ratio, self.freedom))) if self.freedom else 1.0

    def information_gain(self, samples: int) -> float:
        """Return the gain in Bayes's information criterion if its columns were fitted."""
        return self.ratio - self.freedom * float(np.log(samples)) - 2.0 * float(np.log(self.grid))

    @property
    def order(self) -> tuple[bool, float]:
        """What tests are sorted by: equations before mere correlation in time, the most significant first."""
        return self.dependence == PAST, _log_chance(self.ratio, self.freedom)


@dataclass(frozen=True)
class Equation:
    """An equation of motion: name in the tests, location as in `SpecificationTest`, places in q and v, and
    whether commands act in it.
    """

    name: str
    location: str
    q: tuple[int, ...]
    v: tuple[int, ...]
    driven: bool = False


def equations_of(found: MapFit) -> list[Equation]:
    """Return the equations of motion: of joints, wheels and bus, of slosh masses and of modes."""
    model = found.changes.model
    out = [
        Equation(f"torque of {name}", name, (int(kq),), (int(kv),), True)
        for group in (model.arm_joints, model.wheels)
        for name, kq, kv in zip(group.names, group.q, group.v, strict=True)
        if kv not in found.problem.locked
    ]
    if model.free:
        names = [f"{what} on the bus along {axis}" for what in ("force", "torque") for axis in "xyz"]
        out += [Equation(name, "", (), (k,), True) for k, name in enumerate(names)]
    for tank in model.slosh:
        q, v = (tuple(range(x.start, x.stop)) for x in (tank.q, tank.v))
        out.append(Equation(f"slosh {tank.name}", tank.name, q, v))
    return out + [
        Equation(f"mode {name}", name, (int(kq),), (int(kv),))
        for group in (model.modes, model.further_modes)
        for name, kq, kv in zip(group.names, group.q, group.v, strict=True)
    ]


def open_joints(found: MapFit) -> dict[str, float]:
    """Return by how much torques err at the joints of laws whose shape is left open [N m]."""
    known = dict(found.problem.noise.shapes)
    if not known:
        return {}
    groups = (found.changes.model.arm_joints, found.changes.model.wheels)
    return {n: known[int(v)] for g in groups for n, v in zip(g.names, g.v, strict=True) if int(v) in known}


def is_at(place: str, other: str) -> bool:
    """Return whether one place is the other, a component of its channel or a channel of its sensor, or may be
    it: what acts on the bus (empty) may be anything.
    """
    inner = place.startswith((f"{other}[", f"{other}.")) or other.startswith((f"{place}[", f"{place}."))
    return not other or place == other or inner


def _log_chance(ratio: float, freedom: int) -> float:
    """Return the logarithm of chi2.sf; by the first term of its expansion where that underflows."""
    if not freedom:
        return 0.0
    if ratio < 1000.0:
        return float(chi2.logsf(ratio, freedom))
    x, half = 0.5 * ratio, 0.5 * freedom
    return float((half - 1.0) * np.log(x) - x - gammaln(half))


def adequacy(found: MapFit) -> list[SpecificationTest]:
    """Return all generic tests on a fit, the most significant first and correlation in time last: a symptom.

    Torque at every driven joint and wheel against angle, ripple, rate, load, acceleration and time; wrench on
    the bus against time; slosh and modes against their amplitude; every channel against time, its own value
    and rate; and the correlation in time of every channel's innovations.
    """
    left_open = open_joints(found)
    asked = [e for e in equations_of(found) if e.location not in left_open]
    beside_errors = found.with_shape_errors()
    named: list[Named] = [(e.name, e.location, on, own) for e in asked for on, own in _dependences(found, e)]
    named += [(channel, channel, on, own) for channel, on, own in _channels(found)]
    blocks = []
    for some in _group_tests(named):
        changes = [c for *_, own in some for c in own]
        whitened = propagate(found.run, changes).reshape(-1, len(changes))
        ends = np.cumsum([len(own) for *_, own in some])[:-1]
        beside = beside_errors.projected(np.split(whitened, ends, axis=1))
        for (where, location, dependence, _), own in zip(some, beside, strict=True):
            _, _, ratio, values = least_squares(own.gram, own.slope, own.raw)
            freedom = int((values > EXCITED).sum())
            blocks.append(SpecificationTest(where, dependence, ratio, freedom, location=location))
    blocks += whiteness(found)
    return sorted(blocks, key=lambda b: b.order)


def _group_tests(named: Sequence[Named]) -> Iterator[Sequence[Named]]:
    """Yield tests in groups of about `TOGETHER` columns."""
    count = np.cumsum([len(own) for *_, own in named]) // TOGETHER
    for group in np.unique(count):
        yield [one for one, k in zip(named, count, strict=True) if k == group]


def whiteness(found: MapFit) -> list[SpecificationTest]:
    """Return the test of Ljung and Box on every channel's innovations; less what an error of shape, as likely
    as can be, explains of them where that of a law is left open. Errors of a shape are not white, nor is what
    they shake: neither channels of its joint are asked, nor those with `THRESHOLDS.shape_share` of their
    variance by them.
    """
    e, used = found.run.innovations, found.run.used
    out, shares = [], np.zeros(e.shape[1])
    if found.problem.noise.shapes:
        errors = found.shape_error_basis
        e = e - (errors @ (errors.T @ e.ravel())).reshape(e.shape)
        shares = _share_of_shape_errors(found)
    left_open = tuple(f"[{joint}]" for joint in open_joints(found))
    for row, name in enumerate(found.problem.data.names):
        if name.endswith(left_open) or shares[row] > THRESHOLDS.shape_share:
            continue
        x = e[used[:, row], row]
        n = len(x)
        if n < 20 * LAGS:
            continue
        x = x[n // 50 :]  # the start settles
        n = len(x)
        c0 = float(x @ x)
        if c0 == 0.0:
            continue
        r = np.array([float(x[k:] @ x[:-k]) / c0 for k in range(1, LAGS + 1)])
        ratio = n * (n + 2.0) * float((r**2 / (n - np.arange(1, LAGS + 1))).sum())
        out.append(SpecificationTest(name, PAST, ratio, LAGS, location=name))
    return out


def _share_of_shape_errors(found: MapFit) -> np.ndarray:
    """Return which share of the variance of every component's prediction (rows,) the torques of laws make
    whose shape is left open; none where the motion is lost without them.
    """
    exact, at = replace(found.problem, noise=replace(found.problem.noise, shapes=())), found.changes
    try:
        runs = run_filter(at.model, at_point(at.point, exact)), found.run
    except SmsidError as error:
        LOGGER.info("what errors of shape shake is not known: %s", error)
        return np.zeros(found.problem.data.rows)
    own, whole = (_variances(run) for run in runs)
    return 1.0 - own / np.where(whole > 0.0, whole, np.inf)


def _variances(run: FilterRun) -> np.ndarray:
    """Return the median variance of every component's prediction errors (rows,), zero of one never read."""
    told = run.used & (run.normalised != 0.0)
    variance = (run.errors / np.where(told, run.normalised, 1.0)) ** 2
    return np.array(
        [np.median(x[there]) if there.any() else 0.0 for x, there in zip(variance.T, told.T, strict=True)]
    )


def band_tests(found: MapFit, factors: np.ndarray) -> list[SpecificationTest]:
    """Return in which bands of frequency a channel's prediction errors exceed its noise as stated, by three.

    ``factors`` (rows,) are the levels of the fit's noise over the stated one. Each ratio is the power in the
    band, by the periodogram of Bartlett, that is one a degree of freedom where nothing is left.
    """
    run, data = found.run, found.problem.data
    n = len(run.used)
    power = np.abs(np.fft.rfft(np.where(run.used, run.normalised * factors, 0.0), axis=0)) ** 2 / n
    share = np.arange(len(power)) / (0.5 * n)  # of the highest frequency
    degrees = np.where((share == 0.0) | (share == 1.0), 1, 2)
    highest = 0.5 / float(np.median(np.diff(data.times)))
    out = []
    for block in data.blocks:
        there = max(float(run.used[:, block.rows].mean()), 1e-300)
        own = power[:, block.rows].sum(axis=1) * degrees / there
        for low, high in pairwise(BANDS):
            inside = (share <= high) & ((share > low) | (low == 0.0))
            freedom = int(degrees[inside].sum()) * (block.rows.stop - block.rows.start)
            ratio = float(own[inside].sum())
            if ratio > THRESHOLDS.own_channel**2 * freedom > 0.0:
                times = f"{np.sqrt(ratio / freedom):.3g} times the noise"
                band = f"frequency, {low * highest:.2g} to {high * highest:.2g} Hz ({times})"
                out.append(SpecificationTest(block.channel, band, ratio, freedom, location=block.channel))
    return sorted(out, key=lambda b: -b.ratio / b.freedom)


def _times(times: np.ndarray, terms: int = TIME_TERMS) -> list[np.ndarray]:
    x = (times - times[0]) / (times[-1] - times[0])
    return [np.cos(np.pi * k * x) for k in range(terms)]


def _dependences(found: MapFit, equation: Equation) -> list[tuple[str, list[Sensitivity]]]:
    """Return what an equation is tested for, with the changes by forces in it."""
    turns = set(equation.q) & set(found.changes.model.arm_joints.q)

    def driven(s: States, kq: int, kv: int) -> dict[str, list[np.ndarray]]:
        angle, rate, load, acc = s.q[:, kq], s.v[:, kv], s.tau[:, kv], s.a[:, kv]
        sign = np.tanh(rate / SMOOTHING)
        terms = {
            "rate": [rate, sign, rate * np.abs(rate)],
            "load": [load, np.abs(load) * sign],
            "acceleration": [acc],
            "time": _times(s.time),
        }
        if turns:
            terms["angle"] = [f(k * angle) for k in (1, 2) for f in (np.cos, np.sin)]
            terms["ripple over the angle"] = [f(k * angle) for k in RIPPLE for f in (np.cos, np.sin)]
        return terms

    def hidden(s: States, kq: int, kv: int) -> dict[str, list[np.ndarray]]:
        x, v = s.q[:, kq], s.v[:, kv]
        size = max(float(np.abs(x).max()), 1e-12)
        swing = [x, v, x * (x / size) ** 2, np.abs(v) * v, x * (s.time - s.time.mean())]
        return {"amplitude": swing}

    def bus(s: States, kq: int, kv: int) -> dict[str, list[np.ndarray]]:
        return {"time": _times(s.time)}

    terms = hidden if not equation.driven else driven if equation.q else bus
    out: dict[str, list[Sensitivity]] = {}
    for kq, kv in zip(equation.q or (-1,), equation.v, strict=True):
        at, middle = (terms(s, kq, kv) for s in (found.run.states, found.run.middle))
        for key in at:
            forces = zip(middle[key], at[key], strict=True)
            out.setdefault(key, []).extend(Sensitivity.on(kv, *both) for both in forces)
    return list(out.items())


def _channels(found: MapFit) -> list[tuple[str, str, list[Sensitivity]]]:
    changes: Sensitivities = found.changes
    run, data, out = found.run, found.problem.data, []
    values, rates = changes.readings(), changes.rates()

    def reading(row: int, x: np.ndarray) -> Sensitivity:
        return Sensitivity(reading=x[:, None], rows=np.array([row]))

    basis = _times(run.states.time)
    for block in data.blocks:
        rows = range(block.rows.start, block.rows.stop)
        out.append((block.channel, "time", [reading(r, b) for r in rows for b in basis]))
        out.append((block.channel, "its own rate", [reading(r, rates[:, r]) for r in rows]))
        if block.quantity != "attitude":
            out.append((block.channel, "its own value", [reading(r, values[:, r]) for r in rows]))
    return out


WAY = "the way since it turned"
WIDTHS = (0.003, 0.01, 0.03, 0.1, 0.3)  # ways over which the torque turns round, over the joint's travel
REST = 1e-9  # [rad] travel of a joint that does not move


def memory(found: MapFit, locations: Iterable[str]) -> list[SpecificationTest]:
    """Return the test for memory of every arm joint at ``locations`` (or channels with it in brackets): does
    its torque depend on the way since it last turned back (hysteresis)?

    No law of rate and angle has that; causes that are not there stand in for it piece by piece.

    Its column is a torque that follows the angle as Dahl's friction does, over the width that explains most.
    """
    model, run = found.changes.model, found.run
    places = set(locations)
    tests: list[tuple[str, list[np.ndarray], list[np.ndarray], int]] = []
    for name, kq, kv in zip(model.arm_joints.names, model.arm_joints.q, model.arm_joints.v, strict=True):
        here = any(p == name or p.endswith(f"[{name}]") for p in places)
        if not here or int(kv) in found.problem.locked:
            continue
        angle, middle = run.states.q[:, kq], run.middle.q[:, kq]
        travel = float(np.ptp(angle))
        if travel > REST:
            laws = [hysteresis(angle, middle, w * travel) for w in WIDTHS]
            tests.append((name, [a for a, _ in laws], [m for _, m in laws], int(kv)))
    if not tests:
        return []
    changes = [
        Sensitivity.on(kv, *both) for _, at, middle, kv in tests for both in zip(middle, at, strict=True)
    ]
    whitened = propagate(run, changes).reshape(-1, len(changes))
    left = found.left(whitened)
    raw = np.einsum("ij,ij->j", whitened, whitened)
    own = np.einsum("ij,ij->j", left, left)
    seen = own > THRESHOLDS.tested * raw
    ratios = np.where(seen, (left.T @ found.residual) ** 2 / np.where(seen, own, 1.0), 0.0)
    best = ratios.reshape(len(tests), len(WIDTHS)).max(axis=1)
    return [
        SpecificationTest(f"torque of {n}", WAY, float(r), 1, len(WIDTHS), n)
        for (n, *_), r in zip(tests, best, strict=True)
    ]


def hysteresis(angle: np.ndarray, middle: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Return Dahl's friction of size 1 at ``angle`` (N,) and at ``middle`` (N - 1,) between them [rad].

    ``dz / dangle = (1 - z sign(rate)) / width``, from rest with nothing held. Source: Dahl, A solid friction
    model, Aerospace Corporation TOR-0158(3107-18)-1 (1968).
    """
    way = np.empty(2 * len(angle) - 1)
    way[::2], way[1::2] = angle, middle
    z = np.zeros_like(way)
    for k, step in enumerate(np.diff(way)):
        towards = np.sign(step)
        z[k + 1] = towards + (z[k] - towards) * np.exp(-abs(step) / width)
    return z[::2], z[1::2]
