"""A sensor: kinds, presets with overrides, mounting."""

import json
import tomllib

import numpy as np
import pytest
import tomli_w
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from smsid.errors import DescriptionError, RecordingError
from smsid.sensing import MEASURES, ErrorModel, Sensor, preset_names


def rng(seed=0):
    return np.random.default_rng(seed)


@pytest.mark.parametrize("kind", MEASURES)
def test_a_sensor_measures_the_quantities_of_its_kind(kind):
    sensor = Sensor(name="s", kind=kind, rate=10, appendage="panel" if kind == "accelerometers" else None)
    assert sensor.quantities == MEASURES[kind]
    assert sensor.channels == tuple(f"s.{q}" for q in MEASURES[kind])
    assert all(sensor.error(q) == ErrorModel() for q in sensor.quantities)


def test_quantities_restrict():
    tracker = Sensor(name="star", kind="pose", rate=5, quantities=["attitude"])
    assert tracker.channels == ("star.attitude",)
    with pytest.raises(DescriptionError, match="does not measure position"):
        tracker.error("position")


def test_restricting_quantities_restricts_the_preset():
    sensor = Sensor(name="s", kind="pose", preset="reference", quantities=["attitude"])
    assert set(sensor.errors) == {"attitude"}


def test_explicit_keys_override_the_preset_key_by_key():
    plain = Sensor(name="imu", kind="imu", preset="stim300")
    changed = Sensor(
        name="imu",
        kind="imu",
        preset="stim300",
        rate=50.0,
        errors={"angular_rate": {"bias_sigma": 0.0, "delay": 0.01}},
    )
    assert changed.rate == 50.0
    assert changed.error("acceleration") == plain.error("acceleration")
    expected = plain.error("angular_rate").model_copy(update={"bias_sigma": 0.0, "delay": 0.01})
    assert changed.error("angular_rate") == expected


def test_one_kind_of_white_noise_displaces_the_other():
    model = Sensor(
        name="imu", kind="imu", preset="stim300", errors={"angular_rate": {"noise_sigma": 1e-5}}
    ).error("angular_rate")
    assert model.noise_sigma == 1e-5 and model.noise_density is None


def test_a_whole_error_model_replaces_that_of_the_preset():
    sensor = Sensor(name="imu", kind="imu", preset="stim300", errors={"angular_rate": ErrorModel(bias=1.0)})
    assert sensor.error("angular_rate") == ErrorModel(bias=1.0)


@pytest.mark.parametrize("name", preset_names())
def test_sensors_survive_json_and_toml(name):
    kind = next(k for k in MEASURES if name in preset_names(k))
    where = {"appendage": "panel", "stations": (0, 2)} if kind == "accelerometers" else {}
    sensor = Sensor(name="s", kind=kind, preset=name, position=(0.1, 0.2, 0.3), **where)
    assert Sensor(**json.loads(sensor.model_dump_json())) == sensor
    text = tomli_w.dumps(sensor.model_dump(mode="json", exclude_none=True))
    assert Sensor(**tomllib.loads(text)) == sensor


def test_stations_are_indices_or_distances():
    base = {"name": "p", "kind": "accelerometers", "rate": 100, "appendage": "panel"}
    indices, distances = Sensor(**base, stations=[0, 3]), Sensor(**base, stations=[1.0, 2.5])
    assert indices.stations == (0, 3) and all(type(s) is int for s in indices.stations)
    assert distances.stations == (1.0, 2.5) and all(type(s) is float for s in distances.stations)
    assert Sensor(**base).stations is None


