"""Results have a text that fits a screen."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import pkgutil
from xml.etree import ElementTree

import numpy as np
import pytest

import smsid
from smsid._short_repr import LINES, WIDTH, as_html, one_line, short_repr
from smsid.datasets import demonstration
from smsid.diagnose import Diagnosis
from smsid.diagnose.result import FoundCause, Value
from smsid.experiments import named_experiment
from smsid.identify.estimate import Estimate, classify

HEAVY = ("ndarray", "SpacecraftModel", "Regression", "TankFit", "Scene", "Estimate", "Trace,")
OWN = {"Estimate", "Diagnosis", "Comparison"}  # of their own kind, see below


def public() -> list[type]:
    """Public dataclasses with a field whose own text may be long."""
    found = []
    for info in pkgutil.iter_modules(smsid.__path__, "smsid."):
        package = importlib.import_module(info.name) if info.ispkg else None
        for name in getattr(package, "__all__", ()):
            thing = getattr(package, name)
            if inspect.isclass(thing) and dataclasses.is_dataclass(thing):
                kinds = " ".join(str(f.type) for f in dataclasses.fields(thing) if f.repr)
                if any(k in kinds for k in HEAVY):
                    found.append(thing)
    return found


@pytest.mark.parametrize("kind", public(), ids=lambda k: f"{k.__module__}.{k.__name__}")
def test_a_result_with_arrays_has_a_short_text(kind):
    assert kind.__name__ in OWN or kind.__repr__.__module__ == "smsid._short_repr"


@short_repr
@dataclasses.dataclass(frozen=True)
class Everything:
    """One of each."""

    name: str
    values: np.ndarray
    found: tuple[Estimate, ...]
    estimate: Estimate
    table: dict[str, float]
    notes: tuple[str, ...]
    size: float = 2.0
    more: None = None


def test_arrays_are_told_by_shape_and_long_things_by_number():
    own = Estimate("demo", "ml", tuple(classify(f"p{k}", 1.0, "kg", 0.01, "g") for k in range(100)))
    table = {f"key {k}": 0.0 for k in range(100)}
    thing = Everything("x" * 300, np.zeros((500, 4)), (own, own), own, table, ("note " * 90,) * 50)
    lines = repr(thing).splitlines()
    assert len(lines) == 9 and max(map(len, lines)) <= WIDTH
    assert "values: array (500, 4)" in repr(thing)
    assert "2 of Estimate" in repr(thing) and "100 entries: key 0" in repr(thing)
    assert "estimate of 'demo'" in repr(thing)
    assert one_line((1, 2)) == "(1, 2)" and one_line(None) == "None"


@pytest.fixture(scope="module")
def results() -> dict[str, object]:
    """What the functions of `smsid` return, as far as it is cheap to have."""
    craft = smsid.load_spacecraft("paper_sms")
    parameters = tuple(classify(f"bus.part{k}", 1.0 + k, "kg", 0.01, "g") for k in range(100))
    estimate = Estimate("demo", "ml", parameters, covariance=1e-4 * np.eye(100))
    cause = FoundCause(
        "joint_friction", "joint2", "friction", "viscous",
        (Value("friction_joint2.viscous", 1.5, 0.0002, "N m s/rad"),), (), {},
    )  # fmt: skip
    return {
        "spacecraft": craft,
        "experiment": named_experiment("exp1", smsid.build_model(craft)),
        "recording": smsid.load_recording(demonstration().estimation),
        "estimate": estimate,
        "diagnosis": Diagnosis(
            "demo", ("flight",), "explained", "The simulation lacks friction.", causes=(cause,) * 40
        ),
        "comparison": smsid.compare(estimate, estimate),
    }


@pytest.mark.parametrize(
    "name", ["spacecraft", "experiment", "recording", "estimate", "diagnosis", "comparison"]
)
def test_what_functions_return_has_a_text_and_a_table(name, results):
    found = results[name]
    lines = repr(found).splitlines()
    assert 1 < len(lines) <= LINES and max(map(len, lines)) <= WIDTH
    page = found._repr_html_()
    assert (
        page.count("<tr>") == page.count("</tr>") >= 4
        and ElementTree.fromstring(f"<div>{page}</div>") is not None
    )


def test_tables_of_pandas_have_a_row_for_each(results):
    pytest.importorskip("pandas")
    assert results["estimate"].to_dataframe().loc["bus.part3", "value"] == 4.0
    assert len(results["comparison"].to_dataframe()) == 100
    table = results["diagnosis"].to_dataframe()
    assert list(table["location"]) == ["joint2"] * 40 and table["low"][0] < 1.5 < table["high"][0]


def test_html_is_escaped():
    page = as_html("a < b", [("<name>", "x & y")])
    assert "a &lt; b" in page and "&lt;name&gt;" in page and "x &amp; y" in page


def test_many_fields_are_cut():
    fields = [(f"f{k}", int, 0) for k in range(100)]
    many = short_repr(dataclasses.make_dataclass("Many", fields))
    assert len(repr(many()).splitlines()) == LINES and "72 more fields" in repr(many())
