"""What an effect changes along a recorded motion: against all forces of the models with and without it."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from smsid.effects import GearCompliance, GeometricStiffness, JointFriction
from smsid.estimation._measurement_model import MeasurementModel
from smsid.estimation.joint_problem import at_point
from smsid.estimation.kalman import run_filter
from smsid.estimation.parameter_vector import Unknown
from smsid.estimation.process_model import ProcessModel
from smsid.estimation.sensitivities import Entries, Sensitivities, _carry, propagate
from smsid.kernel.jit import SWITCH
from smsid.kernel.sensitivities import carry

THERE = (
    JointFriction(name="rubs", joint="joint1", coulomb=0.02, load=0.01, viscous=0.3),
    JointFriction(name="grinds", joint="joint2", load=0.02),
)
CHANGED = [
    JointFriction(name="rubs", joint="joint1", coulomb=0.02, load=0.03, viscous=0.3),
    JointFriction(name="rubs", joint="joint1", coulomb=0.05, load=0.01, viscous=0.1),
    JointFriction(name="grinds", joint="joint2", load=0.02, start=2.0),
    JointFriction(name="more", joint="joint2", load=0.02, position_cos=0.01),
    JointFriction(name="else", joint="joint3", stribeck=0.01),
]


def passive(model, states):
    out = states.tau.copy()
    for t, q, v, tau in zip(states.time, states.q, states.v, out, strict=True):
        model.add_passive_forces(float(t), q, v, tau, inertial=False)
    return out


@pytest.mark.parametrize("switch", ["1", "0"])
@pytest.mark.parametrize("loaded", [True, False])
@pytest.mark.parametrize("changed", CHANGED, ids=range(len(CHANGED)))
def test_forces_that_see_the_applied_ones_are_those_of_the_whole_model(
    known, problem, changed, loaded, switch, monkeypatch
):
    """An effect of its own, or a change of one there is; beside frictions that go with the torque, or not;
    by compiled code and plainly.
    """
    monkeypatch.setenv(SWITCH, switch)
    point = known.point
    for effect in THERE if loaded else ():
        point = point.with_effect(effect)
    there = {e.name: e for e in point.description.effect}
    nothing = JointFriction(name=changed.name, joint=changed.joint)
    model, other = point.model(), point.with_effect(changed).model()
    changes = Sensitivities(point, model, problem, run_filter(model, problem))
    found = changes.effect(there.get(changed.name, nothing), changed, 1.0)
    for states, forces in ((changes.run.states, found.at), (changes.run.middle, found.middle)):
        expected = passive(other, states) - passive(model, states)
        assert np.abs(expected).max() > 0.0
        own = np.zeros_like(expected)
        own[:, found.dofs] = forces
        np.testing.assert_allclose(own, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("plain", [0.0, 1.0], ids=["from nothing", "of one that is there"])
def test_what_a_softer_panel_changes_is_compiled_as_it_is_plainly(known, problem, plain, monkeypatch):
    effects = [GeometricStiffness(name="soft", appendage="panel", factor=x) for x in (plain, plain + 0.1)]
    point = known.point.with_effect(effects[0]) if plain else known.point
    model, found = point.model(), []
    run = run_filter(model, problem)
    for switch in ("1", "0"):
        monkeypatch.setenv(SWITCH, switch)
        found.append(Sensitivities(point, model, problem, run).effect(*effects, 0.1))
    for name in ("at", "middle", "reading"):
        ours, exact = (getattr(x, name) for x in found)
        assert np.abs(exact).max() > 0.0
        np.testing.assert_allclose(ours, exact, rtol=0.0, atol=1e-10 * np.abs(exact).max())


FEW = 40  # samples


def predicted_with_gains_of(run, point, problem, forces):
    """What a model predicts that is corrected by the gains of another's run: by Pinocchio, step by step."""
    model, q, v = point.model(), run.states.q[0], run.states.v[0]
    plant = ProcessModel(model, problem.locked)
    outputs = MeasurementModel(model, problem.data, problem.locked)
    out = np.empty((FEW, problem.data.rows))
    for k, tau in enumerate(run.states.tau[:FEW]):
        out[k] = outputs.predict(q, v, plant.acceleration(run.edges[k], q, v, tau))[0]
        step = run.gain[k] @ (run.errors[k] + run.predicted[k] - out[k])
        q, v = pin.integrate(model.pin, q, step[: model.nv]), v + step[model.nv : 2 * model.nv]
        h = (run.edges[k + 1] - run.edges[k]) / len(forces.means[k])
        for i, drive in enumerate(zip(forces.means[k], forces.rise[k], strict=True)):
            q, v = plant.step(run.edges[k] + i * h, h, q, v, *drive)
    return out


@pytest.mark.parametrize("name", ["compliance", "motor_inertia", "damping", "carried"])
def test_a_rotor_that_comes_to_rest_between_samples_tells_of_itself(known, problem, name):
    """The acceleration half-way tells nothing of such motion."""
    swing, compliance = 5e-3, 1e-4
    gear = GearCompliance(
        name="gear", joint="joint2", compliance=compliance, motor_inertia=swing**2 / compliance,
        damping=swing / compliance, carried=0.3, inertia_in_link=True, quasistatic=False,
    )  # fmt: skip
    values = problem.data.values.copy()
    for block in problem.data.blocks:
        if block.quantity == "attitude":  # whose errors are no differences
            values[:, block.rows] = np.nan
    problem = replace(problem, substep=1e-3, data=replace(problem.data, values=values))
    point = known.point.with_effect(gear)
    run = run_filter(point.model(), at_point(point, problem))
    changes = Sensitivities(point, point.model(), problem, run)
    value, beside = getattr(gear, name), []
    unknown = Unknown(f"gear.{name}", "effect", "", value, np.inf, 0.1 * value)
    column = propagate(run, [changes.unknown(unknown)])[:FEW, :, 0]
    for step in (1e-3 * value, -1e-3 * value):
        other = point.moved([unknown], np.array([step]))
        beside.append(predicted_with_gains_of(run, other, problem, changes.applied))
    change = np.einsum("nij,nj->ni", run.whitening[:FEW], beside[0] - beside[1]) / (2e-3 * value)
    size = np.linalg.norm(change)
    assert size > 0.0
    assert np.linalg.norm(column - change) < 0.01 * size


def test_changes_are_carried_compiled_as_they_are_plainly():
    rng = np.random.default_rng(3)
    n, rows, width, nv, m = 7, 5, 8, 4, 6
    sizes = ((n, rows, rows), (n, rows, width), (n, width, rows), (n - 1, width, width), (n - 1, width, nv))
    by_a = rng.standard_normal((n, rows, nv))
    by_a[:, [1, 4]] = 0.0
    inverses = (rng.standard_normal((n, nv, nv)), rng.standard_normal((n - 1, nv, nv)))
    filtered = (*(0.3 * rng.standard_normal(size) for size in sizes), by_a, *inverses)

    def entries(count: int, places: int) -> Entries:
        pairs = rng.permutation(m * places)[:9]
        return rng.standard_normal((count, 9)), pairs // places, pairs % places

    given = entries(n - 1, nv), entries(n, nv), entries(n, rows), entries(n - 1, width)
    found = []
    for take in (carry, _carry):
        now, out = np.arange(1.0, m * width + 1.0).reshape(m, width), np.empty((m, n, rows))
        take(filtered, *given, now, out)
        found.append((now, out))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-12 * np.abs(other).max())
