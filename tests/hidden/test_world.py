"""The hidden worlds themselves: same physics as the nominal description, momentum, and what a run writes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from smsid.description import load_description
from smsid.effects import BeamAppendage, GearCompliance, GeometricStiffness
from smsid.identify.estimate import load_estimate
from smsid.model import build_model
from smsid.recording import load_recording

from . import bodies
from .description import write_description
from .experiment import commands
from .flight import write_run
from .numbers import JOINTS, ROTOR, WHEELS, WORLDS, Drivetrain, draw, moved, nominal
from .plant import Plant, simulate
from .sensors import rotations


@pytest.mark.parametrize("world", WORLDS)
def test_nominal_description_accelerates_as_the_world_does(world, tmp_path):
    """Two engines, one set of numbers: accelerations at random states, inputs, no symmetry."""
    n = WORLDS[world]
    model = build_model(load_description(write_description(n, tmp_path)))
    for found, expected in accelerations(model, Plant(n), 20):
        np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())


def test_a_panel_that_does_not_stretch_accelerates_as_the_worlds_does(tmp_path):
    """Points on curves in one engine, Lagrange's equations of first order in the drawing in in the other."""
    share, n = 1e-4, WORLDS["panel"]
    description = load_description(write_description(n, tmp_path))
    panel = next(e for e in description.effect if isinstance(e, BeamAppendage))
    short = GeometricStiffness(name="short", appendage=panel.name, factor=share)
    models = build_model(description), build_model(description.with_effects(short))
    plants = Plant(n), Plant(replace(n, bend=share))
    plain, drawn = (accelerations(m, p, 10) for m, p in zip(models, plants, strict=True))
    for (found, expected), (found_drawn, expected_drawn) in zip(plain, drawn, strict=True):
        change = (expected_drawn - expected) / share
        assert np.abs(change).max() > 1e-4
        np.testing.assert_allclose((found_drawn - found) / share, change, atol=3e-3 * np.abs(change).max())


@pytest.mark.parametrize("world", ["arm", "rigid"])
def test_a_gear_that_gives_accelerates_as_the_worlds_does(world, tmp_path):
    """A body that turns between two links, and a twist with a rotor that turns with the first of them."""
    n, drive = WORLDS[world], Drivetrain(1e-4, ROTOR)
    plant = Plant(replace(n, drivetrain={"joint3": drive}))
    gear = GearCompliance(
        name="g", joint="joint3", motor_inertia=ROTOR, compliance=drive.compliance, inertia_in_link=True,
        damping=2 * drive.damping * np.sqrt(ROTOR / drive.compliance), carried=1.0,
    )  # fmt: skip
    model = build_model(load_description(write_description(n, tmp_path)).with_effects(gear))
    for found, expected in accelerations(model, plant, 20, turned="joint3"):
        np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())


def accelerations(model, plant, count, turned=""):
    """Pairs of accelerations at random states under random commands: the model's, the plant's.

    ``turned`` is a joint with a gear: the plant has the motor's angle and the spring's, the model the link's
    and the twist.
    """
    n, rng = plant.numbers, np.random.default_rng(1)
    iq, iv = pinocchio_indices(model, plant)
    for _ in range(count):
        quaternion = rng.standard_normal(4)
        quaternion /= np.linalg.norm(quaternion)
        plant.reset()
        plant.qpos[:] = rng.uniform(-0.5, 0.5, plant.model.nq)
        plant.qvel[:] = rng.uniform(-0.5, 0.5, plant.model.nv)
        command = rng.uniform(-20, 20, plant.model.nu)
        q, v, tau = np.zeros(model.nq), np.zeros(model.nv), np.zeros(model.nv)
        r = np.eye(3)
        if n.free:
            plant.qpos[3:7] = np.roll(quaternion, 1)
            r = rotations(plant.qpos[None, 3:7])[0]
            q[:7] = [*plant.qpos[:3], *quaternion]
            v[:6] = [*(r.T @ plant.qvel[:3]), *plant.qvel[3:6]]
            tau[:3] = command[:3]
        q[[a for a, _ in iq]] = plant.qpos[[b for _, b in iq]]
        v[[a for a, _ in iv]] = plant.qvel[[b for _, b in iv]]
        if turned:
            (a, fa), (b, fb) = iq[-1], iv[-1]
            own = model.pin.joints[model.pin.getJointId(turned)]
            q[own.idx_q] += plant.qpos[fa]
            v[own.idx_v] += plant.qvel[fb]
            q[a], v[b] = -plant.qpos[fa], -plant.qvel[fb]
        tau[model.arm_joints.v] = command[-3:]
        if n.wheel_inertia is not None:
            tau[model.wheels.v] = command[3:6]
        expected = plant.acceleration(command)
        if n.free:
            expected[:3] = r.T @ expected[:3] - np.cross(v[3:6], v[:3])
        found = model.acceleration(0.0, q, v, tau)
        if turned:
            expected[plant.v_of(turned)] += expected[iv[-1][1]]
            expected[iv[-1][1]] *= -1.0
        free = 6 if n.free else 0
        yield (
            np.r_[found[:free], found[[a for a, _ in iv]]],
            np.r_[expected[:free], expected[[b for _, b in iv]]],
        )


