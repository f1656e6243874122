"""Estimates as files: nothing lost, nothing bare, bad files told."""

from __future__ import annotations

import json
import math

import pytest

from smsid.errors import SmsidError
from smsid.identify.estimate import (
    Estimate,
    Iteration,
    ParameterEstimate,
    judged,
    load_estimate,
    save_estimate,
)


def example() -> Estimate:
    return Estimate(
        description="demo",
        method="paper",
        parameters=(
            judged("M", 2256.8, "kg", 0.7, "exp1", nominal=2000.0),
            judged("b", 0.02, "N s/m", 0.03, "exp1"),
            judged("lost", math.nan, "kg", math.nan, "exp1"),
            judged("small", 0.01, "kg m", 0.1, "exp2", reference=50.0),
        ),
        recordings=("exp1", "exp2"),
        timing={"Exp. 1": 0.5},
        notes=("axis y: no thrust",),
        conditions={"Step B": 170.0},
        history=(Iteration(1.5, None), Iteration(1.01, 0.3)),
    )


def test_round_trip(tmp_path):
    path = tmp_path / "estimate.json"
    save_estimate(example(), path)
    back = load_estimate(path)
    assert back.to_json() == example().to_json()
    assert math.isnan(back["lost"].value)
    kept = [p for p in back.parameters if p.name != "lost"]
    assert kept == [p for p in example().parameters if p.name != "lost"]
    assert back.history == example().history
    assert (back.recordings, back.timing, back.notes, back.conditions) == (
        example().recordings,
        example().timing,
        example().notes,
        example().conditions,
    )


def test_a_file_from_before_histories_were_kept_still_loads(tmp_path):
    document = json.loads(example().to_json())
    del document["history"]
    (tmp_path / "old.json").write_text(json.dumps(document))
    assert load_estimate(tmp_path / "old.json").history == ()


def test_infinity_and_nan_are_null():
    text = example().to_json()
    document = json.loads(text, parse_constant=lambda x: pytest.fail(f"{x} in the JSON"))
    lost = next(p for p in document["parameters"] if p["name"] == "lost")
    assert lost["value"] is None and lost["sigma"] is None and lost["interval"] == [None, None]


def test_never_a_bare_number():
    """Every number but the schema's version has a unit, an interval or a level beside it."""

    def walk(node, path=()):
        if isinstance(node, dict):
            for key, value in node.items():
                if (
                    isinstance(value, int | float)
                    and not isinstance(value, bool)
                    and (*path, key) != ("schema",)
                ):
                    assert "unit" in node, (*path, key)
                walk(value, (*path, key))
        elif isinstance(node, list):
            for value in node:
                assert not isinstance(value, int | float) or path[-1] == "interval", path
                walk(value, path)

    document = json.loads(example().to_json())
    walk(document)
    for p in document["parameters"]:
        assert {"value", "unit", "sigma", "status", "interval", "interval_level"} <= set(p)


@pytest.mark.parametrize(
    ("sigma", "status"),
    [
        (0.0999, "identifiable"),
        (0.1, "not_identifiable"),
        (0.1001, "not_identifiable"),
        (math.nan, "not_identifiable"),
    ],
)
def test_status_at_the_border(sigma: float, status: str):
    """Identifiable below 10 % of the value, or of the reference for a small one."""
    assert judged("x", -1.0, "kg", sigma, "g").status == status
    assert judged("x", 1e-3, "kg", 50 * sigma, "g", reference=50.0).status == status


def test_what_cannot_be_identified_says_how_far_off_it_is():
    assert "50 % of its size" in judged("x", 2.0, "kg", 1.0, "g").note
    assert judged("x", 2.0, "kg", 1.0, "g", note="own words").note == "own words"
    assert judged("x", 0.0, "kg", 1.0, "g").status == "not_identifiable"


def test_interval_and_errors():
    p = judged("x", 10.0, "kg", 1.0, "g", reference=40.0)
    assert p.interval == pytest.approx((8.04, 11.96), abs=1e-3)
    assert p.relative_sigma == pytest.approx(0.025)
    assert p.relative_error(8.0) == pytest.approx(0.25)
    assert p.relative_error(8.0, 40.0) == pytest.approx(0.05)
    assert p.relative_error(0.0) == math.inf
    assert p.small


def test_look_up():
    estimate = example()
    assert estimate["M"].nominal == 2000.0
    assert "M" in estimate and "m" not in estimate
    assert [p.name for p in estimate.group("exp2")] == ["small"]
    with pytest.raises(KeyError):
        estimate["m"]


def _cut(text: str) -> str:
    return text[: len(text) // 2]


def _another_schema(text: str) -> str:
    return text.replace('"schema": 1', '"schema": 99')


def _no_parameters(text: str) -> str:
    document = json.loads(text)
    del document["parameters"]
    return json.dumps(document)


def _bare(text: str) -> str:
    document = json.loads(text)
    document["timing"] = {"Exp. 1": 0.5}
    return json.dumps(document)


def _parameter_without_value(text: str) -> str:
    document = json.loads(text)
    del document["parameters"][0]["value"]
    return json.dumps(document)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (_cut, "cannot be read as an estimate"),
        (_another_schema, "no estimate of schema 1"),
        (_no_parameters, "cannot be read as an estimate: 'parameters'"),
        (_bare, "cannot be read as an estimate"),
        (_parameter_without_value, "cannot be read as an estimate"),
        (lambda text: "[1, 2]", "no estimate of schema 1"),
        (lambda text: "", "cannot be read as an estimate"),
    ],
)
def test_bad_files_are_told(tmp_path, spoil, message: str):
    path = tmp_path / "estimate.json"
    path.write_text(spoil(example().to_json()))
    with pytest.raises(SmsidError, match=message) as caught:
        load_estimate(path)
    assert str(path) in str(caught.value)


def test_missing_file_is_told(tmp_path):
    with pytest.raises(SmsidError, match="does not exist"):
        load_estimate(tmp_path / "none.json")


def test_not_text_is_told(tmp_path):
    path = tmp_path / "estimate.json"
    path.write_bytes(b"\xff\xfe\x00\x01")
    with pytest.raises(SmsidError, match="cannot be read as an estimate"):
        load_estimate(path)


def test_known_parameters_have_no_interval_to_speak_of():
    p = ParameterEstimate("I_rw", 0.159, "kg m^2", 0.0, "known", "description")
    assert p.interval == (0.159, 0.159)
