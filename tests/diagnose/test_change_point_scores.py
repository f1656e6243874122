"""What an effect explains from other times on: against refits there, of a flight in which it does begin."""

from dataclasses import replace

import numpy as np
import pytest

from smsid.diagnose._change_time_posterior import Starts
from smsid.estimation.map_estimate import fit
from smsid.estimation.measurements import measurements_of
from smsid.estimation.sensitivities import propagate
from smsid.experiments import fly, named_experiment
from smsid.model import build_model

from .test_change_time_posterior import begun

KEY = ("joint_friction", "joint1", "viscous")


@pytest.mark.parametrize("size", [0.4, 0.15])
def test_other_times_explain_what_refits_there_do(description, known, problem, size):
    _, late, k, _ = begun(known, problem, KEY, size)
    model = build_model(description.model_copy(update={"effect": (*description.effect, late)}))
    plan = named_experiment("exp2", build_model(description)).model_copy(update={"duration": 6.0})
    recording = fly(model, plan, np.random.default_rng(5)).recording
    data = measurements_of(known.point.base, recording, description.effective_sensors())
    first = begun(known, replace(problem, recording=recording, data=data), KEY, size)[0]
    found = fit(first.point, first.unknowns, first.problem, iterations=10)
    mine = found.point.description.get_effect(late.name)
    starts, times = Starts(found, mine), (2.6, 3.1, 3.4, 4.0, 5.9)
    gram, along, _ = starts.explained(times)
    unit = starts.size[k] * found.scales[k]
    lost = starts.ratios([mine.start]) - starts.ratios(times)
    for i, t in enumerate(times):
        point = found.point.with_effect(mine.model_copy(update={"start": t}))
        there = fit(point, found.unknowns, found.problem, iterations=10)
        assert lost[i] == pytest.approx(2.0 * (there.objective - found.objective), rel=0.01, abs=0.5)
        value, sigma = there.point.value(there.unknowns[k]), unit / np.sqrt(gram[i, i])
        if value > 0.0:  # its bound
            assert along[i] / gram[i, i] * unit == pytest.approx(value, abs=0.1 * sigma)
    assert lost.min() > 3.0 and lost[-1] > 50.0  # as good as without it


@pytest.mark.parametrize(
    "key",
    [
        KEY,
        ("joint_friction", "joint2", "load-dependent"),
        ("sensor_bias", "imu.angular_rate", "bias"),
        ("torque_gain", "joint2", "torque constant"),
        ("mass_loss", "bus", "mass loss"),
    ],
)
def test_what_is_cut_is_what_an_effect_of_that_start_does(known, problem, key):
    found, late, _, _ = begun(known, problem, key, 0.01)
    times = [1.0, 2.995, 3.2, 3.21, 4.4, 5.9]
    changes = [found.changes.effect(late, late.model_copy(update={"start": t}), 1.0) for t in times]
    changed = propagate(found.run, changes).reshape(-1, len(times))
    columns = Starts(found, late).columns(times)
    columns -= columns[:, [2]]  # less what it does as it is
    assert np.abs(changed).max() > 1e-6
    np.testing.assert_allclose(columns[: len(changed)], changed, atol=1e-12 * np.abs(columns).max())
