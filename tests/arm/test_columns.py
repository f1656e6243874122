"""Torque columns against the forces the same effects put into the model."""

from __future__ import annotations

from typing import Literal

import numpy as np
import pinocchio as pin
import pytest

from smsid.arm import JointStates, effect_columns, with_joint_effects
from smsid.description import Description
from smsid.effects import (
    Effect,
    Gear,
    JointFriction,
    JointOffset,
    MotorCoupling,
    MotorInertia,
    Slosh,
    TorqueOffset,
)
from smsid.effects.base import physical
from smsid.effects.gear import gear_matrix
from smsid.effects.joint_state import JointStateOf, TorqueColumns
from smsid.errors import DescriptionError
from smsid.model import build_model

JOINTS = ("joint1", "joint2", "joint3")
EFFECTS = {
    "friction": JointFriction(name="e", joint="joint2", viscous=0.4, coulomb=0.2),
    "laws": JointFriction(
        name="e",
        joint="joint2",
        viscous=0.4,
        coulomb=0.2,
        viscous_direction=0.1,
        coulomb_direction=-0.05,
        quadratic=0.03,
        cubic=0.02,
        stribeck=0.3,
        stribeck_rate=0.8,
        position_cos=0.1,
        position_sin=-0.2,
        load=0.1,
        viscous_temperature=-0.01,
        coulomb_temperature=0.02,
        temperature=35.0,
    ),
    "offset": TorqueOffset(name="e", joint="joint3", torque=-0.7),
    "coupling": MotorCoupling(
        name="e", joints=("joint2", "joint3"), ratios=(2.0, -1.0), inertia=0.7, viscous=0.3, coulomb=0.1
    ),
    "rotor": MotorInertia(name="e", joint="joint1", inertia=0.6),
    "gear": Gear(name="e", joint="joint1", ratio=30.0),
    "zero": JointOffset(name="e", joint="joint1", angle=0.2),
}


@pytest.fixture
def arm(urdf) -> Description:
    return Description(name="arm", urdf="arm3.urdf", folder=urdf, root="fixed", gravity=(0.0, 0.0, -9.81))


@pytest.mark.parametrize("kind", EFFECTS)
def test_columns_times_parameters_are_what_the_motors_give(arm, kind, rng):
    """Inverse dynamics without the effect plus its columns is undone by forward dynamics with it."""
    effect = EFFECTS[kind]
    bare, full = build_model(arm), build_model(arm.with_effects(effect))
    q = pin.randomConfiguration(bare.pin, -np.ones(bare.nq), np.ones(bare.nq))
    v, a = rng.normal(size=(2, 1, bare.nv))
    values = {p.name: p.value for p in effect.parameters()}
    tau = rigid = pin.rnea(bare.pin, bare.data, q, v[0], a[0])
    for _ in range(60):  # the load is the torque itself
        states = JointStates(q[None], v, a, tau[None], np.full((1, bare.nv), 35.0))
        added = [c.values[0] * values[c.name] for c in effect_columns(effect, bare, states)]
        tau = rigid + np.sum(added, axis=0)
    np.testing.assert_allclose(full.acceleration(0.0, q, v[0], tau), a[0], rtol=1e-9, atol=1e-9)


def test_a_coupled_motor_is_felt_by_both_joints_with_their_ratios(arm, rng):
    model = build_model(arm)
    v, a = rng.normal(size=(2, 5, 3))
    effect = MotorCoupling(name="w", joints=("joint2", "joint3"), ratios=(1.0, 3.0))
    inertia, viscous, coulomb = effect_columns(effect, model, JointStates(None, v, a))
    s = np.array([0.0, 1.0, 3.0])
    np.testing.assert_allclose(inertia.values, (a @ s)[:, None] * s)
    np.testing.assert_allclose(viscous.values, (v @ s)[:, None] * s)
    np.testing.assert_allclose(coulomb.values, np.tanh((v @ s) / 0.005)[:, None] * s)
    assert [c.unit for c in (inertia, viscous, coulomb)] == ["kg m^2", "N m s/rad", "N m"]


def test_gears_turn_motors_into_joints(rng):
    gears = [Gear(name="a", joint="j1", ratio=-4.0), Gear(name="b", joint="j2", ratio=5.0, also={"j1": 2.0})]
    matrix, gain = gear_matrix(gears[::-1], ("j1", "j2"))
    np.testing.assert_allclose(matrix, [[-4.0, 0.0], [2.0, 5.0]])
    np.testing.assert_allclose(gain, 1.0)
    rate, torque = rng.normal(size=(2, 2))  # power is the same on both sides of the gears
    assert (matrix @ rate) @ torque == pytest.approx(rate @ (matrix.T @ torque))


@pytest.mark.parametrize(
    ("gears", "text"),
    [
        ([Gear(name="a", joint="j1", ratio=2.0)], "without gear .'j2'"),
        ([Gear(name="a", joint="j1", ratio=2.0), Gear(name="b", joint="j2", ratio=0.0)], "singular"),
        (
            [Gear(name="a", joint="j1", ratio=2.0), Gear(name="b", joint="j2", ratio=2.0, also={"j9": 1.0})],
            "unknown .'j9'",
        ),
    ],
)
def test_gears_that_do_not_fit_are_refused(gears, text):
    with pytest.raises(DescriptionError, match=text):
        gear_matrix(gears, ("j1", "j2"))


def test_effects_that_are_not_linear_in_torque_are_refused(arm):
    tank = Slosh(name="tank", position=(0, 0, 0), mass=1.0, stiffness=(1, 1, 1), damping=(0, 0, 0))
    with pytest.raises(DescriptionError, match="'tank' of kind 'slosh' does not enter joint torques"):
        effect_columns(tank, build_model(arm), JointStates(None, *np.zeros((2, 1, 3))))


def test_joint_effects_are_added_where_there_are_none(arm):
    one = arm.with_effects(JointFriction(name="mine", joint="joint2", viscous=3.0))
    full = with_joint_effects(one, JOINTS, "joint_friction", "motor_inertia")
    kinds = [(e.kind, e.joint) for e in full.effect]
    assert sorted(kinds) == sorted((k, j) for k in ("joint_friction", "motor_inertia") for j in JOINTS)
    assert full.get_effect("mine").viscous == 3.0


class Wind(Effect):
    """An effect of a user: drag of the air, by the square of the rate."""

    kind: Literal["wind"] = "wind"
    joint: str
    drag: float = physical("N m s^2/rad^2", default=0.0)

    def driven_joints(self) -> tuple[str, ...]:
        return (self.joint,)

    def torque_columns(self, of: JointStateOf) -> TorqueColumns:
        rate = of(self.joint).rate
        return {"drag": {self.joint: rate * np.abs(rate)}}


def test_an_effect_of_a_user_takes_part_by_its_own_columns(arm, rng):
    v, a = rng.normal(size=(2, 5, 3))
    states = JointStates(None, v, a)
    (drag,) = effect_columns(Wind(name="w", joint="joint2"), build_model(arm), states)
    assert (drag.name, drag.unit) == ("w.drag", "N m s^2/rad^2")
    np.testing.assert_allclose(drag.values, (v * np.abs(v)) * [0.0, 1.0, 0.0])
    with pytest.raises(DescriptionError, match="no joint 'elbow'"):
        effect_columns(Wind(name="w", joint="elbow"), build_model(arm), states)
