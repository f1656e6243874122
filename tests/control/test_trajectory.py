"""Trajectories: derivatives, the paper's numbers, limits."""

from __future__ import annotations

import numpy as np
import pytest
from control_cases import paper

from smsid.control.trajectory import (
    Motion,
    Reference,
    ShapedMotion,
    check_joints,
    design_motion,
    minimum_jerk,
    shaper,
    trapezoid,
)
from smsid.description import load_description
from smsid.errors import ControlError
from smsid.model import build_model

START, STOP = np.array([0.4, -0.6, 0.9]), np.array([0.9, 0.1, -0.2])
MOTIONS = {
    "trapezoid": trapezoid(START),
    "minimum jerk": minimum_jerk(START, STOP, 60.0),
    "shaped": ShapedMotion(trapezoid(START), shaper("zvd", [0.065, 0.3], 0.005)),
}


def test_the_paper_s_trapezoid():
    """a_0 = 0.001 for 20 s, coasting at 0.02 rad/s, 0.8 rad in all, at rest from 60 to 80 s."""
    motion = MOTIONS["trapezoid"]
    assert motion.duration == 80.0
    x, v, a = motion.at(10.0)
    np.testing.assert_allclose(x - START, 0.05, rtol=1e-12)
    np.testing.assert_allclose(v, 0.01, rtol=1e-12)
    np.testing.assert_allclose(a, 0.001, rtol=1e-12)
    x, v, a = motion.at(30.0)
    np.testing.assert_allclose([x - START, v, a], np.outer([0.4, 0.02, 0.0], np.ones(3)), atol=1e-15)
    np.testing.assert_allclose(motion.at(50.0)[2], -0.001, rtol=1e-12)
    for t in (60.0, 75.0, 80.0, 100.0):
        x, v, a = motion.at(t)
        np.testing.assert_allclose(x - START, 0.8, rtol=1e-12)
        assert not v.any() and not a.any()


@pytest.mark.parametrize("name", MOTIONS)
def test_rates_and_accelerations_are_derivatives(name):
    motion, h = MOTIONS[name], 1e-4
    for t in np.random.default_rng(0).uniform(0.5, motion.duration - 0.5, 40):
        _, v, a = motion.at(t)
        if np.abs(motion.at(t + h)[2] - motion.at(t - h)[2]).max() > 1e-5:
            continue  # a jump of the trapezoid's acceleration in between
        np.testing.assert_allclose(v, (motion.at(t + h)[0] - motion.at(t - h)[0]) / (2 * h), atol=1e-9)
        np.testing.assert_allclose(a, (motion.at(t + h)[1] - motion.at(t - h)[1]) / (2 * h), atol=1e-7)


@pytest.mark.parametrize("name", MOTIONS)
def test_it_rests_before_and_after(name):
    motion = MOTIONS[name]
    for t, at in ((-1.0, START), (motion.duration + 1.0, None)):
        x, v, a = motion.at(t)
        assert np.abs(v).max() < 1e-15 and np.abs(a).max() < 1e-15
        if at is not None:
            np.testing.assert_allclose(x, at, atol=1e-15)
    np.testing.assert_allclose(MOTIONS["minimum jerk"].at(60.0)[0], STOP, atol=1e-14)


def test_minimum_jerk_has_less_jerk_than_neighbours():
    """Any admissible change raises the integral of the squared jerk: here s^3 (1 - s)^3 of either sign."""
    s = np.linspace(0.0, 1.0, 20001)
    jerk = 60.0 * (1 - 6 * s + 6 * s**2)
    bump = np.polynomial.Polynomial([0, 0, 0, 1, -3, 3, -1]).deriv(3)(s)
    exact = np.trapezoid(jerk**2, s)
    assert np.trapezoid((jerk + 0.1 * bump) ** 2, s) > exact < np.trapezoid((jerk - 0.1 * bump) ** 2, s)
    motion = minimum_jerk(np.zeros(1), np.ones(1), 1.0)
    numeric = np.gradient([motion.at(float(t))[2][0] for t in s], s)
    np.testing.assert_allclose(numeric[2:-2], jerk[2:-2], atol=1e-3)


