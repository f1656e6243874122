"""A MuJoCo spacecraft with a moving arm and a beam panel, bodies and panel stated with priors."""

import numpy as np
import pytest

from smsid.description import load_description
from smsid.estimation.bodies import parse_combination
from smsid.estimation.identify_flights import identify_flights
from smsid.estimation.inertial_combinations import whole_bodies
from smsid.model import build_model
from smsid.model.regressor import INERTIAL_NAMES, body_names
from tests.hidden.description import write_description
from tests.hidden.experiment import commands
from tests.hidden.flight import recording
from tests.hidden.numbers import PANEL, draw, nominal

pytest.importorskip("mujoco")


def with_priors(description, stated):
    """Return the description whose effects have the priors that are stated."""
    effects = []
    for effect in description.effect:
        own = {p.name.removeprefix(f"{effect.name}."): p.name for p in effect.parameters()}
        prior = {short: stated[name][1] for short, name in own.items() if name in stated}
        effects.append(effect.model_copy(update={"prior": prior}))
    return description.model_copy(update={"effect": tuple(effects)})


@pytest.mark.slow
def test_bodies_and_panel_are_found_together(tmp_path):
    """What is stated of the bus is of the bus alone; the panel's density is the whole panel's."""
    rng = np.random.default_rng(0)
    true = draw(PANEL, rng)
    made = recording(true, commands("panel", 0, 40.0), rng, name="panel")
    (tmp_path / "true").mkdir()
    description = load_description(write_description(PANEL, tmp_path))
    truth = build_model(load_description(write_description(true, tmp_path / "true")))
    stated = {p.name: (p.value, p.sigma) for p in nominal(PANEL)}
    bodies = {n: x for n, x in stated.items() if n.split(".")[0] in PANEL.body}
    found = identify_flights(with_priors(description, stated), [made], cad=bodies)
    assert found.quality.judgement == "explained" and found.quality.widening == 1.0
    rows = zip(body_names(truth.pin), whole_bodies(truth).reshape(-1, 10), strict=True)
    values = {f"{b}.{s}": x for b, theta in rows for s, x in zip(INERTIAL_NAMES, theta, strict=True)}
    off = []
    for p in found.estimate.parameters:
        terms = parse_combination(p.name)
        if terms and set(terms) <= set(values):
            off.append((p.value - sum(f * values[n] for n, f in terms.items())) / p.sigma)
    density = found.estimate["panel.linear_density"]
    wing = next(e for e in truth.description.effect if e.name == "panel")
    off += [(found.estimate["total.mass"].value - truth.mass) / found.estimate["total.mass"].sigma]
    off += [(density.value - wing.linear_density) / density.sigma]
    assert len(off) > 20
    assert max(map(abs, off)) < 4.0 and np.sqrt(np.mean(np.square(off))) < 1.4
    # a description that states another bus contradicts the recording
    other = {**bodies, "bus.Ixx": (bodies["bus.Ixx"][0] + 60.0, bodies["bus.Ixx"][1])}
    wrong = identify_flights(with_priors(description, stated), [made], cad=other)
    assert wrong.quality.judgement != "explained"
    assert "bus.Ixx" in dict(wrong.quality.conflict.parameters)
