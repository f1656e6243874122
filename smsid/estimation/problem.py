"""A recording, or several, to be explained: samples, commands, how they act, noise, what is known before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np

from smsid.estimation.bias_walk import BiasWalk
from smsid.estimation.input_hold import Hold, commanded_inputs
from smsid.estimation.measurements import ChannelSlice, Measurements
from smsid.estimation.parameter_vector import JointPrior
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording
from smsid.simulate import Inputs

SUBSTEP = 0.025  # [s] longest step of the integration between samples, unless the motion needs shorter ones


@dataclass(frozen=True)
class CommandTiming:
    """How commands act between samples, and on which side of a jump accelerations are sampled.

    ``anywhere``: what jumps does so at an unknown time between two samples, not at one of them.
    """

    hold: Hold = "held"
    side: Literal["left", "right"] = "right"
    anywhere: bool = False

    @property
    def words(self) -> str:
        """How commands act between samples, to be read."""
        return f"{self.hold}, jumping between samples" if self.anywhere else self.hold


@dataclass(frozen=True)
class ProcessNoise:
    """Process noise: standard deviations of the inputs' errors, held over a sample, and of the start.

    ``force`` [N], ``torque`` [N m] on the bus, ``joint`` and ``wheel`` torques [N m] (joints,), (wheels,).
    ``hidden`` are those of slosh and modal coordinates at the start [m, m/s]. ``more`` adds noise to single
    inputs: velocity coordinate and standard deviation [N, N m]; ``shapes`` the same where a law of friction
    is not known exactly in shape, so that its errors repeat with the rate (`shape_errors`). ``accelerations``
    are those of errors of the model, held over a sample, too: velocity coordinate and what it is moved by
    alone [m/s^2, rad/s^2].
    """

    force: float = 1e-6
    torque: float = 1e-6
    joint: float = 1e-6
    wheel: float = 1e-7
    hidden: tuple[float, float] = (1e-2, 1e-2)
    more: tuple[tuple[int, float], ...] = ()
    shapes: tuple[tuple[int, float], ...] = ()
    accelerations: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True)
class Belief:
    """What is known of a state: q (nq,), v (nv,), covariance (2 nv, 2 nv) of the tangent of q and of v."""

    q: np.ndarray
    v: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True)
class UnknownInput:
    """A generalised force that nobody recorded, estimated with the state: a random walk.

    ``dof`` is where it acts, an index in v; ``sigma`` its standard deviation at the first sample [N, N m],
    ``walk`` by how much it wanders [N/sqrt(s), N m/sqrt(s)]. Where it has a ``slope``, the standard deviation
    of its rate at the first sample [N/s, N m/s], it is an integrated walk: it goes straight between samples,
    its rate is a state too, and that is what wanders, by ``walk`` [N/s/sqrt(s)]. It comes on top of what was
    commanded. That of a ``motor`` whose command is recorded is held between samples where commands are. Where
    it drives what is measured, ``row`` is that reading: how far it wanders is no evidence for anything.
    """

    dof: int
    sigma: float
    walk: float
    motor: bool = False
    row: int = -1
    slope: float = 0.0


class UnknownForces(NamedTuple):
    """Unknown inputs as a filter takes them: they act on ``acts`` (k,); of those ``sloped`` (j,), places
    among the k, rates are states after them. ``walk`` (3, k + j) is what random walks add in a second: to the
    variance of each, to what that has in common with its mean over the interval, and to the variance of the
    mean.
    """

    acts: np.ndarray
    sloped: np.ndarray
    walk: np.ndarray


def unknown_forces(inputs: Sequence[UnknownInput], timing: CommandTiming) -> UnknownForces:
    """Return unknown inputs as a filter takes them.

    The mean of a walk in continuous time has a third of what its end has, and half of it in common. What is
    held jumps at the samples: where accelerations are those just before a jump, when the interval begins.
    Rates jump there, too: all that is between samples is a straight line.
    """
    held = {"left": (1.0, 1.0, 1.0), "right": (1.0, 0.0, 0.0)}[timing.side]
    shares = [held if u.motor and timing.hold == "held" else (1.0, 1.0 / 2.0, 1.0 / 3.0) for u in inputs]
    walk = [np.array(s) * (0.0 if u.slope else u.walk**2) for s, u in zip(shares, inputs, strict=True)]
    walk += [np.full(3, u.walk**2) for u in inputs if u.slope]
    return UnknownForces(
        np.array([u.dof for u in inputs], dtype=np.int64),
        np.array([i for i, u in enumerate(inputs) if u.slope], dtype=np.int64),
        np.ascontiguousarray(np.array(walk).reshape(-1, 3).T),
    )


def unknown_sigmas(inputs: Sequence[UnknownInput]) -> np.ndarray:
    """Return standard deviations of unknown inputs and their rates (k + j,) at the first sample."""
    return np.array([u.sigma for u in inputs] + [u.slope for u in inputs if u.slope])


class MovingStart(NamedTuple):
    """A hidden joint that is not at rest as a recording begins: where it is about, ``at`` (nq,) [m, or as the
    mode has it], and its ``rate`` (nv,). ``sigmas`` (2 nv,) are standard deviations of both, where they are
    not those of the noise.
    """

    joint: str
    at: tuple[float, ...]
    rate: tuple[float, ...]
    sigmas: tuple[float, ...] = ()


@dataclass(frozen=True)
class RecordingPart:
    """One of the recordings of a problem of several: what of it is its own.

    ``first`` is its first sample, ``shift`` by what it is later than by its own clock [s]. At a point
    (`at_point`) it has the ``blocks`` that its sensors are read through, and a ``model`` of its own where an
    effect is not in every recording.
    """

    label: str
    recording: Recording
    locked: np.ndarray
    timing: CommandTiming
    first: int
    shift: float = 0.0
    moves: tuple[MovingStart, ...] = ()
    blocks: tuple[ChannelSlice, ...] = ()
    model: SpacecraftModel | None = None


@dataclass(frozen=True)
class Problem:
    """A recording to be explained: samples, commands, how they are taken, and what is known together before.

    ``substep`` is the longest step of the integration between samples [s], ``begin`` what is known of the
    state at the first sample (read from it, with wide standard deviations, when not given).
    ``unknown_inputs`` are states of the filter, too, after q and v, and ``bias_walks`` after these. ``parts``
    are the recordings, where there are several (`joint_problem`): ``recording`` and ``timing`` are then the
    first's. ``coloured``: noise levels count what the model cannot follow, whose spectrum is no noise's.
    ``averaged``: parameters are compared in the mean over all torques, even where they may be `profiled`.
    ``of_all_readings``: where they are, likelihoods are of all readings (`at_likeliest_motion`). ``moves`` is
    where hidden joints begin (`smsid.estimation.moving_start`), unless ``begin`` says so. ``shift`` is by
    what the recording, of several the first, is later than by its own clock [s].
    """

    recording: Recording
    data: Measurements
    locked: np.ndarray
    timing: CommandTiming
    noise: ProcessNoise
    joint: JointPrior = field(default_factory=JointPrior)
    substep: float = SUBSTEP
    begin: Belief | None = None
    unknown_inputs: tuple[UnknownInput, ...] = ()
    parts: tuple[RecordingPart, ...] = ()
    bias_walks: tuple[BiasWalk, ...] = ()
    coloured: bool = False
    averaged: bool = False
    of_all_readings: bool = False
    moves: tuple[MovingStart, ...] = ()
    shift: float = 0.0

    @property
    def own_times(self) -> np.ndarray:
        """Times of the samples (N,) by the clock of the recording, of several by the first's [s]."""
        return self.data.times - self.shift

    @property
    def given(self) -> np.ndarray:
        """Whether readings (rows,) follow unknown inputs; the likelihood is of the others beside them.

        Source: the partial likelihood of Cox, Biometrika 62 (1975) 269.
        """
        out = np.zeros(self.data.rows, dtype=bool)
        out[[u.row for u in self.unknown_inputs if u.row >= 0]] = True
        return out

    @property
    def profiled(self) -> bool:
        """Whether parameters are compared by the likelihood at the likeliest torques, not in the mean of all.

        So where joints or wheels follow their measured motion, beside a recorded command or without one. How
        torques may wander is a guess, and in the mean over what such a prior allows inertias seem larger or
        smaller, and a panel faster or slower, as in a regression on a measured variable: noise is taken for
        motion. At the likeliest torques they do not: that is the total least squares of Golub and Van Loan,
        SIAM J. Numer. Anal. 17 (1980) 883. A command is where torques wander about, no evidence for its own
        scale or for that of the readings. Where errors of inputs are noise, too, it is no measured motion's
        alone; and along what no torque has moved, there is nothing but noise to compare, which makes
        inertias as small as it likes: see `smsid.estimation._likeliest_torques`.
        """
        followed = any(u.row >= 0 for u in self.unknown_inputs)
        return followed and not (self.noise.more or self.averaged)

    @property
    def at_likeliest_motion(self) -> bool:
        """Whether likelihoods that are `profiled` are those at the likeliest motion, of all readings.

        That is a minimum over states and torques, along which slopes are exact
        (`smsid.estimation._smoothed_motion`). Else what was read of joints and wheels is given, and what is
        compared are the others beside: in a search, where readings that a wrong model leaves far off are not
        to lead.
        """
        return self.profiled and self.of_all_readings

    def inputs(self, model: SpacecraftModel) -> Inputs:
        """Return what was commanded; what switches anywhere between samples does so slowly, from one to the
        other, which is right in the mean.
        """
        timing, required = self.timing, self.begin is None
        return commanded_inputs(model, self.recording, timing.hold, required=required, slowly=timing.anywhere)


def recordings_of(problem: Problem) -> tuple[Problem, ...]:
    """Return the problem of every recording by itself, on the common clock; of one, the problem itself."""
    if not problem.parts:
        return (problem,)
    out = []
    for part, here in zip(problem.parts, samples_of_each(problem), strict=True):
        data = problem.data
        attitude = {c: q[here] for c, q in data.attitude.items()}
        own = replace(data, times=data.times[here], values=data.values[here], attitude=attitude)
        own = replace(own, blocks=part.blocks or own.blocks)
        out.append(
            replace(
                problem,
                recording=part.recording,
                data=own,
                locked=part.locked,
                timing=part.timing,
                moves=part.moves,
                parts=(),
                shift=part.shift,
            )
        )
    return tuple(out)


def samples_of_each(problem: Problem) -> list[slice]:
    """Return which samples are of which recording."""
    first = [p.first for p in problem.parts]
    return [slice(a, b) for a, b in zip(first, [*first[1:], len(problem.data.times)], strict=True)]
