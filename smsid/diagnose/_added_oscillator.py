"""One more mass on springs - a second tank, a mode left out - as a candidate: its frequency is searched.

A small mass moves by the acceleration of the place it hangs at, and what it pulls with beyond a mass bolted
there is its own acceleration relative to the bus. Both are linear, so the motion the filter found drives unit
masses of all frequencies at once, and mass and first moment follow by least squares. Coriolis forces and the
displacement's own lever are left out here; the fit that follows has the whole model, with its larger state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import cast

import numpy as np
from scipy.linalg import expm
from scipy.optimize import minimize
from scipy.signal import lfilter

from smsid.diagnose._profiled_hypothesis import (
    ProfiledHypothesis,
    ResolvedHypothesis,
    ResolvedShape,
    Shape,
    best_shape,
    by_one,
    moments,
    place_of,
)
from smsid.diagnose.score_test import EXCITED, Score, recast
from smsid.effects.appendage_effect import ExtraMode
from smsid.effects.base import Effect
from smsid.effects.slosh import Slosh
from smsid.estimation.map_estimate import MapFit, ProjectedColumns
from smsid.estimation.parameter_vector import Unknown
from smsid.estimation.sensitivities import Sensitivities, Sensitivity, propagate
from smsid.simulate.trajectory import States

COARSE = 0.05  # damping ratio of the first grid: one such mass answers a tenth of its frequency wide
# frequencies and damping over the coarse grid's best, and over that one's: a sharp one shows nearby only
FINE = (np.geomspace(0.78, 1.28, 11), (0.08, 0.4, 1.4))
FINER = (np.geomspace(0.95, 1.053, 11), (0.4, 1.0, 2.0))
FINEST = (np.geomspace(0.985, 1.015, 7), (0.6, 0.8, 1.0, 1.25, 1.6))
BUS = np.arange(6)  # its degrees of freedom
STEP = 1e-2  # [kg] and [m]
LEAST = 1e-9  # [kg] a tank that does nothing: a slosh mass cannot be zero


@dataclass(frozen=True)
class AddedOscillatorHypothesis:
    """Where unit masses hang and how they move: ``place`` (3,) in the bus frame [m], ``axes`` (d, 3) along
    which they slide, ``moves`` (k, 3) along which the place is searched, ``spread`` [m] how far from it they
    may be expected: one standard deviation.
    """

    place: np.ndarray
    axes: np.ndarray
    moves: np.ndarray
    spread: float = 1.0


def oscillator_responses(
    changes: Sensitivities,
    springs: AddedOscillatorHypothesis,
    place: np.ndarray,
    omega: np.ndarray,
    zeta: np.ndarray,
) -> list[Sensitivity]:
    """Return what unit masses at a place add to the motion: per axis a and oscillator f, the derivatives by
    mass and by first moment along ``moves``, in the order (a, f, 1 + k).

    ``omega`` [rad/s] and ``zeta`` (f,).
    """
    return unit_response(changes, springs, place, reaction_forces(changes, springs, place, omega, zeta))


def unit_response(
    changes: Sensitivities,
    springs: AddedOscillatorHypothesis,
    place: np.ndarray,
    forces: tuple[np.ndarray, np.ndarray],
) -> list[Sensitivity]:
    """Return what ``forces`` of unit masses at a ``place`` (3,) add to the motion: those of
    `reaction_forces`, (N, f, axes, 1 + k) at the samples and (N - 1, ...) between.
    """
    out = []
    for a, axis in enumerate(springs.axes):
        straight = np.concatenate([axis, np.cross(place, axis)])
        turning = [np.concatenate([np.zeros(3), np.cross(move, axis)]) for move in springs.moves]
        parts = []
        for force in forces:
            own = force[:, :, a].transpose(1, 2, 0)[:, :, :, None] * straight  # (f, 1 + k, N, 6)
            for j, more in enumerate(turning, start=1):
                own[:, j] += force[:, :, a, 0].T[:, :, None] * more
            parts.append(own.reshape(-1, len(force), 6))
        at, middle = parts
        out += [Sensitivity(*both, dofs=BUS) for both in zip(middle, at, strict=True)]
    return out


def reaction_forces(
    changes: Sensitivities,
    springs: AddedOscillatorHypothesis,
    place: np.ndarray,
    omega: np.ndarray,
    zeta: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Return how unit masses pull at a place, (N, f, axes, 1 + k) at the samples and (N - 1, ...) between:
    minus their accelerations relative to it.

    ``omega`` [rad/s] and ``zeta`` (f,); ``place`` (3,), bus frame [m].
    """
    run = changes.run
    at, middle = (
        _place_accelerations(s, springs.axes, place, springs.moves) for s in (run.states, run.middle)
    )
    step = float(np.median(np.diff(run.states.time)))
    return _forces(at, middle, omega, zeta, step, run.begins)


