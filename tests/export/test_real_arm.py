"""A real arm, identified, exported, read back: it predicts the torques it has not seen."""

from __future__ import annotations

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from smsid.arm import JointStates, identify_arm, joint_motion, torque_errors, with_joint_effects
from smsid.arm.identify import rigid_arm, torque_rows
from smsid.datasets import have, tx40
from smsid.description import Description, load_description
from smsid.effects import MotorCoupling
from smsid.export import export_folder
from smsid.model.regressor import Regressor
from smsid.recording import Recording


def test_the_exported_tx40_predicts_held_out_torques(tmp_path):
    if not have("staubli_tx40"):
        pytest.skip("SMSID_DATA has no copy of staubli_tx40")
    bare, log = tx40(download=False)
    train = log.window(0.0, 5.9999).with_role("estimation")
    held = log.window(6.0, 9.0).with_role("validation")
    kinds = ("joint_friction", "motor_inertia", "torque_offset")
    description = with_joint_effects(bare, log.labels["joint"], *kinds).with_effects(
        MotorCoupling(name="wrist", joints=("joint_5", "joint_6"))
    )
    found = identify_arm(description, train, cutoff=100.0)
    out = export_folder(description, tmp_path / "out", found.estimate).folder
    exported = load_description(out / "staubli_tx40.toml")
    model = rigid_arm(exported)
    motion = joint_motion(model, held, 100.0)
    rows, names, _ = torque_rows(model, JointStates(motion.q, motion.v, motion.a))
    values = {p.name: p.value for e in exported.effect for p in e.parameters()}
    x = np.concatenate([Regressor(model).parameters, [values[n] for n in names if n in values]])
    physical = torque_errors(model, rows @ x, motion.torque).relative
    # physical bodies instead of free combinations cost a little
    assert physical < 0.16
    mj = mujoco.MjModel.from_xml_path(str(out / "staubli_tx40.xml"))
    assert (mj.nv, mj.ntendon) == (6, 1)


def test_a_held_tool_is_not_counted_twice(tmp_path):
    """What was identified of the last link has the tool in it, which the URDF has beside it."""
    head, link = (
        '<robot name="two"><link name="base"/>',
        '<link name="l{k}"><inertial><origin xyz="{x} 0 0"/><mass value="{m}"/>'
        '<inertia ixx="0.01" iyy="0.08" izz="0.09" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="j{k}" type="revolute"><parent link="{p}"/><child link="l{k}"/>'
        '<origin xyz="{at} 0 0"/><axis xyz="0 {y} {z}"/>'
        '<limit lower="-9" upper="9" effort="50" velocity="9"/></joint>',
    )
    text = head + link.format(k=1, x=0.3, m=4, p="base", at=0, y=1, z=0)
    text += link.format(k=2, x=0.2, m=2, p="l1", at=0.5, y=1, z=0)
    text += link.format(k=3, x=0.1, m=1.5, p="l2", at=0.4, y=0, z=1) + "</robot>"
    (tmp_path / "two.urdf").write_text(text)
    model = pin.buildModelFromXML(text)
    draw, t = np.random.default_rng(0), np.arange(0.0, 20.0, 0.01)
    omega = 2.0 * np.pi * np.array([0.1, 0.25, 0.4])
    phase = omega[:, None] * t + draw.uniform(0.0, 6.0, (2, 3, 1))
    q, v, a = (
        np.vstack([np.sum(x, axis=1), 0.0 * t]).T
        for x in (
            0.5 * np.sin(phase),
            0.5 * omega[:, None] * np.cos(phase),
            -0.5 * omega[:, None] ** 2 * np.sin(phase),
        )
    )
    torque = np.array([pin.rnea(model, model.createData(), *x) for x in zip(q, v, a, strict=True)])
    torque[:, :2] += 0.05 * draw.normal(size=(t.size, 2))
    channels = {"e.joint_position": q[:, :2], "d.joint_torque": torque[:, :2]}
    log = Recording.from_arrays(t, channels, labels={"joint": ("j1", "j2")}, role="estimation")
    arm = Description(name="two", urdf="two.urdf", folder=tmp_path, root="fixed", gravity=(0.0, 0.0, -9.81))
    found = identify_arm(arm, log, hold={"j3": 0.0})
    export_folder(arm, tmp_path / "out", found.estimate)
    written = pin.buildModelFromUrdf(str(tmp_path / "out" / "two.urdf"))
    again = np.array([pin.rnea(written, written.createData(), *x) for x in zip(q, v, a, strict=True)])
    np.testing.assert_allclose(again[:, :2], torque[:, :2], atol=0.3)
    assert sum(i.mass for i in written.inertias) == pytest.approx(7.5, rel=0.05)
