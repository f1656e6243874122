"""Designs Exp. 2: joints and wheels in motion, free floating.

An experiment is a point of a box that holds, for every joint and wheel, the coefficients of its Fourier
series. Their shape is free; the size is what range, rate and wheel limits allow times the length of the
joint's coefficients, at most one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from smsid.design._forecast import Forecast, single_integral
from smsid.design._goal import Criterion, Goal, goal_of
from smsid.design._limits import Limits, experiment_use, least
from smsid.design._minimum_time import Watch
from smsid.errors import ExperimentError, SmsidError
from smsid.experiments import Experiment, FourierProfile, LimitUse
from smsid.experiments.scaling import spin_inertias
from smsid.inputs.signals import Fourier
from smsid.likelihood.prediction import Prediction
from smsid.model.spacecraft import SpacecraftModel
from smsid.simulate.trajectory import States

HARMONICS, PERIODS = 5, 2  # as in the paper
DRAWS = 30  # random series that the search begins with
STEPS = 240  # of the search
WIDTH, NARROWEST = 0.3, 0.02  # of its steps, in the size of a joint's coefficients
GROW, SHRINK = 1.5, 1.5**-0.25  # after a success, and after a failure
STEEP = 1.5  # price of a limit passed: a little more than what keeping it costs
LEAST = 1e-3  # share of the motion below which limits leave nothing to measure
PASSES = 8


@dataclass(frozen=True)
class FoundMotion:
    """A motion that was found, as an experiment, with what is predicted of it."""

    experiment: Experiment
    goal: Goal
    covariance: np.ndarray
    point: np.ndarray
    shrink: float = 1.0


def design_motion(
    model: SpacecraftModel,
    wanted: Sequence[str],
    criterion: Criterion,
    limits: Limits,
    duration: float,
    rng: np.random.Generator,
    watch: Watch[FoundMotion],
    start: np.ndarray | None = None,
    effort: float = 1.0,
) -> tuple[FoundMotion, FoundMotion]:
    """Return the best motion of a duration [s] that the search finds, and the first random one.

    Random Fourier series first, then steps of random directions from the best, longer after a success and
    shorter after failures (Rechenberg 1973). An interrupt leaves the best in the watch. ``start``: a point to
    begin from instead of random ones, (size,).

    Raises `ExperimentError` when no motion keeps the limits.
    """
    space = SeriesSpace(model, limits, duration)
    if not space.size:
        raise ExperimentError(
            f"'{model.description.name}' has neither arm joints nor wheels to move.",
            advice="Design a thrust: --mode thrust.",
        )
    _check_measured(model)
    forecast = Forecast.of(model, duration)
    first = space.random(rng)
    _, generic = forecast.motion(space.experiment(first))
    goal = goal_of(forecast.parameters, wanted, criterion, generic)

    def look(point: np.ndarray) -> tuple[float, FoundMotion]:
        experiment = space.experiment(point)
        normal, prediction = forecast.motion(experiment)
        covariance = normal.covariance()
        share = max(limits.share(u) for u in limits.use(model, as_states(model, prediction), False))
        cost = goal.cost(covariance) + STEEP * np.log(max(share, 1.0))
        return cost, FoundMotion(experiment, goal, covariance, point)

    def tried(point: np.ndarray) -> tuple[float, FoundMotion]:
        try:
            cost, made = look(point)
        except SmsidError:
            return np.inf, FoundMotion(space.experiment(point), goal, np.eye(1), point)
        watch.tried(made, cost, float(np.exp(cost)))
        return cost, made

    origin = tried(first)
    best = origin if start is None else min(origin, tried(start), key=lambda x: x[0])
    for _ in range(0 if start is not None else max(1, int(effort * DRAWS)) - 1):
        best = min(best, tried(space.random(rng)), key=lambda x: x[0])
    cost, made = best
    x, width = _normalise_joints(made.point), WIDTH
    for _ in range(int(effort * STEPS)):
        step = width / np.sqrt(2.0 * HARMONICS) * rng.normal(size=x.size)
        new, better = tried(x + step)
        if new < cost:
            x, cost, made = better.point, new, better
            width *= GROW
        else:
            width = max(NARROWEST, width * SHRINK)
    return made, origin[1]


def _check_measured(model: SpacecraftModel) -> None:
    """Refuse joints and wheels that nothing measures: predictions take their motion as measured."""
    sensors = [(s.kind, set(s.quantities)) for s in model.description.effective_sensors()]
    for group, kind, *quantities in (
        (model.arm_joints, "encoder", "joint_position", "joint_velocity"),
        (model.wheels, "tachometer", "wheel_rate"),
    ):
        if len(group) and not any(k == kind and set(quantities) <= found for k, found in sensors):
            raise ExperimentError(
                f"No {kind} of '{model.description.name}' measures {' and '.join(quantities)} of "
                f"{', '.join(group.names)}: designs are predicted from measured motion.",
                advice=f"Add a [[sensor]] of kind {kind} with its noise to the description.",
            )


def within_limits(
    model: SpacecraftModel, made: FoundMotion, limits: Limits
) -> tuple[FoundMotion, tuple[LimitUse, ...]]:
    """Return a motion shrunk until its simulation keeps all limits, and what it uses of them.

    Raises `ExperimentError` naming the limits that next to no motion would keep.
    """
    space = SeriesSpace(model, limits, made.experiment.duration)
    shrink = made.shrink
    for _ in range(PASSES):
        experiment = space.experiment(made.point, shrink, made.experiment.name)
        uses = experiment_use(model, experiment, limits)
        broken = limits.violations(uses)
        if not broken:
            return FoundMotion(experiment, made.goal, made.covariance, made.point, shrink), uses
        if shrink <= LEAST:
            break
        shrink = max(LEAST, shrink * 0.995 / max(limits.share(u) for u in broken))
    raise ExperimentError(
        "No motion keeps these limits: " + "; ".join(map(str, broken)) + ".",
        advice="Loosen them, or design for a longer duration.",
        limits=broken,
    )


def as_states(model: SpacecraftModel, prediction: Prediction) -> States:
    """Return a predicted motion at every other node, the torques it takes as reactions."""
    kept = slice(None, None, 2)
    q, v, a = prediction.q[kept], prediction.v[kept], prediction.a[kept]
    timeline = prediction.timeline
    times = timeline.evaluations[timeline.node_evaluation][kept]
    reaction = np.array([pin.rnea(model.pin, model.data, *row) for row in zip(q, v, a, strict=True)])
    reaction[:, :6] = 0.0
    return States(times, q, v, a, np.zeros_like(v), reaction)


def _normalise_joints(point: np.ndarray) -> np.ndarray:
    """The point with the coefficients of every joint and wheel of unit length or less."""
    parts = point.reshape(-1, 2 * HARMONICS)
    size = np.linalg.norm(parts, axis=1, keepdims=True)
    return (parts / np.maximum(size, 1.0)).ravel()


LOOKS = 600  # times at which a series is held against its limits


@dataclass(frozen=True)
class SeriesSpace:
    """Series of `HARMONICS` terms over ``duration`` [s], the first with `PERIODS` periods in it."""

    model: SpacecraftModel
    limits: Limits
    duration: float

    @property
    def size(self) -> int:
        """Number of coordinates of a point."""
        return 2 * HARMONICS * (len(self.model.arm_joints) + len(self.model.wheels))

    def random(self, rng: np.random.Generator) -> np.ndarray:
        """Return a random point (size,), the paper's kind of excitation."""
        order = np.tile(np.arange(1, HARMONICS + 1), self.size // HARMONICS)
        return (rng.normal(size=self.size) / order).ravel()

    def experiment(self, point: np.ndarray, shrink: float = 1.0, name: str = "design") -> Experiment:
        """Return the experiment of a point (size,), joints' motion and wheels' torque times ``shrink``.

        It starts at home and at rest.
        """
        n, frequency = len(self.model.arm_joints), PERIODS / self.duration
        parts = point.reshape(-1, 2, HARMONICS)
        motion = torque = None
        if n:
            a, b = self._joints(parts[:n])
            a, b = shrink * a, shrink * b
            home = self.model.joint_angles(self.model.home)
            motion = FourierProfile(
                frequency=frequency, cos=a.tolist(), sin=b.tolist(), offset=tuple(home - a.sum(axis=1))
            )
        if len(self.model.wheels):
            a, b = self._wheels(parts[n:])
            torque = FourierProfile(frequency=frequency, cos=(shrink * a).tolist(), sin=(shrink * b).tolist())
        return Experiment(
            name=name,
            note="designed: Fourier series on joints and wheels, free floating",
            duration=self.duration,
            joint_motion=motion,
            wheel_torque=torque,
        )

    @cached_property
    def _waves(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angular frequencies (H,), and cosines and sines (H, times)."""
        w = 2.0 * np.pi * PERIODS / self.duration * np.arange(1, HARMONICS + 1)
        phase = np.outer(w, np.linspace(0.0, self.duration / PERIODS, LOOKS))
        return w, np.cos(phase), np.sin(phase)

    def _joints(self, parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        w, cos, sin = self._waves
        a, b = parts[:, 0], parts[:, 1]
        b = b - (b @ w)[:, None] * w / (w @ w)  # at rest at the start
        swing = a @ (cos - 1.0) + b @ sin
        rate = (b * w) @ cos - (a * w) @ sin
        low, high, speed = self._joint_limits
        factor = np.full(len(a), np.inf)
        for room, reach in ((high, swing.max(axis=1)), (low, -swing.min(axis=1))):
            factor = np.minimum(factor, room / np.maximum(reach, 1e-12))
        factor = np.minimum(factor, speed / np.maximum(np.abs(rate).max(axis=1), 1e-12))
        factor *= np.minimum(1.0, np.linalg.norm(parts.reshape(len(a), -1), axis=1))
        return a * factor[:, None], b * factor[:, None]

    @cached_property
    def _joint_limits(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Room below and above home [rad], and rate [rad/s], each (joints,)."""
        own, limits, names = self.model.joint_limits, self.limits, self.model.arm_joints.names
        home = self.model.joint_angles(self.model.home)
        endless = np.isinf(own.upper)
        unused = limits.margin * np.where(endless, 0.0, own.upper - own.lower) / 2.0
        low = np.where(endless, 2.0 * np.pi, home - own.lower - unused)
        high = np.where(endless, 2.0 * np.pi, own.upper - home - unused)
        for i in np.flatnonzero(np.minimum(low, high) <= 0.0):
            raise ExperimentError(
                f"{names[i]} is at its limit at home: {home[i]:.4g} rad of "
                f"{own.lower[i]:.4g} to {own.upper[i]:.4g} rad.",
                advice="Give the arm another `home`.",
            )
        if limits.swing is not None:
            low, high = (np.minimum(x, limits.usable_share * limits.swing) for x in (low, high))
        speed = own.rate if limits.joint_rate is None else np.minimum(own.rate, limits.joint_rate)
        if not np.isfinite(speed).all():
            name = names[int(np.argmax(~np.isfinite(speed)))]
            raise ExperimentError(
                f"{name} has no limit of its rate.", advice="State it in the URDF, or give --joint-rate."
            )
        return low, high, limits.usable_share * speed

    def _wheels(self, parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        a, b = parts[:, 0], parts[:, 1]
        series = Fourier(PERIODS / self.duration, a, b, np.zeros(len(a)))
        times = np.linspace(0.0, self.duration, LOOKS)
        peak = np.abs(series.sampled(times)).max(axis=0)
        spin = np.abs(single_integral(series, times)).max(axis=0) / spin_inertias(self.model)
        factor = np.full(len(a), np.inf)
        for i, wheel in enumerate(self.model.description.wheel):
            torque = least(wheel.max_torque, self.limits.wheel_torque)
            rate = least(wheel.max_rate, self.limits.wheel_rate)
            if torque is None and rate is None:
                raise ExperimentError(
                    f"{wheel.name} has no limit of torque or rate.",
                    advice="State `max_torque` in the description, or give --wheel-torque.",
                )
            for limit, value in ((torque, peak[i]), (rate, spin[i])):
                if limit is not None:
                    factor[i] = min(factor[i], self.limits.usable_share * limit / max(value, 1e-12))
        factor *= np.minimum(1.0, np.linalg.norm(parts.reshape(len(a), -1), axis=1))
        return a * factor[:, None], b * factor[:, None]