@pytest.mark.parametrize("kind", [pytest.param("zv", marks=pytest.mark.slow), "zvd", "ei"])
def test_a_shaped_trapezoid_leaves_its_mode_at_rest(kind):
    """An oscillator driven by the acceleration, integrated exactly between the breaks of the command."""
    f, zeta = 0.065, 0.005
    omega = 2 * np.pi * f
    plain = trapezoid(np.zeros(1), phases=(17.0, 11.0, 17.0, 0.0))
    shaped = ShapedMotion(plain, shaper(kind, [f], zeta))

    def left(motion):
        dt, state = 0.01, np.zeros(2)
        from scipy.linalg import expm

        block = np.zeros((3, 3))
        block[:2] = [[0.0, 1.0, 0.0], [-(omega**2), -2 * zeta * omega, 1.0]]
        step = expm(block * dt)[:2]
        for k in range(round(motion.duration / dt) + 1):
            state = step @ np.array([*state, motion.at((k + 0.5) * dt)[2][0]])
        return np.hypot(omega * state[0], state[1])

    assert left(shaped) < (0.05 if kind == "ei" else 2e-3) * 1.2 * left(plain)
    assert left(plain) > 1e-4


def test_joint_limits_are_checked():
    model = paper()
    check_joints(trapezoid(START), model)
    with pytest.raises(ControlError, match=r"'joint\d' would be at .* rad at t = .*past its limit"):
        check_joints(trapezoid(START, 0.01), model)
    with pytest.raises(ControlError, match="rad/s"):
        check_joints(minimum_jerk(START, STOP, 0.05), model)
    with pytest.raises(ControlError, match="moves 2 joints, the spacecraft has 3"):
        check_joints(trapezoid(np.zeros(2)), model)


def test_reference_holds_the_base():
    reference = Reference(MOTIONS["trapezoid"], (0.1, 0.2, 0.3))
    x, v, a = reference.at(10.0)
    assert reference.size == 6 and reference.duration == 80.0
    np.testing.assert_allclose(x[:3], [0.1, 0.2, 0.3])
    assert not v[:3].any() and not a[:3].any()


@pytest.mark.parametrize(
    "make",
    [
        lambda: trapezoid(START, [0.1, 0.2]),
        lambda: trapezoid(START, phases=(20.0, 20.0, 20.0)),
        lambda: trapezoid(START, phases=(20.0, 20.0, 10.0, 20.0)),
        lambda: trapezoid([0.0, np.nan, 0.0]),
        lambda: minimum_jerk(START, STOP[:2], 10.0),
        lambda: minimum_jerk(START, STOP, 0.0),
        lambda: shaper("zv", [0.0]),
        lambda: shaper("zv", []),
        lambda: shaper("zv", [0.1], 1.0),
        lambda: shaper("zv", [0.1, 0.2], [0.1, 0.1, 0.1]),
        lambda: shaper("zvdd", [0.1]),
        lambda: shaper("ei", [0.1], tolerance=0.0),
    ],
)
def test_bad_input_is_refused(make):
    with pytest.raises(ControlError):
        make()


class Own(Motion):
    """A motion of a user's own, which gives `at` alone."""

    size, duration = 2, 5.0

    def at(self, t):
        return np.array([t, t**2]), np.array([1.0, 2.0 * t]), np.array([0.0, 2.0])


def test_a_motion_that_gives_one_time_gives_many():
    times = np.array([0.0, 1.0, 4.0])
    found = Reference(Own(), (0.1, 0.0, -0.2)).sampled(times)
    np.testing.assert_array_equal(found[:, 0, 3:], np.stack([times, times**2], axis=1))
    np.testing.assert_array_equal(found[:, 1, 3:], np.stack([np.ones(3), 2.0 * times], axis=1))
    np.testing.assert_array_equal(found[:, 0, :3], np.tile([0.1, 0.0, -0.2], (3, 1)))


RAIL = """<robot name="r"><link name="bus"><inertial><mass value="50"/>
<inertia ixx="4" iyy="4" izz="4" ixy="0" ixz="0" iyz="0"/></inertial></link><link name="cart"><inertial>
<mass value="5"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="rod"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="rail" type="prismatic"><parent link="bus"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-0.4" upper="0.1" effort="1" velocity="0.01"/></joint>
<joint name="swing" type="revolute"><parent link="cart"/><child link="rod"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="1" velocity="1"/></joint></robot>"""


def test_the_motion_of_a_design_keeps_to_the_joints(tmp_path):
    (tmp_path / "r.urdf").write_text(RAIL)
    model = build_model(load_description(tmp_path / "r.urdf"))
    motion = design_motion(model)
    check_joints(motion, model)
    position, rate, _ = motion.at(30.0)
    assert rate[0] == pytest.approx(-0.9 * 0.4 / 40.0)  # its way back is longer: 0.36 m in 40 s
    assert motion.at(60.0)[0] == pytest.approx([-0.36, 0.8])  # what has room moves as in the paper
    assert position[1] == pytest.approx(trapezoid([0.0]).at(30.0)[0][0])
    with pytest.raises(ControlError, match=r"'rail' would be at .* m at t"):
        check_joints(trapezoid(np.zeros(2)), model)
