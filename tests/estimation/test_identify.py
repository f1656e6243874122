"""Which estimator takes a set of recordings."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from smsid.errors import NotIdentifiableError
from smsid.estimation import identify
from smsid.identify.estimate import Estimate


@pytest.mark.parametrize("evidence", ["marginal", "other_flight", None])
def test_marginal_combinations_go_to_the_filter_which_marks_them(evidence, monkeypatch):
    message = "The identifiable combinations change with the sensors' noise: l1.m."

    def raises(*_, **__):
        raise NotIdentifiableError(message, **({evidence: True} if evidence else {}))

    estimate = Estimate("x", "ml", (), notes=("first", "last"))
    quality = SimpleNamespace(judgement="explained")
    flights = SimpleNamespace(estimate=estimate, quality=quality, contradictions=())
    monkeypatch.setattr(identify, "wrong_columns", lambda *_: [])
    monkeypatch.setattr(identify, "by_the_paper", raises)
    monkeypatch.setattr(identify, "identify_flights", lambda *_, **__: flights)
    description = SimpleNamespace(effect=())
    if evidence is None:
        with pytest.raises(NotIdentifiableError):
            identify.identify_spacecraft(description, [])
        return
    found = identify.identify_spacecraft(description, [])
    assert found.flights is flights and message in found.estimate.notes[1]
