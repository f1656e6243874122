"""A mass more on springs: its first-order signature against the filter on the whole model."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import dual_annealing

from smsid.diagnose._added_oscillator import (
    LEAST,
    STEP,
    AddedOscillatorHypothesis,
    OscillatorHypothesis,
    _forces,
    oscillator_responses,
)
from smsid.diagnose._profiled_hypothesis import Shape
from smsid.diagnose.hypotheses import more_slosh
from smsid.diagnose.score_test import least_squares
from smsid.effects import Slosh
from smsid.estimation.map_estimate import evaluate
from smsid.estimation.sensitivities import propagate

OMEGA, ZETA = np.array([3.0, 4.0, 5.0]), np.array([0.05, 0.1, 0.02])


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (-0.4, 0.3, 0.2)])
def test_signature_is_what_a_small_tank_does(known, calm, plain, place):
    """Innovations with one per cent of a kilogram more slosh, over the mass; all three axes apart."""
    axes, c, small = np.eye(3), np.array(place), 0.01
    columns = []
    for a in range(3):
        one = AddedOscillatorHypothesis(np.zeros(3), axes[a : a + 1], np.zeros((0, 3)))
        columns += oscillator_responses(plain.changes, one, c, OMEGA[a : a + 1], ZETA[a : a + 1])
    predicted = propagate(plain.run, columns).sum(axis=2)
    tank = Slosh(
        name="more",
        position=place,
        mass=small,
        stiffness=tuple(small * OMEGA**2),
        damping=tuple(2 * small * ZETA * OMEGA),
        mass_in_bus=True,
    )
    with_tank = evaluate(known.point.with_effect(tank), known.unknowns[:1], calm)
    seen = -(with_tank.run.innovations - plain.run.innovations) / small
    off = np.linalg.norm(seen - predicted) / np.linalg.norm(seen)
    assert off < 0.05
    shifted = np.roll(predicted, 2, axis=0)
    assert np.linalg.norm(seen - shifted) > 3.0 * np.linalg.norm(seen - predicted)


def test_first_moment_is_mass_times_place(plain):
    """The signature at a place is that at the origin and of the first moment, but for squares."""
    place, none = np.array([0.01, -0.02, 0.015]), np.zeros((0, 3))
    origin = oscillator_responses(
        plain.changes,
        AddedOscillatorHypothesis(np.zeros(3), np.eye(3), np.eye(3)),
        np.zeros(3),
        OMEGA[:1],
        ZETA[:1],
    )
    for a in range(3):
        parts = [origin[4 * a + j].middle for j in range(4)]
        off, first = [], []
        for share in (1.0, 0.5):
            there = oscillator_responses(
                plain.changes,
                AddedOscillatorHypothesis(place, np.eye(3)[a : a + 1], none),
                share * place,
                OMEGA[:1],
                ZETA[:1],
            )
            moved = there[0].middle - parts[0]
            linear = sum(share * x * p for x, p in zip(place, parts[1:], strict=True))
            off.append(np.linalg.norm(moved - linear))
            first.append(np.linalg.norm(moved))
        assert off[0] / off[1] == pytest.approx(4.0, rel=0.02)
        assert off[1] < 0.3 * first[1]


def test_unit_mass_is_a_damped_oscillator():
    """Exact for a drive held between samples, against an integrator."""
    rng, step = np.random.default_rng(0), 0.05
    held = rng.standard_normal(40)
    at = np.r_[0.0, held]
    found_at, found_middle = _forces(at, held, OMEGA[:1], ZETA[:1], step)

    def rate(t, x):
        drive = held[min(int(t / step), len(held) - 1)]
        return [x[1], -(OMEGA[0] ** 2) * x[0] - 2 * ZETA[0] * OMEGA[0] * x[1] - drive]

    x = np.zeros(2)
    for k in range(len(held)):
        pull = OMEGA[0] ** 2 * x[0] + 2 * ZETA[0] * OMEGA[0] * x[1]
        np.testing.assert_allclose(found_at[k, 0], pull + at[k], atol=1e-7)
        for half in range(2):
            span = (k * step + half * step / 2, k * step + (half + 1) * step / 2 - 1e-12)
            x = solve_ivp(rate, span, x, rtol=1e-9, atol=1e-11).y[:, -1]
            if half == 0:
                pull = OMEGA[0] ** 2 * x[0] + 2 * ZETA[0] * OMEGA[0] * x[1]
                np.testing.assert_allclose(found_middle[k, 0], pull + held[k], atol=1e-7)


def test_a_slosh_mass_stays_one(known, problem):
    """A fit may take it down to what does nothing, which no tank is below."""
    (candidate,) = more_slosh(known.point, problem)
    own, *_ = candidate.resolved(candidate.shapes()[0], np.array([3.0]))
    mass = own.unknowns(())[0]
    assert (mass.name, mass.nominal, mass.lower) == ("slosh_more.mass", 0.0, LEAST)
    there = known.point.with_effect(own.effect).moved((mass,), np.array([-1.0]))
    assert there.value(mass) == LEAST


def test_a_place_is_no_further_off_than_its_prior_lets_it_be():
    """Of a mass of which the moment alone is told, the place is where the prior and the data have it."""
    mass, place = 5.0, np.array([2.5, 0.0, 0.0])
    rng = np.random.default_rng(4)
    columns = rng.normal(size=(400, 4)) * np.array([0.2, 1.0, 1.0, 1.0])  # the mass by itself tells little
    truth = np.concatenate([[mass], mass * place / STEP])
    data = columns @ truth * 0.004
    gram, slope, raw = columns.T @ columns, columns.T @ data, np.sum(columns**2, axis=0)
    tank = OscillatorHypothesis(
        "slosh",
        "bus",
        "slosh",
        "",
        None,
        (),
        (),
        springs=AddedOscillatorHypothesis(np.zeros(3), np.eye(3), np.eye(3)),
    )
    shape = Shape((0, 1, 2, 3), (OMEGA, ZETA, np.zeros(3)))
    found, ratio, _ = tank.estimated(shape, gram, slope, raw)
    where = found[1:] / found[0] * STEP

    def worth(x):
        own = np.concatenate([[1.0], x / STEP])
        return x @ x - max(own @ slope, 0.0) ** 2 / (own @ gram @ own)

    oracle = dual_annealing(worth, [(-5.0, 5.0)] * 3, rng=1, maxiter=200)
    assert where == pytest.approx(oracle.x, abs=1e-3)
    assert ratio == pytest.approx(-oracle.fun, rel=1e-6)
    assert ratio < least_squares(gram, slope, raw)[2]
    away = Shape(shape.columns, (OMEGA, ZETA, np.array([1.0, 0.0, 0.0])))  # columns about another place
    assert tank.estimated(away, gram, slope, raw)[1] < ratio
