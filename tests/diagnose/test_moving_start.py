"""Recordings that begin in the middle of a flight, the tank sloshing and the panel bent."""

import numpy as np
import pytest

from smsid.diagnose import diagnose
from smsid.diagnose.validation import read_like
from smsid.estimation.initial_state import InitialPrior
from smsid.estimation.kalman import first_state
from smsid.estimation.measurements import measurements_of
from smsid.estimation.moving_start import with_likely_start
from smsid.estimation.problem import CommandTiming, Problem, ProcessNoise
from smsid.recording import Recording

REST = ProcessNoise().hidden
BEGIN = 30.0  # [s]


@pytest.fixture(scope="module")
def whole(flown):
    return flown("exp1", 50.0, 0)


@pytest.fixture(scope="module")
def window(whole):
    keep = whole.time() >= BEGIN
    channels = {c: np.asarray(whole[c])[keep] for c in whole.channels if not c.startswith("truth")}
    return Recording.from_arrays(
        whole.time()[keep], channels, labels=whole.labels, role="estimation", name="window"
    )


def as_problem(known, recording, noise):
    base = known.point.base
    data = measurements_of(base, recording, known.point.description.effective_sensors()).thinned(10.0)
    return Problem(recording, data, np.array([], dtype=int), CommandTiming("linear", "right"), noise)


def test_the_tank_moves_where_the_window_begins(whole):
    first = int(np.searchsorted(whole.time(), BEGIN))
    assert np.abs(whole["truth.slosh_position"][first]).max() > 20.0 * REST[0]


@pytest.mark.parametrize("hidden", [REST, InitialPrior().hidden])
def test_how_it_begins_is_told_whatever_was_taken_before(known, whole, window, hidden):
    before = ProcessNoise(hidden=hidden)
    found = [with_likely_start(known.point, as_problem(known, r, before)) for r in (whole, window)]
    assert [p.noise.hidden for p in found] == [REST, InitialPrior().hidden]


def test_every_component_is_begun_where_it_is(known, whole, window):
    begun = with_likely_start(known.point, as_problem(known, window, ProcessNoise()))
    model, first = known.point.model(), int(np.searchsorted(whole.time(), BEGIN))
    q, v = first_state(model, begun)
    tank = model.pin.joints[model.pin.getJointId("tank")]
    assert (tank.nq, tank.nv) == (3, 3)
    places = slice(tank.idx_q, tank.idx_q + 3), slice(tank.idx_v, tank.idx_v + 3)
    np.testing.assert_allclose(q[places[0]], whole["truth.slosh_position"][first], atol=0.05)
    np.testing.assert_allclose(v[places[1]], whole["truth.slosh_velocity"][first], atol=0.02)


def test_a_window_of_a_flight_is_explained(description, window):
    """Begun at rest, no search came to rest in minutes."""
    found = diagnose(description, [window]).diagnosis
    assert found.verdict == "adequate", found.sentence
    assert found.whitened_rms["nominal"] == pytest.approx(1.0, abs=0.03)


def test_a_flight_held_out_begins_in_its_own_way(known, whole, window):
    rests = as_problem(known, whole, ProcessNoise())
    assert read_like(known.point, window, rests, 10.0)[1].noise.hidden == InitialPrior().hidden
    moves = as_problem(known, window, ProcessNoise(hidden=InitialPrior().hidden))
    assert read_like(known.point, whole, moves, 10.0)[1].noise.hidden == REST


def test_what_is_not_followed_either_way_tells_nothing_of_it(known, window):
    """A gyro that is off by a degree a second: the panel would begin bent by as much as that takes."""
    rate = np.asarray(window["imu.angular_rate"]) + 0.02
    off = as_problem(known, window.with_channels({"imu.angular_rate": rate}), ProcessNoise())
    assert with_likely_start(known.point, off).noise.hidden == REST
