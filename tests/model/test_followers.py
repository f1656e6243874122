"""Joints that follow another, against Pinocchio's own mimic joints and in every way through the toolkit."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from smsid.campaign._identification import _base
from smsid.description import Description, load_description
from smsid.errors import DescriptionError, RecordingError
from smsid.estimation.process_model import ProcessModel
from smsid.experiments import fly
from smsid.experiments.schema import Experiment, FourierProfile
from smsid.export import export_folder
from smsid.identify import identify
from smsid.inputs.inputs import JointMotion
from smsid.inputs.signals import Constant, Fourier
from smsid.model import build_model
from smsid.model.column_order import column_map, order_columns
from smsid.recording import Recording
from smsid.simulate import Inputs, simulate

LINK = """<link name="{0}"><inertial><origin xyz="0.2 {1} 0.1"/><mass value="{2}"/>
<inertia ixx="0.02" iyy="0.03" izz="0.04" ixy="0.001" ixz="0" iyz="0.002"/></inertial></link>"""
JOINT = """<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/>
<origin xyz="0.4 0.1 0" rpy="0.2 0 0.3"/><axis xyz="{4}"/>
<limit lower="-2" upper="2" effort="9" velocity="3"/>{5}</joint>"""
MIMIC = '<mimic joint="{}" multiplier="{}" offset="{}"/>'
KINDS = (("j1", "revolute", "bus", "a", "0 0 1"), ("j2", "revolute", "a", "b", "0 1 0"),
         ("j3", "prismatic", "a", "c", "1 0 0"), ("j4", "revolute", "c", "d", "0 0 1"))  # fmt: skip
LED = {"j3": ("j1", 0.1, 0.02), "j4": ("j3", -5.0, 0.3)}


def text(mimics, more=""):
    bodies = (("bus", 0, 60), ("a", 0.1, 3), ("b", 0, 2), ("c", 0.1, 1), ("d", -0.1, 1.5))
    links = "".join(LINK.format(*row) for row in bodies)
    joints = "".join(
        JOINT.format(*row, MIMIC.format(*mimics[row[0]]) if row[0] in mimics else more) for row in KINDS
    )
    return f'<robot name="r">{links}{joints}</robot>'


def craft(folder, mimics=LED, more="", **keys):
    (folder / "r.urdf").write_text(text(mimics, more))
    return Description(name="r", urdf="r.urdf", folder=folder, **keys)


def mimicking(model):
    """Return Pinocchio's own model with mimic joints of the same machine."""
    ids = [model.getJointId(n) for n in ("j1", "j3", "j4")]
    own = pin.transformJointIntoMimic(model, ids[0], ids[1], 0.1, 0.02)
    return pin.transformJointIntoMimic(own, ids[0], ids[2], -0.5, 0.2)


