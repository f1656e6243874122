"""A welded arm of MuJoCo's, in motion as a recording begins, takes up a point mass."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.description.schema import Description
from smsid.effects import JointFriction
from smsid.estimation.flight import flight_of
from smsid.estimation.parameter_vector import Point
from smsid.recording import Recording
from smsid.sensing import Sensor
from smsid.sensing.error_model import ErrorModel
from smsid.tracking import Tracker, track_recordings
from smsid.tracking._setting import Setting
from smsid.tracking._warm_up import linearise_by_search

mujoco = pytest.importorskip("mujoco")

WORLD = """<mujoco><option timestep="0.001" integrator="RK4" gravity="0 0 -9.81"/><worldbody>
<body name="upper"><joint name="j1" axis="0 1 0" damping="0.4"/>
<inertial pos="0.2 0 0" mass="4" diaginertia="0.02 0.08 0.08"/>
<body name="fore" pos="0.4 0 0"><joint name="j2" axis="0 1 0" damping="0.2"/>
<inertial pos="0.15 0.01 0" mass="2" diaginertia="0.01 0.03 0.03"/>
<body name="taken" pos="0.3 0 0"><inertial pos="0 0 0" mass="1e-9" diaginertia="1e-12 1e-12 1e-12"/></body>
</body></body></worldbody><actuator><motor joint="j1"/><motor joint="j2"/></actuator></mujoco>"""
URDF = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="4"/>
<inertia ixx="0.02" iyy="0.08" izz="0.08" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="fore"><inertial><origin xyz="0.15 0.01 0"/><mass value="2"/>
<inertia ixx="0.01" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-9" upper="9" effort="99" velocity="99"/></joint>
<joint name="j2" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0"/>
<axis xyz="0 1 0"/><limit lower="-9" upper="9" effort="99" velocity="99"/></joint></robot>"""
SHAPE = ("coulomb", "stribeck", "stribeck_rate", "stribeck_exponent", "load", "position_cos", "position_sin")
TAKEN = 12.0  # [s]


def flown(seconds: float, mass: float, rng: np.random.Generator, taken: float = TAKEN) -> Recording:
    """Angles, rates and held torques at 50 Hz; a point mass is ``taken`` up [s]."""
    model = mujoco.MjModel.from_xml_string(WORLD)
    state, rows = mujoco.MjData(model), []
    state.qpos[:], state.qvel[:] = [-0.4, 0.7], [0.5, -0.3]
    times = np.arange(round(50 * seconds) + 1) / 50
    for t in times:
        if t >= taken - 1e-9 and mass:
            model.body_mass[3] = mass
            mujoco.mj_setConst(model, mujoco.MjData(model))
        q, v = state.qpos, state.qvel
        slow, fast = np.sin([1.3 * t, 1.9 * t + 1.0]), np.sin([3.1 * t, 4.2 * t])
        wanted = np.array([-0.3, 0.6]) + [0.8, 0.7] * slow + 0.3 * fast
        torque = np.array([40.0, 6.0]) * (wanted - q) - np.array([5.0, 0.5]) * v
        torque -= [25.0 * np.cos(q[0]), 4.0 * np.cos(q.sum())]
        rows.append([*q, *v, *torque])
        state.ctrl[:] = torque
        mujoco.mj_step(model, state, 20)
    x = np.array(rows)
    channels = {
        "encoder.joint_position": x[:, :2] + 1e-4 * rng.standard_normal((len(x), 2)),
        "encoder.joint_velocity": x[:, 2:4] + 1e-3 * rng.standard_normal((len(x), 2)),
        "command.joint_torque": x[:, 4:],
    }
    return Recording.from_arrays(times, channels, labels={"joint": ("j1", "j2")}, name="grasp")


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.urdf").write_text(URDF)
    errors = {q: ErrorModel(noise_sigma=s) for q, s in (("joint_position", 1e-4), ("joint_velocity", 1e-3))}
    return Description(
        name="arm",
        urdf="arm.urdf",
        folder=folder,
        root="fixed",
        gravity=(0.0, 0.0, -9.81),
        effect=tuple(
            JointFriction(name=f"f{k}", joint=f"j{k}", viscous=x, known=SHAPE)
            for k, x in ((1, 0.4), (2, 0.2))
        ),
        sensor=(Sensor(name="encoder", kind="encoder", rate=50.0, errors=errors),),
    )


