"""The gain where a sensor is faulty on the validation flight, too: its faulty samples are the fault's."""

import numpy as np
import pytest

from smsid.diagnose._sensor_faults import Fault
from smsid.diagnose.validation import Gain, gain

CHANNEL, AXIS = "imu.angular_rate", 1
COMPONENT = f"{CHANNEL}[y]"


def stuck(values, rng):
    values[200:400, AXIS] = values[200, AXIS]


def wild(values, rng):
    hit = rng.choice(np.arange(50, len(values) - 50), 12, replace=False)
    values[hit, AXIS] += 4e-4


@pytest.mark.parametrize(("kind", "spoil"), [("stuck", stuck), ("outliers", wild)])
def test_what_a_fault_spoils_is_explained_by_it(kind, spoil, known, problem, recording):
    values = np.array(recording[CHANNEL])
    spoil(values, np.random.default_rng(1))
    spoiled = recording.with_channels({CHANNEL: values})
    points = (known.point,) * 3
    fault = Fault(kind, CHANNEL, COMPONENT, 0.0, 1.0, np.zeros(0, dtype=bool))
    blind = gain(*points, spoiled, problem, 100.0)
    seeing = gain(*points, spoiled, problem, 100.0, [fault])
    elsewhere = gain(
        *points, spoiled, problem, 100.0, [Fault(kind, CHANNEL, f"{CHANNEL}[x]", 0.0, 1.0, fault.samples)]
    )
    assert blind.excess_given == seeing.excess_given > 30.0 * np.sqrt(2.0 * blind.samples)
    assert blind.explained == pytest.approx(0.0, abs=1e-9) == elsewhere.explained
    assert seeing.explained > 0.97


@pytest.mark.parametrize(
    ("given", "extended", "extends", "said"),
    [
        (4000.0, 400.0, True, "explains 90 %"),
        (4000.0, 8000.0, True, "worse than the model as given: off by 3 times the noise instead of 2 times"),
        (4000.0, 8000.0, False, "nothing is extended"),
        (1.0, 400.0, True, "nothing to gain"),
    ],
)
def test_a_gain_is_said_in_words_and_never_as_a_negative_share(given, extended, extends, said):
    found = Gain("held", 1000, 2.0, 2.5, 3.0, given, 500.0, extended, ())
    words = found.in_words(extends=extends)
    assert said in words
    assert "-" not in words.replace("held-out", "").replace("chi-squared", "")
