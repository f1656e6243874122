"""Scores against least squares, whatever the fitted parameters and their priors."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import trapezoid
from scipy.stats import norm

from smsid.diagnose.score_test import Candidate, correlation, is_same_error, odds, score_candidates
from smsid.effects import GearCompliance
from smsid.estimation.map_estimate import MapFit

SHIFT = Candidate("body_error", "link", "inertia", "mass", None, ("a", "b"), (1.0, 1.0))


def stub(rng, rows, fitted, prior):
    """What `score_candidates` needs of a fit: derivatives, priors, residual."""
    whitened = rng.standard_normal((rows, 1, fitted))
    residual = np.concatenate([rng.standard_normal(rows), np.zeros(fitted)])
    own = SimpleNamespace(
        whitened=whitened, unknowns=(None,) * fitted, residual=residual, prior=SimpleNamespace()
    )
    own.prior.rows, own.prior.off = np.diag(prior), np.zeros(fitted)
    own.factors = np.linalg.qr(np.vstack([whitened.reshape(rows, fitted), own.prior.rows]))
    own.told = np.ones(fitted, dtype=bool)
    own.left = lambda c: MapFit.left(own, c)
    own._less = lambda *given: MapFit._less(own, *given)
    own.projected = lambda groups: MapFit.projected(own, groups)
    return own


def only(fit, candidate, columns):
    """The score of one candidate."""
    return score_candidates(fit, [candidate], [columns])[0]


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_ratio_is_what_least_squares_gains(seed):
    rng = np.random.default_rng(seed)
    fit = stub(rng, 60, 3, rng.uniform(0.1, 100.0, 3))
    columns = rng.standard_normal((60, 2)) + fit.whitened[:, 0, :2]
    found = only(fit, SHIFT, columns)
    small = np.vstack([fit.whitened[:, 0], fit.prior.rows])
    large = np.hstack([small, np.vstack([columns, np.zeros((3, 2))])])
    sums = [np.linalg.lstsq(m, fit.residual, rcond=None) for m in (small, large)]
    expected = float(np.sum((fit.residual - small @ sums[0][0]) ** 2))
    expected -= float(np.sum((fit.residual - large @ sums[1][0]) ** 2))
    assert abs(found.ratio - expected) < 1e-8 * (1.0 + expected)
    np.testing.assert_allclose(found.estimate, sums[1][0][3:], atol=1e-9)
    covariance = np.linalg.inv(large.T @ large)[3:, 3:]
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-7)


def test_a_tight_prior_leaves_what_it_forbids():
    rng = np.random.default_rng(1)
    fit = stub(rng, 400, 2, np.array([1e5, 1.0]))
    fit.residual[:400] += 0.02 * fit.whitened[:, 0, 0]
    copy = Candidate("body_error", "link", "inertia", "mass", None, ("a",), (1.0,))
    found = only(fit, copy, fit.whitened[:, 0, :1])
    assert found.freedom == 1
    assert abs(found.estimate[0] - 0.02) < 5.0 / np.sqrt(400)


@pytest.mark.parametrize("share", [1.0, 1e-3, 1e-7])
def test_products_are_those_of_what_is_left(share):
    """Of single columns, and of two of which a combination is nearly what the fitted parameters do."""
    rng = np.random.default_rng(5)
    fit = stub(rng, 400, 3, np.array([1e3, 1.0, 0.1]))
    within, other = fit.whitened[:, 0, 1] + share * rng.standard_normal(400), rng.standard_normal(400)
    groups = [rng.standard_normal((400, 2)), within[:, None], np.column_stack([other, other + within])]
    for columns, own in zip(groups, MapFit.projected(fit, groups), strict=True):
        left = own.left
        np.testing.assert_allclose(left, _left(fit, columns), atol=1e-12)
        np.testing.assert_allclose(own.raw, (columns**2).sum(axis=0))
        size, values = least_squares_shares(own.gram, own.raw), least_squares_shares(left.T @ left, own.raw)
        np.testing.assert_allclose(size, values, rtol=1e-6)
        np.testing.assert_allclose(own.slope, left.T @ fit.residual, rtol=1e-6, atol=1e-9)


def _left(fit, columns):
    """What the fitted parameters leave, by least squares."""
    padded = np.vstack([columns, np.zeros((len(fit.residual) - len(columns), columns.shape[1]))])
    whole = np.vstack([fit.whitened[:, 0], fit.prior.rows])
    return padded - whole @ np.linalg.lstsq(whole, padded, rcond=None)[0]


def least_squares_shares(gram, raw):
    """The shares of information left of columns, ascending."""
    return np.linalg.eigvalsh(gram / np.sqrt(np.outer(raw, raw)))


def test_equal_candidates_are_fully_correlated():
    rng = np.random.default_rng(2)
    fit = stub(rng, 80, 2, np.ones(2))
    columns = rng.standard_normal((80, 2))
    first, second = only(fit, SHIFT, columns), only(fit, SHIFT, columns @ rng.standard_normal((2, 2)))
    assert abs(correlation(first, second) - 1.0) < 1e-9
    other = only(fit, SHIFT, rng.standard_normal((80, 2)))
    assert correlation(first, other) < 0.6


def test_one_that_does_nothing_but_has_a_prior_stays():
    """At no compliance a gear's rotor does nothing, whatever the recording; the refit is to have it."""
    gear = GearCompliance(
        name="gear", joint="j", quasistatic=True, inertia_in_link=True, prior={"motor_inertia": 0.01}
    )
    free = ("gear.compliance", "gear.motor_inertia")
    own = Candidate("gear_compliance", "j", "drivetrain", "compliance", gear, free, (1.0, 1.0))
    rng = np.random.default_rng(3)
    column = rng.standard_normal(60)
    score = only(stub(rng, 60, 3, np.full(3, 1.0)), own, np.column_stack([column, np.zeros(60)]))
    assert score.candidate is own and score.freedom == 1


