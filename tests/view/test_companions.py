"""Several motions in one replay: ghosts, side by side, and the simulated twin of a recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from smsid.cli.view import file_names
from smsid.description import load_description
from smsid.description.schema import Thruster
from smsid.errors import RecordingError, SmsidError
from smsid.model.build import build_model
from smsid.recording import Recording
from smsid.simulate import truth_of
from smsid.view import build_replay, replay, simulated_twin
from smsid.view._export import readouts
from smsid.view._look import VIEW_FROM
from smsid.view._scene import world_poses

from .conftest import URDF


@pytest.fixture(scope="module")
def recording(model, trajectory):
    times = np.linspace(0.0, 6.0, 601)
    return Recording.from_arrays(times, truth_of(trajectory, model.description.sensor)(times), name="flight")


def test_twin_of_an_exact_recording_does_the_same(model, trajectory, recording):
    twin = simulated_twin(model, recording.with_provenance({"inputs": "linear"}))
    assert (twin.start, twin.stop) == (0.0, 6.0)
    times = np.linspace(0.5, 6.0, 23)
    expected, found = trajectory.states(times).v, twin.states(times).v
    assert np.all(np.abs(found - expected).max(axis=0) < 2e-3 * np.abs(expected).max(axis=0))


def test_commands_are_held_where_nothing_else_is_said(model, trajectory, recording):
    """What is gained in steps of h from the value at their start differs by h / 2 times the rate's growth."""
    twin, times = simulated_twin(model, recording), np.linspace(0.0, 6.0, 25)
    wheels = model.wheels.v
    true, found = trajectory.states(times), twin.states(times).v[:, wheels]
    behind = 0.01 / 2 * (true.a - true.a[0])[:, wheels]
    prompt = true.v[:, wheels]
    assert np.abs(found - (prompt - behind)).sum() < 0.1 * np.abs(found - prompt).sum()


def test_twin_of_another_spacecraft_goes_elsewhere(description, recording):
    slosh = description.get_effect("tank")
    heavier = slosh.model_copy(update={"mass": 3.0 * slosh.mass})
    others = [heavier if e.name == "tank" else e for e in description.effect]
    other = build_model(description.model_copy(update={"effect": tuple(others)}))
    shown = replay(other, recording, beside=[("simulated", simulated_twin(other, recording))])
    off = {r.label: r.values for r in readouts(shown)}
    assert off["simulated: arm tool off"][0] < 1e-6
    assert off["simulated: arm tool off"].max() > 1.0  # [mm]


def test_joints_without_torque_follow_their_angles(model, recording):
    measured = recording.without("command.joint_torque")
    twin = simulated_twin(model, measured)
    times = np.linspace(0.5, 5.5, 11)
    index = np.searchsorted(recording.time("encoder.joint_position"), times - 1e-9)
    angles = recording["encoder.joint_position"][index]
    np.testing.assert_allclose(model.joint_angles(twin.states(times).q), angles, atol=1e-6)


def test_single_thrusters_push_the_twin(description):
    """Half of 4 N along x for 2 s is an impulse of 4 N s; off the centre of mass it turns a little."""
    jet = Thruster(name="jet", position=(0.0, 0.0, 0.0), direction=(1.0, 0.0, 0.0), force=4.0)
    craft = build_model(description.model_copy(update={"thruster": (jet,), "effect": ()}).with_sensors())
    times = np.linspace(0.0, 2.0, 21)
    still = {"pose.position": np.zeros((21, 3)), "pose.attitude": np.tile([0.0, 0.0, 0.0, 1.0], (21, 1))}
    flight = Recording.from_arrays(times, {**still, "command.thruster": np.full((21, 1), 0.5)})
    found = simulated_twin(craft, flight).states(np.array([2.0]))
    momentum = craft.momentum(found.q[0], found.v[0])
    np.testing.assert_allclose(momentum[:3], [4.0, 0.0, 0.0], atol=1e-3)


def test_twin_needs_to_know_what_drove_the_motion(model, recording):
    bare = recording.without(*(c for c in recording.channels if c.startswith(("command.", "encoder."))))
    with pytest.raises(RecordingError, match="nothing of what drove"):
        simulated_twin(model, bare)


def test_others_are_played_at_the_times_of_the_first(model, trajectory):
    part = trajectory.states(np.linspace(1.0, 4.0, 31))
    shown = replay(model, trajectory, beside=[("part", part)], fps=10.0)
    other = shown.companions[0]
    np.testing.assert_array_equal(other.motion.time, shown.motion.time)
    inside = (shown.motion.time >= 1.0) & (shown.motion.time <= 4.0)
    np.testing.assert_allclose(other.motion.q[inside], shown.motion.q[inside], atol=1e-3)
    before = other.motion.q[shown.motion.time < 1.0]
    np.testing.assert_allclose(before, np.tile(part.q[0], (len(before), 1)))


def test_a_ghost_lies_over_the_first_and_leaves_out_what_confuses(model, trajectory):
    shown = replay(model, trajectory, beside=[("same", trajectory)], fps=5.0)
    first, ghost = shown.scene, shown.companions[0].scene
    assert ghost.root == "spacecraft_1" and set(ghost.layers) == {"tool trail"}
    own, other = world_poses(first.parts, shown.frames), world_poses(ghost.parts, shown.companions[0].frames)
    for path, poses in other.items():
        np.testing.assert_allclose(poses, own[path.replace("spacecraft_1", "spacecraft", 1)], atol=1e-12)
    solid = [p for p in ghost.parts if p.shape is not None and not p.layer]
    assert solid and all(p.material.opacity < 0.5 and not p.shadow for p in solid)
    assert not any(p.path.endswith("tank.tank") for p in ghost.parts)
    assert set(shown.tracks) >= {p.path for p in ghost.parts if p.driver is not None}


def test_side_by_side_they_do_not_touch(model, trajectory):
    shown = replay(model, trajectory, beside=[("same", trajectory)], layout="beside", fps=5.0)
    shift = shown.companions[0].scene.parts[0].pose[:3, 3]
    alone = replay(model, trajectory, fps=5.0).scene.corners
    right = np.cross([0.0, 0.0, 1.0], VIEW_FROM)
    right /= np.linalg.norm(right)
    assert shift @ right > np.ptp(alone @ right) and abs(shift[2]) < 1e-12
    assert np.ptp(shown.scene.corners @ right) > 2.0 * np.ptp(alone @ right)


def test_unknown_layout_is_refused(model, trajectory):
    with pytest.raises(SmsidError, match="layout"):
        replay(model, trajectory, layout="above")  # type: ignore[arg-type]


def test_recordings_are_named(recording):
    described = load_description(URDF / "paper_sms.toml")
    shown = build_replay(described, [recording, recording], ["a", "b"], fps=2.0)
    assert (shown.label, [c.label for c in shown.companions]) == ("a", ["b"])
    files = [Path("x/a.nc"), Path("y/b.nc"), Path("y/a.nc")]
    assert file_names(files[:2]) == ["a", "b"]
    assert file_names(files) == ["x/a.nc", "y/b.nc", "y/a.nc"]
