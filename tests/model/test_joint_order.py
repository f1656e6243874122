"""Joints of effects on an arm's links: Pinocchio's algorithms agree with one another, as if the tree had been
built in order.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import Arm, Description, Mount, load_description
from smsid.effects import ExtraMode, Payload, Slosh, SloshPendulum
from smsid.model import build_model, rebuild
from smsid.model._joint_order import is_depth_first


def _tank(name: str, frame: str) -> Slosh:
    return Slosh(
        name=name,
        frame=frame,
        position=(0.1, 0.2, 0.3),
        mass=5.0,
        stiffness=(9.0, 8.0, 7.0),
        damping=(1.0, 1.0, 1.0),
    )


def _described(urdf: Path, what: str) -> Description:
    d = load_description(urdf / "paper_sms.toml")
    array = d.get_effect("panel").model_copy(update={"name": "array", "frame": "link2"})
    if what == "nothing":
        return d
    if what == "tank":
        return d.with_effects(_tank("fuel", "link2"))
    if what == "panel":
        return d.with_effects(array)
    if what == "mode":
        return d.with_effects(
            array, ExtraMode(name="more", appendage="array", mass=1.0, position=(1, 0, 0), frequency=3.0)
        )
    if what == "tanks named as links":
        return d.with_effects(
            _tank("link1", "link1"), _tank("tool", "tool"), Payload(name="p", frame="tool", mass=3.0)
        )
    if what == "pendulum":
        swing = SloshPendulum(name="fuel", frame="link1", pivot=(0.1, 0.0, 0.2), mass=4.0, length=0.4)
        return d.with_effects(swing)
    assert what == "arm on the arm"
    own = d.arm or (Arm(name="arm", joints=("joint1", "joint2", "joint3")),)
    second = Arm(name="second", urdf=str(urdf / "arm3.urdf"), mount=Mount(frame="link2", xyz=(0.1, 0.2, 0.0)))
    tanks = _tank("a", "link1"), _tank("b", "second/link1")
    return d.model_copy(update={"arm": (*own, second)}).with_effects(*tanks)


KINDS = ("nothing", "tank", "panel", "mode", "tanks named as links", "pendulum", "arm on the arm")


@pytest.mark.parametrize("what", KINDS)
def test_algorithms_agree(urdf: Path, what: str) -> None:
    """The mass matrix is what unit accelerations take, its inverse is one, derivatives are differences."""
    model = build_model(_described(urdf, what))
    p, data = model.pin, model.pin.createData()
    assert is_depth_first(p)
    rng = np.random.default_rng(4)
    q = pin.integrate(p, model.home, 0.4 * rng.normal(size=p.nv))
    v, a = rng.normal(size=(2, p.nv))
    still = pin.rnea(p, data, q, np.zeros(p.nv), np.zeros(p.nv))
    mass = np.array([pin.rnea(p, data, q, np.zeros(p.nv), e) - still for e in np.eye(p.nv)])
    upper = np.triu(pin.crba(p, data, q))
    np.testing.assert_allclose(upper, np.triu(mass), atol=1e-9)
    inverse = np.triu(pin.computeMinverse(p, data, q))
    inverse = inverse + np.triu(inverse, 1).T
    np.testing.assert_allclose(inverse @ mass, np.eye(p.nv), atol=1e-9)
    by_q, by_v, _ = (np.array(x) for x in pin.computeRNEADerivatives(p, data, q, v, a))
    for j, step in enumerate(1e-6 * np.eye(p.nv)):
        moved = [pin.rnea(p, data, pin.integrate(p, q, s * step), v, a) for s in (1, -1)]
        np.testing.assert_allclose(by_q[:, j], (moved[0] - moved[1]) / 2e-6, atol=1e-5)
        faster = [pin.rnea(p, data, q, v + s * step, a) for s in (1, -1)]
        np.testing.assert_allclose(by_v[:, j], (faster[0] - faster[1]) / 2e-6, atol=1e-5)


@pytest.mark.parametrize("what", KINDS[1:])
def test_nothing_else_changes(urdf: Path, what: str) -> None:
    """Bodies, frames, limits and pictures are those of the joints' names; built anew it is the same."""
    d = _described(urdf, what)
    ordered = build_model(d, visuals=True)
    bare = build_model(d.model_copy(update={"effect": ()}), visuals=True)
    anew = rebuild(bare, d)
    assert list(anew.pin.names) == list(ordered.pin.names)
    assert ordered.wheels.names == bare.wheels.names and ordered.arm_joints.names == bare.arm_joints.names
    for name in (*bare.arm_joints.names, *bare.wheels.names):
        a, b = (m.pin.joints[m.pin.getJointId(name)] for m in (ordered, bare))
        for limit in ("lowerPositionLimit", "upperPositionLimit", "velocityLimit", "effortLimit", "armature"):
            place = (a.idx_q, b.idx_q) if "Position" in limit else (a.idx_v, b.idx_v)
            assert getattr(ordered.pin, limit)[place[0]] == getattr(bare.pin, limit)[place[1]], (name, limit)
    for k in range(bare.pin.nframes):
        a, b = ordered.pin.frames[k], bare.pin.frames[k]
        assert (a.name, a.type, a.parentFrame) == (b.name, b.type, b.parentFrame)
        assert ordered.pin.names[a.parentJoint] == bare.pin.names[b.parentJoint]
        np.testing.assert_array_equal(a.placement, b.placement)
    assert ordered.visual is not None and bare.visual is not None
    for a, b in zip(ordered.visual.geometryObjects, bare.visual.geometryObjects, strict=True):
        assert ordered.pin.names[a.parentJoint] == bare.pin.names[b.parentJoint]
    assert pin.computeTotalMass(anew.pin) == pytest.approx(pin.computeTotalMass(ordered.pin), rel=1e-14)
