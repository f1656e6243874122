"""A short run of the fuzzer: no traceback, what is accepted is sound; ``benchmarks/fuzz.py`` is long."""

from __future__ import annotations

import logging
import sys
from collections import Counter
from pathlib import Path

import pytest

from smsid.cli.app import main

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
try:
    import _fuzz
finally:
    sys.path.pop(0)

SEED = 7
PER_KIND = 6
FEWER = {"samples": 3}  # each follows a stream for seconds
NUMBERS = range(PER_KIND * len(_fuzz.KINDS))


@pytest.mark.parametrize("kind", _fuzz.KINDS)
def test_mutated_inputs_give_no_traceback_and_nothing_unsound(kind, tmp_path, monkeypatch, capsys):
    first = _fuzz.KINDS.index(kind)
    seen: Counter[int] = Counter()
    count = FEWER.get(kind, PER_KIND)
    for number in NUMBERS[first :: len(_fuzz.KINDS)][:count]:
        folder = tmp_path / str(number)
        folder.mkdir()
        case = _fuzz.case(SEED, number, folder)
        assert case.kind == kind
        monkeypatch.chdir(folder)
        monkeypatch.setattr(sys, "argv", ["smsid", *case.words])
        root = logging.getLogger()
        before = root.handlers[:], root.level
        code = 0
        try:
            main()
        except SystemExit as left:
            code = int(left.code or 0)
        finally:
            root.handlers, root.level = before
        told = capsys.readouterr()
        assert not _fuzz.judge(code, told.out, told.err, folder), (case, told.err[-600:])
        seen[code] += 1
    assert sum(seen.values()) == count


def test_the_same_numbers_give_the_same_input(tmp_path):
    made = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        case = _fuzz.case(SEED, 8, tmp_path / name)
        made.append((case, {p.name: p.read_bytes() for p in (tmp_path / name).iterdir()}))
    assert made[0] == made[1]


@pytest.mark.parametrize(
    ("code", "out", "err", "wrong"),
    [
        (70, "", "Traceback", "traceback"),
        (1, "", "error: no", ""),
        (1, "", "", "an error that says nothing"),
        (0, "no json", "", "no JSON"),
        (0, '{"mass": {"value": 0.0}}', "", "a mass of 0.0 kg"),
        (0, '{"mass": {"value": null}}', "", "a mass of None kg"),
        (0, '{"written": ["none.nc"]}', "", "says it wrote none.nc"),
        (5, "", "", "exit code 5"),
        (0, "{}", "", ""),
    ],
)
def test_the_rule_can_fail(code, out, err, wrong, tmp_path):
    found = _fuzz.judge(code, out, err, tmp_path)
    assert (wrong in found) if wrong else not found
