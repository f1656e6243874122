"""The controller on the complete spacecraft: exactness, sampling, sensors, limits."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from control_cases import (
    described,
    joint_space,
    paper,
    random_state,
    rigid_paper,
    track_continuously,
    two_arms,
)

from smsid.control._attitude import attitude_error, attitude_errors
from smsid.control._sensed import SensedState, measured_truth
from smsid.control.closed_loop import Actuators, disturbance, left_out, sensor_noise, track
from smsid.control.gains import gains
from smsid.control.pd import ModelBasedController
from smsid.control.reduced import ReducedDynamics, perturb_bodies
from smsid.control.robust_term import design_robust_term
from smsid.control.trajectory import Motion, Reference, minimum_jerk, trapezoid
from smsid.control.weights import weights_from_level
from smsid.errors import ControlError
from smsid.model import build_model
from smsid.sensing import Sensor

START = np.array([0.4, -0.6, 0.9])
ATTITUDE = (0.1, -0.2, 0.3)
SHORT = Reference(trapezoid(START, 0.01, (1.0, 1.0, 1.0, 1.0)), ATTITUDE)
GENTLE = Reference(trapezoid(START, 0.001, (1.0, 1.0, 1.0, 1.0)), ATTITUDE)  # within the wheels' torque
PAPER = Reference(trapezoid(START), ATTITUDE)


def pd(model, reference=SHORT, level=0.0, **options) -> ModelBasedController:
    dynamics = ReducedDynamics(model)
    if level:
        dynamics = perturb_bodies(dynamics, level, np.random.default_rng(0), "signs")
    return ModelBasedController(dynamics, gains(dynamics.size, 4.0, 4.0), reference, **options)


@pytest.mark.parametrize("coordinates", ["quaternion", "euler"])
def test_rigid_known_noise_free_continuous_tracks_at_integrator_accuracy(coordinates):
    """The paper's trapezoid, the base held at an attitude: all that is left is the step's fourth order."""
    coarse, fine = (
        track_continuously(rigid_paper(), pd(rigid_paper(), PAPER, coordinates=coordinates), dt=dt)
        for dt in (0.1, 0.05)
    )
    assert max(coarse.base, fine.base) < 1e-12
    assert coarse.joints < 1e-8 and 12.0 < coarse.joints / fine.joints < 20.0
    law = pd(rigid_paper(), PAPER, level=0.05, coordinates=coordinates)
    assert track_continuously(rigid_paper(), law, dt=0.1).joints > 100.0 * coarse.joints


@pytest.mark.parametrize("coordinates", ["quaternion", "euler"])
def test_a_moving_base_is_tracked_too(coordinates):
    """Base and joints on a fast minimum-jerk motion: halving the step divides the error by sixteen or so."""
    base = minimum_jerk([0.1, -0.2, 0.3], [0.5, 0.4, -0.6], 4.0)
    reference = Reference(minimum_jerk(START, START + np.array([0.5, -0.4, 0.6]), 4.0), base=base)
    errors = []
    for dt in (0.1, 0.05, 0.025):
        found = track_continuously(
            rigid_paper(), pd(rigid_paper(), reference, coordinates=coordinates), dt=dt
        )
        errors.append(max(found.base, found.joints))
    assert errors[0] < 1e-4
    assert errors[0] / errors[1] > 10.0 and errors[1] / errors[2] > 10.0


@pytest.mark.parametrize("coordinates", ["quaternion", "euler"])
def test_an_initial_error_decays_as_the_error_dynamics_say(coordinates):
    """dde + K_D de + K_P e = 0 (44), from 0.3 rad off in attitude and joints, in either coordinates."""
    model = rigid_paper()
    reference = Reference(minimum_jerk(START, START, 4.0), ATTITUDE)
    law = pd(model, reference, coordinates=coordinates)
    offset = Reference(minimum_jerk(START + 0.3, START + 0.3, 4.0), (0.3, -0.4, 0.1))
    law.reference = offset
    first = law.command(0.0, measured_truth(model, _at(model, reference), np.zeros(model.nv))).error
    assert np.abs(first).min() > 0.1

    class Switched(Motion):
        size, duration = 6, 4.0

        def at(self, t):
            return (reference if t <= 0.0 else offset).at(t)

    law.reference = Switched()
    found = track_continuously(model, law, dt=0.01)
    decay = np.exp(-2.0 * found.time)[:, None] * (1.0 + 2.0 * found.time[:, None])
    # the very first call still sees the old reference: half a step of 0.01 s
    np.testing.assert_allclose(found.error[1:], (decay * first)[1:], atol=3e-3 * np.abs(first).max())


def _at(model, reference):
    q = model.set_joint_angles(model.home, reference.at(0.0)[0][3:])
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(*ATTITUDE)).coeffs()
    return q


@pytest.mark.parametrize("coordinates", ["quaternion", "euler"])
def test_attitude_coordinates_are_consistent(coordinates):
    """The rate is the derivative of the error, and the map to angular acceleration its second derivative."""
    rng = np.random.default_rng(2)
    rotation = pin.rpy.rpyToMatrix(rng.uniform(-0.8, 0.8, 3))
    omega, alpha = 0.3 * rng.standard_normal(3), 0.2 * rng.standard_normal(3)
    wanted, rates, accelerations = rng.uniform(-0.8, 0.8, 3), *rng.uniform(-0.3, 0.3, (2, 3))

    def at(t):
        turn = pin.exp3(omega * t + alpha * t**2 / 2)
        return attitude_error(
            coordinates,
            rotation @ turn,
            omega + alpha * t,
            wanted + rates * t + accelerations * t**2 / 2,
            rates + accelerations * t,
            accelerations,
        )

    h, now = 1e-5, at(0.0)
    np.testing.assert_allclose((at(h).error - at(-h).error) / (2 * h), now.rate, atol=1e-7)
    second = (at(h).rate - at(-h).rate) / (2 * h)
    mapped = now.jacobian @ -second + now.bias
    np.testing.assert_allclose(mapped, alpha, atol=1e-6)


@pytest.mark.parametrize("coordinates", ["quaternion", "euler"])
def test_errors_of_a_whole_run_are_those_of_each_moment(coordinates):
    rng = np.random.default_rng(5)
    turns = np.array([pin.rpy.rpyToMatrix(x) for x in rng.uniform(-0.8, 0.8, (20, 3))])
    omegas, angles, rates = rng.uniform(-0.8, 0.8, (3, 20, 3))
    errors, error_rates = attitude_errors(coordinates, turns, omegas, angles, rates)
    for k in range(20):
        one = attitude_error(coordinates, turns[k], omegas[k], angles[k], rates[k], np.zeros(3))
        np.testing.assert_allclose(errors[k], one.error, atol=1e-14)
        np.testing.assert_allclose(error_rates[k], one.rate, atol=1e-14)


def test_command_is_the_paper_s_equation():
    """Q_c = J_c^-T (H (qdd_d + K_D de + K_P e) + c), (43), from the Euler form of the reduced dynamics."""
    model = rigid_paper()
    law = pd(model, coordinates="euler")
    q, v = random_state(model, np.random.default_rng(4))
    angles = np.array([0.2, -0.3, 0.5])
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(angles)).coeffs()
    seen = measured_truth(model, q, v)
    found = law.command(0.5, seen)
    jacobian = pin.rpy.computeRpyJacobian(angles, pin.LOCAL)
    rates = np.concatenate([np.linalg.solve(jacobian, v[3:6]), seen.rates])
    form = joint_space(law.dynamics, np.concatenate([angles, seen.angles]), rates, seen.wheel_rates)
    x, dx, ddx = SHORT.at(0.5)
    wanted = ddx + 4.0 * (dx - rates) + 4.0 * (x - np.concatenate([angles, seen.angles]))
    exact = np.linalg.solve(form.input, form.inertia @ wanted + form.bias)
    np.testing.assert_allclose(found.torques, exact, rtol=1e-9, atol=1e-9 * np.abs(exact).max())


def robust_for(model, n, level=0.05):
    quiet = np.full(n, 1e-6)
    weights = weights_from_level(
        level, np.full(n, 1e-3), left_out=1e-4, angle_noise=quiet, rate_noise=quiet, crossover=10.0
    )
    return design_robust_term(gains(n, 4.0, 4.0), weights)


def test_the_robust_term_helps_the_complete_spacecraft():
    model = paper()
    plain = track(model, pd(model, GENTLE, level=0.2))
    helped = track(model, pd(model, GENTLE, level=0.2, robust=robust_for(model, 6), period=0.01))
    assert helped.base < 0.5 * plain.base and helped.joints < 0.5 * plain.joints


def test_two_arms_and_four_wheels_fly():
    model = two_arms()
    reference = Reference(trapezoid(model.joint_angles(model.home), 0.001, (1.0, 1.0, 1.0, 0.0)))
    found = track(model, pd(model, reference))
    assert found.error.shape[1] == 9 and found.wheel_torque.shape[1] == 4
    assert found.joints < 1e-4 and found.base < 1e-4 and not found.saturated


def test_delay_and_a_slow_controller_cost_accuracy_and_blow_up_in_the_end():
    model = paper()
    fast, slow = (
        track(model, pd(model, GENTLE, level=0.2), rate=r, dt=0.01, delay=d)
        for r, d in ((100.0, 0), (10.0, 2))
    )
    assert slow.joints > 1.05 * fast.joints
    assert len(fast.time) == 401 and len(slow.time) == 41


def test_sensors_are_what_the_controller_sees():
    model = paper()
    seen = SensedState(model, model.description.sensor, 20.0, 100.0, np.random.default_rng(1))
    q, v = random_state(model, np.random.default_rng(3))
    exact = measured_truth(model, q, v)
    rows = [seen(k / 100.0, q, v) for k in range(2000)]
    for name, sigma in (("omega", 1e-5), ("angles", 1e-5), ("rates", 1e-4), ("wheel_rates", 1e-3)):
        noise = np.array([getattr(r, name) for r in rows]) - getattr(exact, name)
        np.testing.assert_allclose(noise.std(axis=0), sigma, rtol=0.1)
        assert np.abs(noise.mean(axis=0)).max() < 5.0 * sigma / np.sqrt(2000)
    turns = np.array([pin.log3(exact.rotation.T @ r.rotation) for r in rows])
    np.testing.assert_allclose(turns.std(axis=0), 1e-4, rtol=0.1)


def test_slow_late_and_wrong_sensors():
    """A sensor at 10 Hz holds, one with delay reports the past, scale and steps are those of its model."""
    model = paper()
    others = [s for s in model.description.sensor if s.kind in ("pose", "imu", "tachometer")]
    errors = {
        "joint_position": {"delay": 0.03},
        "joint_velocity": {"scale_error": 0.1, "quantisation": 0.01, "saturation": 1.0},
    }
    encoder = Sensor(name="encoder", kind="encoder", rate=10.0, errors=errors)
    seen = SensedState(model, [*others, encoder], 2.0, 100.0, np.random.default_rng(1))
    _, v = random_state(model, np.random.default_rng(3))
    v[model.arm_joints.v] = [0.123, 5.0, -0.4]
    rows = []
    for k in range(30):
        q = model.set_joint_angles(model.home, START + 0.01 * k)
        rows.append(seen(k / 100.0, q, v))
    np.testing.assert_allclose(rows[29].angles, START + 0.01 * 17, atol=1e-12)
    np.testing.assert_allclose(rows[15].angles, START + 0.01 * 7, atol=1e-12)
    np.testing.assert_allclose(rows[0].rates, [0.14, 1.0, -0.44], atol=1e-12)


def test_an_attitude_is_read_in_the_steps_of_its_quaternion():
    """In the axes of its sensor: as `Sensor.measure` does it."""
    model = paper()
    others = [s for s in model.description.sensor if s.kind != "pose"]
    pose = Sensor(
        name="pose", kind="pose", rate=10.0, orientation=(0.3, -0.2, 0.7),
        errors={"attitude": {"quantisation": 0.02}},
    )  # fmt: skip
    seen = SensedState(model, [*others, pose], 1.0, 10.0, np.random.default_rng(1))
    q, v = random_state(model, np.random.default_rng(3))
    exact = pin.Quaternion(measured_truth(model, q, v).rotation).coeffs()
    (read,) = pose.measure("attitude", [0.0], exact[None], np.random.default_rng(1))
    np.testing.assert_allclose(seen(0.0, q, v).rotation, pin.Quaternion(read).toRotationMatrix(), atol=1e-12)
    assert np.abs(pin.log3(measured_truth(model, q, v).rotation.T @ seen(0.1, q, v).rotation)).max() > 1e-3


def test_limits_are_kept_and_told():
    """Asked for more than the wheels give, no wheel passes its torque; the run says which and how often."""
    model = paper()
    reference = Reference(minimum_jerk(START, START + 0.8, 3.0))
    found = track(model, pd(model, reference), duration=3.0)
    assert np.abs(found.wheel_torque).max() <= 2.0 * (1 + 1e-12)
    assert any(name.startswith("wheel") and count > 0 for name, count in found.saturated.items())
    free = track(model, pd(model, reference), duration=3.0, limits=False)
    assert not free.saturated and np.abs(free.wheel_torque).max() > 2.0 and free.base < found.base


def test_no_wheel_passes_its_speed_without_being_told():
    """To what a call's length of the base's own turning adds, 1e-5; the run names the wheels."""
    slow = tuple(w.model_copy(update={"max_rate": 1.0}) for w in described().wheel)
    model = build_model(described(wheel=slow))
    reference = Reference(trapezoid(START, 0.003, (2.0, 2.0, 2.0, 0.0)))
    found = track(model, pd(model, reference))
    assert 0.99 < np.abs(found.wheel_rate).max() < 1.0 + 1e-4
    assert {f"{w.name} speed" for w in slow} <= set(found.saturated)


def test_torques_of_a_run_are_what_acted_on_the_base():
    model = paper()
    act = Actuators(model, 0.01)
    tau = act(np.array([0.3, -0.5, 0.2, 1.0, 2.0, 3.0]), np.zeros(3))
    np.testing.assert_allclose(tau[model.wheels.v], [-0.3, 0.5, -0.2])
    np.testing.assert_allclose(tau[model.arm_joints.v], [1.0, 2.0, 3.0])


def test_disturbance_of_a_run_closes_the_error_dynamics():
    """A known disturbance: the model's joint torques scaled by parameters that are all 10 % too small."""
    model = rigid_paper()
    dynamics = ReducedDynamics(model)
    small = perturb_bodies(dynamics, 0.1, _always(-1.0), "common")
    law = ModelBasedController(small, gains(6, 4.0, 4.0), SHORT)
    run = track_continuously(model, law, dt=0.02)
    middle = np.abs(run.time - 0.15) < 0.1  # while Coriolis terms are still nothing
    d = disturbance(run, law.gains)[middle, 3:]
    fed = 4.0 * (run.error + run.error_rate)[middle, 3:] + 0.01
    np.testing.assert_allclose(d, 0.1 * fed, rtol=0.01)
    assert left_out(paper(), law.gains, SHORT).max() > 1e-6


