"""Where the model never follows: what the identified one leaves anyway, and causes too small to be named."""

from types import SimpleNamespace

import pytest

from smsid.diagnose.search import Search
from smsid.diagnose.verdict import minor, verdict


class Found(SimpleNamespace):
    """What a verdict reads of a search in which misfit is counted."""

    misfit, left, left_before = True, (), ()
    noise = {"panel.acceleration": 40.0}  # noqa: RUF012
    followed = Search.followed


def found(before, after, known, *ratios):
    causes = tuple(SimpleNamespace(ratio=r) for r in ratios)
    return Found(strayed=(before, after), known=known, causes=causes)


NAMED = (
    SimpleNamespace(
        shape="axial softening", family="appendage", effect="geometric_stiffness", location="panel",
        parameters=(), onset=None, aliases=(),
    ),
)  # fmt: skip


@pytest.mark.parametrize(
    ("before", "after", "known", "said"),
    [
        (14.0, 6.0, 1.0, "unexplained"),  # 82 % of the squares
        (14.0, 4.0, 1.0, "explained"),  # 92 %
        (14.0, 6.0, 5.0, "explained"),  # 25 of the 36 that are left were there before: 94 % of the rest
        (14.0, 6.0, 9.0, "explained"),
        (14.0, 9.0, 7.0, "unexplained"),
    ],
)
def test_what_the_identified_model_leaves_is_not_asked_of_a_cause(before, after, known, said):
    assert verdict(found(before, after, known, 500.0), NAMED)[0] == said


def test_a_model_as_good_as_where_it_was_identified_is_adequate():
    assert verdict(found(6.0, 6.0, 5.8), ())[0] == "adequate"
    assert verdict(found(6.0, 6.0, 5.0), ())[0] == "unexplained"
    assert verdict(found(14.0, 14.0, 1.0), ())[0] == "unexplained"


def test_causes_that_explain_little_beside_misfit_are_none():
    assert minor(found(14.0, 4.0, 1.0, 500.0, 66.0, 120.0)) == (False, True, False)
    sound = found(14.0, 4.0, 1.0, 500.0, 66.0)
    sound.misfit = False
    assert minor(sound) == (False, False)
    assert minor(found(14.0, 4.0, 1.0)) == ()
