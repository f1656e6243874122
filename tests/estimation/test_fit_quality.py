"""The verdict's sentence claims only what was tested."""

import math

import pytest

from smsid.estimation.fit_quality import ChannelFit, FitQuality


@pytest.mark.parametrize(("p", "white"), [(0.4, True), (math.nan, False)])
def test_whiteness_is_told_where_it_was_tested(p: float, white: bool) -> None:
    channel = ChannelFit("a", "gyro", "gyro[x]", 1.0, p, p, "explained")
    sentence = FitQuality((channel,), 1.0).sentence
    assert "the sensors' noise" in sentence
    assert ("white" in sentence) is white
