"""Laws of torques at a joint against their formulas, by numbers of their own."""

import numpy as np
import pinocchio as pin
import pytest

from smsid.arm import torque_columns
from smsid.description import Description
from smsid.effects import FrictionAsymmetry, JointCable, JointDrag
from smsid.errors import DescriptionError
from smsid.model import build_model
from smsid.paths import urdf_folder

RATES = (-2.0, -0.3, 0.0, 0.1, 1.5)


def torque(effect, angle=0.0, rate=0.0, t=0.0):
    craft = Description(name="x", urdf="paper_sms.urdf", folder=urdf_folder())
    model = build_model(craft.with_effects(effect))
    v, q = np.zeros(model.nv), pin.integrate(model.pin, model.home, angle * np.eye(model.nv)[7])
    v[7] = rate
    tau = model.passive_forces(t, q, v)
    assert not np.delete(tau, 7).any()
    return tau[7]


@pytest.mark.parametrize("rate", RATES)
def test_drag_grows_with_square_and_cube_and_never_pushes(rate):
    drag = JointDrag(name="d", joint="joint2", quadratic=0.3, cubic=0.2)
    assert torque(drag, rate=rate) == pytest.approx(-0.3 * rate * abs(rate) - 0.2 * rate**3)
    assert torque(drag, rate=rate) * rate <= 0.0


@pytest.mark.parametrize("rate", RATES)
def test_friction_is_larger_one_way_by_as_much_as_it_is_smaller_the_other(rate):
    one = FrictionAsymmetry(name="d", joint="joint2", viscous=0.4, coulomb=0.15)
    assert torque(one, rate=rate) == pytest.approx(-0.4 * abs(rate) - (0.15 if rate else 0.0))


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


@pytest.mark.parametrize(
    "effect",
    [
        JointDrag(name="d", joint="joint2", quadratic=0.3, cubic=0.2),
        FrictionAsymmetry(name="d", joint="joint2", viscous=0.4, coulomb=-0.15),
    ],
)
def test_columns_of_an_arm_on_the_ground_are_the_torque_a_motor_has_to_give(effect):
    arm = Description(name="x", urdf="arm3.urdf", folder=urdf_folder(), root="fixed")
    model = build_model(arm.with_effects(effect))
    v = np.array([[0.1, r, -0.2] for r in RATES])
    values = {p.name: p.value for p in effect.parameters()}
    given = sum(c.values * values[c.name] for c in torque_columns(effect, model, v, 0.0 * v))
    felt = [model.passive_forces(0.0, model.home, row) for row in v]
    assert given == pytest.approx(-np.array(felt))
