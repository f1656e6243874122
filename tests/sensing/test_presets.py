"""The presets are complete, sourced, and what the data sheets say."""

import tomllib
from importlib import resources

import numpy as np
import pytest

from smsid.errors import DescriptionError
from smsid.sensing import MEASURES, Sensor, preset, preset_names

DEG = np.pi / 180.0
G = 9.80665
ALL = [(name, kind) for kind in MEASURES for name in preset_names(kind)]


def sensor(name, kind):
    return Sensor(name="s", kind=kind, preset=name, appendage="panel" if kind == "accelerometers" else None)


@pytest.mark.parametrize(("name", "kind"), ALL)
def test_every_preset_makes_a_sensor_with_errors_for_all_it_measures(name, kind):
    made = sensor(name, kind)
    assert made.rate > 0 and set(made.errors) == set(made.quantities)
    for quantity in made.quantities:
        assert np.any(made.error(quantity).white_sigma(made.rate) > 0)


def test_every_preset_has_a_source_that_says_how_far_it_was_checked():
    text = resources.files("smsid.sensing").joinpath("presets.toml").read_text(encoding="utf-8")
    for entry in tomllib.loads(text)["preset"]:
        assert len(entry["source"]) > 60
        told = any(word in entry["source"] for word in ("Seen", "Typical", "Assumed"))
        assert told or entry["name"] == "reference"


def test_every_kind_has_the_reference_set_and_a_real_one():
    assert all(len(preset_names(kind)) >= 2 and "reference" in preset_names(kind) for kind in MEASURES)
    assert set(preset_names()) == {name for name, _ in ALL}


def test_reference_set():
    """The numbers used in the project's studies."""
    expected = {
        "imu": {"acceleration": 1e-4, "angular_rate": 1e-5},
        "accelerometers": {"acceleration": 1e-4},
        "pose": {"position": 1e-3, "attitude": 1e-4, "velocity": 1e-3},
        "encoder": {"joint_position": 1e-5, "joint_velocity": 1e-4},
        "tachometer": {"wheel_rate": 1e-3},
    }
    for kind, sigmas in expected.items():
        made = sensor("reference", kind)
        assert made.rate == 100.0
        for quantity, sigma in sigmas.items():
            assert made.error(quantity).model_dump(exclude_defaults=True) == {"noise_sigma": sigma}


@pytest.mark.parametrize(
    ("name", "arw", "floor"), [("stim300", 0.15, 0.3), ("hg4930", 0.06, 0.45), ("hg9900", 0.002, None)]
)
def test_gyro_numbers_in_the_units_of_the_data_sheets(name, arw, floor):
    gyro = sensor(name, "imu").error("angular_rate")
    assert gyro.noise_density == pytest.approx(arw * DEG / 60.0, rel=1e-3)
    if floor is not None:
        assert gyro.bias_instability == pytest.approx(floor * DEG / 3600.0, rel=1e-3)


def test_accelerometer_and_encoder_numbers_in_the_units_of_the_data_sheets():
    assert sensor("stim300", "imu").error("acceleration").noise_density == pytest.approx(0.07 / 60, rel=1e-3)
    assert sensor("hg9900", "imu").error("acceleration").bias_sigma == pytest.approx(25e-6 * G, rel=1e-3)
    panel = sensor("sdi2210", "accelerometers").error("acceleration")
    assert panel.noise_density == pytest.approx(7e-6 * G / np.sqrt(2.0), rel=1e-3)
    count = sensor("resolute", "encoder").error("joint_position").quantisation
    assert count == pytest.approx(2 * np.pi / 2**26, rel=1e-6)


def test_star_tracker_measures_attitude_only_and_worst_about_its_boresight():
    tracker = sensor("astro-aps", "pose")
    assert tracker.quantities == ("attitude",)
    sigma = tracker.error("attitude").white_sigma(tracker.rate)
    assert sigma[2] == pytest.approx(8 * sigma[0], rel=1e-3)


def test_unknown_preset_names_the_closest():
    with pytest.raises(DescriptionError, match="stim300") as caught:
        preset("stim30")
    assert "Did you mean 'stim300'?" in str(caught.value)
    with pytest.raises(DescriptionError):
        Sensor(name="imu", kind="imu", preset="stim30")


def test_preset_for_another_kind_is_refused():
    with pytest.raises(DescriptionError, match="is for imu, not pose"):
        Sensor(name="p", kind="pose", preset="stim300")
    with pytest.raises(DescriptionError, match="kind is not given"):
        preset("reference")


def test_presets_hand_out_copies():
    preset("stim300")["errors"]["acceleration"]["bias"] = 1.0
    assert "bias" not in preset("stim300")["errors"]["acceleration"]