def _place_accelerations(s: States, axes: np.ndarray, place: np.ndarray, moves: np.ndarray) -> np.ndarray:
    """Return the acceleration (N, axes, 1 + moves) along each axis of the place, and by moves of it."""
    omega, alpha = s.v[:, 3:6], s.a[:, 3:6]

    def turned(r: np.ndarray) -> np.ndarray:
        return np.cross(alpha, r) + np.cross(omega, np.cross(omega, r))

    still = s.a[:, :3] + np.cross(omega, s.v[:, :3]) + turned(np.broadcast_to(place, alpha.shape))
    whole = [still, *(turned(np.broadcast_to(m, alpha.shape)) for m in moves)]
    return np.stack([x @ axes.T for x in whole], axis=2)


def _forces(
    at: np.ndarray,
    middle: np.ndarray,
    omega: np.ndarray,
    zeta: np.ndarray,
    step: float,
    begins: Sequence[int] = (0,),
) -> tuple[np.ndarray, np.ndarray]:
    """Return the force of unit masses at the samples (N, f, ...) and between (N - 1, f, ...), driven by
    accelerations (N, ...) and (N - 1, ...); at rest at the samples with which recordings begin.
    """
    shape, n, count = at.shape[1:], len(at), len(omega)
    at, middle = at.reshape(n, -1), middle.reshape(len(middle), -1)
    pushed = np.concatenate([middle, np.zeros_like(at[:1])])
    k, d = omega**2, 2.0 * zeta * omega
    whole = np.zeros((count, 3, 3))
    whole[:, 0, 1], whole[:, 1] = 1.0, np.stack([-k, -d, np.full(count, -1.0)], axis=1)
    grown = expm(whole * step / 2.0)
    out_at, out_middle = np.empty((n, count, at.shape[1])), np.empty((n - 1, count, at.shape[1]))
    for i in range(count):
        phi, gamma = grown[i, :2, :2], grown[i, :2, 2]
        pull, after = np.array([k[i], d[i]]), phi @ gamma + gamma  # held from sample to sample
        ends = np.array([1.0, -np.trace(phi @ phi), np.linalg.det(phi @ phi)])
        back = phi @ phi + ends[1] * np.eye(2)
        rises = np.array([0.0, pull @ after, pull @ back @ after])
        halfway = (pull @ gamma) * ends + np.array([0.0, pull @ phi @ after, pull @ phi @ back @ after])
        for first, last in pairwise((*begins, n)):
            mine = pushed[first:last]
            out_at[first:last, i] = at[first:last] + lfilter(rises, ends, mine, axis=0)
            last = min(last, n - 1)
            out_middle[first:last, i] = (mine + lfilter(halfway, ends, mine, axis=0))[: last - first]
    return out_at.reshape(n, count, *shape), out_middle.reshape(n - 1, count, *shape)


