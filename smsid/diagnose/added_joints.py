"""Candidates that add joints: a tank more, a bending mode more."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from smsid.diagnose.added_oscillator import AddedOscillatorHypothesis, Oscillating
from smsid.diagnose.truncated_mode import HigherMode
from smsid.effects.appendage import Appendage
from smsid.estimation.parameter_vector import Point
from smsid.estimation.problem import Problem
from smsid.model.regressor import body_names

SLOSH = (0.03, 1.0)  # [Hz] between which a tank's frequency is looked for
MODE = (0.08, 3.0)  # [Hz] the same of a bending mode
RATIO = 1.13  # of neighbours in the grid
CYCLES = 1.5  # least number of them in a recording
CENTRE = 0.7265  # of a uniform cantilever's first mode: where its moving mass sits, in lengths
MOST_MODES = 20  # of a beam
FURTHER = 2  # of them that are looked for
PER_CYCLE = 5.0  # least number of samples


def more_slosh(point: Point, problem: Problem) -> Iterator[Oscillating]:
    """Yield the candidate of one more slosh mass in the bus."""
    model = point.base
    if not model.free:
        return
    springs = AddedOscillatorHypothesis(np.zeros(3), np.eye(3), np.eye(3))
    name = _unused(point, "slosh_more")
    grid = _grid(problem, SLOSH)
    yield Oscillating(
        "slosh", body_names(model.pin)[0], "slosh", "another slosh mass", None, (), (),
        name=name, springs=springs, frequencies=grid,
    )  # fmt: skip


def more_modes(point: Point, problem: Problem) -> Iterator[Oscillating]:
    """Yield the candidate of one more mode of every appendage of the bus, that bends as its first does."""
    model = point.base
    for joints in model.appendages:
        part: Appendage = joints.appendage
        if not model.free or joints.parent != 1:
            continue
        bending = [m for m in part.modal_data() if np.linalg.norm(m.translation) > 0.0]
        if not bending:
            continue
        along = np.asarray(bending[0].translation)
        size = float(np.linalg.norm(along))
        # anywhere along it: half its length, give or take a uniform distribution's standard deviation
        whole = np.cross(along, np.asarray(bending[0].rotation)) / size**2 / CENTRE
        rest = 0.5 * whole
        turn, root = joints.placement.rotation, joints.placement.translation
        across = [k for k in range(3) if k != int(np.argmax(np.abs(along)))]
        springs = AddedOscillatorHypothesis(
            root + turn @ rest,
            (turn @ along / size)[None],
            np.array([turn[:, k] for k in across]),
            spread=max(float(np.linalg.norm(whole)), 0.1) / np.sqrt(12.0),
        )
        yield Oscillating(
            "extra_mode", part.name, "appendage", "another mode", None, (), (),
            name=_unused(point, f"{part.name}_more"), springs=springs, frequencies=_grid(problem, MODE),
            appendage=part.name, turn=turn.T, root=root,
        )  # fmt: skip


def higher_modes(point: Point, problem: Problem) -> Iterator[HigherMode]:
    """Yield the candidates of every beam's next modes, where accelerometers on it would see them."""
    model = point.base
    seen = {s.appendage for s in point.description.effective_sensors() if s.kind == "accelerometers"}
    rate = 1.0 / float(np.median(np.diff(problem.data.times)))
    for joints in model.appendages:
        beam: Appendage = joints.appendage
        if not (beam.name in seen and model.free and joints.parent == 1):
            continue
        further = (e for e in point.description.effect if e.needs_beam and e.part_of() == beam.name)
        has = {getattr(e, "mode", 0) for e in further}
        missing = [n for n in range(len(joints.joints) + 1, MOST_MODES + 1) if n not in has]
        for number in missing[:FURTHER]:
            mode = beam.higher_mode(number)
            if mode is None:
                break
            name = _unused(point, f"beam_mode_{beam.name}_{number}")
            candidate = HigherMode.of(beam.name, mode, joints.placement, number, name)
            if candidate.highest * PER_CYCLE < rate:
                yield candidate


def _unused(point: Point, name: str) -> str:
    taken = {e.name for e in point.description.effect}
    return next(n for n in (name, *(f"{name}{k}" for k in range(2, 99))) if n not in taken)


def _grid(problem: Problem, band: tuple[float, float]) -> tuple[float, ...]:
    """Return frequencies [Hz] of a band that the recording is long and dense enough for."""
    times = problem.data.times
    low = max(band[0], CYCLES / float(times[-1] - times[0]))
    high = min(band[1], 1.0 / (PER_CYCLE * float(np.median(np.diff(times)))))
    count = max(2, int(np.ceil(np.log(max(high / low, 1.01)) / np.log(RATIO))))
    return tuple(float(f) for f in np.geomspace(low, max(high, 1.01 * low), count))
