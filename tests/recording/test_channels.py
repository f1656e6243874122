from __future__ import annotations

import dataclasses

import pytest

from smsid.effects import catalogue
from smsid.errors import RecordingError
from smsid.recording import QUANTITIES, quantity_of
from smsid.recording.channels import SLIDING


@pytest.mark.parametrize(
    ("channel", "unit", "frame"),
    [
        ("imu.acceleration", "m/s^2", "body"),
        ("pose.position", "m", "inertial"),
        ("pose.attitude", "1", "body to inertial"),
        ("command.wheel_torque", "N m", "wheel axis"),
        ("truth.modal_velocity", "kg^0.5 m/s", "mode"),
    ],
)
def test_quantity_fixes_unit_and_frame(channel, unit, frame):
    quantity = quantity_of(channel)
    assert (quantity.unit, quantity.frame) == (unit, frame)


def test_unknown_quantity_is_refused_with_the_known_ones_and_the_closest():
    with pytest.raises(RecordingError) as caught:
        quantity_of("imu.acceleraton")
    assert "Did you mean 'imu.acceleration'?" in str(caught.value)
    assert set(caught.value.evidence["known"]) == set(QUANTITIES)
    assert all(name in str(caught.value) for name in QUANTITIES)


@pytest.mark.parametrize("name", ["", "imu", "imu.", ".acceleration", "."])
def test_malformed_name_is_refused(name):
    with pytest.raises(RecordingError, match="not a channel name"):
        quantity_of(name)


def test_every_unit_of_a_joint_that_turns_has_that_of_one_that_slides():
    fields = [f for effect in catalogue().values() if "joint" in effect.model_fields
              for f in effect.model_fields.values()]  # fmt: skip
    units = {f.json_schema_extra["unit"] for f in fields if isinstance(f.json_schema_extra, dict)}
    turning = {unit for unit in units if "rad" in unit or "N m" in unit}
    assert len(turning) > 8 and turning <= set(SLIDING)


def test_a_clock_is_no_channel():
    with pytest.raises(RecordingError, match="clock of 'imu'"):
        quantity_of("imu.time")


def test_extra_channel_needs_its_own_unit():
    with pytest.raises(RecordingError, match="has no unit"):
        quantity_of("extra.temperature")
    assert quantity_of("extra.temperature", unit="K").unit == "K"


def test_another_unit_than_the_catalogue_is_refused():
    with pytest.raises(RecordingError, match="not in 'deg/s'"):
        quantity_of("imu.angular_rate", unit="deg/s")


def test_quantities_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        quantity_of("imu.acceleration").unit = "g"  # type: ignore[misc]
    with pytest.raises(TypeError):
        QUANTITIES["new"] = quantity_of("imu.acceleration")  # type: ignore[index]


def test_shapes_read_like_the_design():
    assert quantity_of("panel.acceleration").shapes() == "(N, 3) or (N, station, 3)"
    assert quantity_of("encoder.joint_position").shapes() == "(N, joint)"
