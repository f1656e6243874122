"""The same question asked through `identify` and through `diagnose`: one problem, one answer."""

import sys

import numpy as np
import pytest

from smsid.description import load_description
from smsid.diagnose import diagnose
from smsid.diagnose.hypotheses import propose
from smsid.effects import JointFriction
from smsid.estimation.flight import FlightOptions
from smsid.estimation.identify_flights import identify_flights
from smsid.estimation.initial_state import InitialPrior
from smsid.estimation.problem import ProcessNoise
from smsid.experiments import fly, named_experiment
from smsid.model import build_model

from .test_small_craft import TOML, URDF

PANEL = """
[[effect]]
kind = "modal_appendage"
name = "panel"
position = [0.4, 0.0, 0.0]
mass = 1.5
center_of_mass = [0.75, 0.0, 0.0]
inertia = [0.03, 0.0, 1.13, 0.0, 0.0, 1.16]
prior = { "mode1.frequency" = 0.01, "mode1.damping" = 0.001 }
known = ["mode1.translation", "mode1.rotation"]
[[effect.mode]]
frequency = 0.45
damping = 0.01
translation = [0.0, 0.0, 0.95]
rotation = [0.0, -1.02, 0.0]
"""
BIASES = """preset = "reference"
errors.angular_rate = { noise_sigma = 1e-5, bias_sigma = 1e-2 }
errors.acceleration = { noise_sigma = 1e-4, bias_sigma = 5e-2 }
"""
WHOLE = sys.modules["smsid.diagnose.diagnose"]  # its function has the same name


@pytest.fixture(scope="module")
def description(tmp_path_factory):
    folder = tmp_path_factory.mktemp("small")
    head, _, rest = TOML.partition("[[effect]]")
    toml = head + PANEL + rest[rest.index("[[sensor]]") :]
    imu = 'kind = "imu"\n'
    (folder / "small.toml").write_text(toml.replace(imu + 'preset = "reference"\n', imu + BIASES))
    (folder / "small.urdf").write_text(URDF)
    return load_description(folder / "small.toml")


def test_a_cause_is_as_far_and_as_well_known_as_identified_from_what_was_written(description, monkeypatch):
    model = build_model(description.with_effects(JointFriction(name="seal", joint="shoulder", viscous=0.2)))
    plan = named_experiment("exp2", model).model_copy(update={"duration": 8.0})
    recording = fly(model, plan, np.random.default_rng(0)).recording
    monkeypatch.setattr(WHOLE, "propose", lambda *x: [c for c in propose(*x) if c.shape == "viscous"])
    asked = diagnose(description, [recording], rate=100.0)
    assert asked.diagnosis.verdict == "explained" and asked.search is not None
    last = asked.search.last
    sigma = dict(zip((u.name for u in last.unknowns), np.sqrt(np.diag(last.covariance())), strict=True))
    known = InitialPrior(hidden=ProcessNoise().hidden, position=0.1)
    options = FlightOptions(drive="command", initial=known)
    found = identify_flights(asked.extended, [recording], cad=0.01, options=options).found
    spread = np.sqrt(np.diag(np.linalg.inv(found.gram))) * found.scales
    own = {u.name.removeprefix("exp2: "): (u, s) for u, s in zip(found.unknowns, spread, strict=True)}
    # how the motion begins is a parameter here, and in the covariance of the first state there
    assert {n for n in own if not n.startswith("start.")} == set(sigma)
    told = {f"{e.name}.{field}": s for e in asked.extended.effect for field, s in e.prior.items()}
    assert any(n.endswith("viscous") for n in told), "what was written says how well it is known"
    for unknown in last.unknowns:
        theirs, size = own[unknown.name]
        size = (size**-2 - told.get(unknown.name, np.inf) ** -2) ** -0.5  # less what the prior tells again
        off = (last.point.value(unknown) - found.point.value(theirs)) / size
        within = 0.15 if unknown.kind == "inertial" else 0.05  # single inertias are mostly their priors'
        assert abs(off) < 0.3 and abs(sigma[unknown.name] / size - 1.0) < within, unknown.name


def test_of_what_was_found_the_rest_is_known(description, monkeypatch):
    friction = JointFriction(name="seal", joint="shoulder", viscous=0.2)
    model = build_model(description.with_effects(friction))
    plan = named_experiment("exp2", model).model_copy(update={"duration": 4.0})
    recording = fly(model, plan, np.random.default_rng(0)).recording
    monkeypatch.setattr(WHOLE, "propose", lambda *x: [c for c in propose(*x) if c.shape == "viscous"])
    written = diagnose(description, [recording]).extended
    found = next(e for e in written.effect if e.kind == "joint_friction")
    assert [p.name.rpartition(".")[2] for p in found.unknowns()] == ["viscous"]
    assert all(not e.unknowns() for e in written.effect if e.kind == "body_error")
