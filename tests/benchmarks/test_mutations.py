"""The planted mutations: each one's line is where it is said to be, and so are its tests."""

from __future__ import annotations

import builtins
import io
import keyword
import sys
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))

from mutations import mutations, planted  # noqa: E402

MUTATIONS = mutations()


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda m: m.what)
def test_a_mutation_can_be_planted_and_is_valid_python(mutation):
    text = (ROOT / mutation.path).read_text(encoding="utf-8")
    compile(planted(mutation, text), mutation.path, "exec")
    assert all((ROOT / test).exists() for test in mutation.tests)


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda m: m.what)
def test_a_mutation_is_another_decision_and_no_name_that_is_not_there(mutation):
    """That one would be noticed by any test, whatever it asks."""
    names = names_in(mutation.after) - names_in((ROOT / mutation.path).read_text(encoding="utf-8"))
    assert names <= {*keyword.kwlist, *dir(builtins)}


@pytest.mark.parametrize("test", sorted({test for m in MUTATIONS for test in m.tests}))
def test_nothing_that_ought_to_notice_one_is_slow(test):
    """Mutations are planted for the ordinary tests: what is marked slow would notice none."""
    file = ROOT / test.partition("::")[0]
    for path in file.rglob("*.py") if file.is_dir() else [file]:
        assert "mark.slow" not in path.read_text(encoding="utf-8"), path


def names_in(text: str) -> set[str]:
    """Return the names in a piece of Python, which need not be whole."""
    found = set()
    try:
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            found |= {token.string} if token.type == tokenize.NAME else set()
    except (tokenize.TokenError, IndentationError):  # a bracket or a block that goes on
        pass
    return found


def test_half_of_them_are_of_decisions():
    assert len(MUTATIONS) >= 50
    assert len({m.what for m in MUTATIONS}) == len(MUTATIONS)
    decisions = [m for m in MUTATIONS if m.group in ("diagnosis", "tracking")]
    assert 2 * len(decisions) >= len(MUTATIONS)
