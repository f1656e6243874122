"""Signs and scales of one joint that contradict the description, on another engine's recording."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.arm import identify_arm, joint_doubts, torque_scales, with_joint_effects, with_torque_gains
from smsid.arm.input_checks import wrong_column
from smsid.datasets import have, tx40
from smsid.effects import Gear
from smsid.errors import DescriptionError

from .mujoco_arm import JOINTS, described, motion, recorded


@pytest.fixture(scope="module")
def log():
    return motion()


@pytest.fixture(scope="module")
def arm():
    return with_joint_effects(described(), JOINTS, "joint_friction")


def test_a_right_recording_raises_no_doubt(arm, log):
    t, q, _, torque = log
    assert joint_doubts(arm, recorded(t, q, torque)) == ()


@pytest.mark.parametrize("joint", range(3))
@pytest.mark.parametrize("kind", ["sign of angle", "sign of torque", "sign of axis"])
def test_a_turned_joint_is_named(arm, log, joint, kind):
    t, q, _, torque = log
    q, torque = q.copy(), torque.copy()
    if kind != "sign of torque":
        q[:, joint] *= -1.0
    if kind != "sign of angle":
        torque[:, joint] *= -1.0
    (doubt,) = joint_doubts(arm, recorded(t, q, torque))
    assert (doubt.joint, doubt.kind) == (JOINTS[joint], kind)
    assert doubt.after < 0.05 and JOINTS[joint] in doubt.sentence


@pytest.mark.parametrize("joint", range(3))
def test_a_turned_angle_is_named_where_friction_would_explain_it(log, joint):
    # friction that drives and a rotor of negative inertia fit the turned joint's own torque
    t, q, v, torque = log
    rubbed = torque + np.tanh(v / 0.01) * [200.0, 150.0, 100.0] + v * [600.0, 500.0, 300.0]
    turned = q * np.where(np.arange(3) == joint, -1.0, 1.0)
    assert joint_doubts(described(), recorded(t, q, rubbed)) == ()
    (doubt,) = joint_doubts(described(), recorded(t, turned, rubbed))
    assert (doubt.joint, doubt.kind) == (JOINTS[joint], "sign of angle")
    assert "sign = [...]" in doubt.sentence


def test_signs_of_a_real_arm_are_told_and_what_torques_cannot_tell_apart_together():
    if not have("staubli_tx40"):
        pytest.skip("SMSID_DATA has no copy of staubli_tx40")
    bare, whole = tx40(download=False)
    real = whole.window(0.0, 0.5 * whole.time()[-1])
    channel = next(c for c in real.channels if c.endswith(".joint_position"))
    assert wrong_column(bare, real) is None
    for k, joint in enumerate(real.labels["joint"][:4]):
        turned = np.asarray(real[channel]) * np.where(np.arange(6) == k, -1.0, 1.0)
        doubt = wrong_column(bare, real.with_channels({channel: turned}))
        assert doubt is not None and doubt.joint == joint
        assert "angle" in doubt.told and "torque" in doubt.told  # links of this URDF are too poor to tell


@pytest.mark.parametrize("what", ["angles", "torques", "joints"])
@pytest.mark.parametrize("pair", [(0, 1), (0, 2), (1, 2)])
def test_exchanged_columns_are_named(arm, log, what, pair):
    t, q, _, torque = log
    order = np.arange(3)
    order[list(pair)] = pair[::-1]
    angles = q if what == "torques" else q[:, order]
    (doubt,) = joint_doubts(arm, recorded(t, angles, torque if what == "angles" else torque[:, order]))
    assert doubt.joint == f"{JOINTS[pair[0]]}, {JOINTS[pair[1]]}" and doubt.kind == f"order of {what}"


def test_a_current_in_place_of_a_torque_is_named(arm, log):
    t, q, _, torque = log
    mixed = torque * [1.0, 0.02, 1.0]  # joint2 logs current
    (doubt,) = joint_doubts(arm, recorded(t, q, mixed))
    assert (doubt.joint, doubt.kind) == ("joint2", "torque scale")
    assert "0.02" in doubt.sentence and "current" in doubt.sentence


def test_exchanged_torques_are_named_beside_a_joint_with_a_fault_of_its_own(arm, log, rng):
    t, q, _, torque = log
    noisy = np.column_stack([torque[:, 1], torque[:, 0], 10.0 * rng.normal(size=t.size)])
    (doubt,) = joint_doubts(arm, recorded(t, q, noisy))
    assert (doubt.joint, doubt.kind) == ("joint1, joint2", "order of torques")
    assert doubt.after < 0.05


def test_links_that_are_off_by_a_third_raise_no_doubt(arm, log):
    t, q, _, torque = log
    assert joint_doubts(arm, recorded(t, q, 1.3 * torque)) == ()


def test_unknown_gains_are_found_from_known_links(arm, log):
    t, q, _, torque = log
    gears = [
        Gear(name=f"g{k}", joint=n, ratio=r)
        for k, (n, r) in enumerate(zip(JOINTS, (50, -80, 30), strict=True))
    ]
    geared = arm.with_effects(*gears)
    gain = np.array([0.4, 0.25, 0.6])
    ratios = np.array([50.0, -80.0, 30.0])
    log_ = recorded(t, q * ratios, torque / ratios / gain, source="motor")
    scales = torque_scales(geared, log_)
    found = with_torque_gains(geared, scales)
    for k, s in enumerate(scales):
        assert found.get_effect(f"g{k}").torque_gain == pytest.approx(gain[k], rel=0.01)
        assert abs(s.value - 1.0 / gain[k]) < 4.0 * s.sigma


def test_residuals_show_the_friction_a_rigid_model_lacks(log):
    t, q, _, torque = log
    rigid = identify_arm(described(), recorded(t, q, torque), cutoff=20.0)
    full = identify_arm(
        with_joint_effects(described(), JOINTS, "joint_friction"), recorded(t, q, torque), cutoff=20.0
    )
    held = recorded(*[x for k, x in enumerate(motion(seed=8)) if k != 2])
    assert np.std(rigid.residual(held)) > 5.0 * np.std(full.residual(held))
    errors = full.judge(held)
    np.testing.assert_allclose(
        np.sqrt(np.mean(full.residual(held) ** 2, axis=0)), [errors.rmse[n] for n in JOINTS]
    )


def test_gains_need_gears_and_certainty(arm, log):
    t, q, _, torque = log
    scales = torque_scales(arm, recorded(t, q, torque))
    with pytest.raises(DescriptionError, match="no effect of kind 'gear'"):
        with_torque_gains(arm, scales)
    gear = Gear(name="g", joint="joint1", ratio=50.0)
    noise = np.random.default_rng(0).normal(size=torque.shape)
    unsure = torque_scales(arm, recorded(t, q, noise))[:1]
    with pytest.raises(DescriptionError, match="no gain can be told"):
        with_torque_gains(arm.with_effects(gear), unsure)