def pinocchio_indices(model, plant):
    """Pairs (index of the model under test, index of MuJoCo) of every joint but the free one."""
    names = [(f"{j}", j) for j in JOINTS]
    names += [(w, w) for w in WHEELS] if plant.numbers.wheel_inertia is not None else []
    names += [("g.twist", f"{joint}.flex") for joint in plant.numbers.drivetrain]
    names += [(f"panel.mode{k}", f"mode{k}") for k in range(1, len(plant.numbers.plate_modes()) + 1)]
    iq, iv = [], []
    for own, other in names:
        joint = model.pin.joints[model.pin.getJointId(own)]
        iq.append((joint.idx_q, plant.q_of(other)))
        iv.append((joint.idx_v, plant.v_of(other)))
    for tank in plant.numbers.tanks:
        joint = model.pin.joints[model.pin.getJointId(tank.name)]
        for k, axis in enumerate("xyz"):
            iq.append((joint.idx_q + k, plant.q_of(f"{tank.name}.{axis}")))
            iv.append((joint.idx_v + k, plant.v_of(f"{tank.name}.{axis}")))
    return iq, iv


@pytest.mark.parametrize("world", ["sms", "panel", "rigid"])
def test_momentum_follows_the_thrust(world):
    """Inertial linear momentum is the integral of the thrust, and so for angular momentum."""
    import mujoco

    n, c = WORLDS[world], commands(world, duration=20.0)
    plant = Plant(n)
    plant.reset()
    impulse, turning = np.zeros(3), np.zeros(3)
    nodes, weights = np.polynomial.legendre.leggauss(3)
    for k in range(len(c.time) - 1):
        for node, weight in zip(0.025 * (nodes + 1), 0.025 * weights, strict=True):
            before = plant.data.time
            plant.advance(c.values[k], c.time[k] + node - before)
            force = rotations(plant.qpos[None, 3:7])[0] @ c.values[k, :3]
            impulse += weight * force
            turning += weight * np.cross(plant.qpos[:3], force)
        plant.advance(c.values[k], c.time[k + 1] - plant.data.time)
    plant.acceleration(c.values[-1])
    mujoco.mj_subtreeVel(plant.model, plant.data)
    bus = plant.model.body("bus").id
    p = plant.model.body_subtreemass[bus] * plant.data.subtree_linvel[bus]
    h = plant.data.subtree_angmom[bus] + np.cross(plant.data.subtree_com[bus], p)
    np.testing.assert_allclose(p, impulse, atol=1e-6 * np.abs(impulse).max())
    np.testing.assert_allclose(h, turning, atol=2e-5)
    assert np.abs(turning).max() > 0.1


@pytest.mark.parametrize("world", WORLDS)
def test_joints_stay_within_their_limits(world):
    """The commands of both experiments, flown by the nominal world."""
    for experiment in (0, 1):
        c = commands(world, experiment)
        m = simulate(WORLDS[world], c.time, c.values, c.columns)
        q = m.states[0.0].qpos[:, [m.plant.q_of(j) for j in JOINTS]]
        assert np.abs(q).max() < 3.1
        assert np.ptp(q, axis=0).min() > 0.3, "every joint is excited"


def test_step_is_small_enough():
    """Halving the step changes no channel by a thousandth of its noise."""
    c = commands("panel", duration=40.0)
    import tests.hidden.plant as world

    from .sensors import channels, whitened

    runs = []
    for step in (world.STEP, world.STEP / 2):
        m = simulate(WORLDS["panel"], c.time, c.values, c.columns, [world.Change(step=step)])
        runs.append(channels(m))
    assert np.abs(whitened(runs[1], runs[0])).max() < 1e-3


@pytest.mark.parametrize("world", WORLDS)
def test_drawn_numbers_are_physical_and_spread_as_stated(world):
    n, rng = WORLDS[world], np.random.default_rng(3)
    errors = []
    for _ in range(40):
        true = draw(n, rng)
        assert all(bodies.is_physical(t) for t in true.body.values())
        values = {p.name: p.value for p in nominal(true)}
        errors.append([(values[p.name] - p.value) / p.sigma for p in nominal(n)])
    assert 0.9 < np.std(errors) < 1.1
    assert abs(np.mean(errors)) < 0.1


def test_nominal_parameters_can_be_moved_by_name():
    for n in WORLDS.values():
        for p in nominal(n):
            after = {x.name: x.value for x in nominal(moved(n, {p.name: p.sigma}))}
            assert after[p.name] == pytest.approx(p.value + p.sigma, rel=1e-12)
            assert sum(after[x.name] != x.value for x in nominal(n)) == 1


def test_a_run_writes_what_a_diagnosis_reads(tmp_path):
    """Files load; the estimate names the nominal values; noise is what the description states."""
    files = write_run("sms", tmp_path, [1, 2], duration=40.0)
    description = load_description(files.description)
    assert {s.name for s in description.sensor} == {"pose", "imu", "encoder", "tachometer"}
    estimate = load_estimate(files.estimate)
    assert estimate["bus.m"].value == 2000.0
    assert estimate["tank.stiffness.x"].sigma == pytest.approx(0.04)
    made = load_recording(files.recording).check()
    assert made.role == "estimation"
    assert made.provenance["inputs"] == "held"
    assert load_recording(files.validation).role == "validation"
    gyro = np.diff(made["imu.angular_rate"], n=4, axis=0).std() / np.sqrt(70)
    assert gyro == pytest.approx(1e-5, rel=0.2)


def test_same_seed_same_run(tmp_path):
    first, second = (write_run("rigid", tmp_path / x, 5, duration=40.0) for x in "ab")
    assert load_recording(first.recording).equals(load_recording(second.recording))
