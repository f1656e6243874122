"""Slosh as a pendulum under thrust, against a point mass on a rod in plain numpy and in closed form."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from pydantic import ValidationError
from scipy.special import ellipk

from smsid.description import Description
from smsid.effects import SloshPendulum
from smsid.export._mjcf import write_mjcf
from smsid.model import build_model
from smsid.simulate import Constant, Inputs, simulate
from smsid.tracking import Sample, Tracker
from tests.estimation.satellite import cross, guess, skew

BUS, INERTIA = 100.0, np.array([[20.0, 1.0, -0.5], [1.0, 25.0, 0.7], [-0.5, 0.7, 18.0]])
PIVOT, LENGTH, MASS, DAMPING = np.array([0.1, -0.05, 0.3]), 0.5, 12.0, 0.4
FORCE, TORQUE = np.array([3.0, 2.0, 20.0]), np.array([0.3, -0.2, 0.1])
TANK = SloshPendulum(name="tank", pivot=tuple(PIVOT), mass=MASS, length=LENGTH, damping=DAMPING)
URDF = """<robot name="bus"><link name="bus"><inertial><mass value="{0}"/>
<inertia ixx="{1[0][0]}" iyy="{1[1][1]}" izz="{1[2][2]}" ixy="{1[0][1]}" ixz="{1[0][2]}" iyz="{1[1][2]}"/>
</inertial></link></robot>"""


def craft(folder, tank=TANK, bus=BUS, **more):
    (folder / "bus.urdf").write_text(URDF.format(bus, INERTIA), encoding="utf-8")
    if more.get("root") != "fixed":
        more["thrust"] = {"point": (0.0, 0.0, 0.0)}
    return Description.model_validate(
        {"name": "bus", "urdf": "bus.urdf", "folder": folder, "effect": (tank,), **more}
    )


def rod(x):
    """Bus (p, rotation, v, w in its axes) and mass (y, y') in the inertial frame, held by a rod's tension.

    The force on the mass is the tension along the rod, which keeps its length, and that of two dampers across
    it, whose torques are ``-damping`` times the rates of the two angles.
    """
    p, r, v, w, y, dy = x[:3], x[3:12].reshape(3, 3), x[12:15], x[15:18], x[18:21], x[21:24]
    arm = r @ PIVOT
    u = (y - p - arm) / LENGTH
    spin = r @ w
    speed = dy - (r @ v + np.cross(spin, arm))
    own = r.T @ u  # (-sin b, sin a cos b, -cos a cos b) of the angles a, b
    by_a = r @ np.array([0.0, -own[2], own[1]])
    cos = np.hypot(own[1], own[2])
    by_b = r @ np.array([-cos, own[0] * own[1] / cos, own[0] * own[2] / cos])
    moved = speed - np.cross(spin, LENGTH * u)  # as the bus sees it
    rate_a, rate_b = moved @ by_a / (LENGTH * cos**2), moved @ by_b / LENGTH
    across = -DAMPING / LENGTH * (rate_a / cos**2 * by_a + rate_b * by_b)
    couple = LENGTH * np.cross(u, across)

    def rates(tension):
        pull = -tension * u + across
        about = r.T @ (np.cross(arm, -pull) - couple)
        linear = FORCE - r.T @ pull - BUS * np.cross(w, v)
        dw = np.linalg.solve(INERTIA, TORQUE + about - np.cross(w, INERTIA @ w))
        dv = linear / BUS
        pivot = r @ (dv + np.cross(w, v) + np.cross(dw, PIVOT) + np.cross(w, np.cross(w, PIVOT)))
        return dv, dw, pull / MASS, u @ (pull / MASS - pivot)

    wanted = -(speed @ speed) / LENGTH
    none, one = rates(0.0)[3], rates(1.0)[3]
    dv, dw, ddy, _ = rates((wanted - none) / (one - none))
    return np.concatenate([r @ v, (r @ skew(w)).ravel(), dv, dw, dy, ddy])


def test_a_free_bus_under_thrust_moves_as_one_with_a_mass_on_a_rod(tmp_path):
    model = build_model(craft(tmp_path))
    seconds, n = 4.0, 800
    angles = 0.25, -0.35
    q = model.home.copy()
    q[7:9] = angles
    found = simulate(
        model, Inputs(force=Constant(FORCE), torque=Constant(TORQUE)), seconds, q0=q, v0=np.zeros(model.nv)
    ).states(np.array([seconds]))
    x = np.concatenate([np.zeros(3), np.eye(3).ravel(), np.zeros(12)])
    turned = pin.utils.rotate("x", angles[0]) @ pin.utils.rotate("y", angles[1])
    x[18:21] = PIVOT + turned @ [0.0, 0.0, -LENGTH]
    h = seconds / n
    for _ in range(n):
        k1 = rod(x)
        k2 = rod(x + h / 2 * k1)
        k3 = rod(x + h / 2 * k2)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rod(x + h * k3))
    assert np.linalg.norm(x[18:21] - x[:3] - x[3:12].reshape(3, 3) @ PIVOT) == pytest.approx(LENGTH, abs=1e-7)
    np.testing.assert_allclose(found.q[0, :3], x[:3], atol=1e-5)
    np.testing.assert_allclose(
        pin.Quaternion(found.q[0, 3:7]).toRotationMatrix(), x[3:12].reshape(3, 3), atol=1e-6
    )
    own = x[3:12].reshape(3, 3).T @ (x[18:21] - x[:3]) - PIVOT
    turned = pin.utils.rotate("x", found.q[0, 7]) @ pin.utils.rotate("y", found.q[0, 8])
    np.testing.assert_allclose(turned @ [0.0, 0.0, -LENGTH], own, atol=1e-6)


@pytest.mark.parametrize("swing", [0.05, 1.0])
def test_its_period_goes_with_the_acceleration(tmp_path, swing):
    """A heavy bus: the period of a pendulum, exact at any amplitude; without thrust the spring's."""
    tank = SloshPendulum(name="tank", pivot=(0, 0, 0.5), direction=(2.0, 0.0, 0.0), mass=1e-3, length=0.8)
    model = build_model(craft(tmp_path, tank, bus=1e6))
    for acceleration in (0.05, 0.2):
        period = 4.0 * np.sqrt(0.8 / acceleration) * ellipk(np.sin(swing / 2) ** 2)
        q = model.home.copy()
        q[8] = swing
        drive = Inputs(force=Constant(np.array([1e6 * acceleration, 0.0, 0.0])))
        s = simulate(model, drive, period, q0=q, v0=np.zeros(model.nv)).states(np.array([period / 4, period]))
        np.testing.assert_allclose(s.q[:, 8] / swing, [0.0, 1.0], atol=1e-4)
    held = SloshPendulum(name="tank", pivot=(0, 0, 0), mass=2.0, length=0.5, stiffness=0.3)
    model = build_model(craft(tmp_path, held, root="fixed"))
    period = 2 * np.pi * np.sqrt(2.0 * 0.5**2 / 0.3)
    s = simulate(model, Inputs(), period, q0=np.array([0.0, 1e-3])).states(np.array([period / 4, period]))
    np.testing.assert_allclose(s.q[:, 1], [0.0, 1e-3], atol=1e-6)


def test_mujoco_has_the_same_accelerations(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    model = build_model(craft(tmp_path))
    engine = mujoco.MjModel.from_xml_string(write_mjcf(model))
    data = mujoco.MjData(engine)
    rng = np.random.default_rng(2)
    for _ in range(3):
        q, v = model.home.copy(), np.zeros(model.nv)
        q[7:], v[6:] = rng.uniform(-0.7, 0.7, 2), rng.uniform(-1.0, 1.0, 2)
        data.qpos[:], data.qvel[:] = np.r_[0, 0, 0, 1, 0, 0, 0, q[7:]], np.r_[np.zeros(6), v[6:]]
        data.qfrc_applied[:] = np.r_[FORCE, TORQUE, 0.0, 0.0]
        mujoco.mj_forward(engine, data)
        own = model.acceleration(0.0, q, v, np.r_[FORCE, TORQUE, 0.0, 0.0])
        np.testing.assert_allclose(data.qacc, own, rtol=1e-6, atol=1e-9)


def test_mass_that_the_bus_counts_is_taken_out_where_it_rests(tmp_path):
    whole = build_model(craft(tmp_path, TANK.model_copy(update={"mass_in_bus": True})))
    bare = build_model(craft(tmp_path, SloshPendulum(name="t", pivot=tuple(PIVOT), mass=1e-12, length=0.5)))
    at = [pin.computeTotalMass(m.pin) for m in (whole, bare)]
    assert at[0] == pytest.approx(at[1])
    locked = [pin.crba(m.pin, m.pin.createData(), m.home)[:6, :6] for m in (whole, bare)]
    np.testing.assert_allclose(np.triu(locked[0]), np.triu(locked[1]), atol=1e-9)
    with pytest.raises(ValidationError, match="must not be zero"):
        SloshPendulum(name="t", pivot=(0, 0, 0), direction=(0, 0, 0), mass=1.0, length=1.0)


def test_a_tracker_finds_its_mass_and_length_under_thrust(tmp_path):
    """A burn with a kick across it, gyro and accelerometer: 30 s of the numpy world's rod."""
    sensors = guess(tmp_path, _Satellite(), tank=False, panel=False).sensor[:2]
    described = SloshPendulum(
        name="tank", pivot=tuple(PIVOT), mass=MASS * 1.1, length=LENGTH * 0.9, damping=DAMPING,
        known=("damping", "stiffness"),
    )  # fmt: skip
    tracker = Tracker(
        craft(tmp_path, described, sensor=sensors), follow={"tank.mass": 0.0, "tank.length": 0.0}
    )
    rng, step, n = np.random.default_rng(5), 0.1, 4  # with steps of 0.1 s the world itself is 4 sigma off
    h = step / n
    x = np.concatenate([np.zeros(3), np.eye(3).ravel(), np.zeros(12)])
    x[18:21] = PIVOT - [0.0, 0.0, LENGTH]
    at = np.asarray(sensors[1].position)
    for k in range(round(30.0 / step) + 1):
        k1 = rod(x)
        w, dw = x[15:18], k1[15:18]
        read = k1[12:15] + cross(w, x[12:15]) + cross(dw, at) + cross(w, cross(w, at))
        own = {
            "st.attitude": pin.Quaternion(x[3:12].reshape(3, 3)).coeffs(),
            "gyro.angular_rate": w + rng.normal(0.0, 1e-5, 3),
            "gyro.acceleration": read + rng.normal(0.0, 1e-4, 3),
            "command.force": FORCE,
            "command.torque": TORQUE,
        }
        tracker.update(Sample.of(k * step, own))
        for _ in range(n):
            k1 = rod(x)
            k2 = rod(x + h / 2 * k1)
            k3 = rod(x + h / 2 * k2)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rod(x + h * k3))
    off = (tracker.values - [MASS, LENGTH]) / tracker.sigmas
    assert np.abs(off).max() < 3.0, (tracker.values, tracker.sigmas)
    assert (tracker.sigmas < 0.01 * np.array([MASS, LENGTH])).all()
    assert tracker.watch.explained


class _Satellite:
    """Bodies that `guess` asks of, of which only the sensors are used."""

    mass, inertia, wheel = BUS, INERTIA, 0.04
