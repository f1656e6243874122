"""Several recordings as one problem: sums of what each is by itself, with its own start, drive and biases."""

from dataclasses import replace

import numpy as np
import pytest

from smsid.description import load_description
from smsid.diagnose.priors import nominal
from smsid.effects import ExternalWrench, JointFriction
from smsid.errors import RecordingError
from smsid.estimation.input_hold import locked_coordinates
from smsid.estimation.joint_problem import at_point, joint_problem, on_one_clock, on_own_clock, thin_problem
from smsid.estimation.kalman import run_filter
from smsid.estimation.map_estimate import evaluate
from smsid.estimation.measurements import measurements_of
from smsid.estimation.problem import CommandTiming, Problem, ProcessNoise, recordings_of
from smsid.estimation.sensitivities import propagate
from smsid.experiments import fly, named_experiment
from smsid.model import build_model
from smsid.paths import urdf_folder

LABELS = ("a", "b")


@pytest.fixture(scope="module")
def described():
    """The paper's craft, its gyro with a bias that each recording draws anew."""
    found = load_description(urdf_folder() / "paper_sms.toml")

    def biased(sensor):
        if sensor.kind != "imu":
            return sensor
        error = sensor.error("angular_rate").model_copy(update={"bias_sigma": 1e-4})
        return sensor.model_copy(update={"errors": {**sensor.errors, "angular_rate": error}})

    return found.model_copy(update={"sensor": tuple(biased(s) for s in found.sensor)})


@pytest.fixture(scope="module")
def flown(described):
    """Thrust with the arm held, then torques of the arm: not the same commands, nor the same length."""
    model = build_model(described)
    usual = build_model(
        load_description(urdf_folder() / "paper_sms.toml")
    )  # its search is shared by all tests
    out = []
    for name, seconds, seed in (("exp1", 3.0, 3), ("exp2", 2.0, 4)):
        plan = named_experiment(name, usual).model_copy(update={"duration": seconds})
        out.append(fly(model, plan, np.random.default_rng(seed)).recording)
    return [out[0].without("command.joint_torque"), out[1]]


@pytest.fixture(scope="module")
def known(described):
    return nominal(described, None, LABELS[1:])


@pytest.fixture(scope="module")
def placed(flown):
    return on_one_clock(flown, LABELS)


@pytest.fixture(scope="module")
def alone(known, placed):
    sensors = known.point.description.effective_sensors()
    base = known.point.base
    return [
        Problem(
            p.recording, measurements_of(base, p.recording, sensors), locked_coordinates(base, p.recording),
            CommandTiming("linear"), ProcessNoise(), known.joint,
        )
        for p in placed
    ]  # fmt: skip


@pytest.fixture(scope="module")
def joint(alone, placed):
    return thin_problem(joint_problem(alone, placed), 25.0)


@pytest.fixture(scope="module")
def fitted(known, joint):
    return evaluate(known.point, known.unknowns, joint)


def own_problems(alone):
    return [replace(p, data=p.data.thinned(25.0)) for p in alone]


def test_log_likelihood_and_information_are_sums(known, alone, fitted):
    single = nominal(known.point.description, None)
    common = [i for i, u in enumerate(known.unknowns) if u.kind != "bias"]
    found = [evaluate(known.point, single.unknowns, p) for p in own_problems(alone)]
    assert fitted.run.log_likelihood == pytest.approx(sum(f.run.log_likelihood for f in found), rel=1e-12)
    assert fitted.run.samples == sum(f.run.samples for f in found)
    whole = fitted.whitened.reshape(-1, len(known.unknowns))[:, common]
    parts = [f.whitened.reshape(-1, len(single.unknowns))[:, common] for f in found]
    gram = sum(p.T @ p for p in parts)
    assert np.abs(whole.T @ whole - gram).max() < 1e-9 * np.abs(gram).max()


