"""What a cause has further is freed before another cause is named for what it does."""

from dataclasses import replace

import pytest

from smsid.diagnose import nested_parameters as further
from smsid.diagnose.model_comparison import DetectionThresholds
from smsid.diagnose.nested_parameters import free_nested, free_nested_before_adding
from smsid.diagnose.score_test import odds, scored, signatures
from smsid.effects import Payload
from tests.diagnose.test_exchange_step import paired, with_causes

LOAD, LINK = ("payload", "tool", "payload"), ("body_error", "link3", "inertia")
PLACE = (0.1, 0.3, -0.2)  # [m]


@pytest.fixture(scope="module")
def loaded(description, known):
    """A payload beside the tool's frame, found as one in it; and its place."""

    def found(place):
        truth = Payload(kind="payload", name="load", frame="tool", mass=4.0, com=place)
        nominal, candidates = paired(known, description.with_effects(truth), ("payload", "body_error"))
        causes, current = with_causes(nominal, candidates, [LOAD])
        return causes, current, [c for c in candidates if c.key == LINK]

    return found


def test_the_place_of_a_payload_is_freed_before_a_link_is_blamed(loaded, monkeypatch):
    monkeypatch.setattr("smsid.diagnose.model_comparison._with_more", lambda found, candidate: found)
    causes, current, link = loaded(PLACE)
    (best,) = scored(current, link, list(signatures(current, link).values()))
    larger = free_nested_before_adding(current, causes, replace(best, ratio=1.0), DetectionThresholds())
    assert larger is not None
    names = {u.name for u in larger.unknowns} - {u.name for u in current.unknowns}
    assert names == {f"payload_tool.com.{axis}" for axis in "xyz"}
    gained = odds(2.0 * (current.objective - larger.objective), 3, current.run.samples)
    assert gained > 0.0
    for lead, none in ((6.0, False), (7.0, True)):  # the link's inertia is likelier by so much
        high = next(
            r / 10
            for r in range(10, 100_000)
            if odds(r / 10, best.freedom, current.run.samples) > gained + lead
        )
        assert (
            free_nested_before_adding(current, causes, replace(best, ratio=high), DetectionThresholds())
            is None
        ) is none
    assert free_nested(larger, causes) is None, "nothing is left to free"


def test_nothing_is_freed_that_does_not_pay(loaded, monkeypatch):
    monkeypatch.setattr("smsid.diagnose.model_comparison._with_more", lambda found, candidate: found)
    causes, current, _ = loaded((0.0, 0.0, 0.0))
    tried = []
    monkeypatch.setattr(further, "fit", lambda *args, **kwargs: tried.append(1))
    assert free_nested(current, causes, 6.6) is None and not tried
