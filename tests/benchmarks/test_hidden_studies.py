"""Studies side by side: the table is that of the file, and a study joins with what it counted."""

import importlib
import json
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
RESULTS = BENCHMARKS / "results"


@pytest.fixture(scope="module")
def writer():
    sys.path.insert(0, str(BENCHMARKS))
    try:
        return importlib.import_module("hidden_studies")
    finally:
        sys.path.pop(0)


@pytest.fixture(scope="module")
def kept():
    return json.loads((RESULTS / "hidden_studies.json").read_text(encoding="utf-8"))


def test_the_table_is_that_of_the_file(writer, kept):
    assert (RESULTS / "hidden_studies.md").read_text(encoding="utf-8") == writer.markdown(kept)
    assert kept["together"] == writer.together(kept["studies"])


def test_the_last_study_joins_with_what_it_counted(writer, kept):
    last = json.loads((RESULTS / "hidden_effects.json").read_text(encoding="utf-8"))
    own = writer.study(last)
    assert own["counts"]["wrong_family"] == [last["wrong_family"]["hits"], last["wrong_family"]["total"]]
    assert set(own["counts"]) == set(writer.COUNTS)
    twice = writer.together({"one": own, "other": own})
    assert twice["wrong_family"]["total"] == 2 * last["wrong_family"]["total"]
    few = {**own, "counts": {"wrong_family": [1, 4]}}
    assert writer.together({"one": own, "few": few})["pairs/both"]["total"] == own["counts"]["pairs/both"][1]


def test_a_study_without_runs_of_a_kind_says_so(writer, kept):
    name, first = next(iter(kept["studies"].items()))
    counts = {path: c for path, c in first["counts"].items() if path != "pairs/both"}
    studies = {**kept["studies"], name: {**first, "counts": counts}}
    table = writer.markdown({"studies": studies, "together": writer.together(studies)})
    assert "no runs" in next(line for line in table.splitlines() if line.startswith("| pairs"))
