"""Noise levels from prediction errors: white ones, slow ones, and outliers."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from smsid.diagnose import _noise_covariance as noise_covariance
from smsid.diagnose._forward_step import SearchState
from smsid.diagnose._noise_covariance import (
    InflatedFit,
    _told_by_noise,
    erring_fit,
    first_fit,
    misfit_factors,
    noise_factors,
    normalised_rmse,
    strays_by_row,
    with_levels,
)
from smsid.diagnose._unknown_input import with_unknown
from smsid.diagnose._unknown_structure import refit_noise
from smsid.diagnose.hypotheses import propose
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.errors import SimulationError
from smsid.estimation.map_estimate import evaluate, fit
from smsid.estimation.measurements import measurements_of

N = 20000


def channels(*columns):
    """Prediction errors in stated noise, one channel of one row a column, all used."""
    x = np.column_stack(columns)
    blocks = tuple(SimpleNamespace(rows=slice(i, i + 1), channel=f"c{i}") for i in range(x.shape[1]))
    data = SimpleNamespace(rows=x.shape[1], blocks=blocks, coarse=None)
    return data, SimpleNamespace(normalised=x, used=np.ones(x.shape, dtype=bool))


def slow(rng, memory, n=N):
    """An error that remembers: autoregressive of order one, variance one."""
    return lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], rng.standard_normal(n))


def test_white_noise_is_measured_as_it_is():
    rng = np.random.default_rng(1)
    data, run = channels(0.7 * rng.standard_normal(N), 1.3 * rng.standard_normal(N))
    assert noise_factors(data, run) == pytest.approx([0.7, 1.3], rel=0.03)


def test_what_varies_slowly_and_what_is_far_off_is_no_noise():
    rng = np.random.default_rng(2)
    drifting = rng.standard_normal(N) + 20.0 * np.sin(np.linspace(0.0, 9.0, N))
    with_error = rng.standard_normal(N)
    with_error[::100] += 50.0
    assert noise_factors(*channels(drifting, with_error)) == pytest.approx([1.0, 1.0], rel=0.1)


@pytest.mark.parametrize("erring", [{"shapes": ((7, 1.0),)}, {"more": ((0, 1.0), (7, 1.0))}])
def test_where_inputs_err_only_errors_of_the_sensors_tell_their_noise(known, problem, erring):
    """The encoders of other joints erred by less than the open friction let them: noise of 0.7 was told, and
    the joint that it does not touch did not fit. Nor do readings beside a structure that is unknown: noise of
    next to nothing was told, and all candidates looked like millions.
    """
    run = evaluate(known.point, known.unknowns[:1], problem).run
    rng, sigma = np.random.default_rng(4), problem.data.sigma
    errors = 1.2 * sigma * rng.standard_normal(run.errors.shape)
    spread = np.broadcast_to(sigma, errors.shape).copy()
    block = next(b for b in problem.data.blocks if b.channel == "encoder.joint_velocity")
    spread[:, block.rows.start + 1 : block.rows.stop] *= 5.0  # by the open law, which hardly errs
    run = replace(run, errors=errors, normalised=errors / spread, used=np.ones(errors.shape, dtype=bool))
    opened = replace(problem, noise=replace(problem.noise, **erring))
    factors = [noise_factors(problem.data, _told_by_noise(p, run))[block.rows] for p in (problem, opened)]
    assert factors[0] == pytest.approx(0.72, rel=0.1) and factors[1] == pytest.approx(1.2, rel=0.1)


@pytest.mark.parametrize("memory", [0.0, 0.8, 0.95])
def test_counted_misfit_covers_the_spread_of_a_mean_under_such_errors(memory):
    """White noise of the level found gives a mean at least the spread it has, by drawing it many times."""
    rng = np.random.default_rng(3)
    means = [slow(rng, memory, 2000).mean() for _ in range(400)]
    level = misfit_factors(*channels(slow(rng, memory)))[0]
    said = level / np.sqrt(2000)
    assert np.std(means) < 1.1 * said
    assert said < 2.5 * np.std(means)


def test_straying_is_in_stated_noise_whatever_the_levels_fitted():
    rng = np.random.default_rng(4)
    factors = np.array([3.0, 3.0])
    _, run = channels(rng.standard_normal(N), rng.standard_normal(N))
    assert normalised_rmse(run, factors) == pytest.approx(3.0, rel=0.05)


def test_a_channel_of_which_little_more_than_the_start_is_read_strays_by_nothing():
    """What was left out with a panel's motion strayed by its first sample, and the tank was taken for it."""
    _, run = channels(np.full(N, 2.0), np.full(N, 6.0))
    run.used[1:, 1] = False
    assert strays_by_row(run, np.ones(2)) == pytest.approx([2.0, 0.0])


