"""Columns that agree with each other and not with the craft: exchanged, or with the other sign."""

import numpy as np
import pytest

from smsid.estimation._mapping_check import wrong_columns
from smsid.estimation.flight import flight_of
from smsid.estimation.parameter_vector import Point
from smsid.recording import Recording
from tests.estimation.satellite import Satellite, burns_and_wheels, guess, recorded

TRUTH = Satellite()


@pytest.fixture(scope="module")
def described(tmp_path_factory):
    return guess(tmp_path_factory.mktemp("satellite"), TRUTH, off=0.02)


@pytest.fixture(scope="module")
def flown():
    return recorded(TRUTH, TRUTH.fly(90.0, burns_and_wheels), np.random.default_rng(3), every=10)


def test_a_recording_as_it_is_has_none(described, flown):
    assert not wrong_columns(described, [flown])


@pytest.mark.parametrize(
    ("columns", "signs", "words"),
    [
        ([1, 0, 2], [1.0, 1.0, 1.0], "'command.force.x' and 'command.force.y' seem to be exchanged"),
        ([0, 1, 2], [1.0, -1.0, 1.0], "'command.force.y' seems to have the other sign"),
        ([0, 1, 2], [-1.0, -1.0, -1.0], "all of command.force.x, command.force.y, command.force.z seem"),
    ],
)
def test_axes_of_thrust_are_named(columns, signs, words, described, flown):
    wrong = flown.with_channels({"command.force": (np.asarray(flown["command.force"]) * signs)[:, columns]})
    (said,) = wrong_columns(described, [wrong])
    assert words in said


def test_no_column_is_blamed_where_the_motion_is_not_followed_with_it_mended_either(described, flown):
    """Recorded is one force all along: exchanged axes of it left a seventh of the errors, far too much."""
    burns = flown.window(0.0, 40.0)
    force = np.tile([4.0, 1.0, 0.0], (len(np.asarray(burns["command.force"])), 1))
    assert not wrong_columns(described, [burns.with_channels({"command.force": force})])


def test_wheels_that_have_each_others_names_are_named_in_any_order_of_columns(described, flown):
    """Their torques and rates agree: only parameters that are fitted leave the one and not the other."""
    order = [2, 1, 0]
    channels = {n: np.asarray(flown[n]) for n in flown.channels}
    channels |= {n: channels[n][:, order] for n in ("tacho.wheel_rate", "command.wheel_torque")}
    labels = [("rw2", "rw1", "rw3")[k] for k in order]
    wrong = Recording.from_arrays(flown.time(), channels, labels={"wheel": labels}, name="flight")
    wrong = wrong.window(50.0, 90.0)  # wheels alone
    (said,) = wrong_columns(described, [wrong])
    assert "'rw1' and 'rw2' seem to be exchanged" in said


def test_a_wheel_that_is_driven_and_does_not_turn_is_doubtful(described, flown):
    rate = np.array(flown["tacho.wheel_rate"])
    rate[:, 1] = rate[0, 1]
    flight = flight_of(Point.of(described), flown.with_channels({"tacho.wheel_rate": rate}), "flight")
    doubts = [n for n in flight.notes if n.startswith("doubtful")]
    assert len(doubts) == 1 and "'rw2' stands still while command.wheel_torque drives it" in doubts[0]
    as_it_was = flight_of(Point.of(described), flown, "flight")
    assert not [n for n in as_it_was.notes if n.startswith("doubtful")]