@dataclass(frozen=True)
class OscillatorHypothesis(ProfiledHypothesis):
    """One more mass on springs; ``frequencies`` (f,) [Hz] are those of the first grid.

    ``name`` is what its effect is called; with ``appendage`` it is one more mode of that, else a tank.
    """

    name: str = ""
    springs: AddedOscillatorHypothesis = field(
        default_factory=lambda: AddedOscillatorHypothesis(np.zeros(3), np.eye(3), np.eye(3))
    )
    frequencies: tuple[float, ...] = ()
    appendage: str | None = None
    turn: np.ndarray = field(default_factory=lambda: np.eye(3))  # from the bus frame to that of `appendage`
    root: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def columns(self, changes: Sensitivities, nominal: Sequence[Unknown]) -> list[Sensitivity]:
        """Return for every frequency the derivatives by mass and first moment."""
        omega = 2.0 * np.pi * np.asarray(self.frequencies)
        found = oscillator_responses(
            changes, self.springs, self.springs.place, omega, np.full_like(omega, COARSE)
        )
        width, axes = len(omega) * (1 + len(self.springs.moves)), len(self.springs.axes)
        return [
            _sum([found[a * width + i] for a in range(axes)], STEP * (1.0 if i % self._parts == 0 else STEP))
            for i in range(width)
        ]

    @property
    def _parts(self) -> int:
        return 1 + len(self.springs.moves)

    def shapes(self) -> tuple[Shape, ...]:
        """Return every frequency, at the reference place and anywhere."""
        axes = len(self.springs.axes)
        found = []
        for i, f in enumerate(self.frequencies):
            label = (np.full(axes, 2.0 * np.pi * f), np.full(axes, COARSE), self.springs.place)
            first = i * self._parts
            found.append(Shape((first,), label))
            found.append(Shape(tuple(range(first, first + self._parts)), label))
        return tuple(found)

    def estimated(
        self, shape: Shape, gram: np.ndarray, slope: np.ndarray, raw: np.ndarray
    ) -> tuple[np.ndarray, float, np.ndarray]:
        """Return mass and first moment, the place no further off than its prior lets it be.

        Of a small mass the recording tells the moments of inertia best: one far away would do, too.
        """
        free, ratio, values = super().estimated(shape, gram, slope, raw)
        if len(free) == 1:
            return free, ratio, values
        off = (shape.label[2] - self.springs.place) @ self.springs.moves.T

        def theta(place: np.ndarray) -> np.ndarray:
            return np.concatenate([[1.0], place / STEP])

        def worth(place: np.ndarray) -> float:
            away = (off + place) / self.springs.spread
            return float(away @ away) - by_one(theta(place), gram, slope)

        starts = [np.zeros(len(off)), place_of(free, np.full(len(off), STEP)), -off]
        best = min((minimize(worth, x, method="Nelder-Mead") for x in starts), key=lambda r: r.fun)
        own = theta(best.x)
        mass = max(float(own @ slope), 0.0) / max(float(own @ gram @ own), 1e-300)
        return mass * own, max(-float(best.fun), 0.0), values

    def resolved(self, shape: Shape, coefficients: np.ndarray) -> ResolvedShape:
        """Return the mass on springs with the label's frequencies, where the first moment says."""
        omega, zeta, place = shape.label
        d = len(self.springs.moves)
        offset = place_of(coefficients, np.full(d, STEP))
        mass = float(coefficients[0]) * STEP
        effect = self._effect(max(abs(mass), LEAST), place + offset @ self.springs.moves, omega, zeta)
        free, steps = self._free_parameters(effect)
        by = np.zeros((len(shape.columns), len(free)))
        by[:, : 1 + d] = moments(coefficients[0], offset / STEP, len(shape.columns))
        reference = {
            p.name: p.value for p in self._effect(LEAST, self.springs.place, omega, zeta).parameters()
        }
        means = tuple((n, reference[n]) for n in free[1 : 1 + d])
        own = recast(
            ResolvedHypothesis, self, {"effect": effect, "free": free, "steps": steps, "means": means}
        )
        return own, by, np.r_[coefficients[0], np.zeros(len(free) - 1)], mass > 0.0

    def scored(self, found: MapFit, own: ProjectedColumns) -> Score:
        """Return the score of the best frequency, and where that is worth it of a finer one, axis by axis."""
        coarse = self.scored_coarsely(found, own)
        if coarse.odds(found.run.samples) <= 0.0:
            return coarse
        fine = self._finer(found, coarse)
        if fine.odds(found.run.samples) <= coarse.odds(found.run.samples):
            return coarse
        return replace(fine, another=coarse)  # as fine as that, it may follow what only looks like a mass

    def scored_coarsely(self, found: MapFit, own: ProjectedColumns) -> Score:
        """Return the score of the best frequency of the first grid."""
        return super().scored(found, own)

    def _finer(self, found: MapFit, coarse: Score) -> Score:
        omega, zeta, place = self._label(coarse)
        axes, parts = len(self.springs.axes), self._parts
        best_score, tried = coarse, 0
        for frequencies, damping in (FINE, FINER, FINEST):
            grid = np.array([(f, z) for f in frequencies for z in damping])
            chosen, damped = np.outer(omega, grid[:, 0]), np.outer(zeta, grid[:, 1])
            changes: list[Sensitivity] = []
            for a in range(axes):
                one = AddedOscillatorHypothesis(place, self.springs.axes[a : a + 1], np.zeros((0, 3)))
                changes += oscillator_responses(found.changes, one, place, chosen[a], damped[a])
            best = _choose(found, changes, axes, len(grid))
            omega = np.array([chosen[a, i] for a, i in enumerate(best)])
            zeta = np.array([damped[a, i] for a, i in enumerate(best)])
            each = [
                oscillator_responses(
                    found.changes,
                    AddedOscillatorHypothesis(place, self.springs.axes[a : a + 1], self.springs.moves),
                    place, omega[a : a + 1], zeta[a : a + 1],
                )
                for a in range(axes)
            ]  # fmt: skip
            summed = [_sum([e[i] for e in each], STEP * (STEP if i else 1.0)) for i in range(parts)]
            (beside,) = found.projected([propagate(found.run, summed).reshape(-1, parts)])
            shapes = (Shape((0,), (omega, zeta, place)), Shape(tuple(range(parts)), (omega, zeta, place)))
            tried += len(self.frequencies) * len(grid) ** axes
            score = best_shape(self, found, beside, shapes, tried)
            best_score = max(best_score, score, key=lambda s: s.odds(found.run.samples))
            omega, zeta, place = self._label(score)
        return best_score

    def _label(self, score: Score) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return frequencies [rad/s], damping ratios and place of what a score settled on."""
        if self.appendage is not None:
            mode = cast(ExtraMode, score.candidate.effect)
            place = self.root + self.turn.T @ np.asarray(mode.position)
            return np.array([2.0 * np.pi * mode.frequency]), np.array([mode.damping]), place
        tank = cast(Slosh, score.candidate.effect)
        mass = max(abs(float(score.estimate[0])) * STEP, LEAST)
        omega = np.sqrt(np.asarray(tank.stiffness) / mass)
        return omega, np.asarray(tank.damping) / (2.0 * omega * mass), tank.equilibrium

    def _effect(self, mass: float, place: np.ndarray, omega: np.ndarray, zeta: np.ndarray) -> Effect:
        where = "offset" if self.appendage is None else "position"
        prior = {f"{where}.{axis}": self.springs.spread for axis in "xyz"}
        if self.appendage is not None:
            return ExtraMode(
                name=self.name,
                appendage=self.appendage,
                mass=0.0,
                position=tuple((self.turn @ (place - self.root)).tolist()),
                direction=tuple((self.turn @ self.springs.axes[0]).tolist()),
                frequency=float(omega[0] / (2.0 * np.pi)),
                damping=float(zeta[0]),
                prior=prior,
            )
        return Slosh(
            name=self.name,
            position=tuple(self.springs.place.tolist()),
            offset=tuple((place - self.springs.place).tolist()),
            mass=LEAST,
            stiffness=tuple((mass * omega**2).tolist()),
            damping=tuple((2.0 * mass * zeta * omega).tolist()),
            mass_in_bus=True,
            prior=prior,
        )

    def _free_parameters(self, effect: Effect) -> tuple[tuple[str, ...], tuple[float, ...]]:
        """Return the free parameters, mass and place first, and their steps."""
        local = self.springs.moves @ self.turn.T
        moved = [axis for k, axis in enumerate("xyz") if np.abs(local[:, k]).max(initial=0.0) > 0.5]
        where = "offset" if self.appendage is None else "position"
        names = ["mass", *(f"{where}.{axis}" for axis in moved)]
        steps = [STEP, *(STEP for _ in moved)]
        more = {p.name.removeprefix(f"{self.name}."): p.value for p in effect.parameters()}
        for key in [k for k in more if k.split(".")[0] in ("stiffness", "frequency", "damping")]:
            names.append(key)
            steps.append(0.01 * max(more[key], 1e-6))
        return tuple(f"{self.name}.{n}" for n in names), tuple(steps)


def _choose(found: MapFit, changes: list[Sensitivity], axes: int, choices: int) -> list[int]:
    """Return for every axis the oscillator whose sum over the axes explains most, one mass for all."""
    (beside,) = found.projected([propagate(found.run, changes).reshape(-1, len(changes))])
    gram, slope, raw = beside.gram, beside.slope, beside.raw
    best = [choices // 2] * axes
    for _ in range(3 if axes > 1 else 1):
        for a in range(axes):
            index = np.array(
                [[b * choices + (i if b == a else best[b]) for b in range(axes)] for i in range(choices)]
            )
            square = gram[index[:, :, None], index[:, None, :]].sum(axis=(1, 2))
            along, size = slope[index].sum(axis=1), raw[index].sum(axis=1)
            seen = (square > EXCITED * size) & (along > 0.0)
            best[a] = int(np.argmax(np.where(seen, along**2 / np.where(seen, square, 1.0), 0.0)))
    return best


def _sum(changes: Sequence[Sensitivity], factor: float) -> Sensitivity:
    middle = sum(c.middle for c in changes if c.middle is not None)
    at = sum(c.at for c in changes if c.at is not None)
    return Sensitivity(factor * middle, factor * at, dofs=changes[0].dofs)  # type: ignore[arg-type]