FAULTS = {
    "a jump": ("tachometer.wheel_rate[wheel_y]", lambda t: 3.0 * (t > 3.0)),
    "a rate that is off from the first sample": ("imu.angular_rate[y]", lambda t: 0.15 + 0.0 * t),
    "an attitude that drifts": ("pose.attitude[z]", lambda t: 0.1 * t),
}


@pytest.mark.parametrize(
    "what", [pytest.param(x, marks=[pytest.mark.slow] if "first sample" in x else []) for x in FAULTS]
)
def test_a_sensor_far_off_is_no_misfit_of_the_model(known, problem, what):
    """The parameters are those of the others, and its own channel alone bears it."""
    name, error = FAULTS[what]
    data, unknowns = problem.data, known.unknowns[:4]
    row = data.names.index(name)
    values, attitude = data.values.copy(), dict(data.attitude)
    values[:, row] += error(data.times)
    if name.startswith("pose.attitude"):
        turn = Rotation.from_rotvec(np.outer(error(data.times), [0.0, 0.0, 1.0]))
        attitude["pose.attitude"] = (Rotation.from_quat(attitude["pose.attitude"]) * turn).as_quat()
    off = replace(problem, data=replace(data, values=values, attitude=attitude))
    found = with_levels(first_fit(known.point, off, unknowns), known.point)
    sound = with_levels(first_fit(known.point, with_unknown(problem, name.partition("[")[0]), unknowns))
    own = next(b.rows for b in data.blocks if b.rows.start <= row < b.rows.stop)
    assert found.alone and found.factors[row] > 100.0
    assert np.delete(found.factors, np.r_[own]).max() < 1.5
    for u in unknowns:
        assert abs(found.fit.point.value(u) - sound.fit.point.value(u)) < 0.5 * sound.fit.sigma(u.name)


def test_misfit_stays_in_the_channels_that_are_wrong(known, problem):
    """Two sensors err far: every other one bears it at first, and none in the end."""
    values = problem.data.values.copy()
    wrong = [n for n in problem.data.names if n.startswith(("panel.acceleration", "imu.angular_rate[y]"))]
    rows = [problem.data.names.index(n) for n in wrong]
    values[:, rows] += 3e3 * problem.data.sigma[rows] * np.sin(0.4 * problem.data.times)[:, None]
    far = replace(problem, data=replace(problem.data, values=values))
    found = with_levels(first_fit(known.point, far, known.unknowns))
    assert found.misfit and not found.alone
    assert found.factors[rows].min() > 100.0
    assert np.delete(found.factors, rows).max() < 3.0


def test_a_model_that_is_wrong_all_over_is_misfit_still(known, problem):
    wrong = replace(problem, data=problem.data.scaled(np.full(problem.data.rows, 1e-3)))
    assert with_levels(first_fit(known.point, wrong, known.unknowns[:1])).misfit


def test_where_the_last_step_cannot_be_filtered_the_one_before_is_taken(known, problem, monkeypatch):
    """The last step of a fit is taken on trust; where it led must not cost the diagnosis."""
    before = fit(known.point, known.unknowns[:1], problem)
    astray = before.point.moved(before.unknowns, np.array([1e-3]))
    found = InflatedFit(replace(before, point=astray), np.ones(problem.data.rows))
    started = []

    def filtered(point, unknowns, problem, **options):
        started.append(point)
        if point is astray:
            raise SimulationError("lost")
        return fit(point, unknowns, problem, **options)

    monkeypatch.setattr("smsid.diagnose._noise_covariance.fit", filtered)
    monkeypatch.setattr(
        "smsid.diagnose._noise_covariance.noise_factors", lambda *_: np.full(problem.data.rows, 2.0)
    )
    assert refit_noise(found, strong=True).factors == pytest.approx(2.0 * 2.0)
    assert started[:2] == [astray, before.changes.point]


