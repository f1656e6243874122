"""What a description states of its sensors' errors is taken into account, whichever term it is."""

import numpy as np
import pytest
from scipy.stats import chi2

from smsid.errors import RecordingError
from smsid.estimation import kalman
from smsid.estimation._differences import DERIVATIVE_TOLERANCE, difference_equations
from smsid.estimation._smoother import predicted_covariances
from smsid.estimation.flight import flight_of
from smsid.estimation.gaps import pieces_of
from smsid.estimation.identify import identify_spacecraft
from smsid.estimation.identify_flights import identify_flights
from smsid.estimation.kalman import KalmanFilter
from smsid.estimation.measurements import _block, measurements_of
from smsid.estimation.parameter_vector import Point
from smsid.model import build_model
from smsid.recording import Recording
from smsid.sensing import Sensor, observe
from smsid.sensing.component import ComponentError
from smsid.sensing.error_model import GAUSS_MARKOV_ALLAN_PEAK, ErrorModel
from smsid.simulate import Inputs, Sampled, simulate, truth_of
from smsid.tracking import Tracker
from smsid.tracking._sample import samples_of
from smsid.tracking.followed_parameters import followed_parameters
from tests.estimation.satellite import Satellite, guess, recorded, true_values
from tests.identify.support import paper

RIGID = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))
WALK = 3e-5  # [rad/s/sqrt(s)]


