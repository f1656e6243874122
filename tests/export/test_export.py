"""Exported folders: whole or not at all, read by smsid, Pinocchio and MuJoCo, and as identified."""

from __future__ import annotations

import csv

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from typer.testing import CliRunner

from smsid.cli.app import app
from smsid.description import Arm, Description, Mount, load_description
from smsid.description.robots import robot_urdf
from smsid.effects import JointFriction
from smsid.errors import MissingDependencyError, SmsidError
from smsid.estimation.bodies import parse_combination
from smsid.export import export_folder
from smsid.identify.estimate import Estimate, classify, save_estimate
from smsid.identify.momentum_rows import carried_by_bus
from smsid.likelihood.pseudo_inertia import factor, is_body, parameters_of, step_factor
from smsid.model import build_model
from smsid.model.identifiable import base_parameters
from smsid.model.regressor import Regressor
from smsid.model.rigid_bodies import urdf_bodies

from .machines import MACHINES, URDF, random_state, to_mujoco


@pytest.mark.parametrize("name", MACHINES)
def test_as_described_it_comes_back_the_same(name, tmp_path):
    description = MACHINES[name]()
    found = export_folder(description, tmp_path / "out")
    again = build_model(load_description(found.folder / f"{name}.toml"))
    model = build_model(description)
    assert list(again.pin.names) == list(model.pin.names)
    rng = np.random.default_rng(0)
    for _ in range(10):
        q, v = random_state(model, rng)
        expected = model.acceleration(0.0, q, v, np.zeros(model.nv))
        np.testing.assert_allclose(again.acceleration(0.0, q, v, np.zeros(model.nv)), expected, rtol=1e-9)
    mj = mujoco.MjModel.from_xml_path(str(found.folder / f"{name}.xml"))
    assert mj.nv == model.nv


def test_a_robot_of_example_robot_data_comes_back_with_its_meshes(tmp_path):
    try:
        robot_urdf("panda")
    except MissingDependencyError:
        pytest.skip("example-robot-data is not installed")
    fingers = ("panda_finger_joint1", "panda_finger_joint2")
    arm = Arm(name="panda", robot="panda", mount=Mount(frame="left_base"), fixed=fingers, inertias="trusted")
    description = Description(name="carrier", urdf="bus.urdf", folder=URDF, arm=(arm,))
    found = export_folder(description, tmp_path / "out")
    model = build_model(description)
    again = build_model(load_description(found.folder / "carrier.toml"), visuals=True)
    assert again.visual is not None and len(again.visual.geometryObjects) > 5
    mj = mujoco.MjModel.from_xml_path(str(found.folder / "carrier.xml"))
    mj.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT  # random angles are beyond the Panda's
    data = mujoco.MjData(mj)
    rng = np.random.default_rng(1)
    for _ in range(5):
        q, v = random_state(model, rng)
        a = model.acceleration(0.0, q, v, np.zeros(model.nv))
        np.testing.assert_allclose(again.acceleration(0.0, q, v, np.zeros(model.nv)), a, rtol=1e-9)
        data.qpos[:], data.qvel[:] = to_mujoco(model, mj, q, v)
        mujoco.mj_forward(mj, data)
        _, expected = to_mujoco(model, mj, q, v, a)
        assert np.abs(data.qacc - expected).max() < 1e-9 * np.abs(expected).max()


def other_bodies(description, rng):
    """Physical bodies that differ from the described ones by about a tenth."""
    return {
        joint: parameters_of(step_factor(factor(theta), 0.05 * rng.normal(size=10)))
        for joint, theta in urdf_bodies(description).items()
    }


def true_model(description, bodies):
    """The model with the bodies of its URDFs replaced."""
    model = build_model(description)
    own = urdf_bodies(description)
    for j in range(1, model.pin.njoints):
        name = model.pin.names[j]
        if name in bodies:
            theta = model.pin.inertias[j].toDynamicParameters() + bodies[name] - own[name]
            model.pin.inertias[j] = pin.Inertia.FromDynamicParameters(theta)
    return model


def perfect_estimate(model):
    """What an identification without noise would report: base parameters of random motion."""
    regressor = Regressor(model)
    rng = np.random.default_rng(9)
    states = [random_state(model, rng) for _ in range(150)]
    q, v = (np.array(x) for x in zip(*states, strict=True))
    a = rng.normal(size=v.shape)
    rows = regressor.momentum(q, v) if model.free else regressor.torque(q, v, a)
    theta = regressor.parameters + (carried_by_bus(model, regressor) if model.free else 0.0)
    base = base_parameters(rows.reshape(-1, regressor.columns), regressor.names, regressor.units)
    values = base.values(theta)
    size = {
        u: np.abs([v for v, w in zip(values, base.units, strict=True) if w == u]).max() for u in base.units
    }
    parameters = [
        classify(n, x, u, 1e-5 * size[u], "arm")
        for n, u, x in zip(base.names, base.units, values, strict=True)
    ]
    return Estimate(model.description.name, "test", tuple(parameters))


@pytest.mark.parametrize("name", ["paper_sms", "two_arm_sms", "bench"])
def test_an_identified_machine_moves_as_the_true_one(name, tmp_path):
    description = MACHINES[name]()
    rng = np.random.default_rng(4)
    truth = true_model(description, other_bodies(description, rng))
    found = export_folder(description, tmp_path / "out", perfect_estimate(truth))
    assert found.bodies is not None and found.bodies.misfit < 1.5
    exported = load_description(found.folder / f"{name}.toml")
    again, nominal = build_model(exported), build_model(description)
    assert all(is_body(theta) for theta in urdf_bodies(exported).values())
    close, far = [], []
    for _ in range(20):
        q, _ = random_state(truth, rng)
        expected, got, described = (np.triu(pin.crba(m.pin, m.data, q)) for m in (truth, again, nominal))
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        close.append(np.abs((got - expected) / scale).max())
        far.append(np.abs((described - expected) / scale).max())
    assert max(close) < 5e-3 and max(close) < 0.1 * min(far)


