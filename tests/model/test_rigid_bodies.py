"""Bodies with what effects add to them, against Pinocchio's own sum of inertias."""

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import load_description
from smsid.effects import BodyError, GraspedBody, JointFriction, Payload
from smsid.model import build_model
from smsid.model.rigid_bodies import described_bodies, rigid_model, urdf_bodies, with_shifts_as_numbers
from smsid.paths import urdf_folder

HELD = Payload(name="held", frame="tool", mass=3.0, com=(0.1, -0.2, 0.3))
BOX = GraspedBody(
    name="box", frame="tool", mass=2.0, centre=(0.2, 0.0, 0.1), central_inertia=(1, 0, 2, 0, 0, 2)
)


def test_bodies_have_what_they_carry():
    described = load_description(urdf_folder() / "paper_sms.toml").with_effects(
        HELD, BOX, JointFriction(name="f", joint="joint3", viscous=0.1)
    )
    model = build_model(described).pin
    tool = model.frames[model.getFrameId("tool")]
    own, full = urdf_bodies(described), described_bodies(described)
    joint = model.names[tool.parentJoint]
    total = pin.Inertia.FromDynamicParameters(own[joint])
    total += tool.placement.act(pin.Inertia(3.0, np.array([0.1, -0.2, 0.3]), np.zeros((3, 3))))
    total += tool.placement.act(pin.Inertia(2.0, np.array([0.2, 0.0, 0.1]), np.diag([1.0, 2.0, 2.0])))
    assert np.allclose(full[joint], total.toDynamicParameters())
    for name in set(own) - {joint}:
        assert np.array_equal(full[name], own[name])


def test_a_rigid_model_is_without_what_is_no_body():
    described = load_description(urdf_folder() / "paper_sms.toml")
    dense = described.with_effects(BodyError(name="dense", body="link2", density=0.1))
    plain, more = rigid_model(described).pin, rigid_model(dense).pin
    assert plain.nq == 7 + 3 + len(described.wheel)  # no tank, no modes
    k = plain.getJointId("joint2")
    assert np.allclose(more.inertias[k].toDynamicParameters(), 1.1 * plain.inertias[k].toDynamicParameters())
    assert rigid_model(dense).description is dense


@pytest.mark.parametrize("body", ["link2", "tool", None])
def test_a_share_of_a_body_as_numbers_is_the_same_body(body):
    """In the axes of the frame that the effect names, which may stand off the joint."""
    described = load_description(urdf_folder() / "paper_sms.toml")
    dense = described.with_effects(BodyError(name="dense", body=body, density=0.3, mass=0.5))
    plain = with_shifts_as_numbers(dense)
    (effect,) = [e for e in plain.effect if e.name == "dense"]
    assert effect.density == 0.0 and effect.mass > 0.5
    one, other = build_model(dense).pin, build_model(plain).pin
    for a, b in zip(one.inertias, other.inertias, strict=True):
        assert np.allclose(a.toDynamicParameters(), b.toDynamicParameters(), atol=1e-9)
    assert with_shifts_as_numbers(described) is described
