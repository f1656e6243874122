"""Which strong causes are tried, and how many."""

from types import SimpleNamespace

import pytest

from smsid.diagnose import _strong_causes as strong_causes
from smsid.diagnose._strong_causes import coarse_cause
from smsid.errors import SimulationError


@pytest.mark.parametrize(
    ("follow", "tried"),
    [
        ("ABCDEF", "AC"),  # what is far behind is not tried, another law of the best one's effect is
        ("CDEF", "ABC"),
        ("EF", "ABCDE"),  # of an encoder's bias, fifth, the first three of six did not follow
        ("", "ABCDEF"),
    ],
)
def test_which_strong_causes_are_fitted(monkeypatch, follow, tried):
    """By their worth where each is likeliest; laws of one effect differ by where they were begun."""
    worth = {"A": 100.0, "B": 70.0, "C": 60.0, "D": 50.0, "E": 40.0, "F": 30.0}
    every = [
        SimpleNamespace(name=n, key=("friction", "joint2", n) if n in "AC" else ("gain", f"joint {n}", n))
        for n in worth
    ]
    asked = []

    def fitted(candidate, *_):
        asked.append(candidate.name)
        fit = SimpleNamespace(objective=-worth[candidate.name], name=candidate.name)
        return (fit, ()) if candidate.name in follow else None

    for name, stub in {
        "thin_problem": lambda problem, rate: problem,
        "replace": lambda x, **_: x,
        "_starts": lambda point, candidates, _: [(c, c) for c in candidates],
        "_linear_starts": lambda *_: [],
        "_likelihood": lambda at, _: worth.get(getattr(at, "name", ""), 0.0),
        "_as_likely_as_can_be": lambda at, c, _, likely: (likely, at),
        "_fit_with_less_process_noise": fitted,
        "evaluate": lambda *_: (_ for _ in ()).throw(SimulationError("enough")),
        "loosen_model": lambda *_: None,
    }.items():
        monkeypatch.setattr(strong_causes, name, stub)
    point = SimpleNamespace(model=lambda: None)
    assert coarse_cause(point, SimpleNamespace(parts=(), shift=0.0), (), every) is None
    assert "".join(asked) == tried