@pytest.mark.parametrize("name", ["paper_sms", "bench"])
def test_the_identified_urdf_is_the_same_arm_in_pinocchio_and_mujoco(name, tmp_path):
    description = MACHINES[name]()
    rng = np.random.default_rng(5)
    truth = true_model(description, other_bodies(description, rng))
    found = export_folder(description, tmp_path / "out", perfect_estimate(truth))
    path = str(found.folder / f"{name}.urdf")
    model = pin.buildModelFromUrdf(path)  # both weld the root
    mj = mujoco.MjModel.from_xml_path(path)
    data, mdata = model.createData(), mujoco.MjData(mj)
    names = [mj.joint(k).name for k in range(mj.njnt)]
    order = [model.joints[model.getJointId(n)].idx_v for n in names]
    # MuJoCo applies the <dynamics> of the file, Pinocchio's aba does not: compare it, then leave it out
    np.testing.assert_array_equal(mj.dof_damping, model.damping[order])
    np.testing.assert_array_equal(mj.dof_frictionloss, model.friction[order])
    mj.dof_damping[:], mj.dof_frictionloss[:] = 0.0, 0.0
    for _ in range(10):
        q, v = rng.uniform(-3, 3, model.nq), rng.normal(size=model.nv)
        full = pin.crba(model, data, q)
        full = np.triu(full) + np.triu(full, 1).T
        mdata.qpos[:], mdata.qvel[:] = q[order], v[order]
        mujoco.mj_forward(mj, mdata)
        mass = np.zeros((mj.nv, mj.nv))
        mujoco.mj_fullM(mj, mdata, mass)
        np.testing.assert_allclose(mass, full[np.ix_(order, order)], rtol=1e-9, atol=1e-9)
        expected = pin.aba(model, data, q, v, np.zeros(model.nv))[order]
        np.testing.assert_allclose(mdata.qacc, expected, rtol=1e-8, atol=1e-8)


def test_the_csv_has_every_parameter_with_its_interval(tmp_path):
    description = MACHINES["bench"]()
    estimate = perfect_estimate(build_model(description))
    found = export_folder(description, tmp_path / "out", estimate)
    rows = list(csv.DictReader((found.folder / "parameters.csv").open(encoding="utf-8")))
    for p, row in zip(estimate.parameters, rows, strict=False):
        assert row["name"] == p.name and row["unit"] == p.unit and row["status"] == p.status
        assert [float(row[k]) for k in ("value", "sigma", "low_95", "high_95")] == [
            p.value,
            p.sigma,
            *p.interval,
        ]
    assert sum(r["name"].startswith("body ") for r in rows) == 30


def test_a_folder_in_use_is_left_alone(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("keep")
    with pytest.raises(SmsidError, match="not an empty folder"):
        export_folder(MACHINES["bench"](), tmp_path / "out")
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_an_estimate_of_effects_alone_leaves_the_bodies_as_described(tmp_path):
    """Servos are identified with known links: the export has their friction and gains."""
    bare = Description(name="arm", urdf="arm3.urdf", root="fixed", folder=URDF)
    arm = bare.with_effects(JointFriction(name="rub", joint="joint2"))
    found = Estimate("arm", "test", (classify("rub.viscous", 2.5, "N m s/rad", 0.1, "arm"),))
    done = export_folder(arm, tmp_path / "out", found)
    assert done.bodies is not None and not done.bodies.combinations
    mj = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "arm.xml"))
    assert mj.dof_damping[1] == pytest.approx(2.5)
    assert mj.body_mass.sum() == pytest.approx(build_model(bare).mass)


def test_nothing_is_left_of_an_export_that_fails(tmp_path):
    strange = Estimate("bench", "test", (classify("nothing.m", 1.0, "kg", 0.1, "arm"),))
    with pytest.raises(SmsidError, match="no inertial combination"):
        export_folder(MACHINES["bench"](), tmp_path / "out", strange)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "terms"),
    [
        ("bus.mx - link1.m - 1.5 link2.m", {"bus.mx": 1.0, "link1.m": -1.0, "link2.m": -1.5}),
        ("left/link1.Izz + 1e-05 a.m", {"left/link1.Izz": 1.0, "a.m": 1e-5}),
        ("a.m*(b.m - c.m)/m_s + (d.m)*(e.m)", None),
        ("step A: link1.mx", None),
    ],
)
def test_combinations_are_read_back(text, terms):
    found = parse_combination(text)
    if terms is None:  # not linear: at least one part of it is no parameter
        assert found is None or any("(" in n or ":" in n for n in found)
    else:
        assert found == terms


def test_the_command(tmp_path):
    description = MACHINES["paper_sms"]()
    save_estimate(perfect_estimate(build_model(description)), tmp_path / "e.json")
    source = str(description.folder / "paper_sms.toml")
    shown = CliRunner().invoke(
        app, ["export", source, str(tmp_path / "e.json"), "-o", str(tmp_path / "out")], catch_exceptions=False
    )
    assert shown.exit_code == 0 and "paper_sms.xml" in shown.output
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == [
        "paper_sms.toml", "paper_sms.urdf", "paper_sms.xml", "parameters.csv",
    ]  # fmt: skip
