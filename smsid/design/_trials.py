"""Kinds of experiments that a search can draw at random, step from, and fly without noise."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from smsid.design._limits import Limits
from smsid.design._moving import SeriesSpace
from smsid.design._thrusting import largest_thrust, thrust_steps
from smsid.errors import ExperimentError
from smsid.experiments import Experiment, LimitUse, fly
from smsid.experiments.excitation import DRAFT
from smsid.model import build_model
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

TRIAL_RATE = 10.0  # [Hz]
PIECES = 24  # of a thrust
PASSES = 6


@dataclass(frozen=True, eq=False)
class Trials(ABC):
    """Experiments of one kind, each a point of ordinary numbers."""

    model: SpacecraftModel
    limits: Limits
    duration: float

    @abstractmethod
    def random(self, rng: np.random.Generator) -> np.ndarray:
        """Return a random point (size,)."""

    @abstractmethod
    def experiment(self, point: np.ndarray, shrink: float = 1.0) -> Experiment:
        """Return the experiment of a point (size,), all of it times ``shrink``."""

    def random_step(self, point: np.ndarray, width: float, rng: np.random.Generator) -> np.ndarray:
        """Return a point (size,) a random step away: ``width`` in the root mean square of its numbers."""
        return point + width * float(np.sqrt(np.mean(point**2))) * rng.normal(size=point.shape)

    def flown(
        self, point: np.ndarray, rate: float = TRIAL_RATE
    ) -> tuple[Experiment, Recording, tuple[LimitUse, ...]]:
        """Return a point's experiment, as strong as limits allow, its noise-free recording, and their use.

        ``point`` (size,).

        Raises `ExperimentError` naming the limits that cannot be kept.
        """
        description = self.model.description
        perfect = [
            s.model_copy(update={"errors": {}, "preset": None, "rate": rate}) for s in description.sensor
        ]
        blank = build_model(description.with_sensors(*perfect))
        shrink, broken = 1.0, ()
        for _ in range(PASSES):
            experiment = self.experiment(point, shrink)
            flight = fly(blank, experiment, np.random.default_rng(0), tolerance=DRAFT)
            times = np.linspace(0.0, self.duration, int(8 * self.duration) + 1)
            states = flight.trajectory.states(times)
            uses = self.limits.use(self.model, states, experiment.hold_attitude)
            broken = self.limits.violations(uses)
            if not broken:
                return experiment, flight.recording, uses
            shrink *= 0.995 / max(self.limits.share(u) for u in broken)
        raise ExperimentError(
            "No experiment keeps these limits: " + "; ".join(map(str, broken)) + ".",
            advice="Loosen them.",
            limits=broken,
        )


class Motions(Trials):
    """Fourier series of joints and wheels, free floating."""

    @property
    def space(self) -> SeriesSpace:
        """Their space."""
        return SeriesSpace(self.model, self.limits, self.duration)

    def random(self, rng: np.random.Generator) -> np.ndarray:
        """Return a random point (size,)."""
        return self.space.random(rng)

    def experiment(self, point: np.ndarray, shrink: float = 1.0) -> Experiment:
        """Return the experiment of a point (size,)."""
        return self.space.experiment(point, shrink)


class Thrusts(Trials):
    """Pieces of constant thrust, attitude held."""

    def random(self, rng: np.random.Generator) -> np.ndarray:
        """Return a random point (size,)."""
        return np.repeat(rng.normal(size=(PIECES // 2, 3)), 2, axis=0).ravel()

    def experiment(self, point: np.ndarray, shrink: float = 1.0) -> Experiment:
        """Return the experiment of a point (size,): its largest thrust is what limits allow."""
        thrust = point.reshape(PIECES, 3)
        size = shrink * largest_thrust(self.model, self.limits) / np.abs(thrust).max()
        return thrust_steps(np.round(size * thrust, 3), self.duration)


def families(model: SpacecraftModel, limits: Limits, duration: float) -> list[Trials]:
    """Return the kinds of experiments a spacecraft can fly; raises `ExperimentError` when there is none."""
    found: list[Trials] = []
    if len(model.arm_joints) or len(model.wheels):
        found.append(Motions(model, limits, duration))
    if model.free and (model.description.thrust.max_force or limits.force):
        found.append(Thrusts(model, limits, duration))
    if not found:
        raise ExperimentError(
            f"'{model.description.name}' has nothing to move it: no joints, no wheels, no limit of thrust.",
            advice="Give `max_force` in [thrust], or --force.",
        )
    return found