def test_accelerations_are_those_of_mimic_joints_of_pinocchio(tmp_path):
    model = build_model(craft(tmp_path))
    own = mimicking(model.pin)
    data, rng = own.createData(), np.random.default_rng(3)
    assert model.nv == own.nv + 2
    for _ in range(5):
        q = pin.integrate(own, pin.neutral(own), rng.normal(size=own.nv))
        v, tau = rng.normal(size=(2, own.nv))
        mass = pin.crba(own, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T
        wanted = np.linalg.solve(mass, tau - pin.nonLinearEffects(own, data, q, v))
        names = [n for n in model.pin.names if n not in LED][2:]
        assert names == ["j1", "j2"]
        at = {n: model.pin.joints[model.pin.getJointId(n)].idx_v for n in ("j1", "j2", "j3", "j4")}
        full_q, full_v, full_tau = np.zeros(model.nq), np.zeros(model.nv), np.zeros(model.nv)
        full_q[:7], full_v[:6], full_tau[:6] = q[:7], v[:6], tau[:6]
        for k, name in enumerate(names):
            full_q[at[name] + 1], full_v[at[name]], full_tau[at[name]] = q[7 + k], v[6 + k], tau[6 + k]
        full_q, full_v = model.followers.place_followers(model.pin, full_q), model.followers.driven(full_v)
        found = model.acceleration(0.0, full_q, full_v, full_tau)
        assert found[[*range(6), at["j1"], at["j2"]]] == pytest.approx(wanted, abs=1e-11)
        assert found[[at["j3"], at["j4"]]] == pytest.approx([0.1 * found[at["j1"]], -0.5 * found[at["j1"]]])


def followed(model, angles):
    place = {n: k for k, n in enumerate(model.arm_joints.names)}
    lead = angles[:, place["j1"]]
    return np.abs(np.column_stack([angles[:, place["j3"]] - 0.1 * lead - 0.02,
                                   angles[:, place["j4"]] + 0.5 * lead - 0.2])).max()  # fmt: skip


@pytest.mark.parametrize("kind", ["torque", "motion", "attitude held"])
def test_followers_follow_and_take_no_energy(kind, tmp_path):
    model = build_model(craft(tmp_path))
    n = len(model.arm_joints)
    wave = Fourier(0.5, np.linspace(0.2, 0.4, n)[:, None], np.zeros((n, 1)), np.zeros(n))
    inputs = Inputs(joint_motion=JointMotion.of(wave)) if kind == "motion" else Inputs(joint_torque=wave)
    if kind == "attitude held":
        inputs = Inputs(joint_torque=wave, hold_attitude=True)
    flown = simulate(model, inputs, 3.0, v0=np.r_[np.zeros(6), 0.3 * np.ones(n)])
    angles = model.joint_angles(flown.states(np.linspace(0.0, 3.0, 31)).q)
    assert np.ptp(angles, axis=0).min() > 0.01 and followed(model, angles) < 1e-12
    audit = flown.audit()
    assert audit.energy_drift < 1e-8 * max(audit.energy_scale, 1.0)
    if kind == "torque":
        assert audit.momentum_drift < 1e-9 * audit.momentum_scale


def test_the_linear_model_of_the_filter_is_its_derivative(tmp_path):
    model = build_model(craft(tmp_path))
    process, rng, still = ProcessModel(model, np.zeros(0, dtype=int)), np.random.default_rng(1), 1e-6
    q = model.followers.place_followers(
        model.pin, pin.integrate(model.pin, model.home, 0.3 * rng.normal(size=model.nv))
    )
    v, tau = model.followers.driven(0.3 * rng.normal(size=model.nv)), rng.normal(size=model.nv)
    linear = process.linear(0.0, q, v, tau)
    assert linear.a == pytest.approx(model.acceleration(0.0, q, v, tau), abs=1e-12)
    for k in range(model.nv):
        e = still * np.eye(model.nv)[k]
        up, down = (process.acceleration(0.0, pin.integrate(model.pin, q, s * e), v, tau) for s in (1, -1))
        assert linear.by_q[:, k] == pytest.approx((up - down) / 2 / still, abs=1e-6)
        up, down = (process.acceleration(0.0, q, v + s * e, tau) for s in (1, -1))
        assert linear.by_v[:, k] == pytest.approx((up - down) / 2 / still, abs=1e-6)
        up, down = (process.acceleration(0.0, q, v, tau + s * e) for s in (1, -1))
        assert linear.by_tau[:, k] == pytest.approx((up - down) / 2 / still, abs=1e-6)


def test_exports_come_back_with_their_followers(tmp_path):
    mujoco = pytest.importorskip("mujoco")
    model = build_model(craft(tmp_path))
    export_folder(model.description, tmp_path / "out")
    wanted = (("j3", "j1", 0.1, 0.02), ("j4", "j1", -0.5, 0.2))
    for name in ("r.toml", "r.xml"):
        again = build_model(load_description(tmp_path / "out" / name)).followers
        found = sorted(zip(again.names, again.leaders, again.ratio, again.offset, strict=True))
        assert [(*x[:2], *np.round(x[2:], 12)) for x in found] == list(wanted)
    engine = mujoco.MjModel.from_xml_path(str(tmp_path / "out" / "r.xml"))
    state = mujoco.MjData(engine)
    mujoco.mj_resetDataKeyframe(engine, state, 0)
    state.ctrl[engine.actuator("j1").id] = torque = 0.5
    for _ in range(200):
        mujoco.mj_step(engine, state)
    n = len(model.arm_joints)
    push = np.zeros(n)
    push[model.arm_joints.names.index("j1")] = torque
    own = simulate(model, Inputs(joint_torque=Constant(push)), 1.0).states(np.array([1.0]))
    lead, follow = (float(state.joint(name).qpos[0]) for name in ("j1", "j4"))
    assert follow == pytest.approx(-0.5 * lead + 0.2, abs=1e-4)  # as soft as MuJoCo's constraints are
    assert lead == pytest.approx(model.joint_angles(own.q)[0, model.arm_joints.names.index("j1")], rel=2e-3)


def test_columns_of_followers_are_made_of_their_leaders(tmp_path):
    model = build_model(craft(tmp_path))
    t = np.linspace(0.0, 1.0, 11)
    q, tau = np.column_stack([np.sin(t), np.cos(t)]), np.column_stack([t, 2 * t])
    log = Recording.from_arrays(
        t,
        {"encoder.joint_position": q, "encoder.joint_velocity": 2 * q, "command.joint_torque": tau},
        labels={"joint": ["j2", "j1"]},
    )
    log = order_columns(log, model)
    assert log.labels["joint"] == model.arm_joints.names
    place = {n: k for k, n in enumerate(model.arm_joints.names)}
    assert followed(model, log["encoder.joint_position"]) < 1e-15
    assert log["encoder.joint_velocity"][:, place["j4"]] == pytest.approx(-np.cos(t))
    assert not log["command.joint_torque"][:, place["j4"]].any()
    # by itself: a source that the description knows, or of the spacecraft itself
    matrix, offset = column_map({"joint": ["j2", "j1"]}, "truth.joint_position", 2, model)
    np.testing.assert_allclose(q @ matrix.T + offset, log["encoder.joint_position"], atol=1e-15)
    without = Recording.from_arrays(t, {"truth.joint_position": q[:, :1]}, labels={"joint": ["j2"]})
    with pytest.raises(RecordingError, match="missing 'j1', 'j3', 'j4'"):
        order_columns(without, model)


def test_what_leads_may_stand_still(tmp_path):
    whole = build_model(craft(tmp_path))
    arm = {"name": "arm", "home": {"j1": 0.4}, "fixed": ["j1"]}
    model = build_model(craft(tmp_path, arm=[arm]))
    assert model.arm_joints.names == ("j2",) and model.followers is None
    q = whole.followers.place_followers(
        whole.pin, whole.set_joint_angles(whole.home, np.array([0.4, 0.0, 0.0, 0.0]))
    )
    for one, at in ((whole, q), (model, model.home)):
        pin.framesForwardKinematics(one.pin, one.data, at)
    ends = [m.data.oMf[m.pin.getFrameId("d", pin.BODY)].homogeneous for m in (whole, model)]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-12)


