"""Every hidden effect: nothing at zero, something at its limit; laws against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from . import bodies
from .catalogue import hidden_effects
from .experiment import RATE, commands
from .flight import fly
from .numbers import SMS, WORLDS, curvature
from .plant import Change, Plant, simulate
from .sensors import measured, whitened

SHORT = 6.0  # [s]
STRONG = {
    "frequency_drift": 0.01, "gravity_gradient": 0.02, "mass_loss": 0.5, "slosh_nonlinearity": 1e4,
    "sensor_delay": 0.1, "joint_friction": 1.0, "gear_compliance": 5e-5, "backlash": 1e-3,
    "outside": 1.0,
}  # fmt: skip


def nominal_run(world):
    c = commands(world, 0, SHORT)
    return c, fly(WORLDS[world], c)


def names():
    rows = [("sms", n) for n in hidden_effects("sms") if "panel" not in n]
    rows += [("panel", n) for n in hidden_effects("panel") if "panel" in n]
    # one joint, wheel, axis and channel of a kind is enough, as the others share its code
    seen, kept = set(), []
    for world, name in rows:
        effect = hidden_effects(world)[name]
        key = (
            effect.kind,
            effect.label or effect.parameter.split(".")[0],
            effect.location.startswith("wheel"),
        )
        if effect.family == ("sensor",):
            key = (*key, effect.location.partition(".")[2] in ("attitude", "acceleration"))
        if key not in seen and not (effect.location == "joint1" and effect.kind == "joint_friction"):
            seen.add(key)
            kept.append((world, name))
    return kept


@pytest.fixture(scope="module")
def nominal_runs():
    return {world: nominal_run(world) for world in ("sms", "panel")}


@pytest.mark.parametrize(("world", "name"), names())
def test_zero_is_nominal_and_strong_is_seen(world, name, nominal_runs):
    """At zero strength every channel is that of the nominal run, exactly; at a large one some move."""
    effect = hidden_effects(world)[name]
    c, nominal = nominal_runs[world]
    seen = {}
    for value in (0.0, min(effect.cap, STRONG.get(effect.kind or "outside", 30 * effect.guess))):
        change = effect.make(value, None, np.random.default_rng(1))
        exact = fly(WORLDS[world], c, [change])
        seen[value > 0] = measured(exact, c.time, np.random.default_rng(2), [change])
    base = measured(nominal, c.time, np.random.default_rng(2))
    if effect.kind == "outliers":  # rare: in 6 s there may be none
        seen[True] = measured(
            nominal, c.time, np.random.default_rng(2), [effect.make(0.1, None, np.random.default_rng(1))]
        )
    for channel in base:
        np.testing.assert_array_equal(seen[False][channel], base[channel], err_msg=channel)
    assert np.abs(whitened(seen[True], base)).max() > 1.0


def test_onset_is_nothing_before_and_something_after():
    c, nominal = nominal_run("sms")
    for name, effect in hidden_effects("sms").items():
        if effect.onset and name.split(":")[0] in ("torque_gain", "external_wrench", "sensor_bias"):
            change = effect.make(30 * effect.guess, 3.0, np.random.default_rng(1))
            found = fly(SMS, c, [change])
            before = c.time < 3.0
            for channel, x in nominal.items():
                np.testing.assert_array_equal(found[channel][before], x[before], err_msg=name)
            assert any((found[k] != nominal[k]).any() for k in nominal)
            break_here = name
    assert break_here


def test_delay_shifts_the_command():
    """A delay of half a sample acts as the mean of this sample's command and the one before."""
    c = commands("sms", 0, SHORT)
    late = fly(SMS, c, [Change(delay={"wheel_x": 0.5 / RATE})])
    k = c.columns.index("wheel_x")
    mean = np.array(c.values)
    mean[1:, k] = 0.5 * (c.values[1:, k] + c.values[:-1, k])
    mean[0, k] *= 0.5
    same = fly(SMS, replace(c, values=mean))
    rate = "tachometer.wheel_rate"
    np.testing.assert_allclose(late[rate][:, 0], same[rate][:, 0], atol=1e-6)
    assert np.abs(late[rate] - nominal_run("sms")[1][rate]).max() > 1e-3


def test_a_whole_sample_of_delay_is_a_shift_of_the_command():
    c = commands("sms", 0, SHORT)
    late = fly(SMS, c, [Change(delay={"joint2": 1.0 / RATE})])
    k = c.columns.index("joint2")
    shifted = np.array(c.values)
    shifted[1:, k], shifted[0, k] = c.values[:-1, k], 0.0
    same = fly(SMS, replace(c, values=shifted))
    assert np.abs(whitened(late, same)).max() < 1e-6


def test_late_sensor_reads_what_was():
    """A whole sample late is the row before; half a sample is between two rows."""
    c, nominal = nominal_run("sms")
    gyro = "imu.angular_rate"
    whole = fly(SMS, c, [Change(shift={gyro: 1 / RATE})])[gyro]
    np.testing.assert_array_equal(whole[1:], nominal[gyro][:-1])
    half = fly(SMS, c, [Change(shift={gyro: 0.5 / RATE})])[gyro]
    np.testing.assert_allclose(half[1:], 0.5 * (nominal[gyro][1:] + nominal[gyro][:-1]), atol=1e-5)
    early = fly(SMS, c, [Change(shift={gyro: -0.5 / RATE})])[gyro]
    np.testing.assert_allclose(early[:-1], half[1:], atol=1e-12)