def test_what_a_candidate_explains_is_the_fall_of_squared_errors_in_stated_noise(known, problem):
    """Also where noise levels are raised, which change what its columns and the residual are."""
    factors = np.exp(np.random.default_rng(6).uniform(-1.0, 3.0, problem.data.rows))
    raised = replace(problem, data=problem.data.scaled(factors))
    found = evaluate(known.point, known.unknowns[:3], raised)
    rows, d = found.run.innovations.size, 2
    columns = np.random.default_rng(7).standard_normal((len(found.residual), d))
    estimate = np.array([0.3, -2.0])
    stated = np.tile(factors, rows // len(factors))
    left = found.residual[:rows] - columns[:rows] @ estimate
    fall = ((stated * found.residual[:rows]) ** 2).sum() - ((stated * left) ** 2).sum()
    assert InflatedFit(found, factors, misfit=True).explained(columns, estimate) == pytest.approx(fall)


@pytest.mark.parametrize(("size", "misfit"), [(0.5, False), (8.0, True)])
def test_misfit_is_counted_where_one_channel_alone_is_left_with_it(known, problem, size, misfit):
    """Over all channels it is little; with the noise as stated, what bends to it would be told for sure."""
    row, values = problem.data.names.index("imu.acceleration[y]"), problem.data.values.copy()
    values[:, row] += size * problem.data.sigma[row] * np.sin(0.8 * problem.data.times)
    slow = replace(problem, data=replace(problem.data, values=values))
    first = evaluate(known.point, known.unknowns[:3], slow)
    assert normalised_rmse(first.run) < 2.0
    raised = np.full(problem.data.rows, 5.0)
    before = evaluate(known.point, known.unknowns[:3], replace(slow, data=slow.data.scaled(raised)))
    found = refit_noise(InflatedFit(before, raised, misfit=True, local=False), strong=True)
    assert found.misfit == misfit
    assert (found.factors[row] > 3.0) == misfit


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 4, 7])
def test_errors_slower_than_the_record_are_no_cause(known, problem, flown, seed):
    """A gyro and a panel's accelerometers wander by ten to a hundred times their noise."""
    record, rng = flown("exp2", 20.0, seed), np.random.default_rng([seed, 7])
    data = measurements_of(known.point.base, record, known.point.description.effective_sensors())
    data = data.thinned(10.0)
    values = data.values.copy()
    for row, name in enumerate(data.names):
        if name.startswith(("imu.angular_rate", "panel.")):
            size = data.sigma[row] * np.exp(rng.uniform(np.log(10.0), np.log(100.0)))
            values[:, row] += size * slow(rng, 0.99, len(values) + 3000)[3000:]
    wandering = replace(problem, recording=record, data=replace(data, values=values))
    levels = with_levels(first_fit(known.point, wandering, known.unknowns), known.point)
    assert levels.misfit
    state = SearchState(levels, propose(known.point, wandering, known.unknowns), THRESHOLDS)
    while state.forward_step():
        pass
    assert not state.causes


def test_a_model_that_loses_a_recording_errs_by_as_little_as_it_has_to(known, problem, monkeypatch):
    """Its process noise is that of a model that may err; as stated it is what it was."""
    lost = []

    def fitted(point, unknowns, problem, iterations):
        errs = max(x for _, x in problem.noise.accelerations)
        lost.append(errs)
        if len(lost) != 3:
            raise SimulationError("lost")
        return evaluate(point, unknowns, problem)

    monkeypatch.setattr(noise_covariance, "fit", fitted)
    found = erring_fit(known.point, problem, known.unknowns[:1])
    assert found is not None and found.misfit
    assert lost == pytest.approx([0.001 * lost[2] / 0.1, 0.01 * lost[2] / 0.1, lost[2]])
    assert found.fit.problem.noise.accelerations and not found.stated.noise.accelerations
    assert found.stated.noise == found.strict == problem.noise
    assert erring_fit(known.point, problem, known.unknowns[:1]) is None and len(lost) == 7


@pytest.mark.parametrize(("left", "steps"), [((900.0, 300.0, 3.0), 3), ((900.0, 500.0, 3.0), 2)])
def test_a_fit_to_the_noise_goes_on_while_it_comes_closer(monkeypatch, left, steps):
    """From afar two steps do not reach the noise; one that stays where it is costs no more of them."""
    made, rows = [], SimpleNamespace(data=SimpleNamespace(rows=1))

    def two_steps(*_, iterations):
        if iterations == 6:
            return SimpleNamespace(run=1.0)
        made.append(iterations)
        return SimpleNamespace(run=left[len(made) - 1], point=None)

    monkeypatch.setattr(noise_covariance, "fit", two_steps)
    monkeypatch.setattr(noise_covariance, "normalised_rmse", lambda run: run)
    monkeypatch.setattr(noise_covariance, "continue_fit", two_steps)
    monkeypatch.setattr(noise_covariance, "strays_by_row", lambda *_: np.ones(1))
    found = noise_covariance.fit_to_stated_noise(None, (), rows)
    assert (found is not None) is (steps == 3)
    assert len(made) == steps
