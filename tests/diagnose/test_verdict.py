"""What a search found in words: when it is an explanation, and when pieces of something else."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from smsid.diagnose.model_comparison import Cause
from smsid.diagnose.result import FoundCause
from smsid.diagnose.score_test import Candidate, Score
from smsid.diagnose.stepwise import Search
from smsid.diagnose.thresholds import THRESHOLDS
from smsid.diagnose.verdict import _within_bounds, group_equivalent, remaining_tests, verdict
from smsid.estimation.parameter_vector import Unknown

WHOLE = SimpleNamespace(left=(), misfit=False, causes=())
STRAYS = SimpleNamespace(left=(), misfit=True, followed=0.99, noise={"imu.angular_rate": 20.0}, causes=())


def cause(family, location, onset):
    return FoundCause(f"an effect of {family}", location, family, "shape", (), (), {}, onset=onset)


@pytest.mark.parametrize(
    ("second", "decided"),
    [
        (("actuator", "joint3", 8.9), "unexplained"),
        (("actuator", "joint2", 58.2), "explained"),  # at once
        (("actuator", "joint3", None), "explained"),
        (("inertia", "tool", 8.9), "explained"),  # a payload is grasped, later a motor weakens
    ],
)
@pytest.mark.parametrize("whole", [WHOLE, STRAYS], ids=["followed", "misfit"])
def test_causes_of_a_family_that_begin_in_turn_are_pieces_of_a_drift(whole, second, decided):
    found = (cause("actuator", "joint2", 58.4), cause(*second))
    said, sentence = verdict(whole, found)
    assert said == decided
    assert "joint2" in sentence and ("drift" in sentence) == (said == "unexplained")
    assert verdict(whole, found[:1])[0] == "explained"


@pytest.mark.parametrize(
    ("first", "second", "decided"),
    [
        (
            ("sensor", "imu.angular_rate", 20.0),
            ("sensor", "encoder.joint_position[joint1]", 50.0),
            "explained",
        ),
        (("sensor", "imu.angular_rate", 20.0), ("sensor", "imu.angular_rate", 50.0), "unexplained"),
        (("external", "bus", 20.0), ("external", "link1", 50.0), "unexplained"),
    ],
)
def test_sensors_fail_one_by_one(first, second, decided):
    assert verdict(WHOLE, (cause(*first), cause(*second)))[0] == decided


def searched(shifts, sigmas, rows, factors, left_by, **fields):
    """A search whose k-th cause shows in component ``rows[k]`` most, and a little everywhere, with a
    parameter that is ``shifts[k]`` off with standard deviation ``sigmas[k]``; ``factors`` are noise levels
    over the stated ones, ``left_by`` the prediction errors over these.
    """
    names = [f"effect{k}.size" for k in range(len(shifts))]
    unknowns = tuple(SimpleNamespace(name=n, nominal=0.0, lower=1e-9, upper=np.inf) for n in names)
    whitened = 1e-3 * np.ones((5, len(factors), len(shifts))) / np.maximum(shifts, 1e-9)
    for k, row in enumerate(rows):
        whitened[:, row, k] *= 1e6 / factors[row]
    errors = np.tile(left_by, (100, 1))
    run = SimpleNamespace(normalised=errors, used=np.ones(errors.shape, dtype=bool))
    last = SimpleNamespace(
        run=run, unknowns=unknowns, whitened=whitened, scales=np.ones(len(shifts)),
        covariance=lambda held=(), white=False: np.diag(np.square(sigmas)),
        point=SimpleNamespace(value=lambda u: shifts[names.index(u.name)]),
        problem=SimpleNamespace(
            data=SimpleNamespace(names=[f"row{k}" for k in range(len(factors))]), coloured=False
        ),
    )  # fmt: skip
    none = np.zeros((0, 1))
    own = [Candidate("kind", f"place{k}", "other", "size", None, (n,), (1e-9,)) for k, n in enumerate(names)]
    causes = [Cause(Score(c, 50.0, 1, none[0:0], none, 1.0, none, none), (), 50.0) for c in own]
    noise = {f"row{k}": float(f) for k, f in enumerate(factors)}
    return SimpleNamespace(last=last, causes=causes, factors=factors, noise=noise, **{"bent": {}, **fields})


def test_nothing_is_explained_that_leaves_a_causes_own_component_or_may_be_nothing():
    """Whatever a search ends with: channels were left at 30 times their noise, and a cause was no more than
    its standard deviation.
    """
    rng, said = np.random.default_rng(7), {"explained": 0, "unexplained": 0}
    test = SimpleNamespace(where="torque of joint1", dependence="angle")
    for _ in range(1000):
        count, factors = rng.integers(1, 4), np.exp(rng.uniform(0.0, 2.0, 6))
        rows, sigmas = rng.integers(0, 6, count), np.exp(rng.normal(-4.0, 2.0, count))
        misfit, left = rng.random() < 0.7, (test,) * int(rng.random() < 0.2)
        factors, errors = (factors, np.ones(6)) if misfit else (np.ones(6), factors)
        found = searched(
            np.ones(count), sigmas, rows, factors, errors, misfit=misfit, left=left, left_before=left,
            followed=rng.uniform(0.8, 1.0),
        )  # fmt: skip
        named = [FoundCause("kind", f"place{k}", "other", "size", (), (), {}) for k in range(count)]
        decided, sentence = verdict(found, named)
        nothing = (chi2.sf(sigmas**-2.0, 1) > THRESHOLDS.nested).any()
        open_ = (factors * errors)[rows].max() > 3.0 or (found.followed < 0.9 if misfit else bool(left))
        expected = "unexplained" if nothing or open_ else "explained"
        assert decided == expected, sentence
        said[decided] += 1
    assert min(said.values()) > 50


@pytest.mark.parametrize(
    ("ends", "decided"),
    [
        ((0.3, 4.0), "explained"),
        ((-0.1, 4.0), "unexplained"),
        ((2.0, 4.0), "unexplained"),
        ((1e-9, 4.0), "unexplained"),  # cut off where a mass may end
        ((0.3, np.inf), "unexplained"),  # it was not followed to its end
    ],
)
def test_a_profile_says_whether_a_bent_strength_may_be_nothing(ends, decided):
    """A further mode's mass of 1 +- 0.6: the likelihood falls steeply towards none. Ends that do not hold the
    value are of another fit.
    """
    found = searched(
        np.ones(1), np.full(1, 0.6), [2], np.ones(4), np.ones(4), misfit=False, left=(), left_before=(),
        followed=0.99, bent={"effect0.size": ends},
    )  # fmt: skip
    assert verdict(found, [FoundCause("kind", "place0", "other", "size", (), (), {})])[0] == decided


def test_the_component_that_is_left_is_said_with_its_level():
    found = searched(
        np.ones(1), np.full(1, 1e-3), [2], np.array([50.0, 1.0, 4.0]), np.ones(3), misfit=True, left=(),
        followed=0.99,
    )  # fmt: skip
    said, sentence = verdict(found, [FoundCause("kind", "place0", "other", "size", (), (), {})])
    assert said == "unexplained" and "row2 is left at 4 times its noise" in sentence, sentence
    assert "is not believed" not in sentence, "nothing speaks against its value"


def test_what_causes_take_away_is_a_share_of_the_squares():
    told = SimpleNamespace(normalised_rmse=(10.0, 1.0))
    assert Search.followed.fget(told) == pytest.approx(0.99)  # what the verdict and standing causes read


@pytest.mark.parametrize(
    ("value", "sigma", "expected"),
    [
        (1.0, 0.1, None),
        (0.1, 1.0, (0.0, 2.06)),
        (3.9, 0.2, (3.508, 4.0)),
        (5.0, 1.0, None),
        (1.0, np.inf, None),
    ],
)
def test_no_interval_reaches_beyond_what_a_parameter_can_be(value, sigma, expected):
    u = Unknown("rub.stribeck", "effect", "N m", 0.0, np.inf, 1.0, lower=0.0, upper=4.0)
    found = _within_bounds(u, value, sigma)
    assert found == (None if expected is None else pytest.approx(expected, abs=1e-3))


def test_beside_a_cause_that_stands_what_is_left_is_said_and_not_what_it_took_away():
    """ "Torque of joint2 depends on load, and no cause fits it": load-dependent friction of joint2 stood."""
    before, after = (
        SimpleNamespace(where=where, dependence=on, ratio=r, freedom=1, p_value=0.0)
        for where, on, r in (
            ("torque of joint2", "load", 1e6),
            ("imu.acceleration[z]", "its own past", 200.0),
        )
    )
    found = searched(np.ones(1), np.full(1, 1e-3), [0], np.ones(6), np.ones(6), misfit=False, left=(after,),
                     left_before=(before,), followed=1.0, bands=(), blocks=(after,))  # fmt: skip
    own = FoundCause("kind", "place0", "other", "size", (), (), {})
    fault = FoundCause("outliers", "imu", "sensor", "outliers", (), (), {})
    _, sentence = verdict(found, (own,), (own,), ())
    assert "imu.acceleration[z] depends on its own past" in sentence and "depends on load" not in sentence
    assert [t.where for t in remaining_tests(found, "unexplained", (own,))] == ["imu.acceleration[z]"]
    # nor beside hints: a ripple of joint1 was said to be left of joint3, whose motor's gain stood
    hint = FoundCause("kind", "place1", "other", "size", (), (), {})
    _, sentence = verdict(found, (own, hint), (own,), (hint,))
    assert "imu.acceleration[z] depends on its own past" in sentence and "still depends" not in sentence
    for standing in ((), (fault,)):
        _, sentence = verdict(found, (own,), standing, (own,))
        assert "torque of joint2 depends on load" in sentence
        assert [t.where for t in remaining_tests(found, "unexplained", standing)] == ["torque of joint2"]


def test_errors_of_a_kind_that_do_all_the_cause_does_are_one_at_several_places():
    """The inertia of links about a joint, and its motor's: two names, of three bodies and one motor."""
    rng = np.random.default_rng(5)
    column, others = rng.standard_normal((50, 1)), rng.standard_normal((50, 2))

    def at(kind, place, shape, columns):
        names = tuple(f"{place}.{k}" for k in range(columns.shape[1]))
        own = Candidate(kind, place, "other", shape, None, names, (1.0,) * len(names))
        size = np.ones(len(names))
        return Score(own, 9.0, len(names), size, np.diag(size), 1.0, columns, np.zeros((0, len(names))))

    link = at("body_error", "link1", "inertia", column)
    second = at("body_error", "link2", "inertia", np.hstack([2.0 * column + others[:, :1], others]))
    looks = at("body_error", "link3", "inertia", column + 0.1 * others[:, :1])
    motor, mass = at("motor", "joint1", "inertia", -column), at("body_error", "link4", "mass", column)
    near = [(s, 1.0) for s in (motor, second, looks, mass)]
    assert group_equivalent(Cause.of(link, near, 9.0), near) == (
        ("link2",),
        [(motor, 1.0, ()), (looks, 1.0, ()), (mass, 1.0, ())],
    )
    near = [(s, 1.0) for s in (second, looks, link)]
    assert group_equivalent(Cause.of(motor, near, 9.0), near) == (
        (),
        [(second, 1.0, ("link1",)), (looks, 1.0, ())],
    )
