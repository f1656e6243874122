"""What a search found in words: when it is an explanation, and when pieces of something else."""

from types import SimpleNamespace

import pytest

from smsid.diagnose.result import FoundCause
from smsid.diagnose.verdict import verdict

WHOLE = SimpleNamespace(left=(), misfit=False)


def cause(family, location, onset):
    return FoundCause(f"an effect of {family}", location, family, "shape", (), (), {}, onset=onset)


@pytest.mark.parametrize(
    ("second", "decided"),
    [
        (("actuator", "joint3", 8.9), "unexplained"),
        (("actuator", "joint2", 58.2), "explained"),  # at once
        (("actuator", "joint3", None), "explained"),
        (("inertia", "tool", 8.9), "explained"),  # a payload is grasped, later a motor weakens
    ],
)
def test_causes_of_a_family_that_begin_in_turn_are_pieces_of_a_drift(second, decided):
    found = (cause("actuator", "joint2", 58.4), cause(*second))
    said, sentence = verdict(WHOLE, found)
    assert said == decided
    assert "joint2" in sentence and ("drift" in sentence) == (said == "unexplained")
    assert verdict(WHOLE, found[:1])[0] == "explained"
