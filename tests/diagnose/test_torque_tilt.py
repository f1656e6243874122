"""A base that leans, found from an arm's torques: MuJoCo's gravity in the axes of the base is turned."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from smsid.arm import identify_arm, with_joint_effects
from smsid.arm.identify import rigid_arm, torque_rows
from smsid.arm.motion import measured_states
from smsid.description import load_description, save_description
from smsid.diagnose import diagnose
from smsid.diagnose.torque._equations import torque_equations
from smsid.diagnose.torque._known import prior_of
from smsid.effects import BaseTilt
from smsid.effects.external import tilt_of, tilted_gravity
from tests.diagnose.torque_world import JOINTS, described, on, recorded

UPRIGHT = (0.0, 0.0, -9.81)


def upright():
    return described().model_copy(update={"gravity": UPRIGHT})


def leaning(x: float, y: float) -> np.ndarray:
    """Gravity of a base that leans: towards +x where it turns about -y."""
    return Rotation.from_rotvec([y, -x, 0.0]).apply(UPRIGHT)


def angles(cause) -> tuple[np.ndarray, np.ndarray]:
    by_name = {p.name.partition(".")[2]: p for p in cause.parameters}
    pair = [by_name.get(axis) for axis in "xy"]
    return (
        np.array([0.0 if p is None else p.value for p in pair]),
        np.array([np.inf if p is None else p.sigma for p in pair]),
    )


@pytest.mark.parametrize("lean", [(0.0872, 0.0), (-0.02, 0.03)])
def test_a_base_that_leans_is_named_with_its_angles_and_nothing_else(lean):
    log = recorded(seed=3, gravity=leaning(*lean))
    found = diagnose(upright(), [log])
    result = found.diagnosis
    assert [c.effect for c in result.causes] == ["base_tilt"], result.sentence
    assert result.verdict == "explained", result.sentence
    value, sigma = angles(result.causes[0])
    truth = leaning(*lean) / 9.81
    assert np.allclose(tilted_gravity(np.array([0.0, 0.0, -1.0]), *lean), truth, atol=1e-3)
    assert np.all(np.abs(value - lean) < 3.0 * sigma), (value, sigma)
    assert np.all(sigma < 0.01)


def test_the_tilt_that_is_written_is_read_back_and_explains_another_recording(tmp_path):
    found = diagnose(upright(), [recorded(seed=3, gravity=leaning(0.06, 0.02))])
    save_description(found.extended, tmp_path / "extended.toml")
    extended = load_description(tmp_path / "extended.toml")
    tilt = tilt_of(extended.effect)
    assert tilt is not None
    value, _ = angles(found.diagnosis.causes[0])
    assert np.allclose([tilt.x, tilt.y], value, atol=1e-9)
    again = diagnose(extended, [recorded(seed=4, gravity=leaning(0.06, 0.02))]).diagnosis
    assert again.verdict == "adequate", again.sentence
    own = identify_arm(extended, recorded(seed=4, gravity=leaning(0.06, 0.02)), cutoff=20.0).estimate
    for axis, x in zip("xy", (0.06, 0.02), strict=True):
        p = own[f"{tilt.name}.{axis}"]
        assert abs(p.value - x) < 4.0 * p.sigma < 0.1


def test_a_base_that_leans_is_named_beside_links_that_an_upright_arm_told():
    """More combinations show in a base that leans: what is known of the others is still of those."""
    known = identify_arm(upright(), recorded(seed=4, gravity=UPRIGHT), cutoff=20.0).estimate
    found = diagnose(upright(), [recorded(seed=3, gravity=leaning(0.06, 0.02))], estimate=known).diagnosis
    assert [c.effect for c in found.causes] == ["base_tilt"], found.sentence
    value, sigma = angles(found.causes[0])
    assert np.all(np.abs(value - [0.06, 0.02]) < 3.0 * sigma), (value, sigma)


def test_what_is_known_of_combinations_goes_by_their_names():
    log = recorded(seed=3, seconds=6.0, gravity=UPRIGHT)
    known = identify_arm(upright(), log, cutoff=20.0).estimate
    level, leans = (
        torque_equations(arm, log, cutoff=20.0)
        for arm in (upright(), upright().with_effects(BaseTilt(name="floor", x=0.05)))
    )
    prior = prior_of(level, known)[0]
    there = prior.on(leans)
    shared = set(level.base.names) & set(leans.base.names)
    assert 0 < len(shared) < len(leans.base.names)
    for name, mean, sigma in zip(leans.base.names, there.mean, there.sigma, strict=True):
        if name in shared and np.isfinite(known[name].sigma):
            assert (mean, sigma) == (known[name].value, known[name].sigma)
        else:
            assert np.isinf(sigma)
    back = there.on(level)
    np.testing.assert_array_equal(back.sigma, prior.sigma)


def test_rows_change_with_the_angles_as_those_of_an_arm_on_a_base_that_leans_more():
    def rows(x: float, y: float) -> np.ndarray:
        arm = rigid_arm(upright().with_effects(BaseTilt(name="floor", x=x, y=y)))
        return torque_rows(arm, measured_states(equations.motion))[0]

    floor = BaseTilt(name="floor", x=0.1, y=-0.05)
    equations = torque_equations(upright().with_effects(floor), [recorded(seed=1, seconds=6.0)], cutoff=20.0)
    step = 1e-4
    by_x = (rows(0.1 + step, -0.05) - rows(0.1 - step, -0.05)) / (2.0 * step)
    by_y = (rows(0.1, -0.05 + step) - rows(0.1, -0.05 - step)) / (2.0 * step)
    np.testing.assert_allclose(equations.lean, np.stack([by_x, by_y], axis=-1), atol=1e-6)


def test_friction_is_found_beside_a_tilt():
    log = recorded(on(1, lambda q, v, a, load: 30.0 * v), seed=3, gravity=leaning(0.05, 0.0))
    result = diagnose(upright(), [log]).diagnosis
    assert sorted(c.effect for c in result.causes) == ["base_tilt", "joint_friction"], result.sentence


def test_a_tilt_that_is_described_is_no_cause_and_a_wrong_one_is_corrected():
    log = recorded(seed=3, gravity=leaning(0.05, 0.0))
    right = upright().with_effects(BaseTilt(name="floor", x=0.05))
    assert diagnose(right, [log]).diagnosis.verdict == "adequate"
    wrong = upright().with_effects(BaseTilt(name="floor", x=-0.03))
    found = diagnose(wrong, [log])
    (cause,) = found.diagnosis.causes
    value, sigma = angles(cause)
    assert cause.effect == "base_tilt" and np.all(np.abs(value - [0.05, 0.0]) < 3.0 * sigma)
    assert {p.nominal for p in cause.parameters} <= {-0.03, 0.0}


@pytest.mark.parametrize("seed", [5, 7])
def test_an_upright_arm_with_friction_has_no_tilt(seed):
    log = recorded(lambda q, v, a, load: 40.0 * v + 20.0 * np.tanh(v / 0.01), seed=seed, gravity=UPRIGHT)
    result = diagnose(with_joint_effects(upright(), JOINTS, "joint_friction"), [log]).diagnosis
    assert "base_tilt" not in {c.effect for c in result.causes}, result.sentence
