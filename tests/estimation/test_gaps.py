"""Gaps in a recording whose wheels follow their measured motion: pieces, one estimate."""

import numpy as np
import pytest

from smsid.estimation.hidden_states import hidden_states
from smsid.estimation.identify_flights import identify_flights
from smsid.recording import Recording
from tests.tracking.craft import INERTIA, craft, flight, true_inertia


def cut(recording, gaps):
    """Return a recording without what lies in gaps (begin, end) [s]."""
    t = recording.time()
    there = np.ones(len(t), dtype=bool)
    for begin, end in gaps:
        there &= ~((t > begin) & (t < end - 1e-6))
    channels = {c: np.asarray(recording[c])[there] for c in recording.channels}
    return Recording.from_arrays(t[there], channels, labels=recording.labels, name="cut")


@pytest.fixture(scope="module")
def described(tmp_path_factory):
    return craft(tmp_path_factory.mktemp("craft"))


@pytest.fixture(scope="module")
def whole():
    return flight(40.0)


@pytest.fixture(scope="module")
def full(described, whole):
    """What is found without any gap."""
    return identify_flights(described, [whole], cad=0.2).estimate


@pytest.mark.parametrize(
    "gaps",
    [
        pytest.param(((15.0, 24.0),), marks=pytest.mark.slow),
        ((9.0, 14.0), (20.0, 25.0), (31.0, 36.0)),
    ],
)
def test_what_wheels_did_in_a_gap_teaches_nothing(described, whole, full, gaps):
    """Carried on as it was before 5 s of it, their torque put inertias 8 sigma off, "explained and white"."""
    found = identify_flights(described, [cut(whole, gaps)], cad=0.2)
    names = [n.replace(".I", ".Ic") for n in INERTIA]
    sigma = np.array([found.estimate[n].sigma for n in names])
    off = (np.array([found.estimate[n].value for n in names]) - true_inertia()) / sigma
    assert np.abs(off).max() < 3.2, off
    assert found.quality.judgement == "explained" and not found.contradictions
    assert (sigma > np.array([full[n].sigma for n in names])).all()
    assert found.estimate.recordings == ("cut",)
    assert sum(f"between {len(gaps)} gaps" in n for n in found.estimate.notes) == 1
    assert len({c.channel for c in found.quality.channels}) == len(found.quality.channels)


def test_hidden_states_of_the_pieces_are_one_recording(tmp_path):
    """Biases of the gyro, constant over a recording: they are shared by its pieces."""
    found = identify_flights(craft(tmp_path), [cut(flight(30.0), [(12.0, 17.0)])], cad=0.2)
    biases = [p.name for p in found.estimate.parameters if ".bias." in p.name]
    assert len(biases) == len(set(biases)) == 3
    hidden = hidden_states(found, parameters=False)
    time = hidden.time(hidden.channels[0])
    assert time[0] < 12.0 and time[-1] > 29.0 and (np.diff(time) > 0.0).all()
    assert np.diff(time).max() > 4.9
