"""Readings at the joints: encoders that begin anew, samples that are missing."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.arm import identify_arm
from smsid.arm.identify import rigid_arm
from smsid.arm.readings import joint_readings, whole_turns
from smsid.description import Description
from smsid.errors import RecordingError
from smsid.recording import Recording

URDF = """<robot name="one"><link name="base"/>
<link name="l"><inertial><origin xyz="0.3 0 0"/><mass value="5"/>
<inertia ixx="0.01" iyy="0.2" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="{kind}"><parent link="base"/><child link="l"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="50" velocity="5"/></joint></robot>"""


def arm(tmp_path, kind="continuous"):
    (tmp_path / "one.urdf").write_text(URDF.format(kind=kind))
    return Description(name="one", urdf="one.urdf", folder=tmp_path, root="fixed", gravity=(0.0, 0.0, -9.81))


def log(rng, *, wrapped: bool):
    t = np.arange(0.0, 20.0, 0.005)
    q = 3.0 * np.sin(0.7 * t) + 1.2 * np.sin(1.9 * t) + 0.5
    a = -1.47 * np.sin(0.7 * t) - 4.332 * np.sin(1.9 * t)
    torque = (0.2 + 5.0 * 0.09) * a - 5.0 * 9.81 * 0.3 * np.cos(q) + 0.05 * rng.normal(size=t.size)
    read = q + 1e-5 * rng.normal(size=t.size)
    read = (read + np.pi) % (2 * np.pi) - np.pi if wrapped else read
    channels = {"encoder.joint_position": read[:, None], "drive.joint_torque": torque[:, None]}
    return q, Recording.from_arrays(t, channels, labels={"joint": ("j",)}, role="estimation", name="log")


def test_a_wrapped_encoder_of_a_continuous_joint_is_unwrapped(tmp_path, rng):
    q, recording = log(rng, wrapped=True)
    readings = joint_readings(rigid_arm(arm(tmp_path)), recording)
    np.testing.assert_allclose(readings.position[:, 0], q, atol=1e-4)
    assert readings.unwrapped["j"] > 2
    estimate = identify_arm(arm(tmp_path), recording).estimate
    inertia, first = estimate["l.Iyy"], estimate["l.mx"]
    assert abs(inertia.value - 0.65) < 4.0 * inertia.sigma < 0.02
    assert abs(first.value - 1.5) < 4.0 * first.sigma < 0.02
    assert any("begins anew" in note for note in estimate.notes)


def test_a_turn_that_limits_forbid_is_refused(tmp_path, rng):
    with pytest.raises(RecordingError, match=r"'j' jumps by a whole turn"):
        joint_readings(rigid_arm(arm(tmp_path, "revolute")), log(rng, wrapped=True)[1])


def test_fast_motion_and_steps_are_no_turns():
    t = np.arange(0.0, 5.0, 0.01)
    assert not whole_turns((40.0 * np.sin(3.0 * t))[:, None]).any()
    assert not whole_turns(np.where(t > 2.0, 3.0, 0.0)[:, None]).any()


def test_missing_samples_are_left_out(tmp_path, rng):
    _, recording = log(rng, wrapped=False)
    holes = np.array(recording["encoder.joint_position"])
    holes[1000:1040] = np.nan
    holes[2000] = np.nan
    estimate = identify_arm(
        arm(tmp_path), recording.with_channels({"encoder.joint_position": holes})
    ).estimate
    assert abs(estimate["l.Iyy"].value - 0.65) < 4.0 * estimate["l.Iyy"].sigma < 0.02
    readings = joint_readings(
        rigid_arm(arm(tmp_path)), recording.with_channels({"encoder.joint_position": holes})
    )
    assert len(readings.stretches) == 2
