"""Step B as printed: its regressor with products of first moments closes, and holds Table 3's numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from twins.cases import SKEWED, random_pairs
from twins.description import Ordering, write_description
from twins.mujoco_twin import MujocoTwin
from twins.numbers import PAPER

from smsid.description import load_description
from smsid.errors import NotIdentifiableError
from smsid.identify.paper._momentum_printed import PrintedTerms, printed_parameters, step_b_printed
from smsid.identify.paper.hidden_states import HiddenStates, hidden_states
from smsid.identify.paper.modal_state import ModalState
from smsid.identify.paper.motion import prepare
from smsid.model import build_model

from ..support import URDF, M, exact_motion, oracle, reference

CENTRE = np.array([0.7, -0.4, 0.2])


@pytest.fixture(scope="module", params=["paper", "skewed"])
def case(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory):
    """Random states without momentum, their CM in one point; the slosh is not told."""
    numbers = {"paper": PAPER, "skewed": SKEWED}[request.param]
    model = build_model(load_description(write_description(numbers, tmp_path_factory.mktemp(request.param))))
    twin, order = MujocoTwin(numbers), Ordering(model)
    states = []
    for state, _ in random_pairs(150):
        full, u = twin.mass_matrix(state), state.velocity
        u[:6] = -np.linalg.solve(full[:6, :6], full[:6, 6:] @ u[6:])
        state = replace(state, v_b=u[:3], omega_b=u[3:6])
        com = pin.centerOfMass(model.pin, model.data, order.q(state))
        states.append(replace(state, position=state.position + CENTRE - com))
    modes = ModalState(np.array([s.delta for s in states]), np.array([s.delta_dot for s in states]))
    return model, numbers, exact_motion(states, numbers.point), HiddenStates({}, {"panel": modes})


def test_regressor_times_true_parameters_closes(case):
    """With slosh eliminated and products put in, to round-off relative to the terms that add up."""
    model, numbers, motion, hidden = case
    terms = PrintedTerms.of(model, motion, hidden)
    y, b = terms.rows(motion, hidden, numbers.total_mass, numbers.slosh_mass, CENTRE)
    pi = printed_parameters(model, motion, hidden, numbers.slosh_mass)
    assert y.shape[2] == len(pi) == len(terms.names)
    size = np.abs(y * pi).sum(axis=2) + np.abs(b)
    assert (np.abs(y @ pi - b) < 1e-11 * size).all()
    # the products matter: without them it does not close
    single = np.array(["*" not in n for n in terms.names])
    assert np.abs(y[:, :, single] @ pi[single] - b).max() > 1e-3 * np.abs(b).max()


def test_pi_m_comes_back(case):
    model, numbers, motion, hidden = case
    found = step_b_printed(model, motion, hidden, numbers.total_mass, numbers.slosh_mass, CENTRE)
    pi = printed_parameters(model, motion, hidden, numbers.slosh_mass)
    expected = found.base.values(pi)
    np.testing.assert_allclose(found.values, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize("case", ["paper"], indirect=True)
def test_table_3(case):
    """pi_m(13) = 837.41 of Table 3: inertia of the links and products over m_s, 837.412 as described."""
    model, numbers, motion, hidden = case
    found = step_b_printed(model, motion, hidden, numbers.total_mass, numbers.slosh_mass, CENTRE)
    expected = found.base.values(printed_parameters(model, motion, hidden, numbers.slosh_mass))
    near = int(np.argmin(np.abs(expected - 837.41)))
    assert expected[near] == pytest.approx(837.412, abs=5e-4)
    assert found.base.names[near].startswith("link1.Ixx - link1.Iyy + link2.Izz + 4 link3.m + link3.Izz")
    # by hand: Izz of links 2 and 3 about their joints, link 3 at 2 m, and (150^2 + 50^2) / m_s
    by_hand = 0.21 - 0.21 - 0.0 + (16.69 + 50) * 2 + 4 * 50 + (150**2 + 50**2) / 49.6
    assert expected[near] == pytest.approx(by_hand, abs=1e-6)
    assert found.values[near] == pytest.approx(837.412, abs=1e-2)


@oracle
def test_reference_recording(model):
    """Noise-free, M and m_s exact: pi_m within 1 % of the largest of its unit."""
    motion = prepare(model, reference("exp2_modal3"))
    hidden = HiddenStates({}, hidden_states(model, motion).modes)
    centre = np.array([0.2157532, -0.02001622, 0.10408559])
    found = step_b_printed(model, motion, hidden, M, 49.6, centre)
    expected = found.base.values(printed_parameters(model, motion, hidden, 49.6))
    for unit in ("kg m", "kg m^2"):
        own = np.array([u == unit for u in found.base.units])
        assert np.abs(found.values - expected)[own].max() < 0.01 * np.abs(expected[own]).max()


def test_two_tanks_are_told():
    model = build_model(load_description(URDF / "two_arm_sms.toml"))
    with pytest.raises(NotIdentifiableError, match="needs one slosh mass, 'two_arm_sms' has 2"):
        step_b_printed(model, None, None, 1.0, 1.0, CENTRE)  # type: ignore[arg-type]
