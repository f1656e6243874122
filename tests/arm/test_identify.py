"""Identification of a welded arm: from an independent engine's torques, and from a real one's."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from smsid.arm import identify_arm, with_joint_effects
from smsid.arm.regression import correlation_lags, solve_joints
from smsid.datasets import have, tx40
from smsid.description import Description
from smsid.effects import Gear, JointOffset, MotorCoupling
from smsid.errors import DescriptionError, NotIdentifiableError, RecordingError
from smsid.recording import Recording

JOINTS = ("joint1", "joint2", "joint3")
RATE = 500.0
VISCOUS, ROTOR = (400.0, 300.0, 200.0), (0.0, 30.0, 20.0)
DOCUMENTED_VISCOUS = (8.05, 5.53, 1.97, 1.11, 1.86, 0.65)  # published with the data, TX40_config.yaml


@pytest.fixture(scope="module")
def arm(urdf) -> Description:
    return Description(name="arm", urdf="arm3.urdf", folder=urdf, root="fixed", gravity=(0.0, 0.0, -9.81))


@pytest.fixture(scope="module")
def log(arm) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time, joint angles and torques from MuJoCo's inverse dynamics, with its own friction and armature."""
    spec = mujoco.MjSpec.from_file(str(arm.folder / arm.urdf))
    spec.option.gravity = list(arm.gravity)
    model = spec.compile()
    model.dof_damping[:], model.dof_armature[:] = VISCOUS, ROTOR
    assert [model.joint(k).name for k in range(model.njnt)] == list(JOINTS)
    t = np.arange(0.0, 12.0, 1.0 / RATE)
    rng = np.random.default_rng(2)
    omega = 2 * np.pi * 0.25 * np.arange(1, 5)
    phase, size = rng.uniform(0, 2 * np.pi, (3, 4, 1)), rng.uniform(0.2, 0.6, (3, 4, 1))
    arg = omega[:, None] * t + phase
    q = np.sum(size * np.sin(arg), axis=1).T
    v = np.sum(size * omega[:, None] * np.cos(arg), axis=1).T
    a = -np.sum(size * omega[:, None] ** 2 * np.sin(arg), axis=1).T
    data, torque = mujoco.MjData(model), np.empty_like(q)
    for k in range(len(t)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], v[k], a[k]
        mujoco.mj_inverse(model, data)
        torque[k] = data.qfrc_inverse
    return t, q, torque


def recording(t, q, torque, source="encoder", labels=JOINTS, role="estimation") -> Recording:
    return Recording.from_arrays(
        t,
        {f"{source}.joint_position": q, f"{source}.joint_torque": torque},
        labels={"joint": labels},
        role=role,
    )


def test_friction_and_rotors_of_another_engine_are_found_within_their_intervals(arm, log, rng):
    t, q, torque = log
    noisy = torque + 5.0 * rng.normal(size=torque.shape)
    full = with_joint_effects(arm, JOINTS, "joint_friction", "motor_inertia")
    found = identify_arm(full, recording(t, q, noisy))
    for joint, viscous, rotor in zip(JOINTS, VISCOUS, ROTOR, strict=True):
        p = found.estimate[f"friction_{joint}.viscous"]
        assert abs(p.value - viscous) < 4.0 * p.sigma and p.sigma < 0.05 * viscous
        coulomb = found.estimate[f"friction_{joint}.coulomb"]
        assert abs(coulomb.value) < 4.0 * coulomb.sigma < 20.0
        if joint == "joint3":  # the others' rotors are told apart from no link
            p = found.estimate[f"rotor_{joint}.inertia"]
            assert abs(p.value - rotor) < 4.0 * p.sigma and p.sigma < 0.2 * rotor
    assert found.judge(recording(t, q, torque, role="validation")).relative < 0.01


def test_a_model_without_friction_is_worse_on_other_data(arm, log):
    t, q, torque = log
    early, late = slice(0, 4000), slice(4000, None)
    held = recording(t[late], q[late], torque[late], role="validation")
    bare = identify_arm(arm, recording(t[early], q[early], torque[early])).judge(held).relative
    full = with_joint_effects(arm, JOINTS, "joint_friction", "motor_inertia")
    assert identify_arm(full, recording(t[early], q[early], torque[early])).judge(held).relative < 0.1 * bare


