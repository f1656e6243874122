"""Effects on sensors: which error model they change, for which component, and what a flight records then."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from smsid.description import Arm, Description, load_description
from smsid.effects import (
    Effect,
    LeverArm,
    Outliers,
    Quantisation,
    SensorBias,
    SensorDelay,
    SensorMisalignment,
    SensorScale,
    StuckChannel,
    TimeOffset,
)
from smsid.errors import DescriptionError
from smsid.experiments import Experiment, fly
from smsid.model import build_model, rebuild
from smsid.sensing import ErrorModel, Sensor


@pytest.fixture(scope="module")
def paper(urdf: Path) -> Description:
    return load_description(urdf / "paper_sms.toml")


def sensor(description: Description, name: str, *effects: Effect) -> Sensor:
    found = description.with_effects(*effects).effective_sensors()
    return next(s for s in found if s.name == name)


def test_only_the_named_sensor_and_quantity_change(paper: Description) -> None:
    bias = SensorBias(name="b", sensor="imu", quantity="angular_rate", bias=(1e-3, 0.0, 2e-3), start=4.0)
    after = {s.name: s for s in paper.with_effects(bias).effective_sensors()}
    for before in paper.sensor:
        if before.name != "imu":
            assert after[before.name] is before
    assert after["imu"].error("acceleration") == sensor(paper, "imu").error("acceleration")
    error = after["imu"].error("angular_rate")
    assert error.bias == (1e-3, 0.0, 2e-3) and error.bias_from == 4.0
    assert error.noise_density == sensor(paper, "imu").error("angular_rate").noise_density


def test_biases_add_up_whenever_they_begin(paper: Description) -> None:
    def bias(name: str, value: float, start: float | None) -> SensorBias:
        return SensorBias(
            name=name, sensor="imu", quantity="acceleration", bias=(value, 2 * value, 0.0), start=start
        )

    times, still = np.arange(10.0), np.zeros((10, 3))
    three = [bias("a", 1.0, None), bias("b", 0.5, None), bias("c", 0.25, 5.0)]
    found = sensor(paper, "imu", *three).measure("acceleration", times, still, None)
    np.testing.assert_allclose(found[:, 1], np.where(times < 5.0, 3.0, 3.5))
    with pytest.raises(DescriptionError, match="another bias, that begins at another time"):
        sensor(paper, "imu", *three, bias("d", 0.1, 7.0))


@pytest.mark.parametrize(
    ("component", "quantity", "name", "column"),
    [
        ("joint3", "joint_position", "encoder", 2),
        (1, "joint_velocity", "encoder", 1),
        ("wheel_y", "wheel_rate", "tachometer", 1),
        ("z", "velocity", "pose", 2),
    ],
)
def test_components_by_name_or_number(paper: Description, component, quantity, name, column) -> None:
    times, still = np.arange(5.0), np.ones((5, 3))
    effects = (
        SensorBias(name="b", sensor=name, quantity=quantity, component=component, bias=0.5),
        SensorScale(name="s", sensor=name, quantity=quantity, component=component, error=0.1),
        StuckChannel(name="t", sensor=name, quantity=quantity, component=component, start=2.0),
    )
    found = sensor(paper, name, *effects).measure(quantity, times, still * times[:, None], None)
    expected = still * times[:, None]
    expected[:, column] = 1.1 * np.array([0, 1, 1, 1, 1]) + 0.5
    np.testing.assert_allclose(found, expected)


def test_joint_names_of_an_arm_that_lists_none_are_read_from_its_urdf(urdf: Path) -> None:
    encoder = Sensor(name="encoder", kind="encoder", rate=10.0)
    bias = SensorBias(
        name="b", sensor="encoder", quantity="joint_position", component="left/joint2", bias=0.1
    )
    arm = Arm(name="left", urdf="arm3.urdf")
    description = Description(
        name="x", urdf="bus.urdf", folder=urdf, arm=(arm,), sensor=(encoder,), effect=(bias,)
    )
    names = build_model(description).arm_joints.names
    assert list(description.effective_sensors()[0].error("joint_position").components) == [
        str(names.index("left/joint2"))
    ]


def test_one_accelerometer_of_the_panel(paper: Description) -> None:
    stuck = StuckChannel(name="s", sensor="panel", quantity="acceleration", station=1, start=2.0)
    found = sensor(paper, "panel", stuck).measure(
        "acceleration", np.arange(4.0), np.ones((4, 3, 3)) * np.arange(4.0)[:, None, None], None
    )
    np.testing.assert_array_equal(found[:, 1], np.array([0, 1, 1, 1])[:, None] * np.ones(3))
    np.testing.assert_array_equal(found[:, [0, 2]], np.arange(4.0)[:, None, None] * np.ones((2, 3)))


def test_misalignments_compose(paper: Description) -> None:
    turns = [(0.2, -0.1, 0.3), (-0.05, 0.4, 0.1)]
    effects = [
        SensorMisalignment(name=f"m{k}", sensor="imu", quantity="acceleration", angles=a)
        for k, a in enumerate(turns)
    ]
    x = np.random.default_rng(0).normal(size=(5, 3))
    found = sensor(paper, "imu", *effects).measure("acceleration", np.arange(5.0), x, None)
    both = Rotation.from_rotvec(turns[0]) * Rotation.from_rotvec(turns[1])
    np.testing.assert_allclose(found, both.inv().apply(x), atol=1e-12)


def test_what_does_not_fit_is_refused(paper: Description) -> None:
    with pytest.raises(DescriptionError, match="there is no sensor 'gyro'"):
        sensor(paper, "imu", TimeOffset(name="t", sensor="gyro", offset=0.1))
    with pytest.raises(DescriptionError, match="does not measure angular_rate"):
        sensor(paper, "pose", SensorDelay(name="d", sensor="pose", quantity="angular_rate", delay=0.1))
    with pytest.raises(DescriptionError, match="no component 'joint9'"):
        sensor(
            paper,
            "encoder",
            Quantisation(name="q", sensor="encoder", quantity="joint_position", component="joint9", step=1.0),
        )
    with pytest.raises(DescriptionError, match="has no lever arm"):
        sensor(paper, "encoder", LeverArm(name="l", sensor="encoder", offset=(1, 0, 0)))
    with pytest.raises(DescriptionError, match="has outliers already"):
        hit = {"sensor": "imu", "quantity": "acceleration", "share": 0.1, "size": 1.0}
        sensor(paper, "imu", Outliers(name="a", **hit), Outliers(name="b", **hit))
    with pytest.raises(ValidationError, match="`bias` of a single component is one number"):
        SensorBias(name="b", sensor="imu", quantity="acceleration", component="x", bias=(1, 2, 3))
    with pytest.raises(ValidationError, match="name the `component`"):
        SensorScale(name="b", sensor="encoder", quantity="joint_position", error=0.1)
    with pytest.raises(ValidationError, match="`quantity` is one of"):
        SensorScale(name="b", sensor="pose", quantity="attitude", error=(0.1, 0, 0))


def test_a_flight_records_what_the_effects_make_of_it(paper: Description) -> None:
    """Against the same flight without them: the same noise, another systematic part."""
    quiet = paper.with_sensors(*(s.model_copy(update={"errors": {}, "preset": None}) for s in paper.sensor))
    experiment = Experiment.model_validate(
        {
            "name": "short", "duration": 4.0,
            "joint_torque": {
                "kind": "fourier", "frequency": 0.25, "cos": [[0.5], [1.0], [0.5]],
                "sin": [[1.0], [2.0], [-1.0]],
            },
            "force": {"kind": "constant", "value": [5.0, 0.0, 3.0]},
        }
    )  # fmt: skip
    plain = build_model(quiet)
    offset, shift = np.array([0.2, -0.1, 0.3]), -0.25
    effects = (
        LeverArm(name="l", sensor="imu", offset=tuple(offset)),
        TimeOffset(name="t", sensor="pose", offset=shift),
        SensorBias(
            name="b", sensor="encoder", quantity="joint_position", component="joint2", bias=0.01, start=2.0
        ),
    )
    a = fly(plain, experiment, np.random.default_rng(0)).recording
    flight = fly(rebuild(plain, quiet.with_effects(*effects)), experiment, np.random.default_rng(0))
    b = flight.recording
    step = round(-shift * 100)  # the reference sensors run at 100 Hz
    np.testing.assert_allclose(b["pose.velocity"][:-step], a["pose.velocity"][step:], atol=1e-9)
    ahead = flight.trajectory.states(np.array([4.0 - shift]))
    turn = Rotation.from_quat(ahead.q[0, 3:7])
    np.testing.assert_allclose(
        b["pose.position"][-1], ahead.q[0, :3] + turn.apply(quiet.sensor[0].position), atol=1e-9
    )
    bias = b["encoder.joint_position"] - a["encoder.joint_position"]
    np.testing.assert_allclose(bias, np.outer(a.time() >= 2.0, [0.0, 0.01, 0.0]), atol=1e-9)
    omega = a["imu.angular_rate"]
    alpha = np.gradient(omega, a.time(), axis=0)
    expected = np.cross(alpha, offset) + np.cross(omega, np.cross(omega, offset))
    change = b["imu.acceleration"] - a["imu.acceleration"]
    np.testing.assert_allclose(change[1:-1], expected[1:-1], atol=2e-3 * np.abs(expected).max())
    assert a.time()[-1] == b.time()[-1] == pytest.approx(4.0)


def test_an_attitude_is_rounded_in_steps_of_its_quaternion(paper: Description) -> None:
    coarse = Quantisation(name="c", sensor="pose", quantity="attitude", step=0.01)
    assert [p.unit for p in coarse.parameters()] == ["1"]
    assert sensor(paper, "pose", coarse).error("attitude").quantisation == 0.01
    still = np.tile([0.1, -0.3, 0.2, 0.927], (5, 1))
    read = ErrorModel(quantisation=0.01).apply(np.arange(5.0), still, np.random.default_rng(1), attitude=True)
    whole = np.array([10.0, -30.0, 20.0, 93.0])
    np.testing.assert_allclose(read[0], whole / np.linalg.norm(whole), atol=1e-15)


@pytest.mark.parametrize("wrong", [{"component": "x"}, {"step": 0.5}])
def test_an_attitude_is_rounded_as_a_whole_and_finely(wrong) -> None:
    with pytest.raises(ValidationError):
        Quantisation.model_validate(
            {"name": "c", "sensor": "pose", "quantity": "attitude", "step": 0.01, **wrong}
        )
