"""Laws beside the plain ones are named by themselves: each hidden in a short flight of the paper's craft."""

import numpy as np
import pytest

from smsid.diagnose import diagnose
from smsid.effects import catalogue
from smsid.experiments import fly, named_experiment
from smsid.model import build_model

HIDDEN = {
    "quadratic drag": ("joint_friction", {"joint": "joint2", "quadratic": 3.0}),
    "cable": ("joint_cable", {"joint": "joint2", "stiffness": 0.5, "rest": 0.4}),
}


@pytest.mark.slow
@pytest.mark.parametrize("shape", HIDDEN)
def test_a_law_is_named(description, shape):
    """Not as a simpler one, which leaves clearly more."""
    kind, fields = HIDDEN[shape]
    effect = catalogue()[kind].model_validate({"kind": kind, "name": "hidden", **fields})
    model = build_model(description.with_effects(effect))
    plan = named_experiment("exp2", build_model(description)).model_copy(update={"duration": 8.0})
    recording = fly(model, plan, np.random.default_rng(1)).recording
    found = diagnose(description, [recording]).diagnosis
    assert found.verdict == "explained", found.sentence
    (cause,) = found.causes
    assert (cause.effect, cause.location, cause.fitted) == (kind, "joint2", shape)
    first = cause.parameters[0]
    assert abs(first.value - fields[first.name.partition(".")[2]]) < 3.0 * first.sigma
