"""Angles that are late against torques: found with all else, and allowed for where torques are judged."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from smsid.arm import identify_arm, with_friction_laws, with_joint_effects
from smsid.arm.identify import rigid_arm
from smsid.arm.smooth_motion import smooth_motion
from smsid.arm.solve import delay_column, torque_means
from smsid.diagnose import diagnose
from smsid.recording import Recording

from .test_one_joint import axis

KINDS = ("joint_friction", "torque_offset")


def rows(t):
    """Angle, rate and acceleration of the axis: two sines."""
    return (
        0.1 * np.sin(4.3 * t) + 0.05 * np.sin(9.1 * t + 1.0),
        0.43 * np.cos(4.3 * t) + 0.455 * np.cos(9.1 * t + 1.0),
        -1.849 * np.sin(4.3 * t) - 4.1405 * np.sin(9.1 * t + 1.0),
    )


def force(t):
    _, v, a = rows(t)
    return 95.0 * a + 200.0 * v + 20.0 * np.tanh(v / 0.002) - 3.0


def log(rng, ahead=0.0, seconds=12.0, role="estimation"):
    t = np.arange(0.0, seconds, 0.004)
    channels = {
        "encoder.joint_position": (rows(t)[0] + 1e-6 * rng.normal(size=t.size))[:, None],
        "drive.joint_torque": (force(t + ahead) + 3.0 * rng.normal(size=t.size))[:, None],
    }
    return Recording.from_arrays(t, channels, labels={"joint": ("slide",)}, role=role, name="log")


@pytest.mark.parametrize("ahead", [0.0, 0.0013, -0.007])
def test_the_delay_is_found_and_friction_is_not_biased_by_it(tmp_path, rng, ahead):
    arm = with_joint_effects(axis(tmp_path), ("slide",), *KINDS)
    found = identify_arm(arm, log(rng, ahead))
    assert abs(found.delay.value - ahead) < 4.0 * found.delay.sigma < 0.0012
    viscous = found.estimate["friction_slide.viscous"]
    assert abs(viscous.value - 200.0) < 4.0 * viscous.sigma < 12.0
    told = [n for n in found.estimate.notes if "the torque signal is" in n]
    assert len(told) == (ahead != 0.0)
    # 3 N of noise, averaged over blocks: nothing of the delay is left on another recording
    noise = 3.0 / np.sqrt(found.torques.length)
    other = found.judge(log(rng, ahead, role="validation"))
    assert other.rmse["slide"] < 1.4 * noise


def test_means_are_those_of_the_samples_a_while_before(tmp_path, rng):
    model = rigid_arm(axis(tmp_path))
    motion = smooth_motion(model, log(rng))
    starts = motion.blocks(5)
    smooth = np.sin(2.0 * motion.time)[:, None]
    whole = type(motion)(**{**vars(motion), "torque": smooth})
    for late in (0.0, 0.004, 0.0055, -0.013):
        means = torque_means(whole, starts, late)[3:-3, 0]
        begin = motion.time[starts] - 0.5 * motion.step - late
        width = 5 * motion.step
        exact = (np.cos(2.0 * begin) - np.cos(2.0 * (begin + width))) / (2.0 * width)
        np.testing.assert_allclose(means, exact[3:-3], atol=3e-5)
    at = motion.time[starts]
    column = delay_column(motion, starts, np.sin(2.0 * at)[:, None])
    np.testing.assert_allclose(column[1:-1, 0], 2.0 * np.cos(2.0 * at[1:-1]), atol=3e-3)


def emps(name, role):
    """A recording of a real axis with a ball screw."""
    folder = Path(os.environ.get("SMSID_DATA", "")) / "emps"
    if not (folder / name).is_file():
        pytest.skip("SMSID_DATA has no copy of emps")
    data = loadmat(str(folder / name))
    t, q, signal = (data[k].ravel() for k in ("t", "qm", "vir"))
    channels = {
        "encoder.joint_position": q[:, None],
        "drive.joint_torque": float(data["gtau"].item()) * signal[:, None],
    }
    return Recording.from_arrays(t, channels, labels={"joint": ("slide",)}, role=role, name=name)


def test_pulses_of_emps_are_predicted_better_than_by_hand(tmp_path):
    log = emps("DATA_EMPS.mat", "estimation")
    arm = with_friction_laws(
        with_joint_effects(axis(tmp_path), ("slide",), *KINDS), ("slide",), ("direction",)
    )
    found = identify_arm(arm, log)
    assert found.judge(emps("DATA_EMPS_PULSES.mat", "validation")).relative < 0.0446
    assert 0.0 < found.delay.value < 0.001


@pytest.mark.parametrize("name", ["DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"])
def test_the_diagnosis_of_emps_finds_the_delay_that_its_sliding_tells(tmp_path, name):
    """0.75 ms where the axis is not near rest, by least squares; 1.02 +- 0.03 and 0.92 +- 0.02 were told."""
    causes = diagnose(axis(tmp_path), [emps(name, "estimation")]).diagnosis.causes
    assert {c.shape for c in causes} == {"viscous", "coulomb", "by direction", "delay"}
    values = {p.name: p.value for c in causes for p in c.parameters}
    assert values["actuator_delay_slide.delay"] == pytest.approx(0.75e-3, abs=0.2e-3)
    assert values["joint_friction_slide.coulomb"] > 20.0
