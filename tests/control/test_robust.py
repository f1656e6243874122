"""The linear loop with slosh and panel inside: against the nonlinear spacecraft, names and flags."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from control_cases import paper, rigid_paper

from smsid.control._robust import (
    closed_loop_matrix,
    flexible_plant,
    least_damping,
    named_poles,
    refuse_unstable,
)
from smsid.control._sensed import measured_truth
from smsid.control._statespace import StateSpace
from smsid.control.closed_loop import Actuators
from smsid.control.gains import gains
from smsid.control.pd import ModelBasedController
from smsid.control.reduced import ReducedDynamics, perturb_bodies
from smsid.control.robust_term import design_robust_term, guarded_term
from smsid.control.trajectory import Reference, minimum_jerk
from smsid.control.weights import weights_from_level
from smsid.errors import ControlError

HOME = paper().joint_angles(paper().home)


def inertia_of(dynamics):
    return dynamics.body_terms(np.zeros(3), HOME, np.zeros(3)).inertia


def test_poles_are_those_of_the_nonlinear_closed_loop():
    """Central differences of the complete spacecraft under the controller; conserved quantities add zeros."""
    model = paper()
    dynamics = perturb_bodies(ReducedDynamics(model), 0.2, np.random.default_rng(0), "signs")
    k = gains(6, 0.64, 1.0)
    law = ModelBasedController(dynamics, k, Reference(minimum_jerk(HOME, HOME, 1.0)))
    act, nv, h = Actuators(model, 0.01), model.nv, 1e-6

    def rate(x):
        q, v = pin.integrate(model.pin, model.home, x[:nv]), x[nv:]
        tau = act(law.command(0.0, measured_truth(model, q, v)).torques, v[model.wheels.v])
        return np.concatenate([v, model.acceleration(0.0, q, v, tau)])

    a = np.array([(rate(h * e) - rate(-h * e)) / (2 * h) for e in np.eye(2 * nv)]).T
    numeric = np.linalg.eigvals(a)
    found = np.linalg.eigvals(closed_loop_matrix(flexible_plant(model, HOME), inertia_of(dynamics), k))
    for pole in found:
        assert np.abs(numeric - pole).min() < 1e-5 * max(1.0, abs(pole)), pole
    assert len(numeric) - len(found) == 12
    assert (np.sort(np.abs(numeric))[:12] < 1e-3).all()


def test_known_rigid_plant_has_the_poles_of_the_error_dynamics():
    model = rigid_paper()
    plant = flexible_plant(model, HOME)
    found = named_poles(plant, inertia_of(ReducedDynamics(model)), gains(6, 5.0, 2.0))
    np.testing.assert_allclose([p.value for p in found], -1.0 + 2.0j, rtol=1e-7)
    assert not any(p.flag for p in found)


def test_modes_are_named_and_pd_damps_them():
    poles = named_poles(
        flexible_plant(paper(), HOME), inertia_of(ReducedDynamics(paper())), gains(6, 4.0, 4.0)
    )
    names = {p.name for p in poles}
    assert {"panel.mode1", "panel.mode2", "panel.mode3", "tank x", "tank y", "tank z"} <= names
    assert all(p.value.real < 0.0 and 0.0 < p.share <= 1.0 and not p.flag for p in poles)
    third = next(p for p in poles if p.name == "panel.mode3")
    assert third.damping > 0.005 and 5.0 < abs(third.value) < 5.1


def test_a_design_that_takes_damping_from_the_panel_is_flagged():
    """Feedback that lags: u_inf = -K_D de filtered at 0.2 rad/s, as a slow H-infinity term may do."""
    lag, zero = 0.2 * np.eye(6), np.zeros((6, 6))
    slow = StateSpace(-lag, np.hstack([np.eye(6), zero]), -0.5 * np.eye(6), np.zeros((6, 12)))
    plant, h = flexible_plant(paper(), HOME), inertia_of(ReducedDynamics(paper()))
    poles = refuse_unstable(named_poles(plant, h, gains(6, 4.0, 4.0), slow))
    assert any(p.flag == "driven" and p.name.startswith("panel") for p in poles)


def test_a_design_that_destabilises_the_panel_is_refused_before_it_flies():
    """An H_hat that has the sign of the coupling between base axes wrong."""
    model = paper()
    plant = flexible_plant(model, HOME)
    wrong = inertia_of(ReducedDynamics(model)).copy()
    wrong[1, 1] *= -1.0
    found = named_poles(plant, wrong, gains(6, 4.0, 4.0))
    assert any(p.flag == "unstable" for p in found)

    with pytest.raises(ControlError, match=r"destabilises .*: a pole at"):
        refuse_unstable(found)


def test_sizes_that_do_not_fit_are_refused():
    plant = flexible_plant(paper(), HOME)
    with pytest.raises(ControlError, match="do not fit a plant with 6"):
        closed_loop_matrix(plant, np.eye(5), gains(6, 1.0, 1.0))


def test_a_guarded_design_leaves_the_panel_its_damping():
    """Gains of 0.8 rad/s and a loud attitude sensor: the least error drives the panel."""
    n, k, plant = 6, gains(6, 0.64, 1.6), flexible_plant(paper(), HOME)
    weights = weights_from_level(
        0.05,
        np.concatenate([np.zeros(3), np.full(3, 1e-3)]),
        left_out=np.concatenate([np.full(3, 1e-5), np.full(3, 1e-4)]),
        angle_noise=np.concatenate([np.full(3, 4e-5), np.full(3, 4e-6)]),
        rate_noise=np.full(n, 4e-6),
        crossover=10.0,
    )
    inertia = inertia_of(ReducedDynamics(paper()))
    plain = named_poles(plant, inertia, k, design_robust_term(k, weights).controller)
    term, poles = guarded_term(plant, inertia, k, weights)

    def panel(found):
        return next(p for p in found if p.name == "panel.mode1").damping

    own = least_damping(plant)["panel.mode1"]
    assert own == pytest.approx(0.005, rel=0.02)
    assert panel(plain) < 0.6 * own <= panel(poles)
    assert min(b.crossover for b in term.blocks) > 2.0 and term.gamma <= 1.0 + 1e-6
