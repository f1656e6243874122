"""`smsid new`, `smsid check`, `smsid regressor`, and bundled crafts by name."""

from __future__ import annotations

import json
import re

import pytest
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.description import load_description
from smsid.description.robots import robots_folder
from smsid.errors import MissingDependencyError
from smsid.model import build_model
from smsid.paths import urdf_folder

ARM = str(urdf_folder() / "arm3.urdf")


def run(*arguments, code=0):
    result = CliRunner().invoke(app, [*arguments, "--json"])
    assert result.exit_code == code, result.output + str(result.exception)
    return json.loads(result.stdout)


@pytest.mark.parametrize(
    ("options", "joints", "wheels", "effects"),
    [
        ([], 0, 3, set()),
        (["--arm", ARM, "--wheels", "4", "--tank", "--panel", "6x3"], 3, 4, {"tank", "panel"}),
        (["--arm", ARM, "--arm", ARM, "--wheels", "0", "--mass", "20", "--size", "0.4"], 6, 0, set()),
        (["--arm", ARM, "--tank", "--tank", "--panel", "6x3"], 3, 3, {"tank1", "tank2", "panel"}),
    ],
)
def test_a_new_craft_is_complete_and_loads(tmp_path, monkeypatch, options, joints, wheels, effects):
    monkeypatch.chdir(tmp_path)
    run("new", "craft", *options)
    model = build_model(load_description("craft.toml"))
    assert len(model.arm_joints) == joints and len(model.wheels) == wheels
    assert {e.name for e in model.description.effect} == effects
    assert model.description.thrust.max_force is not None
    assert run("check", "craft.toml") == {"exit_code": 0, "written": [], "wrong": [], "doubtful": []}
    assert "# GUESS" in (tmp_path / "craft.toml").read_text()


def test_an_arm_starts_within_its_limits_and_followers_are_welded(tmp_path, monkeypatch):
    """Whatever its limits: nothing of what `new` writes is doubtful."""
    monkeypatch.chdir(tmp_path)
    text = (urdf_folder() / "arm3.urdf").read_text()
    first = re.search(r"<limit [^>]*>", text)
    assert first is not None
    text = text.replace(first[0], '<limit lower="0.4" upper="1.4" effort="60" velocity="0.5"/>', 1)
    last = text.index("</joint>", text.index('name="joint3"'))
    (tmp_path / "my.urdf").write_text(f'{text[:last]}<mimic joint="joint1"/>{text[last:]}')
    run("new", "craft", "--arm", "my.urdf")
    description = load_description("craft.toml")
    assert description.arm[0].home == {"joint1": 0.9} and description.arm[0].fixed == ("joint3",)
    assert run("check", "craft.toml")["doubtful"] == []


def robots():
    try:
        robots_folder()
    except MissingDependencyError as error:
        pytest.skip(str(error))


def test_an_arm_may_be_a_robot_by_name(tmp_path, monkeypatch):
    robots()
    monkeypatch.chdir(tmp_path)
    run("new", "craft", "--arm", "panda")
    assert load_description("craft.toml").arm[0].robot == "panda"
    (doubt,) = run("check", "craft.toml")["doubtful"]  # what panda.urdf has beyond the format
    assert "panda.urdf: not used: D, K, mu_coulomb, mu_viscous in <dynamics>" in doubt


@pytest.mark.parametrize(
    ("arm", "told"), [("pandda", "panda, panda_collision"), ("no.urdf", "'no.urdf' does not")]
)
def test_an_arm_that_is_not_there_is_told_and_nothing_written(tmp_path, monkeypatch, arm, told):
    robots()
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["new", "craft", "--arm", arm])
    assert result.exit_code == 1 and told in str(result.exception)
    assert not list(tmp_path.iterdir())


def test_new_replaces_nothing(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "craft_bus.urdf").write_text("mine")
    result = CliRunner().invoke(app, ["new", "craft"])
    assert result.exit_code == 1 and "exists" in str(result.exception) + result.output
    assert (tmp_path / "craft_bus.urdf").read_text() == "mine"
    assert not (tmp_path / "craft.toml").exists()


def test_check_tells_all_faults_at_once(tmp_path):
    run_in = tmp_path / "x.toml"
    text = (urdf_folder() / "arm3.urdf").read_text()
    bus = (urdf_folder() / "bus.urdf").read_text()
    (tmp_path / "bus.urdf").write_text(bus.replace('mass value="', 'mass value="x'))
    (tmp_path / "arm.urdf").write_text(text.replace('<axis xyz="', '<axis xyz="0,5 ', 1))
    run_in.write_text(
        'schema = 1\nname = "x"\nurdf = "bus.urdf"\n[[arm]]\nname = "a"\nurdf = "arm.urdf"\n'
        '[[arm]]\nname = "b"\nurdf = "none.urdf"\n[[wheel]]\nname = "w"\ninertia = 1.0\n'
    )
    found = run("check", str(run_in), code=1)
    assert len(found["wrong"]) == 3
    assert all(any(piece in w for w in found["wrong"]) for piece in ("mass of link", "<axis>", "none.urdf"))
    doubts = " ".join(found["doubtful"])
    assert all(key in doubts for key in ("max_torque", "max_rate", "max_force", "[[sensor]]"))


def test_check_doubts_errors_of_sensors_that_none_has(tmp_path):
    file = tmp_path / "x.toml"
    (tmp_path / "bus.urdf").write_text((urdf_folder() / "bus.urdf").read_text())
    file.write_text(
        'schema = 1\nname = "x"\nurdf = "bus.urdf"\n[[sensor]]\nname = "imu"\nkind = "imu"\nrate = 50\n'
        "errors.angular_rate = { noise_sigma = 5e-5, saturation = 1e-6, delay = 3.0 }\n"
    )
    doubts = [d for d in run("check", str(file))["doubtful"] if "'imu': errors.angular_rate" in d]
    assert len(doubts) == 2 and "saturation" in doubts[0] and "delay" in doubts[1]


def test_regressors_of_the_bundled_craft_are_exact():
    found = run("regressor", "paper_sms", "--states", "5")
    assert {"torque, Pinocchio rnea", "momentum, Pinocchio centroidal"} <= found["errors"].keys()
    assert max(found["errors"].values()) < 1e-13
    assert len(found["base_parameters"]) == 68 and found["condition"] > 1.0
    one = run("regressor", "paper_sms", "--states", "1")  # what a craft tells is no matter of one posture
    assert one["states"] == 1 and one["base_parameters"] == found["base_parameters"]


def test_a_root_link_called_world_is_no_ground(tmp_path):
    """As of UR arms: MuJoCo keeps that name for what nothing moves."""
    pytest.importorskip("mujoco")
    text = (urdf_folder() / "paper_sms.urdf").read_text()
    (tmp_path / "r.urdf").write_text(text.replace('"bus"', '"world"').replace('"link2"', '"world_link"'))
    found = run("regressor", str(tmp_path / "r.urdf"), "--states", "3")
    assert found["not_compared"] == [] and found["errors"]["torque, MuJoCo inverse"] < 1e-10


def test_an_arm_on_the_ground_has_torques_alone():
    for how in ([], ["--fixed"]):  # a root without mass stands on the ground anyway
        found = run("regressor", ARM, *how, "--states", "3")
        assert max(found["errors"].values()) < 1e-10
        assert "momentum, Pinocchio centroidal" not in found["errors"]