def test_what_is_measured_at_coupled_motors_in_another_order_gives_the_same(arm, log):
    t, q, torque = log
    full = with_joint_effects(arm, JOINTS, "joint_friction")
    direct = identify_arm(full, recording(t, q, torque))
    gears = (
        Gear(name="g1", joint="joint1", ratio=50.0),
        Gear(name="g2", joint="joint2", ratio=-30.0, torque_gain=0.5),
        Gear(name="g3", joint="joint3", ratio=20.0, also={"joint2": 20.0}),
    )
    zero = JointOffset(name="zero", joint="joint3", angle=0.3)
    matrix = np.array([[50.0, 0, 0], [0, -30.0, 0], [0, 20.0, 20.0]])
    theta = (q - [0.0, 0.0, 0.3]) @ matrix.T
    signal = np.linalg.solve(matrix.T, torque.T).T / [1.0, 0.5, 1.0]
    order = [2, 0, 1]
    at_motors = recording(t, theta[:, order], signal[:, order], "motor", tuple(JOINTS[k] for k in order))
    again = identify_arm(full.with_effects(*gears, zero), at_motors)
    np.testing.assert_allclose(again.regression.x, direct.regression.x, rtol=1e-6, atol=1e-8)


def test_what_no_motion_tells_apart_is_not_given_a_value(arm, log):
    t, q, torque = log
    full = with_joint_effects(arm, JOINTS, "motor_inertia")
    estimate = identify_arm(full, recording(t, q, torque)).estimate
    first = estimate["rotor_joint1.inertia"]
    assert first.status == "not_identifiable" and np.isnan(first.value)
    assert any("rotor_joint1.inertia" in p.name and "Izz" in p.name for p in estimate.parameters)


def test_arms_at_rest_a_floating_base_and_validation_data_are_refused(arm, log):
    t, q, torque = log
    with pytest.raises(NotIdentifiableError):
        identify_arm(with_joint_effects(arm, JOINTS, "joint_friction"), recording(t, 0 * q, torque))
    with pytest.raises(DescriptionError, match="floats"):
        free = arm.model_copy(update={"root": "free", "urdf": "paper_sms.urdf"})
        identify_arm(free, recording(t, q, torque))
    with pytest.raises(RecordingError, match="for validation"):
        identify_arm(arm, recording(t, q, torque, role="validation"))
    with pytest.raises(RecordingError, match=r"unknown 'elbow'; missing 'joint3'"):
        identify_arm(arm, recording(t, q, torque, labels=("joint1", "joint2", "elbow")))


def test_covariance_holds_when_errors_are_correlated(rng):
    """Of 200 fits with errors correlated over 20 samples, the spread is the predicted one."""
    rows = np.stack([np.sin(np.arange(2000) / 30.0), np.cos(np.arange(2000) / 50.0)], axis=1)[:, None, :]
    kernel = np.ones(20) / np.sqrt(20.0)
    found, predicted = [], []
    for _ in range(200):
        error = np.convolve(rng.normal(size=2019), kernel, mode="valid")[:, None]
        solved = solve_joints(rows, rows @ np.array([1.0, -2.0]) + error)
        found.append(solved.x)
        predicted.append(solved.sigma)
    ratio = np.std(found, axis=0) / np.mean(predicted, axis=0)
    assert np.all((ratio > 0.8) & (ratio < 1.25))


def test_correlation_lags_of_white_and_of_slow_residuals(rng):
    white = rng.normal(size=(5000, 2))
    slow = np.apply_along_axis(lambda x: np.convolve(x, np.ones(50), mode="valid"), 0, white)
    assert correlation_lags(white) <= 2
    assert 35 <= correlation_lags(slow) <= 60


@pytest.fixture(scope="module")
def staubli():
    if not have("staubli_tx40"):
        pytest.skip("SMSID_DATA has no copy of staubli_tx40")
    return tx40(download=False)


def test_staubli_tx40_predicts_its_held_out_torques(staubli):
    bare, log = staubli
    joints = log.labels["joint"]
    train = log.window(0.0, 5.9999).with_role("estimation")
    held = log.window(6.0, 9.0).with_role("validation")
    friction = with_joint_effects(bare, joints, "joint_friction", "motor_inertia")
    # the published values are of a sharp sign
    coupling = MotorCoupling(name="wrist", joints=("joint_5", "joint_6"), smoothing=0.02)
    wrist = friction.with_effects(coupling)
    errors = [identify_arm(d, train).judge(held).relative for d in (bare, friction)]
    found = identify_arm(wrist, train)
    errors.append(found.judge(held).relative)
    assert errors[0] > errors[1] > errors[2] and errors[2] < 0.16
    coupling = found.estimate["wrist.viscous"].value
    assert coupling == pytest.approx(0.616, rel=0.1)
    assert found.estimate["wrist.coulomb"].value == pytest.approx(1.95, rel=0.1)
    for k, documented in enumerate(DOCUMENTED_VISCOUS):
        own = found.estimate[f"friction_joint_{k + 1}.viscous"].value
        # the published values of joints 5 and 6 are for the joint's own rate: the coupled motor's share
        # included
        assert own + (coupling if k >= 4 else 0.0) == pytest.approx(documented, rel=0.1)
