"""Modes as joints: they carry the participation factors and the modal mass they are given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smsid.description import Description, load_description
from smsid.effects import ModalAppendage, Mode
from smsid.model import build_model

URDF = Path(__file__).resolve().parents[2] / "urdf"
PAPER = load_description(URDF / "paper_sms.toml")
BARE = Description(name="x", urdf="paper_sms.urdf", folder=URDF)
vectors = st.tuples(*[st.floats(-2.0, 2.0)] * 3)
FREQUENCY, DAMPING = 0.3, 0.02


def mass_matrix(model, q):
    upper = np.triu(pin.crba(model.pin, model.data, q))
    return upper + np.triu(upper, 1).T


def sail(*modes: Mode, frame: str | None = None, position=(0.0, 0.0, 0.0), rpy=(0.0, 0.0, 0.0)):
    """An appendage of 90 kg, heavy and large enough to feed modes of some ten kilograms."""
    return ModalAppendage(
        name="sail",
        frame=frame,
        position=position,
        rpy=rpy,
        mass=90.0,
        center_of_mass=(3.0, 0.2, 0.0),
        inertia=(80.0, -54.0, 1100.0, 0.0, 0.0, 1180.0),
        mode=modes,
    )


def mode(translation, rotation) -> Mode:
    return Mode(frequency=FREQUENCY, damping=DAMPING, translation=translation, rotation=rotation)


def test_modal_data_of_the_beam_make_the_same_spacecraft():
    panel = PAPER.get_effect("panel")
    rigid = panel.rigid_inertia()
    about_root = pin.SE3.Identity().act(rigid).toDynamicParameters()
    twin = ModalAppendage(
        name="panel",
        position=panel.position,
        mass=panel.mass,
        center_of_mass=tuple(rigid.lever),
        inertia=tuple(about_root[4:]),
        mode=panel.modal_data(),
        stations=tuple(map(tuple, panel.station_positions())),
    )
    one, other = build_model(PAPER), build_model(PAPER.with_effects(twin))
    rng = np.random.default_rng(0)
    for _ in range(5):
        q = pin.integrate(one.pin, one.home, rng.standard_normal(one.nv))
        v, tau = rng.standard_normal((2, one.nv))
        a, b = one.acceleration(0.0, q, v, tau), other.acceleration(0.0, q, v, tau)
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(one.momentum(q, v), other.momentum(q, v), rtol=1e-12, atol=1e-9)
        assert one.energy(q, v) == pytest.approx(other.energy(q, v), rel=1e-12)


CASES = {
    "bending": ((0.0, 0.0, 4.0), (0.3, -13.0, 0.0)),
    "bending, sideways": ((1.0, -2.0, 0.5), (1.0, 0.25, -1.0)),
    "pure twist": ((0.0, 0.0, 0.0), (3.0, 0.5, -1.0)),
    "helical": ((0.0, 0.0, 4.0), (0.3, -13.0, 5.0)),
    "helical, left-handed": ((2.0, 1.0, 1.0), (-3.0, -4.0, -2.0)),
    "nearly no twist": ((0.0, 0.0, 4.0), (0.0, -13.0, 1e-4)),
}


@pytest.mark.parametrize("case", CASES)
@settings(max_examples=15, deadline=None)
@given(position=vectors, rpy=vectors, rate=st.floats(-3.0, 3.0))
def test_a_mode_carries_its_participation_and_unit_modal_mass(case, position, rpy, rate):
    """From the mode's rate alone: p = R L_t d, h = (R L_r + r x R L_t) d, T = d^2 / 2."""
    translation, rotation = map(np.array, CASES[case])
    model = build_model(BARE.with_effects(sail(mode(*CASES[case]), position=position, rpy=rpy)))
    v = np.zeros(model.nv)
    v[model.modes.v] = rate / model.mode_scale
    turn = pin.rpy.rpyToMatrix(*rpy)
    linear = turn @ translation * rate
    angular = turn @ rotation * rate + np.cross(position, linear)
    found = model.momentum(model.home, v)
    np.testing.assert_allclose(found, [*linear, *angular], atol=1e-10)
    assert pin.computeKineticEnergy(model.pin, model.data, model.home, v) == pytest.approx(
        0.5 * rate**2, abs=1e-12
    )


