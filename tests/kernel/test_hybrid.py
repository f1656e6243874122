"""Predictions by the compiled kernel and the plain way: the free part under prescribed joints and thrust."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.errors import SimulationError
from smsid.likelihood import prediction
from smsid.likelihood.inputs import DrivenMotion, ThrustHistory
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prediction import predict
from smsid.likelihood.spline import DerivativeSamples, fit_motion
from smsid.likelihood.time_grid import Timeline
from smsid.model import SpacecraftModel, build_model

STOP = 4.0
GRID = Timeline.of(0.0, STOP, [1.5], 0.05)
QUANTITIES = ("q", "v", "a")


def moving(model: SpacecraftModel, group, seed: int):
    """Return a smooth motion of a group of joints."""
    if not len(group):
        return None
    rng = np.random.default_rng(seed)
    times = np.linspace(0.0, STOP, 401)
    values = 0.4 * np.sin(np.outer(times, 1.0 + np.arange(len(group)))) + rng.uniform(-0.5, 0.5, len(group))
    return fit_motion([DerivativeSamples(0, times, values, np.full(len(group), 1e-6))], 0.0, STOP, 100.0, 0.1)


def drive(model: SpacecraftModel, *, held: bool) -> DrivenMotion:
    """Return prescribed joints and wheels, thrust that jumps, the rest free (attitude unless held)."""
    locked = {int(i) for i in (*model.arm_joints.v, *model.wheels.v)} | ({3, 4, 5} if held else set())
    free = np.array([i for i in range(model.nv) if i not in locked])
    force = np.array([[5.0, -2.0, 1.0, 0.3, 0.2, -0.4], [-1.0, 4.0, 2.0, -0.2, 0.5, 0.1]])
    thrust = ThrustHistory(np.array([0.0, 1.5]), force, steps=True)
    joints, wheels = moving(model, model.arm_joints, 1), moving(model, model.wheels, 2)
    return DrivenMotion(free, model.home.copy(), held, thrust, joints, wheels)


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("name", ["paper", "two arms", "sliding", "satellite"])
def test_predictions_are_the_plain_ones(name, held, crafts, both_ways):
    model = crafts[name]
    if model.pin.gravity.linear.any():  # predictions are for craft without weight
        model = build_model(model.description.model_copy(update={"gravity": (0.0, 0.0, 0.0)}))
    parameters, own = Parameters.of(model), drive(model, held=held)
    start = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])
    compiled, plain = both_ways(lambda: predict(parameters, own, GRID, *start))
    for x in QUANTITIES:
        expected = getattr(plain, x)
        assert np.abs(expected).max() > 1e-3
        error = np.abs(getattr(compiled, x) - expected).max() / np.abs(expected).max()
        assert error < 1e-10


def test_a_motion_that_is_not_finite_is_refused_at_the_same_time(crafts, both_ways):
    model = crafts["paper"]
    own = drive(model, held=False)
    assert own.thrust is not None
    endless = own.thrust.values.copy()
    endless[1, 3:] = np.inf
    own = DrivenMotion(
        own.free, own.home, False, ThrustHistory(own.thrust.times, endless, True), own.joints, own.wheels
    )

    def refused() -> tuple[str, float]:
        with pytest.raises(SimulationError, match="not finite") as error:
            predict(Parameters.of(model), own, GRID, np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0]))
        return error.value.message, error.value.evidence["time"]

    compiled, plain = both_ways(refused)
    assert compiled == plain
    assert compiled[1] == 1.5


@pytest.mark.parametrize("steps", [1, 7, 40])
def test_a_motion_predicted_in_parts_is_the_same(steps, crafts, monkeypatch):
    """Parts that end inside of segments, and at the jump of the thrust (30 steps, then 50)."""
    model = crafts["paper"]
    parameters, own = Parameters.of(model), drive(model, held=False)
    start = np.ones(3), np.array([0.0, 0.6, 0.0, 0.8])
    whole = predict(parameters, own, GRID, *start)
    monkeypatch.setattr(prediction, "PART", steps)
    parts = predict(parameters, own, GRID, *start)
    for x in QUANTITIES:
        np.testing.assert_allclose(
            getattr(parts, x), getattr(whole, x), atol=1e-12 * np.abs(getattr(whole, x)).max()
        )
