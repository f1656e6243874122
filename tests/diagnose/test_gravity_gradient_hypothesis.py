"""A gravity gradient of an unknown orbit: the field's matrix gives the vertical back."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from smsid.diagnose._gravity_gradient_hypothesis import (
    FIELDS,
    GravityGradientHypothesis,
    coefficients,
    over_time,
)
from smsid.effects import GravityGradient
from smsid.estimation.map_estimate import evaluate
from tests.diagnose.test_profiled_hypothesis import ROWS, scored, stub

FREE = ("g.gradient", "g.turn.x", "g.turn.y", "g.turn.z")


def candidate():
    effect = GravityGradient(name="g", gradient=0.0)
    return GravityGradientHypothesis(
        "gravity_gradient", "bus", "external", "gravity gradient", effect, FREE, (1e-8, *3 * (1e-2,))
    )


def test_fields_are_a_basis_of_what_has_no_trace():
    np.testing.assert_allclose(np.einsum("aij,bij->ab", FIELDS, FIELDS), np.eye(5), atol=1e-15)
    np.testing.assert_allclose(np.trace(FIELDS, axis1=1, axis2=2), 0.0, atol=1e-15)
    r = np.array([0.48, -0.6, 0.64])
    whole = np.einsum("k,kij->ij", coefficients(2.0 * r), FIELDS)
    np.testing.assert_allclose(whole, 3.0 * np.outer(r, r) - np.eye(3), atol=1e-15)


@pytest.mark.parametrize("seed", range(6))
def test_the_vertical_is_found_wherever_it_is(seed):
    rng = np.random.default_rng(seed)
    vertical, size = Rotation.random(random_state=rng).as_matrix()[0], 0.1
    columns = rng.standard_normal((ROWS, 5))
    found = scored(candidate(), stub(columns, size * coefficients(vertical), rng, 1.0), columns)
    assert found.freedom == 3
    assert found.ratio == pytest.approx(6.0 * size**2 * ROWS, rel=0.4)
    assert abs(found.estimate[0] - size) < 4.0 * np.sqrt(found.covariance[0, 0])
    own = found.candidate.effect
    off = np.linalg.norm(np.cross(own.vertical(0.0), vertical))
    assert off < 5.0 / np.sqrt(9.0 * size**2 * ROWS)  # turned by d, the field changes by 3 sqrt(2) d
    assert abs(np.dot(own.normal, own.nadir)) < 1e-12


def test_a_field_that_repels_is_no_gradient():
    rng = np.random.default_rng(1)
    columns = rng.standard_normal((ROWS, 5))
    pulls = scored(candidate(), stub(columns, 0.1 * coefficients(np.eye(3)[2]), rng, 1.0), columns)
    repels = scored(candidate(), stub(columns, -0.1 * coefficients(np.eye(3)[2]), rng, 1.0), columns)
    assert repels.ratio < 0.5 * pulls.ratio


def test_what_a_turning_vertical_does_is_the_sum_of_its_parts(known, problem):
    """Against the effect's own forces along the run."""
    found = evaluate(known.point, known.unknowns[:1], problem)
    effect = GravityGradient(name="g", gradient=0.4, nadir=(0.6, 0.0, -0.8), normal=(0.0, 1.0, 0.0))
    own = candidate()._turning_sensitivity(found, effect)
    plain = effect.model_copy(update={"gradient": 0.0})
    whole = found.changes.effect(plain, effect, 1.0)
    for part, of in ((own.middle, whole.middle), (own.at, whole.at)):
        np.testing.assert_allclose(part[:, whole.dofs], of, atol=1e-9 * np.abs(of).max())
    turned = over_time(effect, np.array([0.0, 3.0]))
    assert np.abs(turned[1] - turned[0]).max() > 1.0
    np.testing.assert_allclose(turned[1], coefficients(effect.vertical(3.0)), atol=1e-12)
