"""The gain where a sensor is faulty on the validation flight, too: its faulty samples are the fault's."""

import numpy as np
import pytest

from smsid.diagnose._sensor_faults import Fault
from smsid.diagnose.validation import gain

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
