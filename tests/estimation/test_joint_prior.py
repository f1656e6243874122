"""What an estimate knows of several parameters together: its covariance, and the marginal one of a part."""

import numpy as np
import pytest

from smsid.estimation.parameter_vector import JointPrior, Unknown

FACTORS = ({"a.m": 1.0, "b.m": 2.0}, {"b.m": 1.0}, {"tank.mass": 1.0})
COVARIANCE = np.array([[4.0, 1.9, 0.3], [1.9, 1.0, 0.1], [0.3, 0.1, 0.25]])


def unknown(name, sigma=np.inf):
    return Unknown(name, "inertial", "kg", 1.0, sigma, 1.0)


def test_rows_whiten_the_sums_by_their_covariance():
    unknowns = [unknown(n, 1.0) for n in ("a.m", "b.m", "tank.mass")]
    rows = JointPrior(FACTORS, COVARIANCE).rows(unknowns)
    sums = np.array([[f.get(u.name, 0.0) for u in unknowns] for f in FACTORS])
    assert rows.T @ rows == pytest.approx(sums.T @ np.linalg.inv(COVARIANCE) @ sums)


@pytest.mark.parametrize("lost", ["freed", "not fitted"])
def test_of_what_is_not_known_any_more_the_others_keep_their_marginal_covariance(lost):
    some = [unknown("a.m", 1.0), unknown("b.m", 1.0)]
    unknowns = [*some, unknown("tank.mass")] if lost == "freed" else some
    rows = JointPrior(FACTORS, COVARIANCE).rows(unknowns)
    sums = np.array([[1.0, 2.0], [0.0, 1.0]])
    wanted = sums.T @ np.linalg.inv(COVARIANCE[:2, :2]) @ sums
    assert (rows.T @ rows)[:2, :2] == pytest.approx(wanted)
    assert not rows[:, 2:].any()


def test_errors_of_one_sign_are_not_believed_to_cancel():
    unknowns = [unknown(n, 1.0) for n in "abcd"]
    prior = JointPrior(tuple({n: 1.0} for n in "abcd"), 0.9 + 0.1 * np.eye(4))
    alone = JointPrior.independent(prior.factors, np.ones(4))
    along = np.ones(4)
    assert np.sum((prior.rows(unknowns) @ along) ** 2) == pytest.approx(4.0 / 3.7)
    assert np.sum((alone.rows(unknowns) @ along) ** 2) == pytest.approx(4.0)