def driven(t):
    """Thrust, torques and wheels together, held between samples."""
    t = 0.1 * np.floor(10.0 * t + 1e-6)
    force = np.zeros(3)
    force[int(t // 5.0) % 3] = 2.0 if int(t // 15.0) % 2 == 0 else -2.0
    torque = 0.05 * np.sin(2 * np.pi * np.array([0.04, 0.06, 0.09]) * t + [0, 1, 2])
    return force, torque, 0.1 * np.sin(2 * np.pi * np.array([0.05, 0.083, 0.031]) * t)


@pytest.fixture(scope="module")
def flown():
    return RIGID.fly(30.0, driven)


def stated(folder, off=0.1, **errors):
    """Return the first guess; more terms of sensors' errors by ``<sensor>__<quantity>``."""
    description = guess(folder, RIGID, off=off, tank=False, panel=False)
    sensors = []
    for sensor in description.sensor:
        for quantity in sensor.quantities:
            more = errors.get(f"{sensor.name}__{quantity}", {})
            changed = {**sensor.errors, quantity: sensor.error(quantity).model_copy(update=more)}
            sensor = sensor.model_copy(update={"errors": changed})
        sensors.append(sensor)
    return description.with_sensors(*sensors)


def spoilt(flown, seed, channel, error):
    """Return a recording, one of whose channels has an error more."""
    rng = np.random.default_rng([seed, 5])
    recording = recorded(RIGID, flown, rng).with_provenance({"inputs": "held", "acceleration": "right"})
    values = error.apply(recording.time(), recording[channel], rng, attitude=channel.endswith("attitude"))
    return recording.with_channels({channel: values})


def deviations(found):
    """Return deviations of what is identifiable from the truth, in their standard deviations."""
    truth = true_values(RIGID, tank=False, panel=False)
    own = {p.name: p for p in found.estimate.parameters if p.name in truth and p.status == "identifiable"}
    return {name: (p.value - truth[name]) / p.sigma for name, p in own.items()}


CASES = {
    "walk of a gyro": ("gyro.angular_rate", {"random_walk": WALK}),
    "in-run bias of a gyro": (
        "gyro.angular_rate",
        {"bias_instability": GAUSS_MARKOV_ALLAN_PEAK * 2e-4, "bias_correlation_time": 60.0},
    ),
    "fast in-run bias of a gyro": (
        "gyro.angular_rate",
        {"bias_instability": GAUSS_MARKOV_ALLAN_PEAK * 3e-5, "bias_correlation_time": 0.5},
    ),
    "scale of a gyro": ("gyro.angular_rate", {"scale_sigma": 0.02}),
    "misalignment of a gyro": ("gyro.angular_rate", {"misalignment_sigma": 0.02}),
    "scale of tachometers": ("tacho.wheel_rate", {"scale_sigma": 0.03}),
    "bias of tachometers": ("tacho.wheel_rate", {"bias_sigma": 1.0}),
    "misalignment of a star tracker": ("st.attitude", {"misalignment_sigma": 0.02}),
    "outliers of a gyro": ("gyro.angular_rate", {"outlier_rate": 0.1, "outlier_size": 4e-5}),
}


@pytest.mark.parametrize("seeds", [[0], pytest.param([1, 2], marks=pytest.mark.slow)], ids=["one", "more"])
@pytest.mark.parametrize("case", CASES)
def test_an_error_that_is_stated_is_explained_and_intervals_hold(case, seeds, flown, tmp_path):
    """Chi square of some ten parameters; all were wrong or widened before."""
    channel, terms = CASES[case]
    description = stated(tmp_path, **{channel.replace(".", "__"): terms})
    squares, count = 0.0, 0
    for seed in seeds:
        found = identify_flights(description, [spoilt(flown, seed, channel, ErrorModel(**terms))])
        assert found.quality.judgement == "explained"
        assert found.quality.widening == 1.0
        z = np.array(list(deviations(found).values()))
        assert len(z) >= 9
        squares, count = squares + float(z @ z), count + len(z)
    assert squares / count < 2.5  # of 10 or 20 that go together


def test_a_walk_is_the_same_in_compiled_and_in_plain_code(flown, tmp_path, monkeypatch):
    point = Point.of(stated(tmp_path, gyro__angular_rate={"random_walk": WALK}))
    flight = flight_of(point, spoilt(flown, 0, "gyro.angular_rate", ErrorModel(random_walk=WALK)), "flight")
    compiled = KalmanFilter(point.model(), flight.problem).advance(60)
    monkeypatch.setattr(kalman, "compiled_model", lambda base: None)
    plain = KalmanFilter(point.model(), flight.problem).advance(60)
    np.testing.assert_allclose(compiled.innovations, plain.innovations, atol=1e-8)
    np.testing.assert_allclose(compiled.transition, plain.transition, atol=1e-9)


def test_curvatures_beside_a_walk_are_those_of_the_likelihood(flown, tmp_path):
    """Along the mean of the state: about the state without its bias, they were off by factors of two."""
    terms = {"random_walk": WALK, "scale_sigma": 0.01}
    recording = spoilt(flown, 0, "gyro.angular_rate", ErrorModel(**terms))
    result = identify_flights(stated(tmp_path, gyro__angular_rate=terms), [recording])
    exact = difference_equations(result.found, result.flights)
    both = [np.sqrt(np.diag(x.gram)) for x in (result.found, exact)]
    np.testing.assert_allclose(*both, rtol=0.02)
    np.testing.assert_allclose(result.found.slope / both[1], exact.slope / both[1], atol=DERIVATIVE_TOLERANCE)


def test_covariances_of_a_walk_are_those_of_the_filter_and_grow_over_gaps(flown, tmp_path):
    point = Point.of(stated(tmp_path, gyro__angular_rate={"random_walk": WALK}))
    recording = recorded(RIGID, flown, np.random.default_rng(0))
    flight = flight_of(point, recording, "flight")
    filtering = KalmanFilter(point.model(), flight.problem)
    first, walks = filtering.covariance, filtering.walks
    run = filtering.advance(200)
    cut = flight.problem.data.sigma**2
    whole = predicted_covariances(run, first, cut, filtering.input_noise, filtering.forces.walk, walks.rates)
    own = filtering.covariance
    after = KalmanFilter(point.model(), flight.problem)
    after.advance(199)
    np.testing.assert_allclose(whole[-1], after.covariance, atol=1e-6 * np.abs(own).max())
    kept = np.r_[0:100, 200:301]
    times = np.asarray(recording.time())[kept]
    parts = {c: np.asarray(recording[c])[kept] for c in recording.channels}
    gap = Recording.from_arrays(times, parts, labels=dict(recording.labels), name="gap")
    pieces = pieces_of(point, flight_of(point, gap, "gap"))
    assert [w.sigma for w in pieces[0].problem.bias_walks] == [0.0] * 3
    assert pieces[1].problem.bias_walks[0].sigma == pytest.approx(WALK * np.sqrt(20.0))


def test_what_is_saturated_or_stuck_is_no_reading(flown, tmp_path):
    """It was read as it is, where the description says that it is none."""
    recording = recorded(RIGID, flown, np.random.default_rng(0))
    rate, wheels = np.array(recording["gyro.angular_rate"]), np.array(recording["tacho.wheel_rate"])
    limit = 0.5 * float(np.abs(rate).max())
    clipped = recording.with_channels({"gyro.angular_rate": np.clip(rate, -limit, limit)})
    description = stated(
        tmp_path,
        gyro__angular_rate={"saturation": limit},
        tacho__wheel_rate={"components": {"1": ComponentError(stuck_from=10.0)}},
    )
    data = measurements_of(Point.of(description).base, clipped, description.effective_sensors())
    by_name = {b.channel: data.values[:, b.rows] for b in data.blocks}
    lost = np.isnan(by_name["gyro.angular_rate"])
    np.testing.assert_array_equal(lost, np.abs(rate) >= limit)
    stuck = np.isnan(by_name["tacho.wheel_rate"])
    assert stuck[:, 1].sum() == np.sum(data.times >= 10.0)
    assert not stuck[:, [0, 2]].any()
    assert len(wheels) == len(stuck)


@pytest.mark.parametrize("seed", range(5))
def test_a_block_reads_what_the_error_model_does_station_by_station(seed):
    rng = np.random.default_rng(seed)
    components = {
        key: ComponentError(bias=rng.normal(), scale_error=rng.normal() * 0.1, scale_slope=0.01)
        for key in ("1,2", "0,", "1", "2,0")
    }
    errors = ErrorModel(
        bias=tuple(rng.normal(size=3)),
        scale_error=0.02,
        misalignment=(0.1, -0.2, 0.05),
        components=components,
    )
    sensor = Sensor(
        name="a", kind="accelerometers", appendage="panel", rate=10.0, errors={"acceleration": errors}
    )
    ideal = rng.normal(size=(4, 3, 3))
    expected = errors.systematic(np.arange(4.0), ideal)
    block = _block(sensor, "acceleration", slice(0, 9), 3, ())
    np.testing.assert_allclose(block.read(ideal.reshape(4, 9)), expected.reshape(4, 9), atol=1e-12)


def test_steps_of_one_component_are_noise_of_that_component(flown, tmp_path):
    description = stated(tmp_path, tacho__wheel_rate={"components": {"2": ComponentError(quantisation=1.0)}})
    recording = recorded(RIGID, flown, np.random.default_rng(0))
    data = measurements_of(Point.of(description).base, recording, description.effective_sensors())
    rows = next(b.rows for b in data.blocks if b.channel == "tacho.wheel_rate")
    np.testing.assert_allclose(data.sigma[rows], [0.02, 0.02, np.hypot(0.02, 12**-0.5)])


def test_a_constant_channel_that_has_noise_by_its_description_is_named(flown, tmp_path):
    """`gyro.acceleration` constant: the search failed without naming it."""
    recording = recorded(RIGID, flown, np.random.default_rng(0))
    still = np.zeros_like(np.array(recording["gyro.acceleration"]))
    point = Point.of(stated(tmp_path))
    flight = flight_of(point, recording.with_channels({"gyro.acceleration": still}), "flight")
    assert any("doubtful: 'gyro.acceleration' repeats one value" in n for n in flight.notes)
    assert not any("repeats" in n for n in flight_of(point, recording, "flight").notes)


def test_a_tracker_follows_what_is_stated(tmp_path):
    description = stated(
        tmp_path,
        gyro__angular_rate={"random_walk": WALK, "misalignment_sigma": 0.01},
        tacho__wheel_rate={"bias_sigma": 0.5},
    )
    found = {f.name: f for f in followed_parameters(description).followed}
    assert found["gyro.angular_rate.bias.x"].rate >= WALK
    assert found["gyro.angular_rate.misalignment.z"].unknown.sigma == 0.01
    assert found["tacho.wheel_rate.bias.rw2"].unknown.sigma == 0.5


def test_the_paper_s_experiments_go_through_the_filter_where_only_that_knows_an_error(flown, tmp_path):
    description = stated(tmp_path, gyro__angular_rate={"random_walk": WALK})
    recording = spoilt(flown, 0, "gyro.angular_rate", ErrorModel(random_walk=WALK))
    found = identify_spacecraft(description, [recording])
    assert "random_walk of gyro.angular_rate is stated" in found.reason


def test_a_delay_that_is_stated_is_no_contradiction(flown, tmp_path):
    """`gyro` was refused for being later than the star tracker."""
    recording = spoilt(flown, 0, "gyro.angular_rate", ErrorModel(delay=0.5))
    with pytest.raises(RecordingError, match=r"is 0\.5\d? s later"):
        flight_of(Point.of(stated(tmp_path)), recording, "flight")
    point = Point.of(stated(tmp_path, gyro__angular_rate={"delay": 0.5}))
    assert not any("doubtful" in n for n in flight_of(point, recording, "flight").notes)


def test_a_tracker_reads_nothing_that_is_stuck(flown, tmp_path):
    recording = spoilt(flown, 0, "gyro.angular_rate", ErrorModel()).window(0.0, 6.0)
    description = stated(tmp_path, off=0.0, gyro__angular_rate={"stuck_from": 3.0})
    tracker = Tracker(description)
    updates = [*tracker.update_all(samples_of(recording)), *tracker.flush()]
    read = {u.time: any("gyro.angular_rate" in c for c in u.rows) for u in updates}
    assert all(seen == (t < 3.0) for t, seen in read.items())
    assert len(set(read.values())) == 2


def test_each_station_has_axes_of_its_own():
    """Accelerometers along a panel, each turned by itself: what is left is noise."""
    terms = {"misalignment_sigma": 0.03}
    whole = paper()  # its tank would cost a search of its own and tells nothing of the stations
    description = whole.model_copy(update={"effect": (whole.get_effect("panel"),)})
    sensors = [s.model_copy(update={"rate": 20.0}) for s in description.effective_sensors()]
    sensors = [
        s.model_copy(update={"errors": {"acceleration": s.error("acceleration").model_copy(update=terms)}})
        if s.kind == "accelerometers"
        else s
        for s in sensors
    ]
    description = description.with_sensors(*sensors)
    model = build_model(description)
    clock = np.arange(101) / 20.0
    pushed = np.column_stack([20.0 * np.sign(np.sin(w * clock + 0.1)) for w in (0.7, 0.9, 1.3)])
    turned = np.column_stack([0.5 * np.sin(w * clock) for w in (0.5, 0.8, 1.1)])
    inputs = {"force": pushed, "wheel_torque": turned}
    held = {n: Sampled.from_samples(clock, x, degree=0) for n, x in inputs.items()}
    motion = simulate(model, Inputs(**held), 5.0)
    recording = observe(
        truth_of(motion, sensors),
        sensors,
        start=0.0,
        stop=5.0,
        rng=np.random.default_rng(0),
        exact=["command.force", "command.wheel_torque"],
        labels={"wheel": model.wheels.names, "joint": model.arm_joints.names},
    )
    found = identify_flights(description, [recording], bodies=False)
    assert found.quality.judgement == "explained"
    assert found.quality.widening == 1.0
    turns = [p for p in found.estimate.parameters if "panel.acceleration.misalignment" in p.name]
    assert len(turns) == 9
    assert max(abs(p.value) for p in turns) > 0.03
    own = [p for p in found.estimate.parameters if p.status == "identifiable"]
    assert len(own) > 4
    z = np.array([(p.value - p.nominal) / p.sigma for p in own])
    assert z @ z < chi2.ppf(0.99, len(z))
