"""What can be looked up by name behaves alike, and like a mapping: `smsid._by_name`."""

from __future__ import annotations

import importlib
import inspect
import pkgutil

import numpy as np
import pytest

import smsid
from smsid._by_name import ByName
from smsid.campaign.summary import Summary
from smsid.comparison.result import Finding, FindingQuantity
from smsid.identify.estimate import Estimate, classify
from smsid.identify.paper._translation import AxisEstimate
from smsid.identify.paper.combined import CombinedAxes


def looked_up() -> list[type]:
    """Every class of the package that defines ``[]`` itself."""
    found = []
    for info in pkgutil.walk_packages(smsid.__path__, "smsid."):
        if not info.name.endswith("__main__"):
            module = importlib.import_module(info.name)
            own = [x for x in vars(module).values() if inspect.isclass(x) and x.__module__ == info.name]
            found += [x for x in own if "__getitem__" in vars(x)]
    return found


def test_no_class_is_looked_up_without_being_iterable():
    """Python would iterate over such a class by ``[0]``, ``[1]`` ...: a `KeyError`, or nonsense."""
    found = looked_up()
    assert {Estimate, smsid.Recording, ByName} <= set(found)
    assert [x.__qualname__ for x in found if not issubclass(x, ByName)] == []


ESTIMATE = Estimate("demo", "ml", (classify("M", 2.0, "kg", 0.1, "g"), classify("k", 3.0, "N/m", 0.1, "g")))
NOTHING = Estimate("demo", "ml", ())
AXIS = ("M", "m_s"), np.array([2.0, 1.0]), np.eye(2)
QUANTITY = FindingQuantity("mass", 1.0, "kg", 0.1)
THINGS = [
    ESTIMATE,
    NOTHING,
    smsid.compare(ESTIMATE, ESTIMATE),
    smsid.Recording.from_arrays([0.0, 0.1], {"imu.angular_rate": np.zeros((2, 3))}),
    AxisEstimate("x", *AXIS, pi=np.zeros(2), condition=1.0),
    CombinedAxes(*AXIS),
    Finding("body", "bus", "It is heavier.", (QUANTITY,)),
    Summary(0, (), (), 0.01, 0.0),
]


@pytest.mark.parametrize("thing", THINGS, ids=lambda x: type(x).__name__)
def test_what_is_iterated_over_is_in_it_and_can_be_looked_up(thing):
    names = list(thing)
    assert names == list(thing.keys()) == list(dict(thing)) and len(thing) == len(names) and thing
    assert all(name in thing and dict(thing)[name] is not None for name in names)
    assert "nope" not in thing and 0 not in thing
    with pytest.raises((KeyError, smsid.RecordingError), match="nope"):
        thing["nope"]


def test_an_estimate_gives_names_and_its_parameters_by_them():
    assert [ESTIMATE[name].value for name in ESTIMATE] == [2.0, 3.0]
    with pytest.raises(KeyError, match="Did you mean 'k'"):
        ESTIMATE["kk"]