def test_a_parameter_that_does_nothing_is_not_fitted():
    rng = np.random.default_rng(3)
    fit = stub(rng, 60, 3, np.full(3, 1.0))
    columns = rng.standard_normal((60, 2))
    for nothing in (np.zeros(60), 1e-16 * columns[:, 0]):
        whole = Candidate("body_error", "link", "inertia", "mass", None, ("a", "b", "c"), (1.0, 2.0, 3.0))
        score = only(fit, whole, np.column_stack([columns[:, 0], nothing, columns[:, 1]]))
        assert score.candidate.free == ("a", "c")
        assert score.candidate.steps == (1.0, 3.0)
        assert score.freedom == 2 and np.asarray(score.columns).shape[1] == 2 and score.taken.shape[1] == 2
        assert np.isclose(score.ratio, only(fit, SHIFT, columns).ratio, rtol=1e-9)
    still = only(fit, SHIFT, np.zeros((60, 2)))
    assert still.freedom == 0 and still.candidate is SHIFT


@pytest.mark.parametrize(("ratio", "freedom"), [(9.0, 1), (30.0, 1), (30.0, 4), (30.0, 6), (400.0, 3)])
def test_odds_are_those_of_the_likeliest_normal_prior(ratio, freedom):
    """Against the marginal likelihood by quadrature of each component, over a scan of prior widths."""
    size = np.sqrt(ratio / freedom)  # of a component, in its standard deviations
    x = np.linspace(-60.0, 60.0, 200001)
    widths = np.linspace(0.3, 1.5, 61) * size
    gains = [
        np.log(trapezoid(np.exp(size * x - 0.5 * x**2 - 0.5 * size**2) * norm.pdf(x, scale=w), x))
        + 0.5 * size**2
        for w in widths
    ]
    assert odds(ratio, freedom, 10**9) == pytest.approx(2.0 * freedom * max(gains), rel=1e-3)


def test_odds_of_what_is_strong_are_the_criterion():
    assert odds(1e6, 3, 100) == pytest.approx(1e6 - 3.0 * np.log(100))
    assert odds(2.0, 4, 100) < 0.0


def test_the_same_error_of_bodies_that_move_as_one_is_told_from_what_only_looks_like_it():
    """Of another kind, or with a direction of its own, it is refitted by itself when the other is refused."""
    rng = np.random.default_rng(3)
    fit = stub(rng, 200, 3, np.ones(3))
    columns = rng.standard_normal((200, 2))
    first = only(fit, SHIFT, columns)
    mixed = columns @ np.array([[2.0, 0.3], [-1.0, 5.0]])
    assert is_same_error(first, only(fit, replace(SHIFT, location="next link"), mixed))
    assert not is_same_error(first, only(fit, replace(SHIFT, shape="inertia"), mixed))
    beside = np.column_stack([mixed[:, 0], mixed[:, 1] + 0.1 * rng.standard_normal(200)])
    assert not is_same_error(first, only(fit, SHIFT, beside))
