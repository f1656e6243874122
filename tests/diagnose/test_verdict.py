"""Where the model never follows: what the identified one leaves anyway is asked of no cause."""

from types import SimpleNamespace

import numpy as np
import pytest

from smsid.diagnose.diagnose import _left
from smsid.diagnose.search import Search
from smsid.diagnose.verdict import verdict
from smsid.identify.estimate import Estimate


class Found(SimpleNamespace):
    """What a verdict reads of a search in which misfit is counted."""

    misfit, left, left_before = True, (), ()
    noise = {"panel.acceleration": 40.0}  # noqa: RUF012
    followed, as_known = Search.followed, Search.as_known


def found(before, after, known, causes=()):
    """Two components: one that strays, and one that is noise and has a tenth of its samples."""
    rows = ([before, 1.0], [after, 1.0], [known, 0.0])
    first, second, third = (np.array(x) for x in rows)
    counts = np.array([1000, 100])
    return Found(strayed=(first, second), known=third, counts=counts, causes=causes)


NAMED = (
    SimpleNamespace(
        shape="axial softening", family="appendage", effect="geometric_stiffness", location="panel",
        parameters=(), onset=None, aliases=(),
    ),
)  # fmt: skip


@pytest.mark.parametrize(
    ("before", "after", "known", "said"),
    [
        (14.0, 6.0, 0.0, "unexplained"),  # 82 % of the squares
        (14.0, 4.0, 0.0, "explained"),  # 92 %
        (14.0, 6.0, 5.0, "explained"),  # 25 of the 36 that are left were there before: 94 % of the rest
        (14.0, 6.0, 9.0, "explained"),
        (14.0, 9.0, 7.0, "unexplained"),
        (6.0, 5.9, 7.0, "unexplained"),  # it was followed before: there is nothing that it takes away
    ],
)
def test_what_the_identified_model_leaves_is_not_asked_of_a_cause(before, after, known, said):
    assert verdict(found(before, after, known, NAMED), NAMED)[0] == said


def test_a_model_as_good_as_where_it_was_identified_is_adequate():
    assert verdict(found(6.0, 6.0, 5.8), ())[0] == "adequate"
    assert verdict(found(6.0, 6.0, 4.0), ())[0] == "unexplained"
    assert verdict(found(14.0, 14.0, 0.0), ())[0] == "unexplained"
    beside = found(6.0, 6.0, 5.8)  # a fault of samples is not what the model leaves
    assert verdict(beside, NAMED)[0] == "explained"
    other = replace_rows(found(6.0, 6.0, 5.8), 1, 20.0)  # what strays is not what is known to
    assert verdict(other, ())[0] == "unexplained"


def replace_rows(found, row, to):
    for x in found.strayed:
        x[row] = to
    return found


def test_what_is_known_is_of_other_recordings_and_clearly_no_noise():
    block = SimpleNamespace(channel="panel.acceleration", rows=slice(0, 2))
    other = SimpleNamespace(channel="imu.acceleration", rows=slice(2, 3))
    data = SimpleNamespace(rows=3, blocks=(block, other), sigma=np.array([1e-4, 1e-4, 1e-3]))
    residuals = {"panel.acceleration": (2e-3, 4e-4), "imu.acceleration": (6e-3, 6e-3, 6e-3)}
    estimate = Estimate("d", "ml", (), recordings=("exp1_z",), residuals=residuals)
    assert _left(data, estimate, "exp1_xyz") == pytest.approx(
        [20.0, 1.0, 1.0]
    )  # two: of noise; another shape
    assert _left(data, estimate, "exp1_z") is None
    assert _left(data, None, "exp1_xyz") is None
