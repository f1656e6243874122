"""Spacecraft the tests of the controller share."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import ctrlsys
import numpy as np
import pinocchio as pin

from smsid.control.statespace import StateSpace
from smsid.description import Description, load_description
from smsid.model import SpacecraftModel, build_model

URDF = Path(__file__).resolve().parents[2] / "urdf"


@cache
def paper() -> SpacecraftModel:
    return build_model(load_description(URDF / "paper_sms.toml"))


@cache
def two_arms() -> SpacecraftModel:
    return build_model(load_description(URDF / "two_arm_sms.toml"))


@cache
def rigid_paper() -> SpacecraftModel:
    """The paper's spacecraft without slosh and panel."""
    described = load_description(URDF / "paper_sms.toml")
    sensors = tuple(s for s in described.sensor if s.kind != "accelerometers")
    return build_model(described.with_sensors(*sensors).model_copy(update={"effect": ()}))


def described(**changes) -> Description:
    return load_description(URDF / "paper_sms.toml").model_copy(update=changes)


def random_state(model: SpacecraftModel, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A state in full motion, base attitude and linear velocity included; slosh and bending at rest."""
    q, v = model.home.copy(), np.zeros(model.nv)
    q[:3] = rng.standard_normal(3)
    q[3:7] = pin.Quaternion(pin.exp3(rng.standard_normal(3))).coeffs()
    q = model.set_joint_angles(q, rng.uniform(-2.0, 2.0, len(model.arm_joints)))
    v[:3], v[3:6] = rng.standard_normal(3), 0.3 * rng.standard_normal(3)
    v[model.arm_joints.v] = rng.standard_normal(len(model.arm_joints))
    v[model.wheels.v] = 50.0 * rng.standard_normal(len(model.wheels))
    return q, v


def slicot_norm(s: StateSpace) -> float:
    """The H-infinity norm by SLICOT's ab13dd."""
    f = [np.asfortranarray(x) for x in (s.a, np.eye(s.order), s.b, s.c, s.d)]
    size, guess = s.d.shape[::-1], np.array([0.0, 1.0])
    gain, _, info = ctrlsys.ab13dd("C", "I", "N", "D", s.order, *size, guess, *f, 1e-12)
    assert info == 0
    return gain[0] / gain[1]
