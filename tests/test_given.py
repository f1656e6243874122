"""What may be given to `smsid.api`: objects or paths of them; anything else is a `SmsidError`."""

from __future__ import annotations

import inspect
from types import SimpleNamespace

import numpy as np
import pytest

import smsid
from smsid import api
from smsid.datasets import demonstration
from smsid.errors import DescriptionError, EstimateError, ExperimentError, RecordingError, SmsidError
from smsid.identify.estimate import Estimate, classify, save_estimate

DEMO = demonstration()
CRAFT = smsid.load_spacecraft("paper_sms")
FLIGHT = smsid.load_recording(DEMO.estimation)
KINDS = {
    "spacecraft": DescriptionError,
    "recordings": RecordingError,
    "validation": RecordingError,
    "estimate": EstimateError,
    "experiment": ExperimentError,
    "follow": DescriptionError,
    "hold": DescriptionError,
    "path": SmsidError,
    "paths": RecordingError,
    "folder": SmsidError,
    "seed": SmsidError,
}
"""Arguments of `smsid.api`, and the error of what they cannot be."""
RIGHT = {"spacecraft": CRAFT, "recordings": FLIGHT, "path": "none.html", "folder": "none"}
PUBLIC = [f for name, f in vars(api).items() if inspect.isfunction(f) and f.__module__ == api.__name__]
WRONG = [(f, p) for f in PUBLIC for p in inspect.signature(f).parameters if p in KINDS]


def test_the_walk_finds_the_functions():
    assert {f.__name__ for f in PUBLIC} == {
        "load_spacecraft", "load_recordings", "simulate", "identify", "diagnose", "track",
        "design_controller", "report", "view", "export",
    }  # fmt: skip
    assert {f for f, _ in WRONG} == set(PUBLIC)


@pytest.mark.parametrize(("function", "argument"), WRONG, ids=lambda x: getattr(x, "__name__", x))
@pytest.mark.parametrize("given", [None, 3.5, SimpleNamespace(), {"a": 1}, "no such file"], ids=repr)
def test_what_is_no_such_thing_is_an_error_of_smsid(function, argument, given, tmp_path, monkeypatch):
    """A text is a path; ``None`` stands for nothing where it is the default."""
    monkeypatch.chdir(tmp_path)
    asked = inspect.signature(function).parameters
    if given is None and (argument == "hold" or asked[argument].default is None):
        pytest.skip("None is the default")
    if isinstance(given, str) and argument in ("path", "folder") and function is not api.load_spacecraft:
        pytest.skip("a path to write to")
    if given == {"a": 1} and argument == "follow":
        given = {"a": "x"}
    keywords = {k: v for k, v in RIGHT.items() if k in asked and asked[k].default is asked[k].empty}
    with pytest.raises(SmsidError) as caught:
        if argument == "paths":
            function(given)
        else:
            function(**{**keywords, argument: given})
    told = caught.value
    assert told.advice and (isinstance(told, KINDS[argument]) or given == "no such file"), told


def test_the_error_says_what_loads_it():
    with pytest.raises(DescriptionError, match=r"None is not a spacecraft\. .*load_spacecraft loads one"):
        smsid.identify(None, FLIGHT)  # type: ignore[arg-type]
    with pytest.raises(RecordingError, match=r"type ndarray is not a recording\. .*load_recording loads"):
        smsid.identify(CRAFT, [np.zeros(3)])  # type: ignore[list-item]
    with pytest.raises(EstimateError, match=r"smsid\.load_estimate loads one"):
        smsid.compare(None, None)  # type: ignore[arg-type]
    with pytest.raises(DescriptionError, match=r"smsid\.load_spacecraft loads one"):
        smsid.design_experiment(3, ["mass"])  # type: ignore[arg-type]


def test_paths_do_as_well_as_what_they_hold(tmp_path):
    flight = smsid.simulate("paper_sms", "exp1_x", seed=3)
    smsid.save_recording(flight, tmp_path / "exp1.nc")
    found = smsid.identify("paper_sms", [str(tmp_path / "exp1.nc")], method="paper")
    by_object = smsid.identify(CRAFT, flight, method="paper")
    assert found.names == by_object.names and np.array_equal(found.values, by_object.values, equal_nan=True)
    mass = Estimate("demo", "ml", (classify("M", 2.0, "kg", 0.1, "g"),), covariance=0.01 * np.eye(1))
    save_estimate(mass, tmp_path / "e.json")
    assert list(smsid.compare(tmp_path / "e.json", str(tmp_path / "e.json"))) == ["M"]
