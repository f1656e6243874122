"""The benchmark that kills commands knows every command that writes."""

from __future__ import annotations

import sys
from pathlib import Path

from smsid.cli.places import output_marks

from .test_places import FUNCTIONS

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
try:
    import kills
finally:
    sys.path.pop(0)

LEFT_OUT = {
    "demo",  # a minute of commands that are killed singly
    "lab fetch",  # of the network
}


def test_every_command_that_writes_is_killed():
    writing = {words for words, function in FUNCTIONS if output_marks(function)} | {"new"}
    assert writing - LEFT_OUT - set(kills.CALLS) == set()
    assert all(name.partition(" -")[0] in writing for name in kills.CALLS)