@pytest.mark.parametrize(
    "fields",
    [
        {"kind": "imu"},
        {"kind": "imu", "rate": 0.0},
        {"kind": "gps", "rate": 1.0},
        {"kind": "imu", "rate": 1.0, "quantities": ["position"]},
        {"kind": "imu", "rate": 1.0, "quantities": ["acceleration", "acceleration"]},
        {"kind": "imu", "rate": 1.0, "errors": {"position": {}}},
        {"kind": "imu", "rate": 1.0, "errors": {"acceleration": {"nois": 1.0}}},
        {"kind": "imu", "rate": 1.0, "colour": "red"},
        {"kind": "imu", "rate": 1.0, "appendage": "panel"},
        {"kind": "imu", "rate": 1.0, "name": "imu.left"},
        {"kind": "imu", "rate": 1.0, "name": "truth"},
        {"kind": "accelerometers", "rate": 1.0},
        {"kind": "accelerometers", "rate": 1.0, "appendage": "panel", "stations": [1, 1]},
        {"kind": "accelerometers", "rate": 1.0, "appendage": "panel", "stations": [-1]},
        {"kind": "accelerometers", "rate": 1.0, "appendage": "panel", "stations": []},
        {"kind": "encoder", "rate": 1.0, "errors": {"joint_position": {"misalignment_sigma": 0.1}}},
        {"kind": "pose", "rate": 1.0, "errors": {"attitude": {"saturation": 0.1}}},
        {"kind": "pose", "rate": 1.0, "errors": {"attitude": {"quantisation": 0.5}}},
    ],
)
def test_what_does_not_fit_is_refused(fields):
    with pytest.raises(ValidationError):
        Sensor(**{"name": "s", **fields})


def test_sensors_are_frozen():
    with pytest.raises(ValidationError):
        Sensor(name="s", kind="imu", rate=1.0).rate = 2.0  # type: ignore[misc]


def test_errors_of_body_vectors_act_along_the_sensor_axes():
    """A sensor pitched by 90 deg has its z axis along the bus x axis: a bias on z shows on x."""
    sensor = Sensor(
        name="s",
        kind="imu",
        rate=10,
        orientation=(0.0, np.pi / 2, 0.0),
        errors={"acceleration": {"bias": (0, 0, 1)}},
    )
    assert np.allclose(sensor.rotation @ [0, 0, 1], [1, 0, 0])
    x = rng(1).normal(size=(5, 3))
    assert np.allclose(sensor.measure("acceleration", np.arange(5.0), x, rng()), x + np.array([1, 0, 0]))


def test_a_perfect_turned_sensor_reads_in_bus_axes():
    sensor = Sensor(name="s", kind="imu", rate=10, orientation=(0.3, -0.2, 1.0))
    x = rng(1).normal(size=(5, 3))
    assert np.allclose(sensor.measure("angular_rate", np.arange(5.0), x, rng()), x)


def test_attitude_errors_act_about_the_sensor_axes():
    turn = (0.2, 0.7, -0.4)
    tracker = Sensor(
        name="s", kind="pose", rate=10, orientation=turn, errors={"attitude": {"bias": (0.0, 0.0, 0.01)}}
    )
    body = Rotation.random(4, rng=rng(2))
    measured = tracker.measure("attitude", np.arange(4.0), body.as_quat(), rng())
    error = (body.inv() * Rotation.from_quat(measured)).as_rotvec()
    assert np.allclose(error, tracker.rotation @ [0, 0, 0.01])


def test_orientation_leaves_inertial_vectors_alone():
    tilted = Sensor(
        name="s", kind="pose", rate=10, orientation=(1, 1, 1), errors={"position": {"bias": (1, 0, 0)}}
    )
    assert np.allclose(tilted.measure("position", [0.0], np.zeros((1, 3)), rng()), [[1, 0, 0]])


@pytest.mark.parametrize(
    ("fields", "quantity", "shape"),
    [
        ({"kind": "imu"}, "acceleration", (5, 2, 3)),
        ({"kind": "pose"}, "attitude", (5, 3)),
        ({"kind": "encoder"}, "joint_position", (5,)),
        ({"kind": "accelerometers", "appendage": "p", "stations": [0, 1]}, "acceleration", (5, 3, 3)),
        ({"kind": "accelerometers", "appendage": "p"}, "acceleration", (5, 3)),
    ],
)
def test_shapes_are_checked(fields, quantity, shape):
    with pytest.raises(RecordingError, match="has shape"):
        Sensor(name="s", rate=1.0, **fields).measure(quantity, np.arange(5.0), np.zeros(shape), rng())


@pytest.mark.parametrize("name", ["command", "start"])
def test_names_that_mean_something_else_are_not_free(name):
    """``start.rate.x`` is how fast a recording begins."""
    with pytest.raises(ValueError, match=f"'{name}' is not free as the name of a sensor"):
        Sensor(name=name, kind="imu", rate=100.0)
