"""A real arm, identified, exported, read back: it predicts the torques it has not seen."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from smsid.arm import JointStates, identify_arm, joint_motion, torque_errors, with_joint_effects
from smsid.arm.identify import rigid_arm, torque_rows
from smsid.datasets import have, tx40
from smsid.description import load_description
from smsid.effects import MotorCoupling
from smsid.export import export_folder
from smsid.model.regressor import Regressor


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
