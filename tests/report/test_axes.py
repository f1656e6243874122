"""Axes: round ticks that can be told apart."""

import numpy as np
import pytest

from smsid.report.axes import Axis


@pytest.mark.parametrize("base", [1_700_000_000, 2_000_000])
def test_ticks_of_stamps_count_from_a_number_that_the_label_tells(base):
    axis = Axis.over("time [s]", [base + np.linspace(0.25, 20.25, 400)], room=0.0)
    labels = [text for _, text in axis.ticks]
    assert len(labels) == len(set(labels)) >= 3
    told = axis.label.removeprefix("time [s], from ").removesuffix(" on") if "from" in axis.label else "0"
    for value, text in axis.ticks:
        assert int(told) + float(text) == pytest.approx(value, abs=1e-6)
    assert axis.low == base + 0.25 and axis.high == base + 20.25


def test_an_axis_from_zero_keeps_its_label():
    axis = Axis.over("time [s]", [np.linspace(0.0, 20.0, 100)], room=0.0)
    assert axis.label == "time [s]"
    assert [text for _, text in axis.ticks] == ["0", "5", "10", "15", "20"]
