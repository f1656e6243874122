"""Servo joints from commands and encoders alone, against MuJoCo's position actuators."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from smsid.arm import identify_servos, with_joint_effects
from smsid.arm.servo import is_of_servos
from smsid.cli.app import app
from smsid.description import Description
from smsid.errors import DescriptionError, NotIdentifiableError, RecordingError
from smsid.recording import save_recording
from tests.screen import fits, shows

from .servo_twin import TRUTH, URDF, recorded

KINDS = ("joint_friction", "motor_inertia", "torque_offset")


@pytest.fixture
def arm(tmp_path) -> Description:
    (tmp_path / "two.urdf").write_text(URDF)
    bare = Description(name="two", urdf="two.urdf", folder=tmp_path, root="fixed", gravity=(0.0, 0.0, -9.81))
    return with_joint_effects(bare, ("j1", "j2"), *KINDS, "servo")


def test_gains_friction_and_rotors_are_inside_their_intervals(arm):
    scores = []
    for seed in range(3):
        found = identify_servos(arm, recorded(seed)).estimate
        scores.append([(found[n].value - x) / found[n].sigma for n, x in TRUTH.items()])
        assert all(found[n].sigma < 0.02 * x for n, x in TRUTH.items())
    assert np.mean(np.abs(scores) < 1.96) > 0.85 and np.abs(scores).max() < 4.0


def test_steps_of_a_held_command_shake_no_rotor_wrong(arm):
    log = recorded(0, noise=2e-6, coulomb=(1e-9, 1e-9))
    found = identify_servos(arm, log).estimate
    for name in ("rotor_j1.inertia", "rotor_j2.inertia"):  # 0.17 % where the steps are taken for a mean
        assert found[name].value == pytest.approx(TRUTH[name], rel=4e-4)


def test_a_torque_limit_is_found_and_does_not_spoil_the_rest(arm):
    log = recorded(1, limits=(11.7, 1e3))
    found = identify_servos(arm, log)
    limit = found.estimate["servo_j1.limit"]
    assert abs(limit.value - 11.7) < 4.0 * limit.sigma < 1.5
    assert any("at its torque's limit" in n for n in found.estimate.notes)
    assert found.description.get_effect("servo_j1").limit == limit.value
    for name in ("servo_j1.stiffness", "friction_j1.viscous"):
        assert found.estimate[name].value == pytest.approx(TRUTH[name], rel=0.01)
    with pytest.raises(NotIdentifiableError, match="limit"):
        identify_servos(arm, recorded(1, limits=(9.8, 1e3)))


def test_known_gains_are_kept_and_their_damping_is_taken_off(arm):
    known = [
        e.model_copy(update={"stiffness": k, "damping": d, "known": ("all",)})
        for e, k, d in zip(arm.effect[-2:], (60.0, 25.0), (1.0, 0.4), strict=True)
    ]
    found = identify_servos(arm.with_effects(*known), recorded(2)).estimate
    assert not any("stiffness" in p.name for p in found.parameters)
    for name, value in (("friction_j1.viscous", 0.5), ("friction_j2.viscous", 0.2)):
        assert abs(found[name].value - value) < 4.0 * found[name].sigma < 0.1


def test_damping_of_the_error_is_told_from_friction(arm):
    damps = [e.model_copy(update={"damps": "error"}) for e in arm.effect[-2:]]
    found = identify_servos(arm.with_effects(*damps), recorded(3)).estimate
    for joint in ("j1", "j2"):  # the twin damps the rate
        gain, viscous = found[f"servo_{joint}.damping"], found[f"friction_{joint}.viscous"]
        assert abs(gain.value) < 4.0 * gain.sigma
        assert abs(viscous.value - TRUTH[f"friction_{joint}.viscous"]) < 4.0 * viscous.sigma


def test_the_command_identifies_servos_of_a_bare_urdf(arm, tmp_path):
    log = recorded(0, seconds=10.0)
    assert is_of_servos([log])
    save_recording(log, tmp_path / "log.nc")
    arguments = ["identify", tmp_path / "two.urdf", tmp_path / "log.nc", "-o", tmp_path / "e.json"]
    shown = CliRunner().invoke(app, [str(x) for x in arguments])
    assert shown.exit_code == 0, shown.output
    fits(shown.stdout)
    assert "servo_j1.stiffness" in shown.output and "back-EMF" in shown.output
    assert "servo_j1.stiffness" in shows(tmp_path / "e.json")


def test_servos_are_judged_by_another_recording_and_reported(arm, tmp_path):
    train, held = recorded(0, seconds=10.0), recorded(7, seconds=6.0).with_role("validation")
    for name, log in (("train", train), ("held", held)):
        save_recording(log.with_name(name), tmp_path / f"{name}.nc")
    arguments = ["identify", tmp_path / "two.urdf", tmp_path / "train.nc", tmp_path / "held.nc"]
    arguments += ["-o", tmp_path / "e.json", "--report", tmp_path / "r.html"]
    shown = CliRunner().invoke(app, [str(x) for x in arguments])
    assert shown.exit_code == 0, shown.output
    row = next(line for line in shown.output.splitlines() if "validation" in line)
    assert float(row.split()[2]) < 0.1
    assert "held: j1" in (tmp_path / "r.html").read_text(encoding="utf-8")
    found = identify_servos(arm, train)
    both = found.compare(held)
    kept = both.measured[:, 0] != 0.0
    assert np.corrcoef(both.measured[kept, 0], both.predicted[kept, 0])[0, 1] > 0.99
    assert found.residual(held).shape == both.measured.shape


def test_what_cannot_be_told_is_named(arm):
    with pytest.raises(RecordingError, match=r"command\.joint_position"):
        identify_servos(arm, recorded(0, seconds=2.0).without("command.joint_position"))
    bare = arm.model_copy(update={"effect": arm.effect[:-1]})
    with pytest.raises(DescriptionError, match="j2 has no servo"):
        identify_servos(bare, recorded(0, seconds=2.0))
