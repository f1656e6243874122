"""Estimates as files: nothing lost, nothing bare, bad files told."""

from __future__ import annotations

import copy
import json
import math
import pickle
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smsid.errors import EstimateError, MissingDependencyError, SmsidError
from smsid.identify.estimate import (
    Estimate,
    Iteration,
    ParameterEstimate,
    classify,
    distinct,
    load_estimate,
    save_estimate,
    with_distinct_names,
)


def example() -> Estimate:
    return Estimate(
        description="demo",
        method="paper",
        parameters=(
            classify("M", 2256.8, "kg", 0.7, "exp1", nominal=2000.0),
            classify("b", 0.02, "N s/m", 0.03, "exp1"),
            classify("lost", math.nan, "kg", math.nan, "exp1"),
            classify("small", 0.01, "kg m", 0.1, "exp2", reference=50.0),
        ),
        recordings=("exp1", "exp2"),
        timing={"Exp. 1": 0.5},
        notes=("axis y: no thrust",),
        conditions={"Step B": 170.0},
        history=(Iteration(1.5, None), Iteration(1.01, 0.3)),
        covariance=COVARIANCE,
    )


COVARIANCE = np.array(
    [
        [0.49, 0.006, math.nan, 0.01],
        [0.006, 0.0009, math.nan, 0.0],
        [math.nan] * 4,
        [0.01, 0.0, math.nan, 0.01],
    ]
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
                assert not isinstance(value, int | float) or path[-1] in ("interval", "lower_triangle"), path
                walk(value, path)

    document = json.loads(example().to_json())
    assert {"unit", "order"} < set(document["covariance"])
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
    assert classify("x", -1.0, "kg", sigma, "g").status == status
    assert classify("x", 1e-3, "kg", 50 * sigma, "g", reference=50.0).status == status


def test_what_cannot_be_identified_says_how_far_off_it_is():
    assert "50 % of its size" in classify("x", 2.0, "kg", 1.0, "g").note
    assert classify("x", 2.0, "kg", 1.0, "g", note="own words").note == "own words"
    assert classify("x", 0.0, "kg", 1.0, "g").status == "not_identifiable"


def test_interval_and_errors():
    p = classify("x", 10.0, "kg", 1.0, "g", reference=40.0)
    assert p.interval == pytest.approx((8.04, 11.96), abs=1e-3)
    assert p.relative_sigma == pytest.approx(0.025)
    assert p.relative_error(8.0) == pytest.approx(0.25)
    assert p.relative_error(8.0, 40.0) == pytest.approx(0.05)
    assert math.isnan(p.relative_error(0.0))  # nothing is a share of zero
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
        (_cut, "not valid JSON"),
        (_another_schema, "no estimate of schema 1"),
        (_no_parameters, "cannot be read as an estimate: 'parameters'"),
        (_bare, "cannot be read as an estimate"),
        (_parameter_without_value, "cannot be read as an estimate"),
        (
            lambda text: text.replace('"estimate"', '"diagnosis"', 1),
            "of the kind 'diagnosis', no estimate. Give",
        ),
        (lambda text: "[1, 2]", "no estimate of schema 1"),
        (lambda text: "", "not valid JSON"),
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
    with pytest.raises(SmsidError, match="no UTF-8 text"):
        load_estimate(path)


def test_known_parameters_have_no_interval_to_speak_of():
    p = ParameterEstimate("I_rw", 0.159, "kg m^2", 0.0, "known", "description")
    assert p.interval == (0.159, 0.159)


def test_a_name_is_unique():
    twice = (
        classify("link1.mx", 1.0, "kg m", 0.1, "exp2.step_b"),
        classify("link1.mx", 2.0, "kg m", 0.1, "other"),
    )
    with pytest.raises(EstimateError, match=r"2 parameters .* 'link1.mx' \(groups exp2.step_b, other\)"):
        Estimate("demo", "paper", twice)


def test_old_files_with_names_of_two_groups_are_read(tmp_path):
    """What earlier versions wrote: Step B twice, and two recordings of one name."""
    document = json.loads(example().to_json())
    del document["covariance"]
    table = document["parameters"][0]
    for group, value in (("exp2.step_b_printed", 7.0), ("g", 8.0), ("g", 9.0)):
        document["parameters"].append({**table, "group": group, "value": value})
    (tmp_path / "old.json").write_text(json.dumps(document))
    found = load_estimate(tmp_path / "old.json")
    assert found["M"].value == 2256.8
    assert found["as printed: M"].value == 7.0
    assert found["g: M"].value == 8.0 and found["g: M (2)"].value == 9.0
    assert len(set(found.names)) == len(found)


def test_names_that_repeat_are_numbered():
    assert distinct(["a", "b", "a", "a (2)", "a"]) == ["a", "b", "a (2)", "a (2) (2)", "a (3)"]


def test_arrays_are_in_the_order_of_the_parameters():
    found = example()
    assert found.names == ("M", "b", "lost", "small")
    np.testing.assert_allclose(found.values, [2256.8, 0.02, math.nan, 0.01])
    np.testing.assert_allclose(found.sigmas, [0.7, 0.03, math.nan, 0.1])
    np.testing.assert_allclose(found.intervals[0], [2256.8 - 1.959964 * 0.7, 2256.8 + 1.959964 * 0.7])
    assert found.units == ("kg", "N s/m", "kg", "kg m")


def test_covariance_survives_the_file_and_gives_correlations(tmp_path):
    save_estimate(example(), tmp_path / "e.json")
    back = load_estimate(tmp_path / "e.json")
    assert back.covariance is not None
    np.testing.assert_array_equal(back.covariance, COVARIANCE)
    assert back.correlation("b", "M") == pytest.approx(0.006 / (0.7 * 0.03))
    assert math.isnan(back.correlation("M", "lost"))


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda c: c[:2, :2], "shape"),
        (lambda c: c * np.where(np.arange(4) == 1, 2.0, 1.0), "one way"),
        (lambda c: c[::-1, ::-1], "standard deviation of 'M'"),
    ],
)
def test_a_covariance_of_something_else_is_refused(spoil, message: str):
    with pytest.raises(EstimateError, match=message):
        replace(example(), covariance=spoil(COVARIANCE))