def test_what_is_taken_up_is_named_at_its_time_with_its_size(arm):
    """The warm-up is no longer than one value of each parameter explains, which tells that torques are held;
    what a change explains is no misfit that widens bands.
    """
    recording = flown(20.0, 0.5, np.random.default_rng(1))
    history, tracker = track_recordings(arm, [recording], false_alarms=0.1)
    (change,) = [e for e in history.events if e.kind == "change"]
    assert change.text.startswith(f"fore changed at {TAKEN:g} s, give or take 0.02 s: fore.mx by +0.15")
    assert history.conditions["widening"] == 1.0
    for name, truth in (("fore.mx", 0.45), ("fore.Iyy", 0.03 + 2.0 * 0.0225 + 0.5 * 0.09)):
        k = history.names.index(name)
        assert abs(history.values[-1, k] - truth) < 4.0 * history.sigmas[-1, k]
        assert history.sigmas[-1, k] < 1e-4
    assert tracker.watch.sentence == ""


def test_what_is_taken_up_between_recordings_is_there_from_the_second_ones_first_sample(arm):
    rng = np.random.default_rng(3)
    recordings = [flown(20.0, 0.0, rng), flown(20.0, 0.5, rng, taken=0.0)]
    history, tracker = track_recordings(arm, recordings, gap=100.0, false_alarms=0.1)
    (change,) = [e for e in history.events if e.kind == "change"]
    assert change.text.startswith("grasp#2: fore changed before 0 s, while nothing was read: ")
    assert "fore.mx by +0.15 +-" in change.text
    assert "fore.Iyy by +0.045 +-" in change.text
    assert "doubtful" not in change.text
    for name, truth in (("fore.mx", 0.45), ("fore.Iyy", 0.03 + 2.0 * 0.0225 + 0.5 * 0.09)):
        k = history.names.index(name)
        assert abs(history.values[-1, k] - truth) < 4.0 * history.sigmas[-1, k]
    assert tracker.watch.sentence == ""


def test_noise_that_is_stated_too_small_makes_no_size_doubtful(arm):
    """What is left after a change is held against what was left before it."""
    (sensor,) = arm.sensor
    errors = {q: e.model_copy(update={"noise_sigma": e.noise_sigma / 1.6}) for q, e in sensor.errors.items()}
    quieter = arm.model_copy(update={"sensor": (sensor.model_copy(update={"errors": errors}),)})
    history, _ = track_recordings(quieter, [flown(20.0, 0.5, np.random.default_rng(1))], false_alarms=0.1)
    changes = [e.text for e in history.events if e.kind == "change"]
    assert len(changes) == 1
    assert "fore.mx by +0.15 +-" in changes[0]
    assert "doubtful" not in changes[0]


def test_a_warm_up_is_no_longer_than_one_value_each_explains(arm):
    recording = flown(20.0, 0.003, np.random.default_rng(1))  # so little that a search over it all ends
    point = Point.of(arm)
    flight = flight_of(point, recording, "grasp")
    tracker = Tracker(arm, setting=Setting.of_flight(flight))
    _, _, start = linearise_by_search(tracker, point, flight, 20.0)
    assert start is not None
    assert start.until <= TAKEN
    k = tracker.names.index("fore.mx")
    assert abs(start.values[list(start.index).index(k)] - 0.3) < 1e-5  # 9e-4 more from `TAKEN` on


def test_nothing_is_said_of_a_pause_in_which_nothing_changed(arm):
    rng = np.random.default_rng(4)
    history, _ = track_recordings(arm, [flown(20.0, 0.0, rng) for _ in range(2)], gap=9.0, false_alarms=0.1)
    assert [e for e in history.events if e.kind == "change"] == []


def test_how_commands_act_is_told_by_the_models_of_an_estimate(arm):
    recording = flown(10.0, 0.0, np.random.default_rng(2))
    history, _ = track_recordings(arm, [recording], warm_up=0.0)  # straight lines by their looks
    assert history.conditions["widening"] == 1.0
    assert np.sqrt(np.nanmean(history.fit[1:] ** 2)) == pytest.approx(1.0, abs=0.1)
