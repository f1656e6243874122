"""How a search went is told by one measure: the sum of squares by the noise at its end."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.likelihood import Nuisance, refine
from smsid.likelihood.fit import fit, history_of
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.point import Evaluation, SearchPoint
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import piece_of
from smsid.model import build_model

from . import twin
from .test_refine import off


def test_costs_are_those_of_the_points_visited():
    model = build_model(off())
    piece, local = piece_of(model, twin.noisy(twin.exp1((1, 1, 1), 30.0), 0), Nuisance())
    start = SearchPoint(Parameters.of(model), (local,))
    prior = Prior(start.parameters)
    found = fit([piece], start, prior)
    assert sum(c.dropped for c in found.pieces[0].channels) == 0
    sigma = np.sqrt(np.diag(found.normal.covariance()))[: start.parameters.size]
    history = history_of(found.visits, found.pieces, found.samples, sigma)
    assert len(history) == found.iterations + 1
    assert history[0].cost * found.samples == pytest.approx(
        Evaluation.at(found.pieces, start).cost(found.pieces, prior), rel=1e-9
    )
    assert history[-1].cost * found.samples == pytest.approx(found.cost, rel=1e-9)
    assert history[-1].cost == min(x.cost for x in history)
    assert history[0].step is None
    # the way from start to end is the sum of the steps: bus and links have nowhere else to go
    walked = np.sum([v.step for v in found.visits if v.step is not None], axis=0)
    known = {s.name: np.log(s.value) for s in found.point.parameters.scalars if s.log}
    first = {s.name: np.log(s.value) for s in start.parameters.scalars if s.log}
    own = [s.name for s in start.parameters.scalars]
    for name, value in known.items():
        step = walked[start.parameters.inertias.size + own.index(name)]
        assert value - first[name] == pytest.approx(step, rel=1e-6, abs=1e-12)


def test_a_search_that_begins_again_with_another_clock_keeps_both():
    recording = twin.noisy(twin.exp1((1, 1, 1), 60.0), 0)
    late = {
        n: (recording.time(n) + (0.03 if n.startswith("pose.") else 0.0), recording[n])
        for n in recording.channels
    }
    labels = {"joint": list(twin.model().arm_joints.names), "wheel": list(twin.model().wheels.names)}
    changed = type(recording).from_arrays(None, late, labels=labels, role="estimation", name="exp1")
    history = refine(off(), [changed]).estimate.history
    assert sum(x.step is None for x in history) > 1
    assert history[-1].cost == min(x.cost for x in history)