def test_without_covariance_correlations_are_not_invented():
    with pytest.raises(EstimateError, match="no covariance"):
        replace(example(), covariance=None).correlation("M", "b")


def test_frozen():
    found = example()
    with pytest.raises(TypeError):
        found.timing["Exp. 1"] = 0.0  # type: ignore[index]
    assert found.covariance is not None
    with pytest.raises(ValueError, match="read-only"):
        found.covariance[0, 0] = 1.0
    for twin in (pickle.loads(pickle.dumps(found)), copy.deepcopy(found)):
        assert twin.to_json() == found.to_json()


def test_repr_can_be_read():
    """At most 30 lines of 110 characters, with what is asked for and how to get at the rest."""
    terms = " + ".join(f"{k} link{k}.Ixx" for k in range(1, 12))
    many = tuple(classify(f"link{k}.Izz + {terms}", 1.0, "kg m^2", 0.01, "g") for k in range(200))
    for estimate in (example(), Estimate("demo", "ml", many), Estimate("demo", "ml", ())):
        lines = repr(estimate).splitlines()
        assert len(lines) <= 30 and max(map(len, lines)) <= 110
    assert "172 more" in repr(Estimate("demo", "ml", many)).splitlines()[-1]
    assert "M      2256.8 ± 1.4 kg" in repr(example())
    assert "2 of 4 parameters identifiable" in repr(example())


def test_html_escapes_and_names_all():
    found = Estimate("<demo>", "ml", (classify("a<b", 1.0, "kg", 0.01, "g"),))
    text = found._repr_html_()
    assert "&lt;demo&gt;" in text and "a&lt;b" in text and "<b" not in text.replace("<tbody", "")


def test_dataframe():
    pytest.importorskip("pandas")
    frame = example().to_dataframe()
    assert frame.loc["M", "value"] == 2256.8 and frame.loc["M", "described"] == 2000.0
    assert frame.loc["small", "status"] == "identifiable"
    assert list(frame.index) == list(example().names)


def test_dataframe_without_pandas_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingDependencyError, match=r"smsid\[pandas\]"):
        example().to_dataframe()


NAMES = st.lists(
    st.tuples(st.sampled_from(["a.m", "a.mx", "b.m", "b.m (2)"]), st.sampled_from(["one", "two", "three"])),
    min_size=1,
    max_size=8,
)


@given(NAMES)
def test_whatever_groups_share_a_name_every_lookup_finds_its_own(tmp_path_factory, pairs):
    """By name, in the table, in the file, in the correlation: the parameter of that place."""
    rows = [classify(name, float(k), "kg", 1.0 + k, group) for k, (name, group) in enumerate(pairs)]
    if len({name for name, _ in pairs}) < len(pairs):
        with pytest.raises(EstimateError, match="parameters of the estimate are called"):
            Estimate("d", "ml", tuple(rows))
    own = with_distinct_names(rows)
    assert with_distinct_names(own) == own and [p.group for p in own] == [group for _, group in pairs]
    covariance = np.diag([p.sigma**2 for p in own])
    if len(own) > 1:
        covariance[0, -1] = covariance[-1, 0] = 0.5
    estimate = Estimate("d", "ml", own, covariance=covariance)
    file = tmp_path_factory.mktemp("names") / "e.json"
    save_estimate(estimate, file)
    again = load_estimate(file)
    table = estimate.to_dataframe()
    for k, p in enumerate(own):
        assert estimate[p.name] is p and again[p.name].value == float(k)
        assert table.loc[p.name, "value"] == float(k) and table.loc[p.name, "group"] == p.group
    if len(own) > 1:
        expected = 0.5 / (own[0].sigma * own[-1].sigma)
        assert estimate.correlation(own[0].name, own[-1].name) == pytest.approx(expected)
