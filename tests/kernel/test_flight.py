"""Compiled flights under the model-based controller: those of the plain way, to 1e-10."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.control import _compiled_flight as compiled_flight
from smsid.control._compiled_flight import CompiledFlight
from smsid.control._sensed import SensedState
from smsid.control.closed_loop import Actuators, track, track_many
from smsid.control.gains import gains
from smsid.control.pd import ModelBasedController
from smsid.control.reduced import ReducedDynamics, perturb_bodies
from smsid.control.robust_term import design_robust_term
from smsid.control.trajectory import Reference, minimum_jerk
from smsid.control.weights import weights_from_level
from smsid.errors import ControlError, SimulationError

RATE, SECONDS = 20.0, 6.0


@pytest.fixture(scope="module")
def robust():
    k, noise = gains(6, 4.0, 4.0), np.full(6, 1e-5)
    wanted = weights_from_level(
        0.05, np.full(6, 1e-3), left_out=1e-4, angle_noise=noise, rate_noise=noise, crossover=5.0
    )
    return k, design_robust_term(k, wanted)


def law(model, k, robust=None, *, far=0.4, coordinates="quaternion", seed=0):
    """Return a controller with a wrong model that moves joints and base."""
    home, d = model.joint_angles(model.home), ReducedDynamics(model)
    joints, base = (
        minimum_jerk(home, home + far, SECONDS),
        minimum_jerk(np.zeros(3), [0.2, -0.1, 0.3], SECONDS),
    )
    dynamics = perturb_bodies(d, 0.1, np.random.default_rng(seed), "uniform")
    return ModelBasedController(
        dynamics, k, Reference(joints, base=base), robust=robust, period=1.0 / RATE, coordinates=coordinates
    )


def with_errors(model, **errors):
    """Return the craft's sensors with errors of all their quantities but the attitude, slower and later."""
    out = []
    for sensor in model.description.effective_sensors():
        own = {k: e.model_copy(update={} if k == "attitude" else errors) for k, e in sensor.errors.items()}
        out.append(sensor.model_copy(update={"errors": own}))
    return out


def same(ours, plain):
    for name in ("error", "error_rate", "torques", "wheel_torque", "wheel_rate", "q", "v"):
        a, b = getattr(ours, name), getattr(plain, name)
        np.testing.assert_allclose(a, b, rtol=1e-10, atol=1e-10 * max(1.0, np.abs(b).max()), err_msg=name)
    np.testing.assert_array_equal(ours.time, plain.time)
    assert ours.saturated == plain.saturated


@pytest.fixture
def must_be_compiled(monkeypatch):
    """Fail where `track` takes the plain way though compiled code is there."""
    own = CompiledFlight.of

    def checked(*given):
        found = own(*given)
        assert found is not None or not compiled_flight.Kernel.of(given[0])
        return found

    monkeypatch.setattr(CompiledFlight, "of", checked)


@pytest.mark.usefixtures("must_be_compiled")
@pytest.mark.parametrize("term", [False, True])
@pytest.mark.parametrize(("delay", "dt"), [(0, None), (2, 0.01)])
def test_with_the_exact_state(crafts, both_ways, robust, term, delay, dt):
    k, wanted = robust
    controller = law(crafts["paper"], k, wanted if term else None)
    same(*both_ways(lambda: track(crafts["paper"], controller, rate=RATE, delay=delay, dt=dt)))


@pytest.mark.usefixtures("must_be_compiled")
@pytest.mark.parametrize(
    "errors",
    [
        {"noise_sigma": 1e-3},
        {"noise_sigma": 1e-5, "delay": 0.12},
        {"scale_error": 0.05, "misalignment_sigma": 0.02, "noise_sigma": 1e-6},
        {"quantisation": 1e-3},
        {"saturation": 0.02},
    ],
)
def test_with_sensors(crafts, both_ways, robust, errors):
    """Noise that drives wheels to their limits, late ones, scaled and misaligned, rounded, limited."""
    craft, (k, wanted) = crafts["paper"], robust
    sensors = with_errors(craft, **errors)
    slow = [s.model_copy(update={"rate": 7.0}) if s.kind == "encoder" else s for s in sensors]
    controller = law(craft, k, wanted)
    ours, plain = both_ways(
        lambda: track(craft, controller, rate=RATE, sensors=slow, rng=np.random.default_rng(3))
    )
    same(ours, plain)
    if errors == {"noise_sigma": 1e-3}:
        assert ours.saturated


@pytest.mark.usefixtures("must_be_compiled")
def test_redundant_wheels_at_their_limit(crafts, both_ways):
    """Four wheels share their torque by a search, which is left to the plain way sample by sample."""
    craft = crafts["two arms"]
    same(*both_ways(lambda: track(craft, law(craft, gains(9, 4.0, 4.0), far=1.5), rate=RATE)))
    limited = with_errors(craft, noise_sigma=2e-2)
    ours, plain = both_ways(
        lambda: track(
            craft, law(craft, gains(9, 4.0, 4.0)), rate=RATE, sensors=limited, rng=np.random.default_rng(1)
        )
    )
    same(ours, plain)
    assert any("torque" in name for name in ours.saturated)


def test_euler_angles_and_rounded_attitudes_fly_the_plain_way(crafts):
    craft, k = crafts["paper"], gains(6, 4.0, 4.0)
    actuators = Actuators(craft, 1.0 / RATE)
    controller = law(craft, k, coordinates="euler")
    assert CompiledFlight.of(craft, controller, actuators, None, SECONDS, RATE, 1.0 / RATE) is None
    rounded = []
    for s in craft.description.effective_sensors():
        errors = {q: e.model_copy(update={"quantisation": 1e-4}) for q, e in s.errors.items()}
        rounded.append(s.model_copy(update={"errors": errors}))
    sensed = SensedState(craft, rounded, SECONDS, RATE, np.random.default_rng(0))
    assert sensed.table(np.arange(3) / RATE) is None


def test_errors_are_those_of_the_plain_way(crafts, both_ways):
    """An attitude error near half a turn, and a loop that blows up."""
    craft, k = crafts["paper"], gains(6, 4.0, 4.0)
    start = craft.home.copy()
    start[3:7] = [0.0, 0.0, 1.0, 0.0]

    def lost():
        with pytest.raises(ControlError, match="The attitude error is 180"):
            track(craft, law(craft, k), rate=RATE, start=start)

    def wild():
        with pytest.raises(SimulationError, match="blew up at t =") as caught:
            track(craft, law(craft, gains(6, 1e200, 1e200)), rate=RATE, limits=False)
        return caught.value.evidence["time"]

    both_ways(lost)
    ours, plain = both_ways(wild)
    assert ours == plain


def test_flights_in_threads_are_those_alone(crafts, robust):
    craft, (k, wanted) = crafts["paper"], robust
    laws = [law(craft, k, wanted, seed=s) for s in range(5)]
    options = {"rate": RATE, "sensors": with_errors(craft, noise_sigma=1e-3)}
    together = track_many(
        craft, laws, generators=[np.random.default_rng(s) for s in range(5)], workers=2, **options
    )
    for seed, found in enumerate(together):
        alone = track(craft, laws[seed], rng=np.random.default_rng(seed), **options)
        np.testing.assert_array_equal(found.q, alone.q)
        assert found.saturated == alone.saturated
