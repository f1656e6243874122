"""The integrator against closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm
from scipy.special import ellipj, ellipk

from smsid.description import Description
from smsid.effects import Slosh
from smsid.errors import SimulationError
from smsid.model import build_model
from smsid.simulate import Fourier, Inputs, PiecewiseConstant, Tolerance, simulate
from smsid.simulate.integrate import initial_state

URDF = Path(__file__).resolve().parents[2] / "urdf"
TIGHT = Tolerance(1e-11, 1e-13)
MASS, SLOSH, STIFFNESS, DAMPING = 2000.0, 49.6, 0.41, 0.02


def two_masses():
    """Bus and slosh mass on one line through the bus's CM: a linear system."""
    tank = Slosh(
        name="tank", position=(0.0, 0.0, 0.0), mass=SLOSH, stiffness=(STIFFNESS,) * 3, damping=(DAMPING,) * 3
    )
    return build_model(Description(name="x", urdf="bus.urdf", folder=URDF, effect=(tank,)))


def two_mass_matrix():
    """d/dt of (x, s, x', s', f) with force f held: x of the bus, s of the slosh relative to it."""
    a = np.zeros((5, 5))
    a[0, 2] = a[1, 3] = 1.0
    a[2] = np.array([0.0, STIFFNESS, 0.0, DAMPING, 1.0]) / MASS
    a[3] = -a[2] - np.array([0.0, STIFFNESS, 0.0, DAMPING, 0.0]) / SLOSH
    return a


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_slosh_under_stepped_thrust_is_the_matrix_exponential(axis):
    """Breakpoints off any grid: the integration restarts at every one, and takes few steps in between."""
    model = two_masses()
    edges = (0.0, 3.3, np.pi, 17.77, 40.0)
    edges = tuple(sorted(edges))
    force = (40.0, -40.0, 0.0, 13.0)
    values = np.zeros((4, 3))
    values[:, axis] = force
    trajectory = simulate(model, Inputs(force=PiecewiseConstant(edges[:-1], values)), 40.0, tolerance=TIGHT)
    assert {c.times[0] for c in trajectory.charts} == set(edges[:-1])
    assert trajectory.steps < 100
    times = np.array([1.0, np.pi, 3.3, 10.0, 17.77, 30.0, 40.0])
    states = trajectory.states(times)
    a = two_mass_matrix()
    j = model.slosh[0]
    for i, t in enumerate(times):
        y = np.zeros(5)
        for start, stop, f in zip(edges[:-1], edges[1:], force, strict=True):
            y[4] = f
            if t > start:
                y = expm(a * (min(t, stop) - start)) @ y
        found = [states.q[i, axis], states.q[i, j.q][axis], states.v[i, axis], states.v[i, j.v][axis]]
        np.testing.assert_allclose(found, y[:4], rtol=1e-9, atol=1e-9)


def test_accelerations_at_a_jump_are_the_right_limit():
    trajectory = simulate(
        two_masses(), Inputs(force=PiecewiseConstant((1.0,), np.array([[40.0, 0.0, 0.0]]))), 2.0
    )
    before, at = trajectory.states(np.array([1.0 - 1e-12, 1.0])).a[:, 0]
    assert before == pytest.approx(0.0, abs=1e-12)
    assert at == pytest.approx(40.0 / MASS, rel=1e-9)


def test_error_follows_the_tolerance():
    """A thousandth of the tolerance is a thousandth of the error, to within the controller's freedom."""
    model = two_masses()
    force = Fourier(0.05, np.array([[40.0, 10.0, 0.0], [0.0] * 3, [0.0] * 3]), np.zeros((3, 3)), np.zeros(3))
    exact = simulate(model, Inputs(force=force), 60.0, tolerance=Tolerance(1e-13, 1e-14))
    errors, steps = [], []
    for relative in (1e-5, 1e-8, 1e-11):
        found = simulate(model, Inputs(force=force), 60.0, tolerance=Tolerance(relative, relative * 1e-2))
        end = [t.states(np.array([60.0])).q[0] for t in (found, exact)]
        errors.append(np.abs(end[0] - end[1]).max())
        steps.append(found.steps)
    assert errors[0] > 30 * errors[1] > 900 * errors[2]
    assert steps[2] < 12 * steps[0]  # eighth order: 10^6 times the accuracy for some 10^(6/8) times the steps


