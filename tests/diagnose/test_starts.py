"""What an effect explains from other times on: against refits there, of a flight in which it does begin."""

from dataclasses import replace

import numpy as np
import pytest

from smsid.diagnose.channels import measured
from smsid.diagnose.fit import fit
from smsid.diagnose.starts import Starts
from smsid.experiments import fly, named_experiment
from smsid.model import build_model

from .test_began import begun

KEY = ("joint_friction", "joint1", "viscous")


@pytest.mark.parametrize("size", [0.4, 0.15])
def test_other_times_explain_what_refits_there_do(description, known, problem, size):
    _, late, k, _ = begun(known, problem, KEY, size)
    model = build_model(description.model_copy(update={"effect": (*description.effect, late)}))
    plan = named_experiment("exp2", model).model_copy(update={"duration": 6.0})
    recording = fly(model, plan, np.random.default_rng(5)).recording
    data = measured(known.point.base, recording, description.effective_sensors())
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
