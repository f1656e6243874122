"""The gain of a diagnosis is that of the causes it names: hints, which are no causes, gain nothing."""

import sys

import numpy as np
import pytest

from smsid.diagnose import diagnose
from smsid.diagnose.hypotheses import propose
from smsid.effects import JointFriction
from smsid.experiments import fly, named_experiment
from smsid.model import build_model

WHOLE = sys.modules["smsid.diagnose.diagnose"]  # its function has the same name


@pytest.fixture(scope="module")
def flights(description):
    """A flight to be searched and one that is held out, with a joint that drags."""
    model = build_model(description.with_effects(JointFriction(name="seal", joint="joint2", viscous=2.0)))
    plan = named_experiment("exp2", build_model(description)).model_copy(update={"duration": 4.0})
    return [fly(model, plan, np.random.default_rng(seed)).recording for seed in (1, 2)]


@pytest.mark.parametrize(("stands", "gains"), [(True, True), (False, False)])
def test_hints_gain_nothing(description, flights, monkeypatch, stands, gains):
    def drags(*given):
        return [c for c in propose(*given) if c.shape == "viscous" and c.location != "joint3"]

    monkeypatch.setattr(WHOLE, "propose", drags)
    monkeypatch.setattr(WHOLE, "verdict", lambda *_: ("unexplained", "Something else is left."))
    monkeypatch.setattr(
        WHOLE,
        "find_standing_causes",
        lambda found, named: (found, tuple(c if stands else None for c in named)),
    )
    found = diagnose(description, flights[:1], validation=flights[1:])
    said, gain = found.diagnosis, found.diagnosis.gain
    assert len(said.causes) == stands and len(said.partial) == (not stands)
    assert any(e.kind == "joint_friction" for e in found.extended.effect) == stands
    assert gain is not None
    rates = next(c for c in gain.channels if c.channel == "encoder.joint_velocity")
    if gains:
        assert gain.whitened_extended < gain.whitened_nominal - 0.05 and rates.extended < rates.refitted
    else:
        assert gain.whitened_extended == gain.whitened_nominal and rates.extended == rates.refitted