def _always(value):
    class Rng:
        def uniform(self, low, high, size=None):
            return value if size is None else np.full(size, value)

    return Rng()


def test_sensor_noise_is_that_in_the_band():
    angle, rate = sensor_noise(paper().description.sensor, 3, 100.0, np.pi)
    np.testing.assert_allclose(angle, np.array([1e-4] * 3 + [1e-5] * 3) * 0.1, rtol=1e-12)
    np.testing.assert_allclose(rate, np.array([1e-5] * 3 + [1e-4] * 3) * 0.1, rtol=1e-12)


def test_perturbed_models_stay_physical_and_within_the_level():
    """Eigenvalues of H^-1 H_hat lie in 1 +- level for masses and inertias; levers move them a little."""
    dynamics = ReducedDynamics(paper())
    exact = dynamics.body_terms(np.zeros(3), START, np.zeros(3)).inertia
    for seed in range(20):
        common = perturb_bodies(dynamics, 0.2, np.random.default_rng(seed), "common")
        ratio = np.linalg.eigvals(
            np.linalg.solve(exact, common.body_terms(np.zeros(3), START, np.zeros(3)).inertia)
        )
        assert np.abs(ratio - 1.0).max() <= 0.2 + 1e-3
        other = perturb_bodies(dynamics, 0.2, np.random.default_rng(seed), "uniform")
        assert np.linalg.eigvalsh(other.body_terms(np.zeros(3), START, np.zeros(3)).inertia).min() > 0.0
        assert np.abs(other.body_terms(np.zeros(3), START, np.zeros(3)).inertia - exact).max() > 1.0
    np.testing.assert_array_equal(dynamics.body_terms(np.zeros(3), START, np.zeros(3)).inertia, exact)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: pd(paper(), Reference(trapezoid(np.zeros(2)))), "reference have 5 coordinates"),
        (lambda: ModelBasedController(ReducedDynamics(paper()), gains(5, 1.0, 1.0), SHORT), "gains have 5"),
        (lambda: pd(paper(), robust=robust_for(paper(), 6)), "needs the period"),
        (lambda: track(paper(), pd(paper()), sensors=paper().description.sensor), "without a generator"),
        (lambda: track(paper(), pd(paper()), sensors=[], rng=np.random.default_rng(0)), "No sensor measures"),
        (lambda: sensor_noise([], 3, 100.0, 1.0), "No sensor measures"),
        (
            lambda: sensor_noise([Sensor(name="pose", kind="pose", rate=10.0)], 3, 100.0, 1.0),
            r"No noise is stated of attitude, measured by 'pose'.*errors\.attitude",
        ),
        (lambda: perturb_bodies(ReducedDynamics(paper()), 1.0, np.random.default_rng(0)), "not in"),
        (
            lambda: perturb_bodies(ReducedDynamics(paper()), 0.1, np.random.default_rng(0), "x"),
            "no way to draw",
        ),
        (
            lambda: track(
                paper(), pd(paper(), Reference(SHORT.joints, (0.0, 1.56, 0.0)), coordinates="euler")
            ),
            "singular at 90 deg",
        ),
        (
            lambda: track(paper(), pd(paper()), start=_turned(np.pi + 0.3)),
            "attitude error is",
        ),
        (lambda: track(paper(), pd(paper(), coordinates="x")), "no coordinates of an attitude"),
    ],
)
def test_bad_input_is_refused(make, words):
    with pytest.raises(ControlError, match=words):
        make()


def _turned(angle):
    q = paper().home.copy()
    q[3:7] = pin.Quaternion(pin.exp3(np.array([0.0, 0.0, angle]))).coeffs()
    return q
