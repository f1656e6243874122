"""Times of recordings, written so that they can be found."""

import pytest

from smsid._time_text import stamp_text, time_text


@pytest.mark.parametrize(
    ("time", "text"),
    [
        (0.0, "0"),
        (31.02, "31.02"),
        (1e-5, "1e-05"),
        (12345.678, "12345.678"),
        (1764000031.02, "1764000031.02"),
        (-1764000031.02, "-1764000031.02"),
        (1764000031020000000, "1764000031020000000"),
        (float("nan"), "nan"),
        (float("inf"), "inf"),
        (1e300, "1e+300"),
    ],
)
def test_a_stamp_has_the_digits_that_find_it(time, text):
    assert stamp_text(time) == text


def test_large_stamps_are_followed_by_the_time_since_the_start():
    assert time_text(1764000031.02, 1764000000.0) == "1764000031.02 s, 31.02 s after the start"
    assert time_text(31.02, 1.0) == "31.02 s"
    assert time_text(1764000031.02) == "1764000031.02 s"
