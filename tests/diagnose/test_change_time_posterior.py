"""How well a beginning is known: against errors of the best of all, over many draws of noise."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from smsid.diagnose._change_time_posterior import Starts, onset_posteriors, start_of
from smsid.diagnose.hypotheses import propose
from smsid.diagnose.verdict import values
from smsid.estimation.map_estimate import evaluate

CASES = [
    (("torque_gain", "joint2", "torque constant"), 0.002),
    (("torque_gain", "joint2", "torque constant"), 0.0007),  # hardly more than an onset has to gain
    (("joint_friction", "joint1", "viscous"), 0.4),
]
START, DRAWS, WIDE, FEW = 3.2, 200, 60, 12


def begun(known, problem, key, size, start=START):
    """A fit with an effect that begins midway, the effect, and its strength's place among the parameters."""
    own = next(c for c in propose(known.point, problem, known.unknowns) if c.key == key)
    late = own.effect.model_copy(update={"start": start}).with_values({own.free[0]: size})
    unknowns = (*known.unknowns, *own.unknowns(known.unknowns))
    found = evaluate(known.point.with_effect(late), unknowns, problem)
    return found, late, [u.name for u in unknowns].index(own.free[0]), replace(own, effect=late)


def drawn(found, rng):
    """The fit as noise, and knowledge as good as its priors say, would have left it."""
    innovations = rng.standard_normal(found.run.innovations.shape) * found.run.used
    off = rng.standard_normal(found.prior.off.shape)
    return replace(
        found, run=replace(found.run, innovations=innovations), prior=replace(found.prior, off=off)
    )


@pytest.mark.parametrize(("key", "size"), CASES)
def test_it_is_as_large_as_the_errors_of_the_best_fit(known, problem, key, size):
    found, late, k, _ = begun(known, problem, key, size)
    sample = float(np.median(np.diff(found.run.states.time)))
    times = START + 0.5 * sample * np.arange(-2 * WIDE, 2 * WIDE + 1)
    others = Starts(found, late).columns(times.tolist())
    nuisance = np.delete(np.arange(len(found.unknowns)), k)
    flat = found.whitened.reshape(-1, len(found.unknowns))
    design = np.vstack([flat, found.prior.rows])[:, nuisance]
    left = others - design @ (np.linalg.pinv(design) @ others)
    squares = (left**2).sum(axis=0)
    errors, early, said = [], [], []
    for seed in range(DRAWS):
        noisy = drawn(found, np.random.default_rng(seed))
        there = noisy.residual + others[:, 2 * WIDE]
        along = there @ left
        best = int(np.argmax(along**2 / squares))
        early.append(times[best] - START)
        errors.append(size * (along[best] / squares[best] - 1.0))
        if abs(early[-1]) < 0.6 * sample and len(said) < FEW:  # a fit is where it is best
            one = start_of(noisy, late)
            said.append((one.sigma**2, one.covariance[k, k]))
    assert len(said) == FEW
    known_to, more = np.mean(said, axis=0)
    whole = found.sigma(found.unknowns[k].name) ** 2 + more
    assert 0.6 < np.mean(np.square(early)) / known_to < 1.6
    assert 0.7 < np.mean(np.square(errors)) / whole < 1.4


def test_parameters_are_as_uncertain_as_when_they_began_makes_them(known, problem):
    found, late, k, own = begun(known, problem, *CASES[-1])
    cause = SimpleNamespace(score=SimpleNamespace(candidate=own))
    starts = onset_posteriors(found, [cause, cause])
    assert list(starts) == [late.name]
    assert not onset_posteriors(found, [cause], {late.name})  # it is said to begin then
    (value,) = values(SimpleNamespace(last=found, bent={}), own, starts)
    alone = found.sigma(value.name)
    assert value.sigma**2 == pytest.approx(alone**2 + starts[late.name].covariance[k, k])
    assert value.sigma > 1.05 * alone
    always = found.point.with_effect(late.model_copy(update={"start": None}))
    assert not onset_posteriors(replace(found, point=always), [cause])
