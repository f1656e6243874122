"""Faults of samples: found where they were put, and nowhere else."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from smsid.diagnose._noise_covariance import noise_factors
from smsid.diagnose._sensor_faults import inflate_for_quantisation, quantised_channels, stuck_channels
from smsid.sensing.error_model import ErrorModel
from tests.diagnose.test_attitude_rounding import rounded


@pytest.fixture
def data(problem):
    whole = problem.data
    return replace(whole, values=whole.values.copy(), sigma=whole.sigma.copy(), attitude=dict(whole.attitude))


def test_a_sound_recording_has_none(data):
    assert stuck_channels(data) == []
    assert quantised_channels(data) == []


def test_a_stuck_channel_is_found_with_its_time(data):
    row = data.names.index("imu.acceleration[y]")
    data.values[400:, row] = data.values[400, row]
    (fault,) = stuck_channels(data)
    assert fault.channel == "imu.acceleration"
    assert fault.component == "imu.acceleration[y]"
    assert fault.value == data.times[400]
    assert fault.samples[401:, row].all()
    assert fault.samples.sum() == len(data.times) - 401


def test_coarse_steps_are_found_with_their_size(data):
    row = data.names.index("imu.angular_rate[x]")
    data.values[:, row] = np.round(data.values[:, row] / 3e-5) * 3e-5
    (fault,) = quantised_channels(data)
    assert fault.component == "imu.angular_rate[x]"
    assert abs(fault.value - 3e-5) < 1e-9


def test_a_channel_without_rounding_is_stuck_after_a_few_repeats(data):
    """However far apart the closest two of its values happen to be."""
    row = data.names.index("encoder.joint_position[joint2]")
    data.values[:, row] = 0.1 * np.random.default_rng(6).uniform(size=len(data.times))
    data.sigma[row] = 5.0 * np.diff(np.unique(data.values[:, row])).min()
    data.values[300:306, row] = data.values[300, row]
    (fault,) = stuck_channels(data)
    assert fault.component == data.names[row] and fault.samples.sum() == 5


def test_few_repeats_are_a_fault_where_rounding_is_fine(data):
    row = data.names.index("imu.acceleration[y]")
    data.values[200:206, row] = data.values[200, row]
    (fault,) = stuck_channels(data)
    assert fault.component == "imu.acceleration[y]" and fault.samples.sum() == 5


def test_an_encoder_that_turns_round_is_not_stuck(data):
    """Between steps of its own noise's size it rests for some samples where its joint reverses."""
    row = data.names.index("encoder.joint_position[joint1]")
    step = data.sigma[row]
    t = data.times - data.times.mean()
    data.values[:, row] = np.round((0.01 * t + np.sign(t) * 0.02 * t**2) / step) * step
    data.values[:, row] = np.round(np.abs(data.values[:, row]) / step) * step
    assert not [f for f in stuck_channels(data) if f.component == "encoder.joint_position[joint1]"]


@pytest.mark.parametrize("rests", ["first", "first and last", "stuck"])
def test_what_rests_on_a_step_when_the_recording_begins_is_not_stuck(data, rests):
    """Nor is what rests at the end as well; what repeats itself for far longer is."""
    row = data.names.index("encoder.joint_position[joint1]")
    t = data.times - data.times[0]
    begins, ends = {"first": (0.15, 1.0), "first and last": (0.2, 0.75), "stuck": (0.05, 1.0)}[rests]
    moves = (t > begins * t[-1]) & (t < ends * t[-1])
    moved = 0.02 * np.clip(t - begins * t[-1], 0.0, (ends - begins) * t[-1]) + 3e-4 * np.sin(7.0 * t) * moves
    data.values[:, row] = np.round(moved / 1e-3) * 1e-3
    if rests == "stuck":
        data.values[-200:, row] = data.values[-201, row]
    found = [f for f in stuck_channels(data) if f.component == data.names[row]]
    assert len(found) == (rests == "stuck")
    assert all(f.value > data.times[-240] and f.doubtful for f in found)


