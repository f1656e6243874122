"""The reference recordings of another engine come in without code, sample for sample."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from smsid.errors import RecordingError
from smsid.recording import import_recording, load_recording, save_recording

ORACLE = Path(os.environ.get("SMSID_ORACLE", ""))
pytestmark = pytest.mark.skipif(
    not os.environ.get("SMSID_ORACLE") or not ORACLE.is_dir(),
    reason="set SMSID_ORACLE to the folder of the reference recordings",
)
NAMES = [
    *("exp1_x", "exp1_xyz", "exp1_xyz_modal3", "exp1_xyz_thruster", "exp1_z", "exp1_z_modal3"),
    *("exp2", "exp2_fric2", "exp2_modal3", "exp2val", "exp2val_modal3"),
]
ARRAYS = {
    "base_pos_P": "pose.position",
    "base_vel_P": "pose.velocity",
    "omega_body": "imu.angular_rate",
    "acc_imu_body": "imu.acceleration",
    "domega_body": "imu.angular_acceleration",
    "q": "encoder.joint_position",
    "qd": "encoder.joint_velocity",
    "qdd": "encoder.joint_acceleration",
    "tau_arm": "command.joint_torque",
    "tau_rw": "command.wheel_torque",
    "rw_rate": "tachometer.wheel_rate",
    "force_body": "command.force",
    "tau_hold": "command.torque",
    "panel_acc_base": "panel.acceleration",
    "truth_slosh": "truth.slosh_position",
    "truth_slosh_vel": "truth.slosh_velocity",
    "truth_panel_modal": "truth.modal_position",
    "truth_panel_modal_vel": "truth.modal_velocity",
    "truth_force_body": "truth.force",
}
UNMAPPED = {
    "t",
    "quat_wxyz",
    "base_pos_cm",
    "base_vel_cm",
    "truth_base_mass",
    "truth_panel_q",
    "truth_panel_qd",
}


def mapping(name: str) -> str:
    return "oracle_exp1" if name.startswith("exp1") else "oracle_exp2"


@pytest.mark.parametrize("name", NAMES)
def test_every_channel_is_the_array_of_the_file(name):
    rec = import_recording(ORACLE / f"{name}.npz", mapping(name))
    with np.load(ORACLE / f"{name}.npz") as raw:
        assert set(raw.files) <= UNMAPPED | set(ARRAYS)
        present = {ARRAYS[array] for array in raw.files if array in ARRAYS}
        assert set(rec.channels) == present | {"pose.attitude"}
        np.testing.assert_array_equal(rec.time(), raw["t"])
        np.testing.assert_array_equal(rec["pose.attitude"], raw["quat_wxyz"][:, [1, 2, 3, 0]])
        for array in set(raw.files) & set(ARRAYS):
            np.testing.assert_array_equal(rec[ARRAYS[array]], raw[array])
    assert rec.suspicious() == []


def test_the_mapping_of_the_other_experiment_names_what_is_missing():
    with pytest.raises(RecordingError, match=r"has no 'force_body'.*it has t, base_pos_P"):
        import_recording(ORACLE / "exp2val.npz", "oracle_exp1")


def test_a_reference_recording_survives_saving(tmp_path):
    rec = import_recording(ORACLE / "exp2val.npz", "oracle_exp2").with_role("validation")
    assert load_recording(save_recording(rec, tmp_path / "val.nc")).equals(rec)