def symmetric_top(tmp_path, axial=30.0, transverse=20.0):
    (tmp_path / "top.urdf").write_text(
        '<robot name="top"><link name="top"><inertial><mass value="5"/>'
        f'<inertia ixx="{transverse}" iyy="{transverse}" izz="{axial}" ixy="0" ixz="0" iyz="0"/>'
        "</inertial></link></robot>"
    )
    return build_model(Description(name="x", urdf="top.urdf", folder=tmp_path))


def test_a_fast_torque_free_symmetric_top_turns_as_the_closed_form(tmp_path):
    """R(t) = exp(h/It t) exp((1 - Ia/It) w3 t e3): many turns, so the chart is re-centred many times."""
    axial, transverse = 30.0, 20.0
    model = symmetric_top(tmp_path, axial, transverse)
    omega = np.array([1.2, -0.7, 9.0])
    trajectory = simulate(model, Inputs(), 20.0, v0=np.concatenate([np.zeros(3), omega]), tolerance=TIGHT)
    times = np.linspace(0.0, 20.0, 201)
    states = trajectory.states(times)
    momentum = np.array([transverse, transverse, axial]) * omega
    for t, q, v in zip(times, states.q, states.v, strict=True):
        own = pin.exp3(np.array([0.0, 0.0, (1.0 - axial / transverse) * omega[2] * t]))
        expected = pin.exp3(momentum / transverse * t) @ own
        found = pin.Quaternion(q[3:7]).toRotationMatrix()
        np.testing.assert_allclose(found, expected, atol=2e-8)
        np.testing.assert_allclose(v[3:], own.T @ omega, atol=2e-8)
    assert len(trajectory.charts) > 20 * np.linalg.norm(omega) / (2 * np.pi)  # several per turn
    assert np.abs(np.linalg.norm(states.q[:, 3:7], axis=1) - 1.0).max() < 1e-12
    audit = trajectory.audit()
    assert audit.momentum_drift < 1e-9 * np.linalg.norm(momentum)
    assert audit.energy_drift < 1e-9 * audit.energy_scale


@pytest.mark.parametrize("omega", [(0.0, 0.0, 50.0), (3.0, 4.0, 5.0)])
def test_no_step_turns_the_chart_beyond_where_its_logarithm_is_regular(omega):
    """A plain spin has no error to control: only the bound on the angle of a step keeps them short."""
    bus = build_model(Description(name="x", urdf="bus.urdf", folder=URDF))
    trajectory = simulate(bus, Inputs(), 10.0, v0=np.array([0.0, 0.0, 0.0, *omega]))
    for chart in trajectory.charts:
        assert np.linalg.norm(chart.raw(chart.times)[:, 3:6], axis=1).max() < np.pi
    times = np.linspace(0.0, 10.0, 101)
    for t, q in zip(times, trajectory.states(times).q, strict=True):
        expected = pin.exp3(np.array(omega) * t)
        np.testing.assert_allclose(pin.Quaternion(q[3:7]).toRotationMatrix(), expected, atol=1e-10)


def test_a_spinning_bus_far_from_the_origin_flies_straight():
    """Its CM is the bus origin, which must keep its velocity in the inertial frame."""
    model = two_masses()
    q0, v0 = model.home.copy(), np.zeros(model.nv)
    q0[:3] = [1e4, -2e3, 5.0]
    v0[:6] = [1.0, 2.0, -0.5, 0.3, 0.1, 1.5]
    v0[model.slosh[0].v] = 0.0
    light = Slosh(name="tank", position=(0, 0, 0), mass=1e-9, stiffness=(0,) * 3, damping=(0,) * 3)
    model = build_model(model.description.with_effects(light))
    trajectory = simulate(model, Inputs(), 30.0, q0=q0, v0=v0)
    states = trajectory.states(np.array([0.0, 7.0, 30.0]))
    expected = q0[:3] + np.array([0.0, 7.0, 30.0])[:, None] * v0[:3]
    np.testing.assert_allclose(states.q[:, :3], expected, atol=1e-5)


