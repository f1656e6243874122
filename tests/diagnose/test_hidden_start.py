"""Recordings that begin in the middle of a flight, the tank sloshing and the panel bent."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from smsid.diagnose import _hidden_start as hidden_start
from smsid.diagnose import diagnose
from smsid.diagnose._hidden_start import with_likely_start
from smsid.diagnose.validation import read_like
from smsid.effects import JointFriction, SensorBias
from smsid.estimation.initial_state import InitialPrior
from smsid.estimation.kalman import KalmanFilter, first_state
from smsid.estimation.map_estimate import evaluate, fit
from smsid.estimation.measurements import measurements_of
from smsid.estimation.moving_start import in_motion
from smsid.estimation.problem import CommandTiming, Problem, ProcessNoise
from smsid.experiments import fly, named_experiment
from smsid.model import build_model
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


def test_about_rest_each_coordinate_has_the_size_that_is_read(known, whole, window):
    """The tank's of decimetres, but never less than what is known of rest; a joint at home begins there."""
    problem = as_problem(known, window, ProcessNoise())
    found = {m.joint: m for m in hidden_start._about_rest(known.point, problem).moves}
    first = int(np.searchsorted(whole.time(), BEGIN))
    tank, model = found["tank"], known.point.model()
    np.testing.assert_allclose(tank.sigmas[:3], np.abs(whole["truth.slosh_position"][first]), atol=0.05)
    assert tank.at == tank.rate == (0.0, 0.0, 0.0)
    assert all(min(m.sigmas) >= min(REST) for m in found.values())
    sigma = np.sqrt(KalmanFilter(model, replace(problem, moves=tuple(found.values()))).covariance.diagonal())
    own = model.pin.joints[model.pin.getJointId("tank")].idx_v
    np.testing.assert_allclose(sigma[[own, model.nv + own]], [tank.sigmas[0], tank.sigmas[3]])


def test_a_window_of_a_flight_is_explained(description, window):
    """Begun at rest, no search came to rest in minutes."""
    found = diagnose(description, [window]).diagnosis
    assert found.verdict == "adequate", found.sentence
    assert found.whitened_rms["nominal"] == pytest.approx(1.0, abs=0.03)


@pytest.fixture(scope="module")
def gently(description):
    """Ten seconds of a flight with a tenth of the thrust: the tank begins 24 cm off, or at rest."""

    def begun(share, begin, seed):
        model = build_model(description)
        plan = named_experiment("exp1", model)
        values = tuple(tuple(share * x for x in v) for v in plan.force.values)
        changed = {"duration": begin + 10.0, "force": plan.force.model_copy(update={"values": values})}
        flight = fly(model, plan.model_copy(update=changed), np.random.default_rng(seed)).recording
        return flight.window(begin, begin + 10.0)

    return begun


@pytest.mark.parametrize("begin", [30.0, 0.0])
def test_a_start_near_rest_is_no_cause(description, gently, begin):
    """A tank 24 cm off its place, believed at rest, was a thermal snap; others were masses and gains."""
    window = gently(0.1, begin, 1)
    found = diagnose(description, [window]).diagnosis
    assert found.verdict == "adequate", found.sentence
    assert not found.causes


def test_a_cause_is_none_of_a_start(description, flown):
    """From rest, with a wheel's friction that nobody lists."""
    drag = JointFriction(name="drag", joint="wheel_x", viscous=2e-3)
    rubs = fly(
        build_model(description.with_effects(drag)),
        named_experiment("exp2", build_model(description)).model_copy(update={"duration": 10.0}),
        np.random.default_rng(2),
    ).recording
    found = diagnose(description, [rubs]).diagnosis
    assert [c.location for c in found.causes] == ["wheel_x"], found.sentence
    assert [c.family for c in found.causes] == ["friction"]


@pytest.mark.parametrize(
    ("there", "parameters", "rests"),
    [(-100.0, 7, True), (-104.0, 7, True), (-106.0, 7, False), (-101.0, 5, False)],
)
def test_rest_is_believed_unless_motion_is_clearly_likelier(monkeypatch, there, parameters, rests):
    """By more than 5; two parameters of causes beside a start at rest cost log(100) together."""
    monkeypatch.setattr(hidden_start, "_fitted_about_rest", lambda *_: SimpleNamespace(objective=there))

    def fitted(count):
        problem = SimpleNamespace(data=SimpleNamespace(times=range(100)))
        return SimpleNamespace(objective=-100.0, unknowns=(None,) * count, problem=problem)

    nominal = fitted(5)
    found = hidden_start.rest_is_likelier((nominal, fitted(7)), (nominal, fitted(parameters)))  # type: ignore[arg-type]
    assert found is rests


def test_a_held_out_window_begins_about_rest(known, gently):
    """After others that begin in motion; else it is taken for begun at rest."""
    window = gently(0.1, 30.0, 1)
    after = as_problem(known, window, ProcessNoise(hidden=InitialPrior().hidden))
    begun = [
        read_like(known.point, window, p, 10.0)[1] for p in (after, as_problem(known, window, ProcessNoise()))
    ]
    assert [bool(p.moves) for p in begun] == [True, False]


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


def test_the_start_is_sought_anew_beside_causes(known, whole, window):
    """Put a metre off by what the model lacked, the tank is found where it was beside what it lacked."""
    bias = SensorBias(name="off", sensor="imu", quantity="angular_rate", bias=(2e-4, 0.0, 0.0))
    rate = np.asarray(window["imu.angular_rate"]) + bias.bias
    problem = as_problem(known, window.with_channels({"imu.angular_rate": rate}), ProcessNoise())
    first = int(np.searchsorted(whole.time(), BEGIN))
    begun = in_motion(known.point.with_effect(bias), problem)
    moves = [m._replace(at=tuple(np.add(m.at, 1.0))) if m.joint == "tank" else m for m in begun.moves]
    begun = replace(begun, moves=tuple(moves))
    last = evaluate(known.point.with_effect(bias), known.unknowns, begun)
    again = hidden_start.start_beside_causes(last)
    assert again is not None
    (tank,) = (m for m in again.moves if m.joint == "tank")
    np.testing.assert_allclose(tank.at, whole["truth.slosh_position"][first], atol=0.05)
    there = fit(last.point, last.unknowns, again, iterations=6)
    assert hidden_start.start_beside_causes(there) is None  # it is where it was put
    rests = replace(problem, noise=ProcessNoise(hidden=REST))
    assert (
        hidden_start.start_beside_causes(replace(last, problem=rests)) is None
    )  # of a start at rest nothing
