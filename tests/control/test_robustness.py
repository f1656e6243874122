"""Identified intervals inside the loop with slosh and panel: exact matrices, mu, worst parameters, tuning."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from control_cases import URDF, paper
from test_identified_model import true_estimate

from smsid._statistics import NORMAL95
from smsid.control._robust import closed_loop_matrix, flexible_plant
from smsid.control._uncertain_plant import uncertain_plant
from smsid.control.gains import gains
from smsid.control.identified_model import identified_level, identified_model, inertia_at
from smsid.control.robust_term import design_robust_term
from smsid.control.robustness import robust_stability, worst_parameters
from smsid.control.tuning import Demands, natural_modes, noise_error, tuned_gains
from smsid.control.weights import weights_from_level
from smsid.description import load_description
from smsid.effects.slosh import Slosh
from smsid.errors import ControlError
from smsid.identify.estimate import Estimate, classify
from smsid.model import build_model

HOME = paper().joint_angles(paper().home)
SIGMA = 2e-3


@cache
def case(sigma=SIGMA):
    estimate = true_estimate(sigma)
    identified = identified_model(paper().description, estimate)
    level = identified_level(identified, np.random.default_rng(0), draws=50)
    return uncertain_plant(identified, estimate, HOME), inertia_at(identified.dynamics(), HOME), level


@cache
def robust_term():
    quiet = np.full(6, 1e-6)
    weights = weights_from_level(
        0.05, np.full(6, 1e-3), left_out=1e-4, angle_noise=quiet, rate_noise=quiet, crossover=10.0
    )
    return design_robust_term(gains(6, 4.0, 4.0), weights).controller


def near(found, exact, tolerance):
    for pole in exact:
        assert np.abs(found - pole).min() < tolerance * max(1.0, abs(pole)), pole


def test_the_centre_is_the_loop_of_the_flexible_plant():
    plant, h, _ = case()
    k = gains(6, 4.0, 4.0)
    for term in (None, robust_term()):
        a = plant.closed_loop(np.zeros(len(plant.changes)), h, k, term)
        exact = closed_loop_matrix(flexible_plant(paper(), HOME), h, k, term)
        near(np.linalg.eigvals(a), np.linalg.eigvals(exact), 2e-5)


def test_changed_parameters_are_those_of_a_changed_description():
    """Slosh mass, stiffness and damping moved to the ends of their intervals: built anew from the TOML."""
    plant, h, _ = case(1e-2)
    ends = {"tank.mass": 1.0, "tank.stiffness.x": -1.0, "tank.damping.z": 1.0, "tank.stiffness.y": 0.5}
    delta = np.array([ends.get(c.name, 0.0) for c in plant.changes])
    assert {c.name for c in plant.changes} >= set(ends)
    described = load_description(URDF / "paper_sms.toml")
    tank = next(e for e in described.effect if isinstance(e, Slosh))
    half = {p.name: NORMAL95 * 1e-2 * p.value for p in tank.parameters()}
    values = {name: end * half[name] for name, end in ends.items()}
    moved = tank.with_values({p.name: p.value + values.get(p.name, 0.0) for p in tank.parameters()})
    other = build_model(described.with_effects(moved))
    exact = closed_loop_matrix(flexible_plant(other, HOME), h, gains(6, 4.0, 4.0))
    near(np.linalg.eigvals(plant.closed_loop(delta, h, gains(6, 4.0, 4.0))), np.linalg.eigvals(exact), 2e-5)


@pytest.mark.parametrize("term", [False, True])
def test_the_fractional_form_closes_to_the_same_loop(term):
    """F(N, Delta) with the scalars of any parameters has the poles of M(delta), D(delta), K(delta)."""
    plant, h, level = case()
    controller = robust_term() if term else None
    k = gains(6, 4.0, 4.0)
    n, blocks, owner = plant.fractional(h, k, controller, level=level)
    assert sum(b.size for b in blocks) == len(owner) == n.d.shape[0] == n.d.shape[1]
    rng = np.random.default_rng(1)
    delta = np.array([0.0 if c.rigid else rng.uniform(-1.0, 1.0) for c in plant.changes])
    closing = np.diag(np.where(owner >= 0, delta[owner], 0.0))
    a = n.a + n.b @ closing @ np.linalg.solve(np.eye(len(owner)) - n.d @ closing, n.c)
    near(np.linalg.eigvals(a), np.linalg.eigvals(plant.closed_loop(delta, h, k, controller)), 1e-7)


def test_an_identified_spacecraft_is_robustly_stable_and_a_thousand_plants_agree():
    plant, h, level = case()
    found = robust_stability(
        plant, h, gains(6, 4.0, 4.0), robust_term(), level=level, rng=np.random.default_rng(2)
    )
    assert found.stable and found.mu_upper < 1.0 and found.samples == 1000 and found.unstable == 0
    assert found.mu_lower <= found.mu_upper * 1.01
    assert 0.0 < found.damping <= found.sampled_damping * 1.01
    assert set(found.worst) == {c.name for c in plant.changes}


def test_a_slosh_damping_that_may_be_nothing_is_found_by_both_bounds():
    """Its interval reaches zero: mu is about one or more there, and the worst parameters say which."""
    low = [
        classify(p.name, p.value, p.unit, 1.0 * p.value, p.group) if "tank.damping" in p.name else p
        for p in true_estimate(SIGMA).parameters
    ]
    estimate = Estimate("paper_sms", "paper", tuple(low))
    identified = identified_model(paper().description, estimate)
    plant = uncertain_plant(identified, estimate, HOME)
    _, h, level = case()
    found = robust_stability(
        plant, h, gains(6, 4.0, 4.0), level=level, rng=np.random.default_rng(2), samples=50
    )
    assert found.mu_upper > 0.98 and 0.9 < found.mu_lower <= 1.01 * found.mu_upper
    assert found.frequency == pytest.approx(0.092, rel=0.02)
    assert min(found.worst[f"tank.damping.{axis}"] for axis in "xyz") == -1.0


def test_the_worst_parameters_are_worse_than_any_of_a_hundred_random_ends():
    plant, h, level = case(1e-2)
    k = gains(6, 4.0, 4.0)
    damping, delta = worst_parameters(plant, h, k, level=level, scale=1.0, rng=np.random.default_rng(0))

    def least(d):
        poles = np.linalg.eigvals(plant.closed_loop(d, h, k))
        return (-poles.real / np.abs(poles)).min()

    assert least(delta) == pytest.approx(damping)
    rng = np.random.default_rng(1)
    rigid = np.array([c.rigid for c in plant.changes])
    drawn = [np.where(rigid, 0.0, rng.choice([-1.0, 1.0], len(rigid))) for _ in range(100)]
    assert damping <= min(least(d) for d in drawn) + 1e-9


def test_an_unstable_loop_and_wrong_sizes_are_refused():
    plant, h, level = case()
    with pytest.raises(ControlError, match="not stable even at the identified values"):
        robust_stability(
            plant,
            np.diag([1, -1, 1, 1, 1, 1]) @ h,
            gains(6, 4.0, 4.0),
            level=level,
            rng=np.random.default_rng(0),
        )
    with pytest.raises(ControlError, match="parameters were given"):
        plant.closed_loop(np.zeros(3), h, gains(6, 4.0, 4.0))
    with pytest.raises(ControlError, match="those of no spacecraft"):
        plant.closed_loop(np.full(len(plant.changes), -1e4), h, gains(6, 4.0, 4.0))


def test_natural_frequencies_are_known():
    """errata: clamped panel 0.0457, 0.2864, 0.8018 Hz; free to turn 0.41 and about 1.88 and 5.1 rad/s."""
    plant, _, _ = case()
    modes = natural_modes(plant, np.random.default_rng(0))
    free = {m.name: m for m in modes if not m.held and m.name.startswith("panel")}
    assert free["panel.mode1"].frequency == pytest.approx(2 * np.pi * 0.0657, rel=0.02)
    assert free["panel.mode2"].frequency == pytest.approx(2 * np.pi * 0.298, rel=0.01)
    assert free["panel.mode3"].frequency == pytest.approx(2 * np.pi * 0.810, rel=0.01)
    slosh = [m for m in modes if m.name.startswith("tank")]
    assert len(slosh) == 6 and all(m.frequency == pytest.approx(0.092, rel=0.01) for m in slosh)
    assert all(m.low <= m.frequency <= m.high for m in modes)
    half = 0.5 * (slosh[0].high - slosh[0].low) / slosh[0].frequency
    assert 0.5 * 1.96 * SIGMA < 2.0 * half < 4.0 * 1.96 * SIGMA


def demands(**changes):
    base = {
        "disturbance": np.array([1e-5] * 3 + [1e-4] * 3),
        "angle_noise": np.array([1e-4] * 3 + [1e-5] * 3),
        "rate_noise": np.array([1e-5] * 3 + [1e-4] * 3),
        "strength": np.full(6, np.inf),
        "rate": 100.0,
    }
    return Demands(**{**base, **changes})


def test_tuned_gains_keep_clear_of_every_band_and_follow_the_noise():
    plant, h, _ = case()
    modes = natural_modes(plant, np.random.default_rng(0))
    flexible = flexible_plant(paper(), HOME)
    found = tuned_gains(flexible, h, demands(), modes)
    for w in (found.attitude, found.joints):
        assert not any(m.band[0] <= w <= m.band[1] for m in modes)
    np.testing.assert_allclose(np.diag(found.gains.proportional)[:3], found.attitude**2)
    np.testing.assert_allclose(np.diag(found.gains.derivative)[3:], 2.0 * found.joints)
    assert not any(p.flag for p in found.poles)
    louder = tuned_gains(flexible, h, demands(angle_noise=np.full(6, 1e-2)), modes)
    assert louder.attitude < found.attitude and louder.joints < found.joints
    slow = tuned_gains(flexible, h, demands(rate=10.0), modes)
    assert max(slow.attitude, slow.joints) <= 2.0
    late = tuned_gains(flexible, h, demands(fastest=3.0), modes)
    assert late.joints <= 3.0 < found.joints
    weak = tuned_gains(flexible, h, demands(strength=np.full(6, 2e-4)), modes)
    assert weak.attitude < found.attitude
    with pytest.raises(ControlError, match="No gains keep clear"):
        tuned_gains(flexible, h, demands(strength=np.full(6, 1e-9)), modes)


def test_noise_of_the_loop_is_as_predicted():
    """Against a simulation of the error dynamics with noise held from sample to sample."""
    w, rate, sigma = 1.0, 50.0, (1e-3, 2e-3)
    rng, state, found = np.random.default_rng(0), np.zeros(2), []
    a = np.array([[0.0, 1.0], [-(w**2), -2.0 * w]])
    step = np.eye(2) + a / rate + a @ a / (2 * rate**2) + a @ a @ a / (6 * rate**3)
    drive = np.linalg.solve(a, step - np.eye(2)) @ np.array([0.0, -1.0])
    for _ in range(100000):
        n = w**2 * sigma[0] * rng.standard_normal() + 2.0 * w * sigma[1] * rng.standard_normal()
        state = step @ state + drive * n
        found.append(state[0])
    assert np.std(found) == pytest.approx(noise_error(w, *sigma, rate), rel=0.05)
