"""The filter: its linearisation against differences, white innovations, and their derivatives."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.linalg import expm

from smsid.estimation._measurement_model import MeasurementModel
from smsid.estimation.filter_pass import predict_delayed
from smsid.estimation.kalman import _readable, run_filter
from smsid.estimation.map_estimate import columns_of
from smsid.estimation.problem import CommandTiming
from smsid.estimation.process_model import ProcessModel
from smsid.estimation.sensitivities import Sensitivities, Sensitivity, propagate
from smsid.kernel.covariance import transition

STEP = 1e-6


@pytest.fixture(scope="module")
def run(known, problem):
    return run_filter(known.point.model(), problem)


@pytest.fixture(scope="module")
def noiseless(known, problem):
    """The problem with the model's own open-loop readings: innovations nil, gains as ever."""
    opened = run_filter(known.point.model(), problem, until=-np.inf)
    attitude = {name: opened.states.q[:, 3:7] for name in problem.data.attitude}
    data = replace(problem.data, values=opened.predicted, attitude=attitude)
    return replace(problem, data=data)


def test_linearised_step_is_that_of_differences(known):
    model, rng = known.point.base, np.random.default_rng(1)
    nv = model.nv
    plant = ProcessModel(model, np.array([], dtype=int))
    q = pin.integrate(model.pin, model.home, 0.1 * rng.standard_normal(nv))
    v, tau = 0.1 * rng.standard_normal(nv), rng.standard_normal(nv)
    transition, _ = plant.transition(0.01, v, plant.linear(0.0, q, v, tau))

    def after(x):
        return plant.step(0.0, 0.01, pin.integrate(model.pin, q, x[:nv]), v + x[nv:], tau)

    q0, v0 = after(np.zeros(2 * nv))
    columns = []
    for x in STEP * np.eye(2 * nv):
        q1, v1 = after(x)
        columns.append(np.concatenate([pin.difference(model.pin, q0, q1), v1 - v0]) / STEP)
    np.testing.assert_allclose(transition, np.stack(columns, axis=1), atol=2e-5)


@pytest.mark.parametrize("h", [0.01, 0.1, 1.0])
@pytest.mark.parametrize("damping", [0.0, 100.0])
@pytest.mark.parametrize("plain", [True, False])
def test_a_transition_is_exact_however_fast_the_motion_is(known, h, damping, plain):
    """A mode turns by radians from a slow sample to the next, and what friction brakes has stopped."""
    model = known.point.base
    nv, v = model.nv, 0.1 * np.random.default_rng(3).standard_normal(model.nv)
    moving = ProcessModel(model, np.array([], dtype=int))
    linear = moving.linear(0.0, model.home, v, np.zeros(nv))
    linear.by_v[6:9, 6:9] -= damping * np.eye(3)
    a = np.zeros((3 * nv, 3 * nv))  # with forces that stay, whose integral is beside it
    a[:nv, nv : 2 * nv], a[nv : 2 * nv, :nv], a[nv : 2 * nv, nv : 2 * nv] = (
        np.eye(nv),
        linear.by_q,
        linear.by_v,
    )
    a[:6, :6], a[nv : 2 * nv, 2 * nv :] = -pin.Motion(v[:6]).action, np.eye(nv)
    exact = expm(a * h)[: 2 * nv]
    if plain:
        found, integral = moving.transition(h, v, linear)
        forcing = integral[:, nv:]
    else:
        found, forcing = np.zeros((2 * nv, 2 * nv)), np.zeros((2 * nv, nv))
        transition(h, v, linear.by_q, linear.by_v, True, found, forcing)
    np.testing.assert_allclose(found, exact[:, : 2 * nv], atol=1e-3 * np.abs(exact).max())
    np.testing.assert_allclose(forcing, exact[:, 2 * nv :], atol=1e-3 * np.abs(forcing).max())


def test_a_step_under_a_force_that_ramps_is_the_limit_of_many_short_ones(known):
    model, rng = known.point.base, np.random.default_rng(2)
    nv, h, n = model.nv, 0.02, 400
    plant = ProcessModel(model, np.array([], dtype=int))
    q0 = pin.integrate(model.pin, model.home, 0.1 * rng.standard_normal(nv))
    v0, tau, rise = 0.3 * rng.standard_normal(nv), rng.standard_normal(nv), 5.0 * rng.standard_normal(nv)
    q, v = q0, v0
    for k in range(n):
        q, v = plant.step(k * h / n, h / n, q, v, tau + (2.0 * (k + 0.5) / n - 1.0) * rise)
    once, rate = plant.step(0.0, h, q0, v0, tau, rise)
    level, rate_level = plant.step(0.0, h, q0, v0, tau)
    away = np.abs(pin.difference(model.pin, level, q)).max(), np.abs(rate_level - v).max()
    assert np.abs(pin.difference(model.pin, once, q)).max() < 1e-3 * away[0]
    assert np.abs(rate - v).max() < 1e-2 * away[1]


def test_innovations_of_the_true_model_are_white_and_of_unit_size(run):
    e = run.innovations[100:]
    n = len(e)
    np.testing.assert_allclose(e.T @ e / n, np.eye(e.shape[1]), atol=6.0 / np.sqrt(n))
    lagged = e[1:].T @ e[:-1] / n
    assert np.abs(lagged).max() < 5.5 / np.sqrt(n)


@pytest.mark.parametrize("name", ["bus.m", "link2.my", "link3.Iyy", "tank.mass", "tank.stiffness.x"])
def test_derivatives_of_innovations_are_those_of_filtering_again(known, noiseless, name):
    unknown = next(u for u in known.unknowns if u.name == name)
    point = known.point
    run = run_filter(point.model(), noiseless)
    changes = Sensitivities(point, point.model(), noiseless, run)
    found = propagate(run, columns_of(changes, [unknown]))[:, :, 0] * unknown.scale
    step = 1e-3 * unknown.scale
    more, less = (
        run_filter(point.moved([unknown], np.array([s])).model(), noiseless).innovations
        for s in (step, -step)
    )
    expected = -(more - less) / 2e-3
    assert np.linalg.norm(found - expected) < 0.01 * np.linalg.norm(expected)


