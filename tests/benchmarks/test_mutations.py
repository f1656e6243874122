"""The planted mutations: each one's line is where it is said to be, and so are its tests."""

from __future__ import annotations

import sys
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


def test_half_of_them_are_of_decisions():
    assert len(MUTATIONS) >= 50
    assert len({m.what for m in MUTATIONS}) == len(MUTATIONS)
    decisions = [m for m in MUTATIONS if m.group in ("diagnosis", "tracking")]
    assert 2 * len(decisions) >= len(MUTATIONS)
