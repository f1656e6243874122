"""The paper's excitations: thrust (48), and Fourier series within limits."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.errors import ExperimentError
from smsid.experiments import fourier_experiment, limit_use, momentum_condition, thrust_experiment
from smsid.experiments.excitation import DRAFT
from smsid.model import build_model
from smsid.simulate import Tolerance, simulate

ONE = {"candidates": 1}


@pytest.mark.parametrize(
    ("t", "force"), [(0.0, 40), (19.99, 40), (20.0, -40), (39.99, -40), (40.0, 0), (120.0, 0)]
)
def test_thrust_is_equation_48(t: float, force: float):
    """40 N until t_f/6, -40 N until t_f/3, then none; at a switch the later value."""
    inputs = thrust_experiment("xyz").inputs()
    assert inputs.force is not None
    np.testing.assert_array_equal(inputs.force(t), [force] * 3)


@pytest.mark.parametrize(("axes", "expected"), [("x", [40, 0, 0]), ("zx", [40, 0, 40]), ("y", [0, 40, 0])])
def test_thrust_acts_along_the_axes_asked(axes: str, expected: list[float]):
    e = thrust_experiment(axes)
    assert e.hold_attitude and e.lock_joints and e.lock_wheels
    inputs = e.inputs()
    assert inputs.force is not None
    np.testing.assert_array_equal(inputs.force(1.0), expected)


def test_thrust_scales_with_force_and_duration():
    inputs = thrust_experiment("x", force=10.0, duration=60.0).inputs()
    assert inputs.force is not None
    assert [inputs.force(t)[0] for t in (9.9, 10.0, 19.9, 20.0)] == [10.0, -10.0, -10.0, 0.0]


@pytest.mark.parametrize("axes", ["", "w", "x y"])
def test_wrong_axes_are_told(axes: str):
    with pytest.raises(ExperimentError, match="letters of 'xyz'"):
        thrust_experiment(axes)


@pytest.fixture(scope="module", params=["one arm", "two arms"])
def flown(request, model, two_arms):
    spacecraft = model if request.param == "one arm" else two_arms
    return spacecraft, fourier_experiment(spacecraft, np.random.default_rng(3), **ONE)


def test_it_starts_at_rest_at_home(flown):
    model, found = flown
    motion = found.experiment.inputs().joint_motion
    home = model.joint_angles(model.home)
    np.testing.assert_allclose(motion.position(0.0), home, atol=1e-12)
    np.testing.assert_allclose(motion.velocity(0.0), 0.0, atol=1e-12)
    assert max(np.abs(motion.velocity(t)).max() for t in range(80)) > 0.01


def test_two_periods_fit(flown):
    """So that all signals come back to where they were in the middle."""
    _, found = flown
    inputs = found.experiment.inputs()
    assert inputs.joint_motion is not None and inputs.wheel_torque is not None
    for signal in (inputs.joint_motion.position, inputs.wheel_torque):
        np.testing.assert_allclose(signal(2.3), signal(42.3), atol=1e-9)


def test_limits_hold_on_a_finer_simulation(flown):
    """What was checked on a draft holds to a per cent when simulated to 1e-9 and looked at more closely."""
    model, found = flown
    assert not any(use.exceeded for use in found.limits)
    e = found.experiment
    trajectory = simulate(model, e.inputs(), e.duration, q0=e.start(model), tolerance=Tolerance(1e-9, 1e-11))
    fine = limit_use(model, trajectory.states(np.linspace(0, e.duration, 800)))
    assert [u.quantity for u in fine] == [u.quantity for u in found.limits]
    for use in fine:
        assert use.limit is None or use.value < 1.01 * use.limit, use


def test_the_seed_gives_it_back(flown):
    """Excitation and condition number, to the last digit."""
    model, found = flown
    again = fourier_experiment(model, np.random.default_rng(3), **ONE)
    assert again.experiment == found.experiment
    assert again.condition == found.condition
    other = fourier_experiment(model, np.random.default_rng(4), **ONE)
    assert other.condition != found.condition


def test_condition_is_that_of_the_regressor(flown):
    """Computed again from the states of a fresh simulation at the same tolerance."""
    model, found = flown
    e = found.experiment
    s = simulate(model, e.inputs(), e.duration, q0=e.start(model), tolerance=DRAFT).states(
        np.linspace(0.0, e.duration, int(4 * e.duration) + 1)
    )
    assert momentum_condition(model, s.q, s.v) == pytest.approx(found.condition, rel=1e-9)


def test_the_best_of_several_is_kept(model):
    """The first draw is among them, so more candidates cannot do worse."""
    one = fourier_experiment(model, np.random.default_rng(5), candidates=1)
    several = fourier_experiment(model, np.random.default_rng(5), candidates=3)
    assert several.condition <= one.condition


def test_impossible_limits_are_told(model):
    """Wheels that may hardly turn, asked for a hundred times that."""
    d = model.description
    weak = tuple(w.model_copy(update={"max_torque": 1e-3, "max_rate": 1e-2}) for w in d.wheel)
    with pytest.raises(ExperimentError, match=r"No candidate respects the limits: .*of wheel_") as caught:
        fourier_experiment(
            build_model(d.model_copy(update={"wheel": weak})),
            np.random.default_rng(0),
            wheel_share=100.0,
            **ONE,
        )
    assert all(use.exceeded for use in caught.value.evidence["limits"])


def test_nothing_to_move_is_told(two_arms):
    d = two_arms.description
    sensors = tuple(s for s in d.sensor if s.kind not in ("encoder", "tachometer"))
    bare = d.model_copy(update={"arm": (), "wheel": (), "sensor": sensors})
    with pytest.raises(ExperimentError, match="needs wheels or arm joints"):
        fourier_experiment(build_model(bare), np.random.default_rng(0))
