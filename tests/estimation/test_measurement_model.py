"""Predicted readings: derivatives against differences, one sample against the simulator's sensors."""

import numpy as np
import pinocchio as pin
import pytest

from smsid.description import load_description
from smsid.effects import BeamMode, GearCompliance, GeometricStiffness
from smsid.estimation._measurement_model import MeasurementModel
from smsid.estimation.measurements import measurements_of
from smsid.model import build_model
from smsid.recording import Recording
from smsid.sensing import Sensor
from smsid.simulate.trajectory import States

STEP = 1e-6


@pytest.fixture(scope="module", params=["as described", "drawn in", "one mode more"])
def place(known, problem, request):
    """A state; with ``drawn in`` the panel shortens as it bends, and its accelerometers see that; with ``one
    mode more`` they see that, too.
    """
    point = known.point
    if request.param != "as described":
        point = point.with_effect(GeometricStiffness(name="soft", appendage="panel", factor=0.7))
    if request.param == "one mode more":
        point = point.with_effect(BeamMode(name="more", appendage="panel", mode=4, factor=0.8))
    model, rng = point.model(), np.random.default_rng(0)
    q = pin.integrate(model.pin, model.home, 0.2 * rng.standard_normal(model.nv))
    return MeasurementModel(model, problem.data), q, *(0.2 * rng.standard_normal((2, model.nv)))


def test_one_sample_reads_what_the_simulator_reads(place):
    outputs, q, v, a = place
    nothing = np.zeros((1, len(v)))
    states = States(np.zeros(1), q[None], v[None], a[None], nothing, nothing)
    np.testing.assert_allclose(outputs.predict(q, v, a)[0], outputs.all(states)[0], atol=1e-13)


@pytest.mark.parametrize("by", ["q", "v", "a"])
def test_derivatives_are_those_of_central_differences(place, by):
    outputs, q, v, a = place
    model = outputs.model.pin

    def reading(step):
        if by == "q":
            return outputs.predict(pin.integrate(model, q, step), v, a)[0]
        return outputs.predict(q, v + step, a)[0] if by == "v" else outputs.predict(q, v, a + step)[0]

    found = dict(zip("qva", outputs.predict(q, v, a)[1:], strict=True))[by]
    steps = STEP * np.eye(len(v))
    expected = np.stack([(reading(s) - reading(-s)) / (2 * STEP) for s in steps], axis=1)
    rows = [i for i, name in enumerate(outputs.data.names) if "attitude" not in name]
    np.testing.assert_allclose(found[rows], expected[rows], atol=2e-9)


@pytest.mark.parametrize("locked", [False, True])
def test_encoder_sees_a_gear_that_gives_at_once(known, problem, locked):
    """The twist of what the rotor hands on; all else is left behind by what the rotor takes along."""
    gear = GearCompliance(name="g", joint="joint2", compliance=1e-3, motor_inertia=0.5, quasistatic=True)
    model = known.point.with_effect(gear).model()
    rng = np.random.default_rng(3)
    q, v, (tau, a) = model.home, np.zeros(model.nv), rng.standard_normal((2, model.nv))
    k, held = int(model.arm_joints.v[1]), model.arm_joints.v[:1]
    h = np.zeros(problem.data.rows)
    MeasurementModel(model, problem.data, held if locked else None).twisted(h, 0.0, q, v, tau, a)
    rows = next(b.rows for b in problem.data.blocks if b.channel == "encoder.joint_position")
    twist = 1e-3 * (tau[k] - 0.5 * a[k])
    free = [i for i in range(model.nv) if not (locked and i in held)]
    mass = pin.crba(model.pin, model.pin.createData(), q)
    mass = np.triu(mass) + np.triu(mass, 1).T
    behind = np.zeros(model.nv)
    behind[free] = np.linalg.inv(mass[np.ix_(free, free)])[:, free.index(k)] * 0.5 * twist
    expected = np.zeros(problem.data.rows)
    expected[rows] = -behind[model.arm_joints.v]
    expected[rows.start + 1] += twist
    assert abs(behind[k]) > 1e-3 * abs(twist)
    np.testing.assert_allclose(h, expected, rtol=1e-12, atol=1e-18)


def test_a_welded_arm_reads_its_encoder_beside_sensors_of_a_bus_it_does_not_have(tmp_path):
    """One joint: there are fewer columns than a free bus has coordinates."""
    (tmp_path / "one.urdf").write_text(
        '<robot name="one"><link name="base"/><link name="hand"><inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="wrist" type="revolute"><parent link="base"/><child link="hand"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    sensors = tuple(Sensor(name=k, kind=k, rate=10.0) for k in ("imu", "pose", "encoder"))
    (tmp_path / "one.toml").write_text(
        'schema = 1\nname = "one"\nurdf = "one.urdf"\nroot = "fixed"\n'
        '[[arm]]\nname = "arm"\njoints = ["wrist"]\n'
    )
    model = build_model(load_description(tmp_path / "one.toml").with_sensors(*sensors))
    rng, times = np.random.default_rng(1), np.arange(20) / 10.0
    still = np.tile([0.0, 0.0, 0.0, 1.0], (20, 1))
    channels = {"imu.angular_rate": (20, 3), "imu.acceleration": (20, 3), "encoder.joint_position": (20, 1)}
    arrays = {name: rng.normal(size=shape) for name, shape in channels.items()}
    recording = Recording.from_arrays(times, arrays | {"pose.attitude": still}, labels={"joint": ("wrist",)})
    outputs = MeasurementModel(model, measurements_of(model, recording, sensors))
    h, by_q, by_v, by_a = outputs.predict(np.array([0.3]), np.array([0.1]), np.array([0.2]))
    (encoder,) = (b for b in outputs.data.blocks if b.quantity == "joint_position")
    np.testing.assert_allclose(h[encoder.rows], 0.3)
    assert by_q.sum() == by_q[encoder.rows].sum() == 1.0
    assert not by_v.any() and not by_a.any()
