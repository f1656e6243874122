"""What a cause has further is freed before another cause is named for what it does."""

import pytest

from smsid.diagnose import model_comparison
from smsid.diagnose.model_comparison import with_further
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
        return with_causes(nominal, candidates, [LOAD])

    return found


def test_the_place_of_a_payload_is_freed(loaded, monkeypatch):
    freed = model_comparison._fit_further_parameters
    monkeypatch.setattr(model_comparison, "_fit_further_parameters", lambda found, candidate: found)
    causes, current = loaded(PLACE)
    monkeypatch.setattr(model_comparison, "_fit_further_parameters", freed)
    larger = with_further(current, causes)
    assert larger is not None and larger.objective < current.objective - 0.5 * 3 * 7.0
    names = {u.name for u in larger.unknowns} - {u.name for u in current.unknowns}
    assert names == {f"payload_tool.com.{axis}" for axis in "xyz"}
    assert with_further(larger, causes) is None, "nothing is left to free"


def test_nothing_is_freed_that_does_not_pay(loaded, monkeypatch):
    causes, current = loaded((0.0, 0.0, 0.0))
    monkeypatch.setattr(model_comparison, "fit", lambda *_, **__: pytest.fail("it was tried"))
    assert with_further(current, causes) is None


def test_nothing_is_freed_to_what_cannot_be(loaded, monkeypatch):
    causes, current = loaded(PLACE)
    monkeypatch.setattr(model_comparison, "impossible_fit", lambda *_: "it is too far away")
    assert with_further(current, causes) is None
