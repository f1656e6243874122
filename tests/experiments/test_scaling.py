"""The named experiments fit the craft: its limits, size and inertia."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.description import Arm, Description, Wheel
from smsid.effects import BeamAppendage, Slosh
from smsid.errors import ExperimentError
from smsid.experiments import ConstantProfile, Experiment, fly, named_experiment
from smsid.experiments.fly import check_plausible
from smsid.experiments.scaling import bus_size, spin_inertias, thrust_strength
from smsid.model import build_model
from smsid.sensing.sensor import Sensor

SMALL = """<robot name="small">
<link name="bus"><inertial><mass value="6.9"/>
  <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="disc"><inertial><mass value="0.5"/>
  <inertia ixx="0.0006" iyy="0.0006" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="link"><inertial><origin xyz="0.2 0 0"/><mass value="0.5"/>
  <inertia ixx="0.001" iyy="0.005" izz="0.005" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="wheel" type="continuous"><parent link="bus"/><child link="disc"/><axis xyz="0 0 1"/></joint>
<joint name="elbow" type="revolute"><parent link="bus"/><child link="link"/><origin xyz="0.2 0 0"/>
  <axis xyz="0 0 1"/><limit lower="0.5" upper="2.5" effort="1" velocity="1"/></joint>
</robot>"""


def small(tmp_path, **more):
    (tmp_path / "small.urdf").write_text(SMALL)
    return Description(
        name="small",
        urdf="small.urdf",
        folder=tmp_path,
        wheel=(Wheel(name="spin", joint="wheel"),),
        arm=(Arm(name="arm", joints=("elbow",), home=more.pop("home", {"elbow": 1.0})),),
        sensor=(Sensor(name="imu", kind="imu", rate=10.0),),
        **more,
    )


@pytest.mark.parametrize(("limit", "expected"), [(0.1, 0.09), (1.0, 0.02 * 7.9), (None, 0.02 * 7.9)])
def test_thrust_keeps_to_limit_and_size(tmp_path, limit, expected):
    model = build_model(small(tmp_path, thrust={"max_force": limit}))
    plan = named_experiment("exp1", model)
    force = plan.inputs().force
    assert force is not None
    assert force(0.0) == pytest.approx([expected] * 3)
    assert ("max_force" if limit == 0.1 else "m/s^2") in plan.note
    assert thrust_strength(model)[0] <= (limit or np.inf)


def test_spin_inertia_of_a_joint_is_that_of_its_link(tmp_path):
    assert spin_inertias(build_model(small(tmp_path))) == pytest.approx([0.001])


def test_wheels_and_bus_stay_slow(tmp_path):
    model = build_model(small(tmp_path))
    flight = fly(model, named_experiment("exp2", model), np.random.default_rng(1))
    assert not flight.exceeded
    rates = {u.quantity: u.value for u in flight.limits}
    assert 20.0 < rates["rate of wheel"] < 400.0
    states = flight.trajectory.states(np.linspace(0, 80, 200))
    assert np.abs(states.v[:, 3:6]).max() < 1.0


def test_arm_starts_in_the_middle_where_home_is_beyond_limits(tmp_path, caplog):
    model = build_model(small(tmp_path, home={}))
    assert "'elbow': home 0 is outside 0.5 .. 2.5" in caplog.text and '"elbow" = 1.5' in caplog.text
    plan = named_experiment("exp2", model)
    assert plan.joints == pytest.approx((1.5,))
    assert "elbow starts at 1.5, the middle" in plan.note
    motion = plan.inputs().joint_motion
    assert motion is not None
    angles = np.array([motion.position(t)[0] for t in np.linspace(0, 80, 400)])
    assert angles.min() > 0.5 and angles.max() < 2.5 and np.ptp(angles) > 0.3


def test_size_of_the_bus_is_that_of_a_box(tmp_path):
    assert bus_size(build_model(small(tmp_path))) == pytest.approx(np.sqrt(6 * 0.1 / 6.9), rel=1e-9)


NOT_POSSIBLE = {
    "force": ({"force": (1e18, 0.0, 0.0)}, ["1e+18 N", "m/s^2", "30"]),
    "thrust": ({"force": (4.0, 0.0, 0.0)}, ["max_force = 1 N", "4 N", "3 N"]),
    "torque": ({"torque": (0.0, 0.0, 10.0)}, ["rad/s^2", "30"]),
    "wheel": ({"wheel_torque": (0.2,)}, ["wheel 'wheel'", "2000 rad/s", "1500 rad/s"]),
    "joint": ({"joint_torque": (1e4,)}, ["joint 'elbow'", "1e+04 rad/s^2"]),
}


@pytest.mark.parametrize("case", NOT_POSSIBLE)
def test_what_is_not_possible_is_refused_with_number_and_limit(tmp_path, case):
    commands, expected = NOT_POSSIBLE[case]
    model = build_model(small(tmp_path, thrust={"max_force": 1.0}))
    profiles = {key: ConstantProfile(value=value) for key, value in commands.items()}
    plan = Experiment(name="wild", duration=10.0, **profiles)
    with pytest.raises(ExperimentError) as caught:
        check_plausible(model, plan)
    for piece in expected:
        assert piece in str(caught.value)


def with_tank(tmp_path, stiffness, *more):
    tank = Slosh(name="tank", position=(0, 0, 0), mass=0.2, stiffness=[stiffness] * 3, damping=[0.001] * 3)
    return build_model(small(tmp_path, thrust={"max_force": 1.0}, effect=(tank, *more)))


def test_size_of_the_bus_leaves_panels_out(tmp_path):
    panel = BeamAppendage(
        name="panel", position=(0, 0.3, 0), length=2.0, width=0.5, thickness=0.002, density=500.0,
        youngs_modulus=70e9, damping=0.01, modes=1,
    )  # fmt: skip
    sizes = [bus_size(with_tank(tmp_path, 1.0, *more)) for more in ((), (panel,))]
    assert sizes == pytest.approx([np.sqrt(6 * 0.1 / 6.9)] * 2, rel=1e-9)


def test_slosh_far_out_of_the_bus_is_refused_and_a_little_is_told(tmp_path):
    """A push of 1 N on 8 kg for 6 s: free, the mass would be 2 m behind in a bus of 0.3 m."""
    plan = Experiment(name="push", duration=6.0, hold_attitude=True, force=ConstantProfile(value=(1, 0, 0)))
    with pytest.raises(ExperimentError, match=r"bus of 0.2949 m the stroke of tank reaches .* 1.769 m") as e:
        fly(with_tank(tmp_path, 1e-4), plan, np.random.default_rng(1))
    assert e.value.evidence["value"] == pytest.approx(0.5 * 36.0 / 7.9, rel=0.05)
    flight = fly(with_tank(tmp_path, 0.1), plan, np.random.default_rng(1))
    assert "stroke of tank" in [u.quantity for u in flight.exceeded]
