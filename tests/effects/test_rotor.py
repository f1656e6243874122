"""Rotors that turn with the link that carries them: Lagrange's equations, another rotor, stiff gears."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smsid.description import load_description
from smsid.effects import BodyError, GearCompliance
from smsid.effects.spatial import Rotor, turns
from smsid.errors import DescriptionError
from smsid.model import build_model
from smsid.sensing import Sensor
from smsid.simulate import Constant, Inputs, simulate, truth_of

STEP = 1e-4
INERTIA, JOINT = 0.7, 3  # of the arm below, whose fourth joint is the twist


def arm() -> pin.Model:
    """Three joints about skewed axes on a wall, and the twist of a gear."""
    model = pin.Model()
    for name, axis in (("a", (0, 0, 1)), ("b", (0.6, 0.8, 0)), ("c", (0, 0.6, 0.8))):
        place = pin.SE3(pin.rpy.rpyToMatrix(0.3, -0.2, 0.5), np.array([0.4, 0.1, 0.2]))
        model.addJoint(model.njoints - 1, pin.JointModelRevoluteUnaligned(*map(float, axis)), place, name)
    model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "twist")
    return model


@settings(max_examples=25, deadline=None)
@given(
    carried=st.floats(-1, 1),
    in_link=st.booleans(),
    gives=st.booleans(),
    x=st.lists(st.floats(-1, 1), min_size=12, max_size=12),
)
def test_forces_are_lagranges(carried, in_link, gives, x):
    """d/dt dT/dv - dT/dq of 1/2 I w^2, differenced, of rates that Pinocchio's velocities give."""
    model, (q, v, a) = arm(), np.reshape(x, (3, 4))
    data = model.createData()
    axis = np.array([0.0, 0.6, 0.8])

    def energy(q, v):
        pin.forwardKinematics(model, data, q, v)
        before = data.oMi[JOINT].rotation @ axis @ data.oMi[2].rotation @ data.v[2].angular
        s = v[2] + carried * before
        twist = v[3] if gives else 0.0
        return 0.5 * INERTIA * ((s + twist) ** 2 - in_link * s**2 - twist**2)  # armature has the last

    def by_v(q, v):
        return np.array([(energy(q, v + d) - energy(q, v - d)) / (2 * STEP) for d in STEP * np.eye(4)])

    by_q = np.array([(energy(q + d, v) - energy(q - d, v)) / (2 * STEP) for d in STEP * np.eye(4)])
    later, sooner = (by_v(q + h * v, v + h * a) for h in (STEP, -STEP))
    expected = (later - sooner) / (2 * STEP) - by_q
    rotor = Rotor(model, JOINT, INERTIA, carried, gear=3 if gives else None, in_link=in_link)
    mass, bias = rotor(0.0, q, v)
    np.testing.assert_allclose(mass @ a + bias, expected, atol=1e-6)


@pytest.mark.parametrize("quasistatic", [True, False])
def test_a_rotor_that_turns_with_its_link_is_part_of_it(urdf: Path, quasistatic: bool) -> None:
    """A rotor beside a link and one counted in a link that has as much more inertia about the axis."""
    description = load_description(urdf / "paper_sms.toml")
    rotor = dict(name="g", joint="joint2", motor_inertia=0.5, carried=1.0, quasistatic=quasistatic)
    beside = GearCompliance(**rotor, compliance=1e-4)
    within = GearCompliance(**rotor, compliance=1e-4, inertia_in_link=True)
    model = build_model(description).pin
    axis = {"RX": 0, "RY": 2, "RZ": 5}[model.joints[model.getJointId("joint2")].shortname()[-2:]]
    plump = np.array([1.0, 0.0, 1.0, 0.0, 0.0, 1.0])  # slender links have no room for a rotor
    inertias = (plump, plump + 0.5 * np.eye(6)[axis])
    bodies = [BodyError(name="m", body="link2", inertia=tuple(x)) for x in inertias]
    gears = (beside, within)
    models = [build_model(description.with_effects(*e)) for e in zip(gears, bodies, strict=True)]
    rng = np.random.default_rng(5)
    nv = models[0].nv
    q = pin.integrate(models[0].pin, models[0].home, rng.uniform(-0.5, 0.5, nv))
    v, tau = rng.standard_normal((2, nv))
    one, other = (m.acceleration(0.0, q, v, tau) for m in models)
    np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)
    plain = build_model(description.with_effects(beside.model_copy(update={"carried": 0.0}), bodies[0]))
    assert np.abs(plain.acceleration(0.0, q, v, tau) - one).max() > 1e-4


@pytest.mark.parametrize("carried", [0.0, 1.0])
@pytest.mark.parametrize("in_link", [False, True])
@pytest.mark.parametrize("side", ["motor", "link"])
def test_a_quasistatic_gear_of_a_free_spacecraft_is_what_a_stiff_one_settles_to(
    urdf: Path, carried: float, in_link: bool, side: str
) -> None:
    """Encoders beside those of a gear with a twist of its own, at rest after its ringing."""
    description = load_description(urdf / "paper_sms.toml")
    rotor, compliance, times = 2.0, 1e-6, np.linspace(0.2, 0.4, 5)
    encoder = Sensor(name="encoder", kind="encoder", rate=100.0)
    torque = Inputs(joint_torque=Constant(np.array([1.0, 5.0, -3.0])))
    readings = []
    for more in (
        {"compliance": compliance, "damping": 0.5 * np.sqrt(rotor / compliance)},
        {"compliance": compliance, "quasistatic": True},
        {"compliance": 0.0},
    ):
        gear = GearCompliance(
            name="g", joint="joint3", encoder=side, motor_inertia=rotor, carried=carried,
            inertia_in_link=in_link, **more,
        )  # fmt: skip
        trajectory = simulate(build_model(description.with_effects(gear)), torque, 0.4)
        readings.append(truth_of(trajectory, (encoder,))(times)["encoder.joint_position"])
    stiff, at_once, rigid = readings
    twist = at_once - rigid
    np.testing.assert_allclose(stiff - rigid, twist, atol=2e-3 * np.abs(twist).max())
    assert np.abs(twist[:, 1]).max() > 0.01 * np.abs(twist[:, 2]).max()  # the joint before is left behind


def test_a_link_that_slides_carries_no_rotor_round() -> None:
    model = arm()
    slide = model.addJoint(2, pin.JointModelPX(), pin.SE3.Identity(), "slide")
    with pytest.raises(DescriptionError, match="slides"):
        Rotor(model, slide, 0.5, 0.3, gear=None, in_link=True)


@pytest.mark.parametrize(
    ("joint", "expected"),
    [
        (pin.JointModelRZ(), True),
        (pin.JointModelRUBX(), True),
        (pin.JointModelRevoluteUnaligned(np.array([0.6, 0.8, 0.0])), True),
        (pin.JointModelPX(), False),
        (pin.JointModelPrismaticUnaligned(np.array([0.0, 0.6, 0.8])), False),
        (pin.JointModelHX(0.1), False),
    ],
    ids=lambda x: x.shortname() if hasattr(x, "shortname") else "",
)
def test_which_joints_turn(joint: object, expected: bool) -> None:
    model = pin.Model()
    assert turns(model, model.addJoint(0, joint, pin.SE3.Identity(), "j")) is expected