@pytest.mark.parametrize("start", [0.3, 2.0, 3.0])
def test_a_pendulum_on_a_welded_bus_is_the_elliptic_function(tmp_path, start):
    """sin(theta / 2) = k sn(K - w t), k = sin(theta0 / 2)."""
    (tmp_path / "pendulum.urdf").write_text(
        '<robot name="p"><link name="wall"/><joint name="hinge" type="continuous"><parent link="wall"/>'
        '<child link="bob"/><axis xyz="0 1 0"/></joint><link name="bob"><inertial>'
        '<origin xyz="0 0 -0.8"/><mass value="3"/>'
        '<inertia ixx="0.1" iyy="0.2" izz="0.15" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'
    )
    description = Description(
        name="x", urdf="pendulum.urdf", folder=tmp_path, root="fixed", gravity=(0.0, 0.0, -9.81)
    )
    model = build_model(description)
    omega = np.sqrt(3.0 * 9.81 * 0.8 / (0.2 + 3.0 * 0.8**2))
    q0 = model.set_joint_angles(model.home, np.array([start]))
    trajectory = simulate(model, Inputs(), 12.0, q0=q0, tolerance=TIGHT)
    times = np.linspace(0.0, 12.0, 121)
    k = np.sin(start / 2)
    sn, _, _, _ = ellipj(ellipk(k**2) - omega * times, k**2)
    found = model.joint_angles(trajectory.states(times).q)[:, 0]
    np.testing.assert_allclose(np.sin(found / 2), k * sn, atol=1e-8)
    audit = trajectory.audit()
    assert audit.energy_drift < 1e-9 * audit.energy_scale
    assert np.isnan(audit.momentum_drift)  # the wall takes it


def test_a_simulation_that_blows_up_says_when():
    class Runaway:
        size, breakpoints = 3, ()

        def __call__(self, t):
            return np.array([1e3 / max(1.0 - t, 0.0) ** 2, 0.0, 0.0]) if t < 1.0 else np.full(3, np.nan)

        def mapped(self, matrix):
            mapped = Runaway()
            mapped.size = len(matrix)
            mapped.__class__ = type(
                "R", (Runaway,), {"__call__": lambda s, t: matrix @ Runaway.__call__(self, t)}
            )
            return mapped

    with pytest.raises(SimulationError, match=r"failed at t = (0\.9|1)") as caught:
        simulate(two_masses(), Inputs(force=Runaway()), 2.0)
    assert 0.9 < caught.value.evidence["time"] <= 1.0 + 1e-6
    assert caught.value.advice


@pytest.mark.parametrize("duration", [0.0, -1.0, np.inf, np.nan])
def test_durations_that_are_none_are_refused(duration):
    with pytest.raises(SimulationError, match="positive duration"):
        simulate(two_masses(), Inputs(), duration)


def test_starts_that_are_no_state_are_refused():
    model = two_masses()
    twisted = model.home.copy()
    twisted[3:7] = [0.0, 0.0, 0.0, 2.0]
    for q0, v0, text in (
        (model.home[:-1], None, "q0 must be"),
        (None, np.zeros(model.nv + 1), "v0 must be"),
        (None, np.full(model.nv, np.nan), "finite"),
        (twisted, None, "norm one"),
    ):
        with pytest.raises(SimulationError, match=text):
            simulate(model, Inputs(), 1.0, q0=q0, v0=v0)
    nearly = model.home * (1.0 + 1e-9)
    assert np.linalg.norm(initial_state(model, nearly, None)[0][3:7]) == pytest.approx(1.0, abs=1e-15)


def test_states_outside_the_simulated_time_are_refused():
    trajectory = simulate(two_masses(), Inputs(), 2.0, start=1.0)
    assert trajectory.states(np.array([1.0, 3.0])).q.shape == (2, 10)
    with pytest.raises(SimulationError, match="simulated 1 to 3 s"):
        trajectory.states(np.array([0.5]))
