"""Exp. 2 from a recording of hours: Steps A and B window by window, in memory that does not grow.

The recording is read three times: for the factors of Step A; for Step A's covariance and the factors of Step
B; for Step B's covariance. What is not measured is carried from window to window: the slosh exactly, the
modal states by the filter, smoothed with the window after as what is still to come.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from smsid._short_repr import short_repr
from smsid.errors import NotIdentifiableError
from smsid.identify.hidden_states import LEAST_NOISE, check_on_bus
from smsid.identify.modal_state import ModalState, smooth_modes
from smsid.identify.momentum import NOTHING, HiddenStates, Regression, StepA, rows_a, rows_b
from smsid.identify.momentum_rows import CORRELATION_TIME, Split, carried_by_bus, select_unknowns
from smsid.identify.motion import Motion, prepare
from smsid.identify.noise_replicates import add_noise_replicate
from smsid.identify.robust import white_sigma
from smsid.identify.slosh_state import estimate_slosh
from smsid.identify.square_root_information import RowSums, ScoreSums
from smsid.model.identifiable import base_parameters
from smsid.model.regressor import Regressor
from smsid.model.spacecraft import SpacecraftModel
from smsid.recording import Recording

MARGIN = 5.0  # [s] read on both sides of a window, in which filters settle

Chunk = tuple[Motion, HiddenStates]
Chunks = Callable[[], Iterator[Chunk]]


class Windows(Protocol):
    """A recording too long to hold: from ``start`` to ``stop`` [s], of which a window can be read."""

    start: float
    stop: float

    def window(self, t0: float, t1: float) -> Recording:
        """Return the recording from t0 to t1 [s], both included."""
        ...


@short_repr
@dataclass(frozen=True)
class StreamedMomentum:
    """Steps A and B, and how many samples of motion they are from."""

    a: StepA
    b: Regression
    samples: int


def identify_streamed(
    model: SpacecraftModel,
    windows: Windows,
    mass: float,
    *,
    length: float = 200.0,
    cutoff: float = 2.0,
    rate: float = 20.0,
) -> StreamedMomentum:
    """Identify inertial parameters as `identify_momentum` does, ``length`` [s] at a time.

    ``model`` carries slosh and appendages, these as `linear_appendages` gives them, ``mass`` is M [kg]; the
    recording starts at rest. Errors of the columns are those that noise once more shows, as there; its
    repetitions, and the errors of Exp. 1, are not carried over. ``length`` is rounded to whole samples at
    ``rate`` [Hz] and should hold a few periods of the slowest mode. Raises what `step_a` and `step_b` raise.
    """
    check_on_bus(model)

    def chunks() -> Iterator[Chunk]:
        return with_hidden_states(model, motion_windows(model, windows, length, cutoff, rate))

    return momentum_of_chunks(model, chunks, mass)


def momentum_of_chunks(model: SpacecraftModel, chunks: Chunks, mass: float) -> StreamedMomentum:
    """Return Steps A and B of motions that follow each other; ``chunks()`` gives them anew every time.

    Raises `NotIdentifiableError` as `step_a` and `step_b` do, and without samples.
    """
    regressor = Regressor(model)
    parts_a = Split.of(model, regressor, bus_first=False)
    parts_b = Split.of(model, regressor, bus_first=True)

    start: float | None = None  # of the recording, where Step A's centre of mass is meant

    def equations_a(motion: Motion, hidden: HiddenStates) -> tuple[np.ndarray, np.ndarray]:
        return rows_a(model, regressor, parts_a, motion, hidden, mass, start)

    sums, step = RowSums(3), 0.0
    for motion, hidden in chunks():
        start = float(motion.time[0]) if start is None else start
        sums.add(*equations_a(motion, hidden), _again(equations_a, motion, hidden))
        step = motion.step if len(motion) > 1 else step
    if not sums.samples:
        raise NotIdentifiableError("The recording has no samples.", advice="Give one of a few minutes.")
    base = NOTHING
    if parts_a.unknown:
        own = range(6, 6 + len(parts_a.unknown))
        base = base_parameters(sums.columns(range(3), own), parts_a.names, parts_a.units)
    kept = [*range(6), *(6 + int(i) for i in base.independent)]
    labels = ["v_cm.x", "v_cm.y", "v_cm.z", "r_cm.x", "r_cm.y", "r_cm.z", *base.names]
    ones = np.ones(3)
    solution, root = sums.solved(kept, ones, labels)
    scores = ScoreSums(max(1, round(CORRELATION_TIME / step)))
    centre = solution.x[3:6]

    def equations_b(motion: Motion, hidden: HiddenStates) -> tuple[np.ndarray, np.ndarray]:
        return rows_b(model, regressor, parts_b, motion, hidden, mass, centre)

    sums_b = RowSums(6)
    for motion, hidden in chunks():
        _score(scores, equations_a(motion, hidden), kept, solution.x, ones)
        sums_b.add(*equations_b(motion, hidden), _again(equations_b, motion, hidden))
    found = replace(solution, covariance=scores.covariance(root))
    a = StepA(
        velocity=found.x[:3],
        position=found.x[3:6],
        position_sigma=found.standard_deviation[3:6],
        moments=Regression(base, select_unknowns(found, slice(6, None)), parts_a.names),
    )
    count = len(parts_b.names)
    base = base_parameters(sums_b.columns(range(6), range(count)), parts_b.names, parts_b.units)
    kept = [*base.independent.tolist(), *range(count, count + 3)]
    labels = [*base.names, "r_cm.x", "r_cm.y", "r_cm.z"]
    weights = np.ones(6)
    solution, root = sums_b.solved(kept, weights, labels)
    size = sums_b.residual(kept, solution.x)
    weights = 1.0 / np.maximum(size, 1e-9 * size.max())
    solution, root = sums_b.solved(kept, weights, labels)
    scores = ScoreSums(scores.lags)
    for motion, hidden in chunks():
        _score(scores, equations_b(motion, hidden), kept, solution.x, weights)
    found = select_unknowns(replace(solution, covariance=scores.covariance(root)), slice(0, len(base)))
    turning = sums_b.columns(range(3), [*base.independent.tolist(), -1])
    lengths = np.linalg.norm(turning, axis=0)
    shares = lengths[:-1] * np.abs(found.x) / lengths[-1]
    carried = base.matrix @ carried_by_bus(model, regressor)[parts_b.unknown]
    b = Regression(base, replace(found, x=found.x + carried), parts_b.names, shares)
    return StreamedMomentum(a, b, sums.samples)


def _again(
    equations: Callable[[Motion, HiddenStates], tuple[np.ndarray, np.ndarray]],
    motion: Motion,
    hidden: HiddenStates,
) -> tuple[np.ndarray, np.ndarray] | None:
    return None if motion.again is None else equations(motion.again, hidden.again or hidden)


def _score(
    scores: ScoreSums,
    equations: tuple[np.ndarray, np.ndarray],
    kept: list[int],
    x: np.ndarray,
    weights: np.ndarray,
) -> None:
    rows, rhs = equations[0][:, :, kept], equations[1]
    scores.add(rows * weights[:, None], (rhs - rows @ x) * weights)


def motion_windows(
    model: SpacecraftModel, windows: Windows, length: float, cutoff: float, rate: float
) -> Iterator[Motion]:
    """Yield the motion in pieces of ``length`` [s], each prepared with a margin that is then left out.

    The noise that is added once more is drawn anew for every piece, the same at every reading.
    """
    step = 1.0 / rate
    length, margin = (max(round(x / step), 1) * step for x in (length, MARGIN))
    sensors = model.description.effective_sensors()
    count = max(1, int(np.ceil((windows.stop - windows.start) / length - 1e-9)))
    for k in range(count):
        first = windows.start + k * length
        last = first + length if k + 1 < count else np.inf
        read = windows.window(max(first - margin, windows.start), min(last + margin, windows.stop))
        noisier = add_noise_replicate(read, sensors, np.random.default_rng([0, k]))
        motion = prepare(model, read, cutoff=cutoff, rate=rate)
        motion = replace(motion, again=prepare(model, noisier, cutoff=cutoff, rate=rate))
        inside = (motion.time > first - 0.25 * step) & (motion.time < last - 0.25 * step)
        if inside.any():
            yield motion.only(inside)


def with_hidden_states(model: SpacecraftModel, pieces: Iterator[Motion]) -> Iterator[Chunk]:
    """Yield every motion with its hidden states, carried on from the one before; a piece late."""
    states = HiddenStateCarrier(model)
    for motion in pieces:
        if (chunk := states.push(motion)) is not None:
            yield chunk
    if (chunk := states.push(None)) is not None:
        yield chunk


class HiddenStateCarrier:
    """Hidden states of motions that follow each other; a piece comes out when the one after it is there."""

    def __init__(self, model: SpacecraftModel) -> None:
        self.model = model
        self._carry, self._carry_again = Carry({}, {}), Carry({}, {})
        self._noises: tuple[dict[str, float], dict[str, float]] | None = None
        self._before: Motion | None = None
        self._previous: Motion | None = None

    def push(self, motion: Motion | None) -> Chunk | None:
        """Take in the next motion, or ``None`` at the end; return the one before with its hidden states."""
        previous, out = self._previous, None
        if previous is not None:
            self._noises = self._noises or _noises(self.model, previous)
            hidden = _carried(self.model, self._before, previous, motion, self._carry, self._noises[0])
            if previous.again is not None:
                more = [m.again if m is not None else None for m in (self._before, previous, motion)]
                assert more[1] is not None
                other = _carried(self.model, more[0], more[1], more[2], self._carry_again, self._noises[1])
                hidden = replace(hidden, again=other)
            out = previous, hidden
        self._before, self._previous = previous, motion
        return out


@dataclass
class Carry:
    """Where hidden states are at the end of a piece: slosh (rho, rho'), the filter of every panel."""

    slosh: dict[str, tuple[np.ndarray, np.ndarray]]
    modes: dict[str, tuple[np.ndarray, np.ndarray]]


def _carried(
    model: SpacecraftModel,
    before: Motion | None,
    motion: Motion,
    after: Motion | None,
    carry: Carry,
    noise: dict[str, float],
) -> HiddenStates:
    """Hidden states of a piece, with the last sample of the one before and the one after as what comes."""
    joined, skip = motion, 0
    if before is not None:
        joined, skip = before.only(slice(-1, None)).followed_by(motion), 1
    kept = slice(skip, skip + len(motion))
    slosh, modes = {}, {}
    for joint in model.slosh:
        tank, name = joint.tank, joint.name
        springs = np.array(tank.stiffness), np.array(tank.damping)
        start = carry.slosh.get(name)
        rho, rate = estimate_slosh(joined, joint.position, tank.mass, *springs, start=start)
        carry.slosh[name] = rho[-1], rate[-1]
        slosh[name] = rho[kept], rate[kept]
    longer = joined if after is None else joined.followed_by(after)
    for panel in model.appendages:
        name = panel.appendage.name
        own = smooth_modes(
            longer,
            panel,
            accelerometer=noise.get(name, noise["imu"]),
            imu=noise["imu"],
            start=carry.modes.get(name),
            going_on=True,
        )
        assert own.forward is not None
        last = skip + len(motion) - 1
        carry.modes[name] = own.forward[0][last], own.forward[1][last]
        modes[name] = ModalState(own.position[kept], own.velocity[kept])
    return HiddenStates(slosh, modes)


def _noises(model: SpacecraftModel, motion: Motion) -> tuple[dict[str, float], dict[str, float]]:
    """Noise of the prepared accelerations, read from the first piece, without and with noise once more."""

    def of(motion: Motion) -> dict[str, float]:
        values = {"imu": motion.acceleration, **motion.panels}
        return {k: max(float(np.sqrt(np.mean(white_sigma(x) ** 2))), LEAST_NOISE) for k, x in values.items()}

    return of(motion), of(motion.again if motion.again is not None else motion)
