"""A cable across a joint against its formula."""

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import Description
from smsid.effects import JointCable
from smsid.errors import DescriptionError
from smsid.model import build_model
from smsid.paths import urdf_folder


def torque(effect, angle=0.0, rate=0.0, t=0.0):
    craft = Description(name="x", urdf="paper_sms.urdf", folder=urdf_folder())
    model = build_model(craft.with_effects(effect))
    v, q = np.zeros(model.nv), pin.integrate(model.pin, model.home, angle * np.eye(model.nv)[7])
    v[7] = rate
    tau = model.passive_forces(t, q, v)
    assert not np.delete(tau, 7).any()
    return tau[7]


def test_a_cable_pulls_to_its_angle_of_rest_from_its_start_on():
    cable = JointCable(name="c", joint="joint2", stiffness=5.0, rest=0.3, start=2.0)
    assert [torque(cable, angle=a, t=2.0) for a in (0.3, 0.5, -0.1)] == pytest.approx([0.0, -1.0, 2.0])
    assert torque(cable, angle=0.5, t=1.9) == 0.0


def test_a_cable_across_a_joint_without_end_is_refused(tmp_path):
    urdf = (urdf_folder() / "paper_sms.urdf").read_text()
    (tmp_path / "x.urdf").write_text(
        urdf.replace('name="joint2" type="revolute"', 'name="joint2" type="continuous"')
    )
    craft = Description(name="x", urdf="x.urdf", folder=tmp_path)
    with pytest.raises(DescriptionError, match="turns without end"):
        build_model(craft.with_effects(JointCable(name="c", joint="joint2", stiffness=5.0)))
