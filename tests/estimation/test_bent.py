"""What goes with a poorly known parameter of an effect, on normal equations written by hand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from smsid.estimation.bent import MOST, POORLY, bent_by
from smsid.estimation.normal_equations import NormalEquations


def equations(values: dict[str, float]) -> NormalEquations:
    """A craft's mass and a tank's: ``scales`` are two."""
    kinds = {"bus.m": False, "tank.mass": True, "tank.stiffness": True}
    unknowns = tuple(SimpleNamespace(name=n, positive=k) for n, k in kinds.items())
    point = SimpleNamespace(value=lambda u: values[u.name])
    return cast(NormalEquations, SimpleNamespace(unknowns=unknowns, point=point, scales=np.full(3, 2.0)))


ROWS = np.array([[2.0, 2.0, 0.0], [2.0, 0.0, 0.0], [0.0, 2.0, 0.0]])  # total, bus and tank alone
COVARIANCE = np.diag([0.05, 0.5, 0.01]) ** 2


@pytest.mark.parametrize(("tank", "expected"), [(5.0, [None] * 3), (3.0, ["tank.mass", None, "tank.mass"])])
def test_the_total_goes_with_the_tank_where_that_is_poorly_known(tank, expected):
    """Its standard deviation is 1 kg: a fifth of 5 kg, a third of 3."""
    found = equations({"bus.m": 100.0, "tank.mass": tank, "tank.stiffness": 1.0})
    assert bent_by(found, ROWS, COVARIANCE) == expected


def test_what_is_known_together_is_not_bent():
    """The total is known to 0.01, though neither part is: held against conditioning by samples."""
    covariance = COVARIANCE.copy()
    covariance[:2, :2] = [[0.25, -0.2499], [-0.2499, 0.25]]
    found = equations({"bus.m": 100.0, "tank.mass": 3.0, "tank.stiffness": 1.0})
    total, bus, tank = bent_by(found, ROWS, covariance)
    draws = np.random.default_rng(1).multivariate_normal(np.zeros(3), covariance, 200_000)
    rows: Any = draws @ ROWS.T
    shares = [np.corrcoef(rows[:, k], draws[:, 1])[0, 1] ** 2 for k in range(3)]
    assert [s > MOST for s in shares] == [total is not None, bus is not None, tank is not None]
    assert POORLY < 1.0 / 3.0 and total is None
