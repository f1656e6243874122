"""What the user knows of a body takes the place of the wide prior around the description."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.errors import DescriptionError
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.prior import CAD, Prior

from . import twin


def test_what_is_known_of_a_body_weighs_as_it_is_given():
    at = Parameters.of(twin.model())
    prior = Prior(at, {"link2.m": (52.0, 0.5), "bus.Ixy": (3.0, 2.0)})
    residual, jacobian = prior.residual(at)
    names = list(at.names)
    mass, product = names.index("link2.m"), names.index("bus.Ixy")
    assert residual[mass] == pytest.approx((50.0 - 52.0) / 0.5)
    assert residual[product] == pytest.approx((at.inertias.ravel()[product] - 3.0) / 2.0)
    others = np.delete(residual, [mass, product])
    np.testing.assert_allclose(others, 0.0, atol=1e-14)
    step = np.zeros(at.size)
    step[mass] = 1e-3
    moved, _ = prior.residual(at.moved(step))
    np.testing.assert_allclose(moved - residual, jacobian @ step, atol=1e-12)
    # a step of one is the size of the body: 100 sigmas of half a kilogram in 50
    assert jacobian[mass, mass] == pytest.approx(100.0)
    assert Prior(at).residual(at)[1][mass, mass] == pytest.approx(1.0 / CAD)


@pytest.mark.parametrize("wrong", [{"link9.m": (1.0, 1.0)}, {"link2.m": (50.0, 0.0)}])
def test_what_is_no_prior_is_refused(wrong):
    with pytest.raises(DescriptionError, match="is no prior of a body"):
        Prior(Parameters.of(twin.model()), wrong)


def test_one_relative_deviation_narrows_every_body():
    at = Parameters.of(twin.model())
    wide, narrow = Prior(at), Prior(at, 0.05)
    np.testing.assert_allclose(narrow.sigma / wide.sigma, 0.05 / CAD)
    for wrong in (0.0, -1.0, float("nan")):
        with pytest.raises(DescriptionError, match="relative standard deviation"):
            Prior(at, wrong)