def test_a_reading_that_is_off_goes_through_the_filter_as_predicted(known, noiseless):
    run = run_filter(known.point.model(), noiseless)
    problem = noiseless
    shifted = replace(problem.data, values=problem.data.values.copy())
    row = problem.data.names.index("imu.angular_rate[y]")
    shifted.values[1:, row] += 1e-6  # the first sample is where the filter starts
    moved = run_filter(known.point.model(), replace(problem, data=shifted)).innovations
    reading = np.zeros_like(run.predicted)
    reading[1:, row] = 1.0
    found = propagate(run, [Sensitivity(reading=reading)])[:, :, 0] * 1e-6
    np.testing.assert_allclose(moved - run.innovations, found, atol=1e-3 * np.abs(found).max())


@pytest.mark.parametrize("delay", [0.02, -0.02])
def test_a_late_sensor_reads_what_was_a_delay_ago(known, problem, delay):
    """Accelerations included, against the plant integrated backwards under the forces until then.

    One that is early reads what is to come, under the forces from then on.
    """
    model = known.point.base
    plant, outputs = ProcessModel(model, problem.locked), MeasurementModel(model, problem.data)
    rng = np.random.default_rng(5)
    q = pin.integrate(model.pin, model.home, 0.1 * rng.standard_normal(model.nv))
    v, tau = 0.1 * rng.standard_normal((2, model.nv))
    late = np.full(len(problem.data.blocks), delay)
    forces = (tau, tau + 1.0) if delay > 0.0 else (tau + 1.0, tau)
    found = predict_delayed(outputs, late, 1.0, (q, v), plant.acceleration(1.0, q, v, tau), forces, plant)[0]
    before, slower = plant.step(1.0, -delay, q, v, tau)
    then = plant.acceleration(1.0 - delay, before, slower, tau)
    expected, now = (
        outputs.predict(*x)[0] for x in ((before, slower, then), (q, v, plant.acceleration(1.0, q, v, tau)))
    )
    here, there = (pin.Quaternion(x[3:7]).matrix() for x in (q, before))
    for block in problem.data.blocks:
        if block.quantity == "attitude":  # as a rotation from the attitude there is now
            expected[block.rows] = pin.log3(here.T @ there)
        off = np.abs(found[block.rows] - expected[block.rows]).max()
        assert off < 0.05 * np.abs(now[block.rows] - expected[block.rows]).max() + 1e-12, block.channel


def test_a_late_reading_is_off_by_the_fourth_order_of_its_delay(known, problem):
    """By the third, an encoder 36 ms late was twice as loud as its noise, and its delay 0.2 % off."""
    model = known.point.base
    plant, outputs = ProcessModel(model, problem.locked), MeasurementModel(model, problem.data)
    rng = np.random.default_rng(5)
    q = pin.integrate(model.pin, model.home, 0.1 * rng.standard_normal(model.nv))
    v, tau = 0.1 * rng.standard_normal((2, model.nv))
    now = plant.acceleration(1.0, q, v, tau)
    (block,) = (b for b in problem.data.blocks if b.channel == "encoder.joint_position")
    off = []
    for delay in (0.08, 0.04):
        late = np.full(len(problem.data.blocks), delay)
        found = predict_delayed(outputs, late, 1.0, (q, v), now, (tau, tau), plant)[0]
        before, slower = q, v
        for k in range(16):
            before, slower = plant.step(1.0 - k * delay / 16, -delay / 16, before, slower, tau)
        expected = outputs.predict(before, slower, plant.acceleration(1.0 - delay, before, slower, tau))[0]
        off.append(np.abs(found[block.rows] - expected[block.rows]).max())
    assert off[0] > 11.0 * off[1]  # 16 by the fourth order, 8 by the third


@pytest.mark.parametrize(
    ("side", "begins", "counts"), [("left", 1.0, False), ("left", 0.0, True), ("right", 1.0, True)]
)
def test_what_acted_before_the_first_sample_is_not_believed(problem, side, begins, counts):
    """An encoder behind a gear that gives, an accelerometer: they show a command that nobody has recorded."""
    commands = {c: np.array(problem.recording[c]) for c in problem.recording.channels if "command." in c}
    for values in commands.values():
        values[0] = begins
    recording = problem.recording.with_channels(commands)
    present = _readable(replace(problem, recording=recording, timing=CommandTiming("held", side)))
    for block in problem.data.blocks:
        at_once = block.quantity in ("joint_position", "acceleration")
        there = np.isfinite(problem.data.values[:, block.rows])
        assert (present[1:, block.rows] == there[1:]).all()
        assert (present[0, block.rows] == (there[0] & (counts or not at_once))).all()


def test_open_loop_needs_no_derivatives(known, problem, run):
    """After the last correction: as a filter whose sensors are nothing but noise."""
    until = float(problem.data.times[150])
    opened = run_filter(known.point.model(), problem, until=until)
    np.testing.assert_array_equal(opened.errors[:151], run.errors[:151])
    assert opened.sensitivity[150].any() and not opened.sensitivity[151:].any()
    alone = run_filter(known.point.model(), problem, until=-np.inf)
    deaf = replace(problem, data=replace(problem.data, sigma=1e12 * problem.data.sigma))
    np.testing.assert_allclose(
        alone.errors, run_filter(known.point.model(), deaf).errors, rtol=1e-6, atol=1e-9
    )
