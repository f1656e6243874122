from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smsid.errors import RecordingError
from smsid.recording import QUANTITIES
from smsid.recording._units import convert

FACTORS = {
    ("deg", "rad"): np.pi / 180,
    ("deg/s", "rad/s"): np.pi / 180,
    ("°/s", "rad/s"): np.pi / 180,
    ("rpm", "rad/s"): np.pi / 30,
    ("turn/s", "rad/s"): 2 * np.pi,
    ("mrad/s", "rad/s"): 1e-3,
    ("g_0", "m/s^2"): 9.80665,
    ("mm/s**2", "m/s^2"): 1e-3,
    ("km", "m"): 1e3,
    ("ms", "s"): 1e-3,
    ("lbf ft", "N m"): 1.3558179483314004,
    ("mN*m", "N m"): 1e-3,
    ("g^0.5 mm", "kg^0.5 m"): 1e-3 * 1e-3**0.5,
}


@given(st.sampled_from(sorted(FACTORS)), st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=5))
def test_conversion_multiplies_by_the_factor(units, values):
    array = np.array(values)
    np.testing.assert_allclose(convert(array, *units, "x"), FACTORS[units] * array, rtol=1e-12, atol=1e-300)
    back = convert(convert(array, *units, "x"), *units[::-1], "x")
    np.testing.assert_allclose(back, array, rtol=1e-12, atol=1e-300)
    np.testing.assert_array_equal(array, values)


@pytest.mark.parametrize("unit", sorted({quantity.unit for quantity in QUANTITIES.values()}))
def test_units_of_the_catalogue_are_known_and_convert_to_themselves_exactly(unit):
    values = np.array([0.1, -3.3])
    np.testing.assert_array_equal(convert(values, unit, unit, "x"), values)


def test_offsets_are_honoured():
    assert convert(np.array([20.0]), "degC", "K", "x")[0] == pytest.approx(293.15)


@pytest.mark.parametrize(
    ("unit", "to"),
    [
        ("deg", "m/s^2"),
        ("Hz", "rad/s"),
        ("1/s", "rad/s"),
        ("1", "rad"),
        ("rad", "1"),
        ("N", "N m"),
        ("", "m"),
    ],
)
def test_other_dimensions_are_refused_and_an_angle_is_one(unit, to):
    with pytest.raises(RecordingError, match="cannot become") as caught:
        convert(np.ones(1), unit, to, "channel 'x'")
    assert "channel 'x'" in str(caught.value)


@pytest.mark.parametrize("unit", ["wibble", "m/", "m^^2", "3 +", "()", "__import__('os')", "m; s"])
def test_what_is_no_unit_is_refused(unit):
    with pytest.raises(RecordingError, match=r"is not a unit|cannot become"):
        convert(np.ones(1), unit, "m", "channel 'x'")
