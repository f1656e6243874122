"""Thrust that switches between samples of its command is no cause."""

import numpy as np
import pytest

from smsid.diagnose import diagnose
from smsid.experiments import fly, named_experiment
from smsid.model import build_model


@pytest.fixture(scope="module")
def between(description):
    """Thrust that switches 3 ms and 7 ms after samples, the attitude free."""
    plan = named_experiment("exp1", build_model(description))
    force = plan.force.model_copy(update={"times": (0.0, 5.003, 10.007)})
    changed = {"duration": 15.0, "force": force, "hold_attitude": False}
    return fly(build_model(description), plan.model_copy(update=changed), np.random.default_rng(3)).recording


def test_nothing_is_found(description, between):
    """A thruster turned by 2.5 rad and a thermal snap were, in a flight like this."""
    found = diagnose(description, [between]).diagnosis
    assert found.verdict == "adequate", found.sentence
    assert not found.causes
    assert any("jumping between samples" in n for n in found.notes)