@pytest.mark.parametrize("case", CASES)
def test_locked_modes_leave_the_rigid_appendage(case):
    position, rpy = (1.5, 0.2, -0.1), (0.3, -0.5, 0.7)
    effect = sail(mode(*CASES[case]), position=position, rpy=rpy)
    model, bare = build_model(BARE.with_effects(effect)), build_model(BARE)
    placement = pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(position))
    rigid = placement.act(effect.rigid_inertia()).matrix()
    expected = mass_matrix(bare, bare.home)[:6, :6] + rigid
    np.testing.assert_allclose(mass_matrix(model, model.home)[:6, :6], expected, rtol=1e-11, atol=1e-9)


@pytest.mark.parametrize("case", CASES)
def test_a_clamped_mode_rings_at_its_frequency_and_damping(case):
    model = build_model(BARE.with_effects(sail(mode(*CASES[case]))))
    (j,) = model.modes.v
    (scale,) = model.mode_scale
    (row,) = np.flatnonzero(model.spring_v == j)
    modal_mass = mass_matrix(model, model.home)[j, j]
    assert modal_mass == pytest.approx(scale**2, rel=1e-12)
    omega = np.sqrt(model.stiffness[row] / modal_mass)
    assert omega == pytest.approx(2 * np.pi * FREQUENCY)
    assert model.damping[row] / modal_mass == pytest.approx(2 * DAMPING * omega)


@pytest.mark.parametrize("case", ["bending", "pure twist", "helical"])
def test_an_appendage_on_a_link_of_the_arm(case):
    position, rpy = (0.4, 0.1, 0.0), (0.2, 0.3, -0.4)
    light = sail(mode(*(np.array(x) * 0.2 for x in CASES[case])), frame="link3", position=position, rpy=rpy)
    model, bare = build_model(BARE.with_effects(light)), build_model(BARE)
    angles = np.array([0.7, -0.4, 1.1])
    q = model.set_joint_angles(model.home, angles)
    pin.framesForwardKinematics(bare.pin, bare.data, bare.set_joint_angles(bare.home, angles))
    link = bare.data.oMf[bare.pin.getFrameId("link3", pin.BODY)]
    root = link * pin.SE3(pin.rpy.rpyToMatrix(*rpy), np.array(position))
    v = np.zeros(model.nv)
    v[model.modes.v] = 1.0 / model.mode_scale
    translation, rotation = (root.rotation @ np.array(x) * 0.2 for x in CASES[case])
    expected = [*translation, *(rotation + np.cross(root.translation, translation))]
    np.testing.assert_allclose(model.momentum(q, v), expected, atol=1e-11)
    rigid = root.act(light.rigid_inertia())
    own = mass_matrix(bare, bare.set_joint_angles(bare.home, angles))[:6, :6]
    np.testing.assert_allclose(mass_matrix(model, q)[:6, :6], own + rigid.matrix(), rtol=1e-10, atol=1e-8)
    (found,) = model.appendages
    pin.forwardKinematics(model.pin, model.data, q)
    where = model.data.oMi[found.parent] * found.placement
    np.testing.assert_allclose(where.homogeneous, root.homogeneous, atol=1e-12)


def test_several_modes_do_not_disturb_each_other():
    first, second = CASES["helical"], ((0.0, 0.0, -2.0), (2.0, 8.0, 1.0))
    model = build_model(BARE.with_effects(sail(mode(*first), mode(*second))))
    mass = mass_matrix(model, model.home)[np.ix_(model.modes.v, model.modes.v)]
    np.testing.assert_allclose(mass, np.diag(model.mode_scale**2), atol=1e-12)
    v = np.zeros(model.nv)
    v[model.modes.v] = np.array([1.0, 1.0]) / model.mode_scale
    np.testing.assert_allclose(
        model.momentum(model.home, v), np.concatenate(first) + np.concatenate(second), atol=1e-11
    )
