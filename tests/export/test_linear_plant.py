"""The linear plant against formulas: a free-free panel mode, a pendulum, and python-control."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.io import loadmat
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.description import Description, save_description
from smsid.export.linear_plant import linear_plant, save_linear_plant
from smsid.identify.estimate import Estimate
from smsid.identify.parameter_estimate import ParameterEstimate

BUS = """<robot name="b"><link name="bus"><inertial><mass value="100"/>
<inertia ixx="20" iyy="30" izz="40" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""
LT, LR = np.array([0.0, 0.0, 2.0]), np.array([0.0, -3.0, 0.0])


def craft(folder):
    (folder / "b.urdf").write_text(BUS)
    mode = {"frequency": 0.5, "damping": 0.01, "translation": tuple(LT), "rotation": tuple(LR)}
    panel = {
        "kind": "modal_appendage", "name": "panel", "position": (0.0, 0.0, 0.0), "mass": 12.0,
        "center_of_mass": (1.5, 0.0, 0.0), "inertia": (1.0, 0.0, 36.0, 0.0, 0.0, 36.0), "mode": [mode],
    }  # fmt: skip
    wheel = {"name": "w", "axis": (0.0, 0.0, 1.0), "inertia": 0.05}
    return Description.model_validate(
        {"name": "b", "urdf": "b.urdf", "folder": folder, "effect": [panel], "wheel": [wheel]}
    )


def test_the_poles_are_those_of_the_free_free_panel(tmp_path):
    plant = linear_plant(craft(tmp_path))
    # (1 - L' M^-1 L) eta'' + 2 z w eta' + w^2 eta = 0 with the rigid 6 x 6 mass M about the root
    s = np.array([[0, 0, 0], [0, 0, -1.5], [0, 1.5, 0]]) * 12.0  # m [c]x of the panel
    rigid = np.block([[112.0 * np.eye(3), -s], [s, np.diag([21.0, 66.0, 76.0])]])
    share = np.concatenate([LT, LR]) @ np.linalg.solve(rigid, np.concatenate([LT, LR]))
    w = 2 * np.pi * 0.5
    wanted = np.roots([1.0 - share, 2 * 0.01 * w, w * w])
    poles = np.linalg.eigvals(plant.a)
    found = poles[np.abs(poles) > 1.0]
    assert np.sort_complex(found) == pytest.approx(np.sort_complex(wanted), rel=1e-8)
    k = plant.states.index("panel.mode1 rate")
    force = plant.inputs.index("force.z")
    # M a + L eta'' = F; L' a + eta'' = 0
    a = np.linalg.solve(rigid - np.outer(np.r_[LT, LR], np.r_[LT, LR]), np.eye(6)[2])
    assert plant.b[k, force] == pytest.approx(-np.r_[LT, LR] @ a, rel=1e-10)
    assert plant.units[k] == "kg^0.5 m/s"


def test_a_pendulum_about_its_holding_torque(tmp_path):
    urdf = """<robot name="p"><link name="base"/><link name="l"><inertial>
    <origin xyz="0.5 0 0"/><mass value="2"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="j" type="continuous"><parent link="base"/><child link="l"/><axis xyz="0 1 0"/>
    <dynamics damping="0.3" friction="0.2"/></joint></robot>"""
    (tmp_path / "p.urdf").write_text(urdf)
    arm = [{"name": "arm", "home": {"j": 0.4}}]
    d = Description(name="p", urdf="p.urdf", folder=tmp_path, root="fixed", gravity=(0, 0, -9.81), arm=arm)
    plant = linear_plant(d)
    inertia, weight = 0.1 + 2 * 0.25, 2 * 9.81 * 0.5  # gravity's torque about y is weight cos(angle)
    assert plant.a == pytest.approx(
        np.array([[0, 1], [-weight * np.sin(0.4) / inertia, -0.3 / inertia]]), rel=1e-8
    )
    assert plant.b[1, 0] == pytest.approx(1 / inertia)
    assert any("Coulomb" in note for note in plant.notes)
    assert any(f"{-weight * np.cos(0.4):.6g}" in note for note in plant.notes)


def test_files_hold_what_control_gets(tmp_path):
    control = pytest.importorskip("control")
    plant = linear_plant(craft(tmp_path))
    system = plant.state_space()
    assert isinstance(system, control.StateSpace) and system.input_labels == [
        x.replace(".", "_") for x in plant.inputs
    ]
    mat = loadmat(save_linear_plant(plant, tmp_path / "p.mat"), simplify_cells=True)
    text = json.loads(save_linear_plant(plant, tmp_path / "p.json").read_text())
    np.testing.assert_array_equal(mat["A"], system.A)
    np.testing.assert_array_equal(text["B"], system.B)
    assert list(mat["inputs"]) == text["inputs"] == list(plant.inputs)


def test_an_estimate_makes_the_plant_uncertain_where_it_is(tmp_path):
    d = craft(tmp_path)
    names = [f"bus.{x}" for x in ("m", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")]
    values = [112.0, 18.0, 0, 0, 21.0, 0, 66.0, 0, 0, 76.0]
    sigmas = [1.12, *9 * [1e-9]]
    parameters = [
        ParameterEstimate(n, x, "1", s, "identified", "bodies")
        for n, x, s in zip(names, values, sigmas, strict=True)
    ]
    plant = linear_plant(d, Estimate("b", "test", tuple(parameters)), draws=40)
    k, force = plant.states.index("bus.position.x rate"), plant.inputs.index("force.x")
    # along x the force passes the root: 1 / m, of 1 %
    assert plant.b[k, force] == pytest.approx(1 / 112.0, rel=1e-3)
    assert plant.b_sigma[k, force] == pytest.approx(0.01 / 112.0, rel=0.3)
    assert plant.a_sigma[k].max() < 1e-3


def test_the_command_writes_what_is_asked(tmp_path):
    save_description(craft(tmp_path), tmp_path / "b.toml")
    words = ["export", str(tmp_path / "b.toml"), "--linear", str(tmp_path / "p.json")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0 and "16 states" in done.output
    assert json.loads((tmp_path / "p.json").read_text())["kind"] == "linear_plant"
    assert "Nothing is to be written" in str(CliRunner().invoke(app, words[:2]).exception)