def test_lost_mass_leaves_with_the_velocity_it_had():
    """A body that coasts keeps its velocity while it loses mass at its centre."""
    bus = bodies.theta(100.0, np.zeros(3), np.diag([50.0, 60.0, 70.0]))
    n = replace(WORLDS["rigid"], body={**WORLDS["rigid"].body, "bus": bus})
    plant = Plant(n)
    plant.reset()
    plant.qvel[:3] = [0.1, 0.2, 0.3]
    before = plant.acceleration(np.array([10.0, 0, 0, 0, 0, 0, 0, 0, 0]))[0]
    plant.set_body("bus", -bodies.point(20.0, np.zeros(3)))
    after = plant.acceleration(np.array([10.0, 0, 0, 0, 0, 0, 0, 0, 0]))[0]
    np.testing.assert_array_equal(plant.qvel[:3], [0.1, 0.2, 0.3])
    lighter = replace(n, body={**n.body, "bus": bus - bodies.point(20.0, np.zeros(3))})
    again = Plant(lighter)
    again.reset()
    assert after == pytest.approx(again.acceleration(np.array([10.0, 0, 0, 0, 0, 0, 0, 0, 0]))[0], rel=1e-12)
    assert after > before


def test_axial_acceleration_softens_the_panel():
    """omega^2 of mode 1 falls by a_x kappa on a bus too heavy to take part, a_x its acceleration."""
    acceleration, heavy = -0.2, bodies.theta(1e9, np.zeros(3), 1e9 * np.eye(3))
    push = np.array([acceleration * 1e9, 0, 0, 0, 0, 0, 0, 0, 0])
    stiffness = {}
    for bend in (0.0, 1.0):
        plant = Plant(replace(WORLDS["panel"].with_body("bus", heavy), bend=bend))
        iq, iv = plant.q_of("mode1"), plant.v_of("mode1")
        pair = []
        for sign in (1.0, -1.0):
            plant.reset()
            plant.qpos[iq] = sign * 1e-3
            pair.append(plant.acceleration(push)[iv])
        stiffness[bend] = -(pair[0] - pair[1]) / 2e-3
    plate = WORLDS["panel"].plate
    assert plate is not None
    assert stiffness[0.0] == pytest.approx(plate.omega[0] ** 2, rel=1e-5)
    found = stiffness[1.0] - stiffness[0.0]
    assert found == pytest.approx(-acceleration * curvature(plate)[0], rel=1e-4)


def test_second_tank_keeps_the_total_mass():
    effect = hidden_effects("sms")["slosh:second@tank2"]
    change = effect.make(10.0, None, np.random.default_rng(0))
    assert change.numbers is not None
    changed = change.numbers(SMS)
    assert changed.body["bus"][0] + changed.tank("tank2").mass == pytest.approx(2000.0)
    masses = [Plant(n).model.body_mass.sum() for n in (SMS, changed)]
    assert masses[0] == pytest.approx(masses[1], rel=1e-12)


def test_gravity_gradient_turns_as_the_textbook_says():
    """Torque 3 n^2 r x I r on a rigid spacecraft, all at rest (Hughes, Spacecraft Attitude Dynamics)."""
    effect = hidden_effects("rigid")["gravity_gradient:rate@bus"]
    n, rate = WORLDS["rigid"], 2e-3
    plain, pulled = Plant(n), Plant(n)
    change = effect.make(rate, None, np.random.default_rng(0))
    assert change.hook is not None
    for plant in (plain, pulled):
        plant.reset()
        plant.acceleration(np.zeros(9))
    change.hook(pulled)(0.005)
    d, m = plain.data, plain.model
    mass = m.body_mass[1:]
    centre = mass @ d.xipos[1:] / mass.sum()
    inertia = np.zeros((3, 3))
    for b in range(1, m.nbody):
        axes = d.ximat[b].reshape(3, 3)
        inertia += bodies.steiner(m.body_mass[b], d.xipos[b] - centre)
        inertia += axes @ np.diag(m.body_inertia[b]) @ axes.T
    nadir = np.array([np.cos(0.8), np.sin(0.8), 0.3]) / np.sqrt(1.09)
    # about the bus origin the net tidal force vanishes, so the torque is that about the centre
    torque = 3 * rate**2 * np.cross(nadir, inertia @ nadir)
    np.testing.assert_allclose(pulled.data.qfrc_applied[:3], 0.0, atol=1e-12)
    np.testing.assert_allclose(pulled.data.qfrc_applied[3:6], torque, rtol=1e-9)


def test_simulation_with_forces_is_repeatable():
    effect = hidden_effects("sms")["outside:dahl@joint2"]
    c = commands("sms", 0, SHORT)
    runs = [
        simulate(SMS, c.time, c.values, c.columns, [effect.make(0.5, None, np.random.default_rng(k))])
        for k in (0, 1)
    ]
    np.testing.assert_array_equal(runs[0].states[0.0].qpos, runs[1].states[0.0].qpos)
