"""Mechanisms of one joint: Pinocchio's bindings give their matrices as vectors."""

from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

from smsid.arm import identify_arm, with_joint_effects
from smsid.cli.app import app
from smsid.description import Description, load_description
from smsid.diagnose import diagnose
from smsid.effects.spatial import FrameMotion, turns
from smsid.errors import RecordingError
from smsid.model import build_model
from smsid.model.column_order import order_columns
from smsid.model.regressor import Regressor
from smsid.recording import Recording, import_recording, save_recording
from smsid.recording.mapping import parse_mapping

URDF = """<robot name="axis"><link name="base"/>
<link name="carriage"><inertial><mass value="90"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="slide" type="{kind}"><parent link="base"/><child link="carriage"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="500" velocity="1"/></joint></robot>"""
KINDS = ("joint_friction", "torque_offset")


def axis(tmp_path, kind="prismatic"):
    (tmp_path / "axis.urdf").write_text(URDF.format(kind=kind))
    return Description(
        name="axis", urdf="axis.urdf", folder=tmp_path, root="fixed", gravity=(0.0, 0.0, -9.81)
    )


def log(rng, still=False, idle=False):
    t = np.arange(0.0, 12.0, 0.004)
    q = 0.1 * np.sin(1.3 * t) + 0.05 * np.sin(3.1 * t + 1.0)
    v = 0.13 * np.cos(1.3 * t) + 0.155 * np.cos(3.1 * t + 1.0)
    a = -0.169 * np.sin(1.3 * t) - 0.4805 * np.sin(3.1 * t + 1.0)
    force = 95.0 * a + 200.0 * v + 20.0 * np.sign(v) - 3.0 + rng.normal(size=t.size)
    q = q + 1e-6 * rng.normal(size=t.size)
    channels = {"encoder.joint_position": (0.0 if still else 1.0) * q[:, None]}
    channels["drive.joint_torque"] = (0.0 if idle else 1.0) * force[:, None]
    return Recording.from_arrays(t, channels, labels={"joint": ("slide",)}, role="estimation", name="log")


@pytest.mark.parametrize("kind", ["prismatic", "revolute", "continuous"])
def test_jacobians_and_regressors_of_one_joint_are_matrices(tmp_path, kind):
    model = build_model(axis(tmp_path, kind))
    assert turns(model.pin, 1) == (kind != "prismatic")
    jacobian, velocity, _ = FrameMotion(model.pin, 1).at(model.home, np.ones(1))
    assert jacobian.shape == (6, 1)
    np.testing.assert_allclose(jacobian[:, 0], velocity)
    rows = Regressor(model).generalised_momentum(model.home[None], np.ones((1, 1)))
    parameters = Regressor(model).parameters
    expected = 90.0 if kind == "prismatic" else 0.1
    assert float(rows[0, 0] @ parameters) == pytest.approx(expected)


def test_a_sliding_axis_is_identified_in_metres_and_newtons(tmp_path, rng):
    found = identify_arm(with_joint_effects(axis(tmp_path), ("slide",), *KINDS), log(rng)).estimate
    truth = {
        "carriage.m": (95.0, "kg"),
        "friction_slide.viscous": (200.0, "N s/m"),
        "friction_slide.coulomb": (20.0, "N"),
        "bias_slide.torque": (-3.0, "N"),
    }
    for name, (value, unit) in truth.items():
        p = found[name]
        assert p.unit == unit and abs(p.value - value) < 4.0 * p.sigma < 0.2 * abs(value)


@pytest.mark.parametrize(
    ("unit", "does", "other"), [("mm", "turns", "revolute"), ("degree", "slides", "prismatic")]
)
def test_a_unit_that_the_joint_cannot_have_is_refused(unit, does, other, tmp_path, rng):
    rows = np.column_stack(
        [log(rng).time(), log(rng)["encoder.joint_position"], log(rng)["drive.joint_torque"]]
    )
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="t,q,f", comments="")
    force = "N" if unit == "mm" else "N m"
    columns = {"encoder.joint_position": ("q", unit), "drive.joint_torque": ("f", force)}
    tree = {
        "recording": {"role": "estimation"},
        "time": {"column": "t", "unit": "s"},
        "channel": {n: {"columns": [c], "unit": u, "labels": ["slide"]} for n, (c, u) in columns.items()},
    }
    recording = import_recording(tmp_path / "log.csv", parse_mapping(tree))
    with pytest.raises(RecordingError, match=f"'slide' was imported in .*, but in 'axis' it {does}"):
        identify_arm(axis(tmp_path, other), recording)
    right = {"mm": "prismatic", "degree": "revolute"}[unit]
    order_columns(recording, build_model(axis(tmp_path, right)))


def test_one_joint_is_diagnosed(tmp_path, rng):
    result = diagnose(axis(tmp_path), [log(rng)]).diagnosis
    assert result.verdict in ("explained", "unexplained")
    units = {p.unit for c in result.causes if c.effect == "joint_friction" for p in c.parameters}
    assert units and units <= {"N s/m", "N", "m/s"}


@pytest.mark.parametrize(("what", "words"), [("still", "moves"), ("idle", "constant")])
def test_a_log_without_motion_or_torque_is_not_evaluated(tmp_path, rng, what, words):
    result = diagnose(axis(tmp_path), [log(rng, **{what: True})]).diagnosis
    assert result.verdict == "not_evaluated" and words in result.sentence


def test_the_command_takes_a_bare_urdf(tmp_path, rng):
    axis(tmp_path)
    save_recording(log(rng), tmp_path / "log.nc")
    arguments = ["identify", tmp_path / "axis.urdf", tmp_path / "log.nc", "-o", tmp_path / "e.json"]
    shown = CliRunner().invoke(app, [str(x) for x in arguments])
    assert shown.exit_code == 0, shown.output
    assert "friction_slide.viscous" in shown.output and "N s/m" in shown.output
    assert "it is noise" in shown.output
    rigid = CliRunner().invoke(app, [*(str(x) for x in arguments), "--rigid"])
    assert rigid.exit_code == 0, rigid.output
    assert "hint" in rigid.output and "friction" in rigid.output


def test_what_was_identified_without_a_description_is_exported(tmp_path, rng):
    urdf = axis(tmp_path).folder / "axis.urdf"
    save_recording(log(rng), tmp_path / "log.nc")
    arguments = ["identify", urdf, tmp_path / "log.nc", "-o", tmp_path / "e.json"]
    assert CliRunner().invoke(app, [str(x) for x in arguments]).exit_code == 0
    done = CliRunner().invoke(
        app, ["export", str(urdf), str(tmp_path / "e.json"), "-o", str(tmp_path / "out")]
    )
    assert done.exit_code == 0, done.output
    arm = load_description(tmp_path / "out" / "axis.toml")
    friction = arm.get_effect("friction_slide")
    assert friction.viscous == pytest.approx(200.0, rel=0.02)
    assert build_model(arm).pin.inertias[1].mass == pytest.approx(95.0, rel=0.02)
