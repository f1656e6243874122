"""What an estimate says of ordinary parameters, where it tells the centre of mass and not the mass."""

import numpy as np
import pytest

from smsid.estimation.bodies import linear_terms
from smsid.estimation.inertial_combinations import about_centre
from smsid.identify.estimate import Estimate, ParameterEstimate
from smsid.model.regressor import INERTIAL_NAMES

BODY = np.array([3.0, 0.3, -0.6, 0.9, 8.0, 0.4, 7.0, -0.2, 0.1, 6.0])
OTHER = np.array([4.0, 0.1, 0.2, -0.3, 9.0, 0.1, 6.0, 0.3, -0.1, 5.0])
CENTRAL = ("cx", "cy", "cz", "Icxx", "Icxy", "Icyy", "Icxz", "Icyz", "Iczz")


def told(*names: str) -> Estimate:
    values = dict(zip(CENTRAL, about_centre(BODY), strict=True))
    parameters = [
        ParameterEstimate(f"bus.{n}", float(values[n]), "1", 0.1, "identifiable", "maximum_likelihood")
        for n in names
    ]
    return Estimate("craft", "maximum_likelihood", tuple(parameters))


@pytest.mark.parametrize("name", CENTRAL)
def test_they_are_the_first_order_at_the_body(name: str):
    factors, value = linear_terms(told(*CENTRAL), BODY)[f"bus.{name}"]
    row = np.array([factors.get(f"bus.{n}", 0.0) for n in INERTIAL_NAMES])
    assert row @ BODY == pytest.approx(value, abs=1e-12)
    k = CENTRAL.index(name)
    for i in range(10):
        step = 1e-6 * np.eye(10)[i]
        slope = (about_centre(BODY + step)[k] - about_centre(BODY - step)[k]) / 2e-6
        assert row[i] == pytest.approx(slope, abs=1e-8)


def test_a_centre_that_is_told_is_not_the_described_one():
    """The mass is the described one: nothing tells it."""
    factors, value = linear_terms(told(*CENTRAL), OTHER)["bus.cy"]
    assert factors == {"bus.my": 1.0 / OTHER[0], "bus.m": pytest.approx(0.2 / OTHER[0])}
    assert value == 0.0


def test_without_a_centre_it_is_the_described_one():
    factors, value = linear_terms(told("Icxx"), OTHER)["bus.Icxx"]
    c = OTHER[1:4] / OTHER[0]
    assert factors["bus.m"] == pytest.approx(c[1] ** 2 + c[2] ** 2)
    assert factors["bus.my"] == pytest.approx(-2.0 * c[1])
    assert value == told("Icxx")["bus.Icxx"].value
