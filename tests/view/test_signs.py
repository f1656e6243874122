"""Arrows, bent arrows and trails: where they point, how large they are."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from smsid.view import Look, build_scene
from smsid.view._arrows import INDICES, _bent_arrow, joint_axis, tool_frame, tool_positions, tube_along
from smsid.view._drivers import DrawnFrames
from smsid.view._motion import motion_of


@pytest.fixture(scope="module")
def scene(model, trajectory):
    motion = motion_of(model, trajectory, 0.1, 1000)
    built = build_scene(model, motion)
    frames = DrawnFrames.of(model, motion, built.scale)
    return built, motion, frames, built.poses(frames)


def test_every_moving_sign_can_be_switched_off(scene):
    built, *_ = scene
    wanted = {"thrust", "torques", "momentum", "angular momentum", "centre of mass", "tool trail", "sensors"}
    assert set(built.layers) == wanted
    bare = build_scene(built.model, scene[1], Look(arrows=False, trail=False, sensors=False))
    assert not bare.layers


def test_torque_turns_about_the_joint_and_is_as_large(scene, model):
    _, motion, _, poses = scene
    largest = np.abs(motion.joint_torque).max()
    sizes = []
    for k, joint in enumerate(model.arm_joints.joints):
        path = next(p for p in poses if p.endswith(f"{model.pin.names[int(joint)]}/torque"))
        axis = joint_axis(model, int(joint))
        sign = poses[path][:, :3, 0]
        along = sign @ axis
        np.testing.assert_allclose(np.linalg.norm(sign, axis=1), np.maximum(np.abs(along), 1e-4), atol=1e-9)
        clear = np.abs(motion.joint_torque[:, k]) > 0.01 * largest
        sizes.append(along[clear] / motion.joint_torque[clear, k])
    sizes = np.concatenate(sizes)
    assert sizes.min() > 0.0
    np.testing.assert_allclose(sizes, sizes[0], rtol=1e-9)  # one scale for all joints


def test_axes_are_those_that_joints_turn_about(model):
    for joint in (*model.arm_joints.joints, *model.wheels.joints):
        index = model.pin.joints[int(joint)].idx_q
        data, q = model.pin.createData(), pin.neutral(model.pin)
        pin.forwardKinematics(model.pin, data, q)
        before = data.liMi[int(joint)].copy()
        q[index] += 0.3
        pin.forwardKinematics(model.pin, data, q)
        turned = pin.log3(before.rotation.T @ data.liMi[int(joint)].rotation)
        np.testing.assert_allclose(turned, 0.3 * joint_axis(model, int(joint)), atol=1e-12)
    assert joint_axis(model, 1) is None  # the free flyer
    assert joint_axis(model, model.slosh[0].joint) is None


def test_bent_arrow_is_right_handed():
    points = _bent_arrow().vertices
    middle = points.reshape(-1, 10, 3).mean(axis=1)
    turning = np.cross(middle[:-1], middle[1:])
    assert np.all(turning[:, 0] > 0.0)
    assert np.abs(middle[:, 0]).max() < 1e-12


def test_momentum_arrows_start_at_the_centre_of_mass(scene):
    _, _, frames, poses = scene
    for path in ("spacecraft/linear_momentum", "spacecraft/com"):
        np.testing.assert_allclose(poses[path][:, :3, 3], frames.momenta.com)
    arrow, p = poses["spacecraft/linear_momentum"][:, :3, 0], frames.momenta.linear
    clear = np.linalg.norm(p, axis=1) > 1e-2 * frames.momenta.linear_scale
    np.testing.assert_allclose(np.cross(arrow, p)[clear], 0.0, atol=1e-6)
    assert np.all(np.sum(arrow * p, axis=1)[clear] > 0.0)


def test_trail_goes_through_the_tool(scene, model):
    built, motion, _, _ = scene
    way = tool_positions(model, motion.q)["arm"]
    frame = tool_frame(model, model.arms["arm"])
    assert model.pin.frames[frame].name == "tool"
    data = model.pin.createData()
    for i in (0, 20, 59):
        pin.framesForwardKinematics(model.pin, data, motion.q[i])
        np.testing.assert_allclose(way[i], data.oMf[frame].translation, atol=1e-12)
    tube = built.part("spacecraft/trail.arm").shape
    rings = tube.vertices.reshape(len(way), -1, 3)
    np.testing.assert_allclose(rings.mean(axis=1), way, atol=1e-9)
    pieces = built.trails["spacecraft/trail.arm"]
    assert pieces == len(way) - 1 and tube.faces.size == pieces * INDICES


def test_tube_has_one_thickness_also_where_the_way_stops_and_turns_back():
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1, 0], [1, 0.5, 0.0]], dtype=float)
    rings = tube_along(points, 0.1).vertices.reshape(len(points), -1, 3)
    np.testing.assert_allclose(np.linalg.norm(rings - points[:, None], axis=2), 0.1, atol=1e-12)