def test_a_slow_component_on_the_grid_of_another_is_coarse_too_and_tells_once_what_lasts(data):
    rows = [data.names.index(f"imu.angular_rate[{axis}]") for axis in "xyz"]
    step, n = 0.01 * np.ptp(data.values[:, rows[0]]), len(data.times)
    data.values[:, rows[0]] = np.round(data.values[:, rows[0]] / step) * step
    data.values[:, rows[1]] = np.where(np.arange(n) < n // 2, 3.0, 4.0) * step
    found = quantised_channels(data)
    assert {f.component for f in found} == {"imu.angular_rate[x]", "imu.angular_rate[y]"}
    assert all(f.value == pytest.approx(step) for f in found)
    rough = inflate_for_quantisation(data, found)
    assert rough.sigma[rows[1]] == pytest.approx(step * np.sqrt(n / 2 / 12.0), rel=0.01)
    assert rough.sigma[rows[2]] == data.sigma[rows[2]]
    assert rough.coarse is not None and list(np.flatnonzero(rough.coarse)) == rows[:2]
    small = SimpleNamespace(
        normalised=1e-3 * np.random.default_rng(1).standard_normal(data.values.shape),
        used=np.isfinite(data.values),
    )
    factors = noise_factors(rough, small)
    assert factors[rows[2]] == pytest.approx(1e-3, rel=0.1)
    assert (factors[rows[:2]] == 1.0).all()
    every = replace(rough, coarse=np.ones(data.rows, dtype=bool))
    assert (noise_factors(every, small) == 1.0).all()


STEP = 4e-3  # of a quaternion's components, 40 times the attitude's noise


def test_a_rounded_attitude_is_found_with_its_step(data):
    """A turn of two steps is what its error is of; each reading lasts for some samples."""
    read = data.attitude["pose.attitude"] = rounded(data.attitude["pose.attitude"], STEP)
    found = quantised_channels(data)
    assert [f.component for f in found] == [f"pose.attitude[{axis}]" for axis in "xyz"]
    assert all(f.value == pytest.approx(STEP, abs=3.0 * f.sigma) and f.sigma < 1e-2 * STEP for f in found)
    row = data.names.index("pose.attitude[x]")
    lasts = len(read) / len(np.unique(np.cumsum((np.diff(read, axis=0, prepend=0.0) != 0.0).any(axis=1))))
    expected = np.hypot(data.sigma[row], 2.0 * STEP * np.sqrt(lasts / 12.0))
    assert inflate_for_quantisation(data, found).sigma[row] == pytest.approx(expected, rel=0.02)
    assert not [f for f in stuck_channels(data) if f.channel == "pose.attitude"]


def with_pose(data, **update):
    """The data with another pose sensor."""
    own = next(b.sensor for b in data.blocks if b.quantity == "attitude")
    others = [b.sensor for b in data.blocks if b.sensor.name != own.name]
    return data.with_blocks([own.model_copy(update=update), *others])


def test_an_attitude_with_a_stated_step_is_sound(data):
    data.attitude["pose.attitude"] = rounded(data.attitude["pose.attitude"], STEP)
    assert quantised_channels(with_pose(data, errors={"attitude": ErrorModel(quantisation=STEP)})) == []
    assert quantised_channels(with_pose(data, errors={"attitude": ErrorModel(quantisation=0.8 * STEP)}))


def test_an_attitude_is_rounded_in_the_axes_of_its_sensor(data):
    """Turned back to those of the bus, it is on no grid."""
    mount = Rotation.from_euler("xyz", (0.3, -0.2, 0.7))
    own = rounded((Rotation.from_quat(data.attitude["pose.attitude"]) * mount).as_quat(), STEP)
    data.attitude["pose.attitude"] = (Rotation.from_quat(own) * mount.inv()).as_quat()
    assert quantised_channels(data) == []
    found = quantised_channels(with_pose(data, orientation=(0.3, -0.2, 0.7)))
    assert len(found) == 3 and found[0].value == pytest.approx(STEP, abs=3.0 * found[0].sigma)
