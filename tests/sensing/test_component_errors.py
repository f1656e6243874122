"""Onsets, clocks, outliers, stuck channels, single components, and the part of the errors that repeats."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from smsid.errors import DescriptionError
from smsid.sensing import ErrorModel, Sensor, observe
from smsid.sensing.component import place_of

TIMES = np.arange(500) / 50.0


def wave(shape: tuple[int, ...] = (3,)) -> np.ndarray:
    return np.sin(np.multiply.outer(TIMES, np.linspace(0.5, 1.5, int(np.prod(shape))).reshape(shape)))


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_a_bias_begins_when_it_does() -> None:
    model = ErrorModel(bias=(0.1, 0.2, -0.3), bias_from=4.0)
    error = model.apply(TIMES, wave(), rng()) - wave()
    np.testing.assert_allclose(error, np.outer(TIMES >= 4.0, [0.1, 0.2, -0.3]), atol=1e-15)
    turn = Rotation.from_rotvec([0.0, 0.0, 0.1])
    still = np.tile([0.0, 0.0, 0.0, 1.0], (500, 1))
    turned = ErrorModel(bias=(0.0, 0.0, 0.1), bias_from=4.0).apply(TIMES, still, rng(), attitude=True)
    np.testing.assert_allclose(turned[199], still[0])
    np.testing.assert_allclose(turned[200], turn.as_quat())


@pytest.mark.parametrize("offset", [0.13, -0.07])
def test_a_clock_that_is_off_reads_another_time(offset: float) -> None:
    model = ErrorModel(time_offset=offset, delay=0.02)
    seen = np.clip(TIMES - offset - 0.02, TIMES[0], TIMES[-1])
    expected = np.sin(np.multiply.outer(seen, np.linspace(0.5, 1.5, 3)))
    np.testing.assert_allclose(model.apply(TIMES, wave(), rng()), expected, atol=1e-6)


def test_a_clock_ahead_asks_for_what_comes_after_the_end() -> None:
    asked: list[float] = []

    def truth(t: np.ndarray) -> dict[str, np.ndarray]:
        asked.append(t.max())
        return {"enc.joint_position": np.column_stack([t, 2 * t])}

    errors = {"joint_position": ErrorModel(time_offset=-0.5)}
    sensor = Sensor(name="enc", kind="encoder", rate=10.0, quantities=("joint_position",), errors=errors)
    found = observe(truth, [sensor], start=0.0, stop=2.0, rng=rng(), known_until=3.0)
    np.testing.assert_allclose(found["enc.joint_position"][:, 0], found.time() + 0.5)
    held = observe(truth, [sensor], start=0.0, stop=2.0, rng=rng())
    np.testing.assert_allclose(held["enc.joint_position"][-1, 0], 2.0)
    assert max(asked) == pytest.approx(2.5)


def test_outliers_have_the_stated_share_and_size() -> None:
    model = ErrorModel(outlier_rate=0.05, outlier_size=3.0)
    error = model.apply(np.arange(40_000) / 50.0, np.zeros((40_000, 3)), rng(5))
    hit = error != 0.0
    # binomial and chi-squared, four sigma
    assert abs(hit.mean() - 0.05) < 4 * np.sqrt(0.05 * 0.95 / error.size)
    assert abs(np.mean(error[hit] ** 2) / 9.0 - 1.0) < 4 * np.sqrt(2 / hit.sum())
    assert np.abs(np.corrcoef(error.T) - np.eye(3)).max() < 0.03


def test_outliers_leave_the_other_draws_alone_and_a_longer_recording_begins_the_same() -> None:
    noisy = ErrorModel(noise_sigma=0.1, bias_sigma=0.2)
    with_error = ErrorModel(noise_sigma=0.1, bias_sigma=0.2, outlier_rate=0.1, outlier_size=1.0)
    a, b = noisy.apply(TIMES, wave(), rng(3)), with_error.apply(TIMES, wave(), rng(3))
    assert 0.7 < np.mean(a == b) < 1.0
    np.testing.assert_array_equal(with_error.apply(TIMES[:100], wave()[:100], rng(3)), b[:100])


@settings(deadline=None)
@given(st.floats(-1.0, 11.0))
def test_a_stuck_channel_repeats_its_last_value(start: float) -> None:
    measured = ErrorModel(noise_sigma=0.1).apply(TIMES, wave(), rng(2))
    stuck = ErrorModel(noise_sigma=0.1, stuck_from=start).apply(TIMES, wave(), rng(2))
    last = max(np.count_nonzero(start > TIMES) - 1, 0)
    np.testing.assert_array_equal(stuck[: last + 1], measured[: last + 1])
    assert np.all(stuck[last:] == measured[last])


@pytest.mark.parametrize(
    ("key", "place"),
    [("1", np.s_[:, :, 1]), ("2,1", np.s_[:, 2, 1]), ("2,", np.s_[:, 2, :])],
)
def test_errors_of_components_stay_there(key: str, place) -> None:
    x = wave((4, 3))
    one = {"bias": 0.5, "scale_error": 0.1, "quantisation": 0.01, "bias_from": 2.0}
    found = ErrorModel.model_validate({"components": {key: one}}).apply(TIMES, x, rng())
    expected = x.copy()
    late = (TIMES >= 2.0).reshape(-1, *(1,) * (x[place].ndim - 1))
    expected[place] = np.round((1.1 * x[place] + 0.5 * late) / 0.01) * 0.01
    np.testing.assert_allclose(found, expected, atol=1e-14)
    stuck = ErrorModel.model_validate({"components": {key: {"stuck_from": 3.0}}}).apply(TIMES, x, rng())
    expected = x.copy()
    expected[150:][place] = x[149:150][place]
    np.testing.assert_array_equal(stuck, expected)
    hit = {"outlier_rate": 0.5, "outlier_size": 1.0}
    error = ErrorModel.model_validate({"components": {key: hit}}).apply(TIMES, x, rng(1)) - x
    inside = np.zeros(x.shape, dtype=bool)
    inside[place] = True
    assert np.all(error[~inside] == 0.0) and 0.4 < np.mean(error[inside] != 0.0) < 0.6


@pytest.mark.parametrize("key", ["3", "a", "", ",", "0,0", "-1", "1,2,3"])
def test_components_that_are_not_there_are_refused(key: str) -> None:
    with pytest.raises(DescriptionError, match="There is no component"):
        place_of(key, (10, 3))


def test_an_attitude_has_no_components() -> None:
    with pytest.raises(ValidationError, match="components has no meaning for an attitude"):
        Sensor.model_validate(
            {"name": "p", "kind": "pose", "rate": 1.0, "errors": {"attitude": {"components": {"1": {}}}}}
        )


FIXED = {
    "bias": (0.1, -0.2, 0.3), "bias_from": 3.0, "scale_error": (0.01, 0.02, 0.03),
    "misalignment": (0.1, 0.0, 0.2), "delay": 0.03, "time_offset": -0.01, "stuck_from": 8.0,
    "components": {"2": {"bias": 1.0, "stuck_from": 5.0}},
}  # fmt: skip


def test_the_systematic_part_is_what_noise_is_added_to() -> None:
    drawn = {"noise_sigma": 0.1, "bias_sigma": 1.0, "scale_sigma": 0.1, "misalignment_sigma": 0.1}
    limits = {"saturation": 0.01, "quantisation": 0.5, "outlier_rate": 0.1, "outlier_size": 1.0}
    exact = ErrorModel.model_validate(FIXED)
    found = ErrorModel.model_validate({**FIXED, **drawn, **limits}).systematic(TIMES, wave())
    np.testing.assert_array_equal(found, exact.systematic(TIMES, wave()))
    np.testing.assert_array_equal(found, exact.apply(TIMES, wave(), rng()))


def test_the_systematic_part_of_an_oriented_sensor_acts_along_its_axes() -> None:
    common = {"name": "imu", "kind": "imu", "rate": 50.0, "orientation": (0.3, -0.5, 1.1)}
    sensor = Sensor.model_validate({**common, "errors": {"acceleration": FIXED}})
    measured = sensor.measure("acceleration", TIMES, wave(), rng())
    np.testing.assert_array_equal(sensor.measure("acceleration", TIMES, wave(), None), measured)
    pose = Sensor.model_validate(
        {
            **common,
            "name": "st",
            "kind": "pose",
            "errors": {"attitude": {"misalignment": (0.1, 0.2, 0.0), "delay": 0.1}},
        }
    )
    turn = Rotation.from_rotvec(wave()).as_quat()
    np.testing.assert_allclose(
        pose.measure("attitude", TIMES, turn, None), pose.measure("attitude", TIMES, turn, rng()), atol=1e-15
    )


def test_axes_of_single_stations_are_turned() -> None:
    turns = np.array([[0.1, 0.0, 0.2], [0.1, -0.3, 0.2]])
    more = {"1,1": {"misalignment": -0.3}}
    model = ErrorModel.model_validate({"misalignment": (0.1, 0.0, 0.2), "components": more})
    x = wave((2, 3))
    expected = np.stack([Rotation.from_rotvec(t).inv().apply(x[:, k]) for k, t in enumerate(turns)], axis=1)
    np.testing.assert_allclose(model.apply(TIMES, x, rng()), expected, atol=1e-15)
    np.testing.assert_allclose(model.turns((len(TIMES), 2, 3)), turns)
    with pytest.raises(ValidationError, match="misalignment has no meaning"):
        Sensor.model_validate(
            {
                "name": "e",
                "kind": "encoder",
                "rate": 1.0,
                "errors": {"joint_position": {"components": {"1": {"misalignment": 0.1}}}},
            }
        )