def test_each_recording_has_its_own_bias(known, joint, fitted):
    """Derivatives of the log-likelihood by the second recording's bias, by differences and along the run."""
    names = [u.name for u in known.unknowns if u.kind == "bias"]
    assert len(names) == 6 and sum(n.startswith("b: ") for n in names) == 3
    (i,) = [k for k, u in enumerate(known.unknowns) if u.name.startswith("b: ") and u.name.endswith(".z")]
    one = known.unknowns[i]
    shift = np.zeros(len(known.unknowns))
    likely = []
    for way in (1.0, -1.0):
        shift[i] = way * 1e-2 * one.scale
        moved = known.point.moved(known.unknowns, shift)
        run = run_filter(moved.model(), at_point(moved, joint))
        likely.append(run.log_likelihood)
        before = slice(0, joint.parts[1].first)
        assert np.allclose(run.innovations[before], fitted.run.innovations[before], atol=1e-6)
    slope = (likely[0] - likely[1]) / 2e-2
    along = float(np.vdot(fitted.whitened[:, :, i], fitted.run.innovations))
    assert along == pytest.approx(slope, rel=1e-3)


def test_an_effect_by_differences_and_along_the_run(known, joint, fitted):
    """A force that acts in both."""
    plain = ExternalWrench(name="push", force=(0.0, 0.0, 0.0))
    pushed = ExternalWrench(name="push", force=(1e-3, 0.0, 0.0))
    point = known.point.with_effect(pushed)
    run = run_filter(point.model(), at_point(point, joint))
    change = fitted.changes.effect(plain, pushed, 1.0)
    predicted = propagate(fitted.run, [change])[:, :, 0]
    seen = fitted.run.innovations - run.innovations
    first = joint.parts[1].first
    for own in (slice(0, first), slice(first, None)):
        assert np.abs(predicted[own] - seen[own]).max() < 5e-3 * np.abs(seen[own]).max()


def test_what_is_held_in_one_moves_in_the_other(known, alone, joint):
    assert len(alone[0].locked) > 0 and len(joint.locked) < len(alone[0].locked)
    point = known.point.with_effect(JointFriction(name="seal", joint="joint2", viscous=1.0))
    first = joint.parts[1].first
    with_it, without = (run_filter(p.model(), at_point(p, joint)).innovations for p in (point, known.point))
    assert np.allclose(with_it[:first], without[:first], atol=1e-3)
    assert np.abs(with_it[first:] - without[first:]).max() > 1.0


def test_a_channel_that_one_recording_lacks_is_not_read_there(known, alone, placed):
    fewer = alone[1].data
    kept = tuple(b for b in fewer.blocks if b.quantity != "acceleration")
    gone = next(b for b in fewer.blocks if b.quantity == "acceleration")
    rows = np.concatenate([np.arange(b.rows.start, b.rows.stop) for b in kept])
    starts = np.cumsum([0, *(b.rows.stop - b.rows.start for b in kept)])
    moved = tuple(
        replace(b, rows=slice(int(s), int(s) + b.rows.stop - b.rows.start))
        for b, s in zip(kept, starts, strict=False)
    )
    data = replace(fewer, values=fewer.values[:, rows], sigma=fewer.sigma[rows], blocks=moved)
    both = joint_problem([alone[0], replace(alone[1], data=data)], placed)
    assert both.data.rows == alone[0].data.rows
    row = both.data.names.index(gone.names[0])
    assert np.isfinite(both.data.values[: both.parts[1].first, row]).all()
    assert np.isnan(both.data.values[both.parts[1].first :, row]).all()
    wrong = replace(data, blocks=tuple(replace(b, names=tuple(n + "?" for n in b.names)) for b in moved))
    with pytest.raises(RecordingError, match="other components"):
        joint_problem([alone[0], replace(alone[1], data=wrong)], placed)


def test_pieces_of_one_flight_keep_their_clock(flown):
    whole = flown[0]
    pieces = [whole.window(0.0, 1.0), whole.window(1.5, 2.5)]
    kept = on_one_clock(pieces, LABELS)
    assert [p.shift for p in kept] == [0.0, 0.0]
    turned = on_one_clock(pieces[::-1], LABELS)
    assert turned[0].shift == 0.0 and turned[1].shift > 0.0
    assert turned[1].recording.time()[0] > turned[0].recording.time()[-1]
    assert np.array_equal(turned[1].recording["imu.angular_rate"], pieces[0]["imu.angular_rate"])


def test_a_time_is_told_on_the_clock_of_its_recording(joint, placed):
    assert on_own_clock(joint, 1.0) == (1.0, "a")
    time, label = on_own_clock(joint, placed[1].shift + 0.5)
    assert label == "b" and time == pytest.approx(0.5)
    assert on_own_clock(recordings_of(joint)[0], 1.0) == (1.0, "")
