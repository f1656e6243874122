"""A beam's next mode: its first-order signature against the filter on the whole model, and its search."""

from dataclasses import replace

import numpy as np
import pytest

from smsid.diagnose._truncated_mode import OFF, STEPS
from smsid.diagnose.hypotheses import higher_modes, propose
from smsid.diagnose.priors import nominal
from smsid.diagnose.score_test import score_candidates, signatures
from smsid.effects import BeamMode
from smsid.estimation.map_estimate import evaluate
from smsid.estimation.sensitivities import propagate


@pytest.fixture(scope="module")
def candidate(known, calm):
    return next(higher_modes(known.point, calm))


def test_signature_is_what_a_little_of_the_mode_does(known, calm, plain, candidate):
    """Innovations with a thousandth of mode 4, over the thousandth; its stations see it."""
    off, damping, small = 0.03, 0.02, 1e-3
    (column,) = candidate._columns(plain.changes, [(off, damping)])
    predicted = propagate(plain.run, [column])[:, :, 0] / STEPS[0]
    mode = BeamMode(name="more", appendage="panel", mode=4, factor=small, frequency=off, damping=damping)
    with_mode = evaluate(known.point.with_effect(mode), known.unknowns[:1], calm)
    seen = -(with_mode.run.innovations - plain.run.innovations) / small
    assert np.linalg.norm(seen - predicted) < 0.05 * np.linalg.norm(seen)
    panel = next(b for b in calm.data.blocks if b.channel == "panel.acceleration").rows
    assert np.linalg.norm(seen[:, panel]) > 0.5 * np.linalg.norm(seen)


def test_it_is_found_beside_the_frequencies_that_are_tried(known, calm, candidate):
    """A mode two and a half per cent off, between two of the first grid: the finer ones settle on it."""
    off = float(OFF[10] + 0.5 * (OFF[11] - OFF[10]))
    truth = BeamMode(name="true", appendage="panel", mode=4, factor=0.3, frequency=off)
    there = evaluate(known.point.with_effect(truth), known.unknowns[:1], calm)
    plain = evaluate(known.point, known.unknowns[:1], calm)
    # what the model without the mode leaves of data that have it, to first order
    run = replace(plain.run, innovations=plain.run.innovations - there.run.innovations)
    found = replace(plain, run=run)
    (score,) = score_candidates(found, [candidate], [signatures(found, [candidate])[0]])
    effect = score.candidate.effect
    assert isinstance(effect, BeamMode)
    assert effect.frequency == pytest.approx(off, abs=2e-3)
    assert score.estimate[0] * STEPS[0] == pytest.approx(0.3, rel=0.3)
    assert score.candidate.grid > len(OFF)


def test_it_is_sought_about_the_fitted_beam(known, calm, plain, candidate):
    """A stiffer beam than described has a faster next mode."""
    beam = known.point.description.get_effect("panel")
    stiffer = known.point.with_effect(beam.model_copy(update={"youngs_modulus": 1.1 * beam.youngs_modulus}))
    there = evaluate(stiffer, known.unknowns[:1], calm)
    faster = candidate._at(there.changes)
    assert faster.mode.frequency == pytest.approx(np.sqrt(1.1) * candidate.mode.frequency)
    assert candidate._at(plain.changes).mode == candidate.mode


def test_a_description_that_has_one_can_be_diagnosed(description, calm):
    """Its joint is no body whose mass would be asked for; how large it is, how fast, and how damped is."""
    more = BeamMode(name="more", appendage="panel", mode=4, factor=0.9, damping=0.004)
    found = nominal(description.with_effects(more), None)
    assert all(u.sigma > 0.0 and u.scale > 0.0 for u in found.unknowns)
    mine = {u.name: u.sigma for u in found.unknowns if u.name.startswith("more.")}
    assert mine == pytest.approx({"more.factor": 0.09, "more.frequency": 0.1, "more.damping": 4e-4})
    assert next(u for u in found.unknowns if u.name == "tank.mass").positive
    shifts = [c for c in propose(found.point, calm, found.unknowns) if c.location == "more"]
    assert {c.shape for c in shifts} == {"size", "frequency", "damping"}


def test_only_where_it_is_seen(known, calm):
    """Not without accelerometers on the beam, and not where it swings faster than is looked."""
    assert list(higher_modes(known.point, replace(calm, data=calm.data.thinned(5.0)))) == []
    blind = known.point.description.model_copy(
        update={"sensor": tuple(s for s in known.point.description.sensor if s.kind != "accelerometers")}
    )
    assert list(higher_modes(replace(known.point, description=blind), calm)) == []


def test_which_are_missing(known, calm):
    """The next two, as long as they are looked at often enough; not one that is there as an effect."""

    def numbers(point, rate):
        return [c.number for c in higher_modes(point, replace(calm, data=calm.data.thinned(rate)))]

    assert numbers(known.point, 25.0) == [4, 5]
    assert numbers(known.point, 10.0) == [4]
    has = known.point.with_effect(BeamMode(name="more", appendage="panel", mode=4))
    assert numbers(has, 25.0) == [5, 6]
