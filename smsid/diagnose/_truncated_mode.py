"""A beam's next bending mode as a candidate: all of it is known but its frequency, nearly.

A uniform beam of some length and mass has one next mode, with one shape. What is not known is how far the
frequency of a real one is off, and that has to be found to a part of the resonance's width: frequencies about
the beam's are searched, and how much of the mode there is follows by least squares. What its stations read
of it is its own acceleration; Coriolis forces are left out here and come in with the fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
import pinocchio as pin

from smsid.diagnose._added_oscillator import AddedOscillatorHypothesis, reaction_forces, unit_response
from smsid.diagnose._profiled_hypothesis import (
    ProfiledHypothesis,
    ResolvedHypothesis,
    ResolvedShape,
    Shape,
    best_shape,
)
from smsid.diagnose.score_test import Score, recast
from smsid.effects.appendage import Mode
from smsid.effects.beam_mode import BeamMode
from smsid.estimation.map_estimate import MapFit, ProjectedColumns
from smsid.estimation.parameter_vector import Unknown
from smsid.estimation.sensitivities import Sensitivities, Sensitivity, propagate
from smsid.model.stations import find_appendage, station_indices

OFF = np.linspace(-0.08, 0.08, 17)  # relative errors of the frequency that are tried first
COARSE = 0.01  # least damping ratio there: wide enough to be seen between two of them
FINE = ((np.linspace(-0.008, 0.008, 9), (0.5, 1.0, 2.0)), (np.linspace(-0.0015, 0.0015, 7), (0.7, 1.0, 1.4)))
STEPS = (1e-2, 1e-3, 1e-3)  # of factor, frequency and damping


@dataclass(frozen=True)
class HigherMode(ProfiledHypothesis):
    """Mode ``number`` of a beam that has one less. ``mode`` is what it would be; ``springs`` say where its
    mass hangs, ``seen`` (stations, 3) how far that moves the stations per displacement, bus axes.
    """

    name: str = ""
    number: int = 0
    mode: Mode | None = None
    springs: AddedOscillatorHypothesis = field(
        default_factory=lambda: AddedOscillatorHypothesis(np.zeros(3), np.eye(3)[2:], np.zeros((0, 3)))
    )
    seen: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))

    @classmethod
    def of(cls, beam: str, mode: Mode, placement: pin.SE3, number: int, name: str) -> HigherMode:
        """Return the candidate of a beam's mode ``number``; ``placement`` of its root is in the bus frame."""
        along = np.asarray(mode.translation)
        size = float(np.linalg.norm(along))
        turn = placement.rotation
        place = placement.act(np.cross(along, np.asarray(mode.rotation)) / size**2)
        axis = turn @ along / size
        seen = size * np.array(mode.shape).reshape(-1, 3) @ turn.T
        return cls(
            "beam_mode", beam, "appendage", f"mode {number}", None, (), (), name=name, number=number,
            mode=mode, springs=AddedOscillatorHypothesis(place, axis[None], np.zeros((0, 3))), seen=seen,
        )  # fmt: skip

    @property
    def highest(self) -> float:
        """The highest frequency that is tried [Hz]."""
        return self._mode.frequency * (1.0 + float(OFF[-1]))

    @property
    def _mode(self) -> Mode:
        assert self.mode is not None
        return self.mode

    def columns(self, changes: Sensitivities, nominal: Sequence[Unknown]) -> list[Sensitivity]:
        """Return the derivatives by the factor for every frequency of the first grid."""
        here = self._at(changes)
        return here._columns(changes, [(f, here._coarse) for f in OFF])

    def _at(self, changes: Sensitivities) -> HigherMode:
        """Return the candidate of the beam as it is fitted: its density and stiffness may have moved."""
        panel = find_appendage(changes.model, self.location)
        mode = panel.appendage.higher_mode(self.number)
        assert mode is not None
        return HigherMode.of(self.location, mode, panel.placement, self.number, self.name)

    @property
    def _coarse(self) -> float:
        return max(COARSE, self._mode.damping)

    def _columns(self, changes: Sensitivities, tried: Sequence[tuple[float, float]]) -> list[Sensitivity]:
        """Return the derivatives by the factor for relative errors of frequency and damping ratios."""
        omega = 2.0 * np.pi * self._mode.frequency * (1.0 + np.array([f for f, _ in tried]))
        zeta = np.array([z for _, z in tried])
        mass = float(np.sum(np.square(self._mode.translation)))
        place = self.springs.place
        at, middle = reaction_forces(changes, self.springs, place, omega, zeta)
        forces = unit_response(changes, self.springs, place, (at, middle))
        found = []
        for f, force in enumerate(forces):
            reading = self._station_readings(changes, -at[:, f, 0, 0])
            step = STEPS[0]
            found.append(replace(force.times(step * mass), reading=step * reading))
        return found

    def _station_readings(self, changes: Sensitivities, acceleration: np.ndarray) -> np.ndarray:
        """Return what stations read (N, rows) of accelerations (N,) of the mass along its axis."""
        out = np.zeros((len(acceleration), changes.problem.data.rows))
        for block in changes.problem.data.blocks:
            if block.sensor.kind == "accelerometers" and block.sensor.appendage == self.location:
                chosen = station_indices(find_appendage(changes.model, self.location), block.sensor)
                read = self.seen[chosen].reshape(-1, len(block.gain)) @ block.gain.T
                out[:, block.rows] = np.outer(acceleration, read.ravel())
        return out

    def shapes(self) -> tuple[Shape, ...]:
        """Return every frequency of the first grid."""
        return tuple(Shape((i,), (float(f), self._coarse)) for i, f in enumerate(OFF))

    def resolved(self, shape: Shape, coefficients: np.ndarray) -> ResolvedShape:
        """Return the mode with the label's frequency and damping, and how much of it there is."""
        off, zeta = shape.label
        effect = BeamMode(
            name=self.name,
            appendage=self.location,
            mode=self.number,
            factor=0.0,
            frequency=off,
            damping=zeta,
        )
        free = tuple(f"{self.name}.{key}" for key in ("factor", "frequency", "damping"))
        own = recast(ResolvedHypothesis, self, {"effect": effect, "free": free, "steps": STEPS})
        by = np.array([[1.0, 0.0, 0.0]])
        return own, by, np.array([float(coefficients[0]), 0.0, 0.0]), bool(coefficients[0] > 0.0)

    def scored(self, found: MapFit, own: ProjectedColumns) -> Score:
        """Return the score of the best frequency, and where that is worth it of a finer one."""
        here, samples = self._at(found.changes), found.run.samples
        best = best_shape(here, found, own, here.shapes())
        tried = len(OFF)
        for offs, dampings in FINE:
            if best.odds(samples) <= 0.0:
                break
            effect = cast(BeamMode, best.candidate.effect)
            assert effect.damping is not None
            grid = [(effect.frequency + float(f), d * effect.damping) for f in offs for d in dampings]
            changes = here._columns(found.changes, grid)
            (beside,) = found.projected([propagate(found.run, changes).reshape(-1, len(grid))])
            tried += len(grid)
            finer = best_shape(here, found, beside, [Shape((i,), label) for i, label in enumerate(grid)])
            finer, best = (replace(s, candidate=replace(s.candidate, grid=tried)) for s in (finer, best))
            if finer.odds(samples) <= best.odds(samples):
                break
            best = finer
        return best
