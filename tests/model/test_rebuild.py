"""A model rebuilt for another description is the one built from the files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import Arm, Description, Mount, Wheel, load_description
from smsid.description.schema import Thrust
from smsid.effects import BodyError, GeometricStiffness, JointFriction, Payload
from smsid.model import SpacecraftModel, build_model, rebuild


def same(a: SpacecraftModel, b: SpacecraftModel) -> None:
    assert list(a.pin.names) == list(b.pin.names)
    rng = np.random.default_rng(0)
    for _ in range(3):
        q = pin.integrate(a.pin, a.home, 0.3 * rng.normal(size=a.nv))
        v, tau = rng.normal(size=(2, a.nv))
        np.testing.assert_array_equal(a.acceleration(1.0, q, v, tau), b.acceleration(1.0, q, v, tau))
    for field in ("home", "mode_scale", "spring_v", "stiffness", "damping"):
        np.testing.assert_array_equal(getattr(a, field), getattr(b, field))
    assert a.arm_joints.names == b.arm_joints.names and a.wheels.names == b.wheels.names


@pytest.mark.parametrize("what", ["effects", "wheels", "gravity", "thrust", "nothing"])
def test_it_is_what_the_files_give(urdf: Path, what: str) -> None:
    description = load_description(urdf / "paper_sms.toml")
    start = build_model(description)
    kept = start.acceleration(0.0, start.home, np.ones(start.nv), np.ones(start.nv))
    changed = {
        "effects": description.with_effects(
            Payload(name="p", frame="tool", mass=3.0),
            BodyError(name="b", body="link2", mass=1.0),
            JointFriction(name="f", joint="joint1", coulomb=0.1),
            GeometricStiffness(name="g", appendage="panel"),
            description.get_effect("panel").with_values({"panel.density": 2800.0}),
        ),
        "wheels": description.model_copy(update={"wheel": (Wheel(name="w", axis=(1, 1, 0), inertia=0.3),)}),
        "gravity": description.model_copy(update={"gravity": (0.0, 0.0, -1.6)}),
        "thrust": description.model_copy(update={"thrust": Thrust(point=(1.0, 0.0, 0.0))}),
        "nothing": description,
    }[what]  # fmt: skip
    once = rebuild(start, changed)
    same(once, build_model(changed))
    same(rebuild(once, changed), once)
    same(rebuild(once, description), start)
    again = start.acceleration(0.0, start.home, np.ones(start.nv), np.ones(start.nv))
    np.testing.assert_array_equal(again, kept)


def test_another_arm_is_read_from_its_file(urdf: Path) -> None:
    one = Description(name="x", urdf="bus.urdf", folder=urdf, arm=(Arm(name="a", urdf="arm3.urdf"),))
    moved = one.arm[0].model_copy(update={"mount": Mount(xyz=(0.1, 0.2, 1.0))})
    other = one.model_copy(update={"arm": (moved,)})
    same(rebuild(build_model(one), other), build_model(other))