def test_a_leader_that_is_not_there_is_told(tmp_path, caplog):
    model = build_model(craft(tmp_path, {"j3": ("nobody", 1, 0), "j4": ("j1", 1, 0)}))
    assert "'j3' mimics 'nobody', which does not exist: it moves on its own" in caplog.text
    assert model.followers.names == ("j4",)


@pytest.mark.parametrize(
    ("mimics", "keys", "words"),
    [
        ({"j3": ("j4", 1, 0), "j4": ("j3", 1, 0)}, {}, "mimic each other"),
        (
            LED,
            {"arm": [{"name": "a", "home": {"j1": 0.1, "j3": 0.5}}]},
            r"`home` puts joint 'j3' at 0.5.*0\.03",
        ),
        (LED, {"arm": [{"name": "a", "joints": ["j1", "j2"]}]}, "both have to be joints of an arm"),
        ({"j3": ("j1", "two", 0)}, {}, "multiplier = 'two'"),
    ],
)
def test_what_cannot_be_is_refused_by_name(mimics, keys, words, tmp_path):
    with pytest.raises(DescriptionError, match=words):
        build_model(craft(tmp_path, mimics, **keys))


def error(size):
    return {"noise_sigma": size}


SENSORS = [
    {"kind": "pose", "name": "pose", "rate": 25,
     "errors": {"position": error(1e-4), "attitude": error(1e-6), "velocity": error(1e-5)}},
    {"kind": "imu", "name": "imu", "rate": 25,
     "errors": {"angular_rate": error(1e-6), "acceleration": error(1e-5)}},
    {"kind": "encoder", "name": "encoder", "rate": 25,
     "errors": {"joint_position": error(1e-6), "joint_velocity": error(1e-6)}},
    {"kind": "tachometer", "name": "tacho", "rate": 25, "errors": {"wheel_rate": error(1e-4)}},
]  # fmt: skip


def test_bodies_are_identified_from_a_log_without_followers(tmp_path):
    wheel = {"inertia": 0.05, "max_torque": 1.0, "max_rate": 300.0, "inertia_in_bus": False}
    wheels = [{"name": f"w{k}", "axis": axis, **wheel} for k, axis in enumerate(np.eye(3).tolist())]
    model = build_model(craft(tmp_path, sensor=SENSORS, wheel=wheels))
    rng, n = np.random.default_rng(4), len(model.arm_joints)
    cos, sin = rng.normal(size=(2, n + 3, 3)) / np.arange(1, 4)
    sin[:n] -= (sin[:n] @ np.arange(1, 4))[:, None] * np.arange(1, 4) / 14.0  # at rest at the start
    rows = lambda x: tuple(map(tuple, x.tolist()))  # noqa: E731
    motion = {"frequency": 0.05, "cos": rows(0.25 * cos[:n]), "sin": rows(0.25 * sin[:n])}
    torque = {"frequency": 0.05, "cos": rows(0.002 * cos[n:]), "sin": rows(0.002 * sin[n:])}
    flown = fly(
        model,
        Experiment(
            name="exp2",
            duration=40.0,
            joint_motion=FourierProfile(**motion, offset=tuple((-0.25 * cos[:n].sum(axis=1)).tolist())),
            wheel_torque=FourierProfile(**torque),
        ),
        rng,
    ).recording
    kept = [flown.labels["joint"].index(name) for name in ("j1", "j2")]
    channels = {
        name: (flown.time(name), flown[name][:, kept] if "joint" in name else flown[name])
        for name in flown.channels
        if not name.startswith("truth")
    }
    log = Recording.from_arrays(
        None, channels, labels={**flown.labels, "joint": ["j1", "j2"]}, role="estimation", name="exp2"
    )
    found = identify(model.description, [log])
    truth = _base(model, found.momentum.b, carried=True)
    off = [(p.value - truth[p.name]) / p.sigma for p in found.estimate.parameters if p.name in truth]
    assert len(off) > 25 and np.abs(off).max() < 5.0
    sharp = [p for p in found.estimate.parameters if p.name in ("b.mx", "b.mz")]
    assert len(sharp) == 2 and all(p.sigma < 0.01 for p in sharp)
