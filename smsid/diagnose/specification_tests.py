"""Generic tests of what is left: does any equation or channel still depend on anything?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln
from scipy.stats import chi2

from smsid.diagnose.score_test import EXCITED
from smsid.estimation.map_estimate import Fit
from smsid.estimation.sensitivities import Sensitivities, Sensitivity, propagate
from smsid.simulate.trajectory import States

TIME_TERMS = 6
RIPPLE = range(3, 13)
LAGS = 8
PAST = "its own past"
SIGN = 1e-3  # [rad/s] rate at which the sign of a rate turns over


@dataclass(frozen=True)
class SpecificationTest:
    """One test: an equation or channel against what it may depend on, by ``freedom`` columns.

    ``grid`` counts the variants of which the best is taken.
    """

    where: str
    dependence: str
    ratio: float
    freedom: int
    grid: int = 1

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


def _log_chance(ratio: float, freedom: int) -> float:
    """Return the logarithm of chi2.sf; by the first term of its expansion where that underflows."""
    if not freedom:
        return 0.0
    if ratio < 1000.0:
        return float(chi2.logsf(ratio, freedom))
    x, half = 0.5 * ratio, 0.5 * freedom
    return float((half - 1.0) * np.log(x) - x - gammaln(half))


def adequacy(found: Fit) -> list[SpecificationTest]:
    """Return all generic tests on a fit, the most significant first and correlation in time last: a symptom.

    Torque at every driven joint and wheel against angle, ripple, rate, load, acceleration and time; wrench on
    the bus against time; slosh and modes against their amplitude; every channel against time, its own value
    and rate; and the correlation in time of every channel's innovations.
    """
    named: list[tuple[str, str, list[Sensitivity]]] = []
    named += _torques(found)
    named += _bus(found)
    named += _hidden(found)
    named += _channels(found)
    changes = [c for _, _, own in named for c in own]
    whitened = propagate(found.run, changes).reshape(-1, len(changes))
    blocks, start = [], 0
    left = found.left(whitened)
    slope = left.T @ found.residual
    for where, dependence, part in named:
        index = slice(start, start + len(part))
        start = index.stop
        own = left[:, index]
        raw = np.einsum("ij,ij->j", whitened[:, index], whitened[:, index])
        size = np.sqrt(np.where(raw > 0.0, raw, 1.0))
        values, vectors = np.linalg.eigh((own.T @ own) / np.outer(size, size))
        keep = values > EXCITED
        scaled = (vectors[:, keep] / np.sqrt(values[keep])).T @ (slope[index] / size)
        blocks.append(SpecificationTest(where, dependence, float(scaled @ scaled), int(keep.sum())))
    blocks += whiteness(found)
    return sorted(blocks, key=lambda b: b.order)


def whiteness(found: Fit) -> list[SpecificationTest]:
    """Return the test of Ljung and Box on every channel's innovations."""
    e, used = found.run.innovations, found.run.used
    out = []
    for row, name in enumerate(found.problem.data.names):
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
        out.append(SpecificationTest(name, PAST, ratio, LAGS))
    return out


def _times(times: np.ndarray, terms: int = TIME_TERMS) -> list[np.ndarray]:
    x = (times - times[0]) / (times[-1] - times[0])
    return [np.cos(np.pi * k * x) for k in range(terms)]


def force_on(found: Fit, dof: int, of: list[np.ndarray], of_mid: list[np.ndarray]) -> list[Sensitivity]:
    """Return the changes by forces on one degree of freedom.

    They are given at the samples, ``of`` (N,) each, and between them, ``of_mid`` (N - 1,).
    """
    changes = []
    run = found.run
    for at, middle in zip(of, of_mid, strict=True):
        changes.append(
            Sensitivity(run.middle_inverse[:, :, dof] * middle[:, None], run.inverse[:, :, dof] * at[:, None])
        )
    return changes


def _torques(found: Fit) -> list[tuple[str, str, list[Sensitivity]]]:
    model, out = found.changes.model, []
    for group in (model.arm_joints, model.wheels):
        for name, kq, kv in zip(group.names, group.q, group.v, strict=True):
            if kv in found.problem.locked:
                continue

            def terms(s: States, kq: int = int(kq), kv: int = int(kv)) -> dict[str, list[np.ndarray]]:
                angle, rate, load, acc = s.q[:, kq], s.v[:, kv], s.tau[:, kv], s.a[:, kv]
                sign = np.tanh(rate / SIGN)
                found_ = {
                    "rate": [rate, sign, rate * np.abs(rate)],
                    "load": [load, np.abs(load) * sign],
                    "acceleration": [acc],
                    "time": _times(s.time),
                }
                if kq in model.arm_joints.q:
                    found_["angle"] = [f(k * angle) for k in (1, 2) for f in (np.cos, np.sin)]
                    found_["ripple over the angle"] = [f(k * angle) for k in RIPPLE for f in (np.cos, np.sin)]
                return found_

            at, middle = terms(found.run.states), terms(found.run.middle)
            out += [(f"torque of {name}", key, force_on(found, int(kv), at[key], middle[key])) for key in at]
    return out


def _bus(found: Fit) -> list[tuple[str, str, list[Sensitivity]]]:
    if not found.changes.model.free:
        return []
    at, middle = _times(found.run.states.time), _times(found.run.middle.time)
    names = [f"{what} on the bus along {axis}" for what in ("force", "torque") for axis in "xyz"]
    return [(name, "time", force_on(found, i, at, middle)) for i, name in enumerate(names)]


def _hidden(found: Fit) -> list[tuple[str, str, list[Sensitivity]]]:
    model, out = found.changes.model, []

    def terms(s: States, kq: int, kv: int) -> list[np.ndarray]:
        x, v = s.q[:, kq], s.v[:, kv]
        size = max(float(np.abs(x).max()), 1e-12)
        return [x, v, x * (x / size) ** 2, np.abs(v) * v, x * (s.time - s.time.mean())]

    groups = [
        (
            f"slosh {tank.name}",
            list(zip(range(tank.q.start, tank.q.stop), range(tank.v.start, tank.v.stop), strict=True)),
        )
        for tank in model.slosh
    ]
    groups += [
        (f"mode {name}", [(int(kq), int(kv))])
        for g in (model.modes, model.further_modes)
        for name, kq, kv in zip(g.names, g.q, g.v, strict=True)
    ]
    for name, dofs in groups:
        own: list[Sensitivity] = []
        for kq, kv in dofs:
            own += force_on(found, kv, terms(found.run.states, kq, kv), terms(found.run.middle, kq, kv))
        out.append((name, "amplitude", own))
    return out


def _channels(found: Fit) -> list[tuple[str, str, list[Sensitivity]]]:
    changes: Sensitivities = found.changes
    run, data, out = found.run, found.problem.data, []
    values, rates = changes.readings(), changes.rates()
    n = len(run.states.time)

    def reading(row: int, x: np.ndarray) -> Sensitivity:
        column = np.zeros((n, data.rows))
        column[:, row] = x
        return Sensitivity(reading=column)

    basis = _times(run.states.time)
    for block in data.blocks:
        rows = range(block.rows.start, block.rows.stop)
        out.append((block.channel, "time", [reading(r, b) for r in rows for b in basis]))
        out.append((block.channel, "its own rate", [reading(r, rates[:, r]) for r in rows]))
        if block.quantity != "attitude":
            out.append((block.channel, "its own value", [reading(r, values[:, r]) for r in rows]))
    return out
