"""What a verdict rests on, simulated or by hand: size of statistics under the null, power at the limit."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import chi2, norm

from smsid.diagnose import _change_time_posterior as change_time_posterior
from smsid.diagnose import specification_tests as blocks
from smsid.diagnose import verdict
from smsid.diagnose._exchange_step import eliminate_backward
from smsid.diagnose._noise_covariance import misfit_factors
from smsid.diagnose._wald_test import chance_of_share, wald
from smsid.diagnose.model_comparison import accept, is_distinguishable, simplest_law
from smsid.diagnose.score_test import Candidate, Score, correlation, least_squares
from smsid.diagnose.specification_tests import SpecificationTest, adequacy, whiteness
from smsid.diagnose.thresholds import THRESHOLDS, DetectionThresholds
from smsid.effects import JointFriction
from smsid.estimation.map_estimate import MapFit
from smsid.estimation.problem import ProcessNoise
from smsid.estimation.sensitivities import Sensitivity

from .test_backward_elimination import cause, fitted
from .test_model_comparison import score
from .test_score_test import SHIFT, only, stub

DRAWS = 400


def of_chance(x: np.ndarray, level: float) -> float:
    """Standard deviations by which the share of p-values below a level is off."""
    return float((np.mean(x < level) - level) / np.sqrt(level * (1.0 - level) / len(x)))


def test_scores_have_the_size_they_say():
    """On noise, p-values are uniform: of one parameter of either sign, and of two together."""
    rng = np.random.default_rng(1)
    one = Candidate("body_error", "link", "inertia", "mass", None, ("a",), (1.0,))
    for candidate in (one, SHIFT):
        found = []
        for _ in range(DRAWS):
            fit = stub(rng, 30, 2, np.ones(2))
            fit.residual[30:] = rng.standard_normal(2)
            found.append(only(fit, candidate, rng.standard_normal((30, len(candidate.free)))).p_value)
        for level in (0.05, 0.3, 0.7):
            assert abs(of_chance(np.array(found), level)) < 4.0


def test_the_searched_pay_for_every_variant_and_those_with_a_sign_half():
    plain = score(12.0, 2)
    searched = replace(plain, candidate=replace(plain.candidate, grid=30))
    assert plain.p_value == pytest.approx(chi2.sf(12.0, 2))
    assert searched.p_value == pytest.approx(30 * chi2.sf(12.0, 2))
    assert replace(plain, sides=1).p_value == pytest.approx(0.5 * chi2.sf(12.0, 2))
    paid = plain.information_gain(1000) - searched.information_gain(1000)
    assert paid == pytest.approx(2 * np.log(30)) == plain.odds(1000) - searched.odds(1000)


def test_a_direction_that_rounding_leaves_is_no_parameter():
    gram, slope = np.diag([4.0, 4e-15]), np.array([2.0, 2.0])
    estimate, covariance, ratio, shares = least_squares(gram, slope, np.array([4.0, 4.0]))
    assert ratio == pytest.approx(1.0) and estimate == pytest.approx([0.5, 0.0])
    assert covariance == pytest.approx(np.diag([0.25, 0.0])) and (shares > THRESHOLDS.excited).sum() == 1


def test_two_that_share_one_direction_of_two_are_correlated():
    rng = np.random.default_rng(4)
    fit = stub(rng, 200, 1, np.ones(1))
    shared, others = rng.standard_normal((200, 1)), rng.standard_normal((200, 2))
    first, second = (only(fit, SHIFT, np.hstack([shared, others[:, k : k + 1]])) for k in (0, 1))
    assert correlation(first, second) == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize(("tried", "named"), [(1, True), (200, False)])
def test_a_cause_pays_for_all_that_were_tried(monkeypatch, tried, named):
    """Its chance is 1e-3 by itself and a fifth among two hundred."""
    ratio = float(chi2.isf(1e-3, 1))
    run = SimpleNamespace(samples=1000)
    found = SimpleNamespace(objective=0.0, run=run, unknowns=(), problem=Coloured(False))
    monkeypatch.setattr("smsid.diagnose.model_comparison.refit", lambda current, s, at_most: found)
    monkeypatch.setattr("smsid.diagnose._wald_test.wald", lambda *_, **__: 1e3)
    current = SimpleNamespace(objective=0.5 * ratio, run=run, unknowns=())
    best = score(ratio, 1)
    assert (accept(current, best, [best], DetectionThresholds(), tried)[0] is not None) is named


@pytest.mark.parametrize(
    ("ratio", "follows", "named"), [(680.0, True, True), (680.0, False, False), (300.0, True, False)]
)
def test_what_lets_the_model_follow_is_no_chance(monkeypatch, ratio, follows, named):
    """A second tank of 19 kg took too little of the misfit away to be proven by that, and was not named."""
    run = SimpleNamespace(samples=1000)
    found = SimpleNamespace(objective=0.0, run=run, unknowns=(), problem=Coloured(True))
    monkeypatch.setattr("smsid.diagnose.model_comparison.refit", lambda current, s, at_most: found)
    monkeypatch.setattr("smsid.diagnose.model_comparison.chance_of_nothing", lambda *_: 1e-4)
    current = SimpleNamespace(objective=0.5 * ratio, run=run, unknowns=())
    best, asked = score(ratio, 1), []

    def tried(fit):
        asked.append(fit)
        return follows

    monkeypatch.setattr(type(best), "chance_of", lambda own, nothing: nothing)
    cause, _ = accept(current, best, [best], DetectionThresholds(), 122, follows=tried)
    assert (cause is not None) is named
    assert asked == ([found] if ratio > DetectionThresholds().linear else [])


@pytest.mark.parametrize("hopeful", [True, False])
@pytest.mark.parametrize("followed", ["best", "other", ""])
def test_what_may_be_nothing_but_lets_the_model_follow_is_a_cause(monkeypatch, followed, hopeful):
    """An attitude's bias of 1.35 rad is hardly seen in noise as large as itself; with it all is followed.

    What comes behind is asked by its chance alone: a fit to the stated noise of each would take minutes.
    """
    run, asked = SimpleNamespace(samples=1000), []
    best, other = (replace(score(ratio, 1), columns=np.ones((5, 1))) for ratio in (40.0, 39.0))
    other = replace(other, candidate=replace(other.candidate, location="other"))
    fits = {
        s.candidate.key: SimpleNamespace(objective=0.0, run=run, unknowns=(), problem=Coloured(True))
        for s in (best, other)
    }
    module = "smsid.diagnose.model_comparison"
    monkeypatch.setattr(f"{module}.refit", lambda current, s, at_most: fits[s.candidate.key])
    monkeypatch.setattr(f"{module}.chance_of_nothing", lambda *_: 0.03)

    def follows(fit):
        asked.append(fit)
        return fit is {"best": fits[best.candidate.key], "other": fits[other.candidate.key]}.get(followed)

    current = SimpleNamespace(objective=20.0, run=run, unknowns=())
    levels = replace(DetectionThresholds(), linear=0.0)
    hopes = {"hopeful": lambda s: hopeful, "follows": follows}
    in_vain = set()
    cause, _ = accept(current, best, [best, other], levels, 122, in_vain=in_vain, **hopes)
    assert asked == [fits[best.candidate.key]] * hopeful
    assert (cause is not None) is (hopeful and followed == "best")
    if cause is None:  # the other is asked when it is the best
        assert in_vain == {best.candidate.key} | (set() if hopeful else {other.candidate.key})
    else:  # it has the same columns
        assert [s.candidate.key for s, _ in cause.aliases] == [other.candidate.key]


def test_a_cause_that_the_others_made_weak_pays_for_all_that_were_tried(monkeypatch):
    """Wald's statistic of 12 is one case in two thousand: enough for one alone, not for one of sixty."""

    def wald(found, candidate, *, held=False, strength=False):
        return 12.0 if candidate.location == "joint1" else 50.0

    for module in ("_exchange_step", "_wald_test"):
        monkeypatch.setattr(f"smsid.diagnose.{module}.wald", wald)
    monkeypatch.setattr("smsid.diagnose._exchange_step.each_may_be_zero", lambda *_: False)
    monkeypatch.setattr("smsid.diagnose._exchange_step.without_cause", lambda found, *_: found)
    monkeypatch.setattr("smsid.diagnose._exchange_step.fit", lambda *_, **options: fitted(1.0))
    causes = [cause("joint1"), cause("joint2")]
    for tried, kept in ((1, 2), (60, 1)):
        assert (
            len(eliminate_backward(list(causes), fitted(0.0), fitted(1.0), DetectionThresholds(), tried)[0])
            == kept
        )


def test_correlation_in_time_is_found_as_often_as_by_chance():
    """Ljung and Box's statistic of white innovations is chi-squared with as many degrees as lags."""
    rng = np.random.default_rng(2)
    n, rows = 1000, DRAWS
    run = SimpleNamespace(innovations=rng.standard_normal((n, rows)), used=np.ones((n, rows), dtype=bool))
    names = tuple(f"row{k}" for k in range(rows))
    problem = SimpleNamespace(data=SimpleNamespace(names=names), noise=ProcessNoise())
    found = whiteness(SimpleNamespace(run=run, problem=problem))
    assert np.mean([b.ratio for b in found]) == pytest.approx(
        blocks.LAGS, abs=4 * np.sqrt(2 * blocks.LAGS / rows)
    )
    assert abs(of_chance(np.array([b.p_value for b in found]), 0.05)) < 4.0


def test_generic_tests_have_the_size_they_say(monkeypatch):
    rng = np.random.default_rng(3)
    rows, tests, each = 60, DRAWS, 3
    columns = rng.standard_normal((rows, tests * each))
    fit = stub(rng, rows, 2, np.ones(2))
    fit.residual[rows:] = rng.standard_normal(2)
    fit.run = None
    fit.problem, fit.with_shape_errors = SimpleNamespace(noise=ProcessNoise()), lambda: fit
    named = [("imu.angular_rate", "rate", [Sensitivity()] * each)] * tests
    for part in ("equations_of", "whiteness"):
        monkeypatch.setattr(f"smsid.diagnose.specification_tests.{part}", lambda found: [])
    monkeypatch.setattr("smsid.diagnose.specification_tests._channels", lambda found: named)
    rest = iter(columns.T)  # tests are asked in groups
    monkeypatch.setattr(
        "smsid.diagnose.specification_tests.propagate",
        lambda run, changes: np.column_stack([next(rest) for _ in changes]),
    )
    found = adequacy(fit)
    assert {b.freedom for b in found} == {each}
    # one residual for all, of `rows` dimensions beside the fitted parameters: a test of k takes k of them
    expected = each * float(np.sum(_rest(fit) ** 2)) / rows
    assert np.mean([b.ratio for b in found]) == pytest.approx(expected, rel=0.15)


def _rest(fit) -> np.ndarray:
    """What of the residual the fitted parameters leave."""
    q = fit.factors[0]
    return fit.residual - q @ (q.T @ fit.residual)


def test_the_limits_are_seen_in_nineteen_cases_of_twenty():
    """Of a parameter as large as its limit, whatever its sign, at the level of all that are tried."""
    effect = JointFriction(name="rub", joint="joint1")
    own = Candidate("joint_friction", "joint1", "friction", "viscous", effect, ("rub.viscous",), (2.0,))
    found = Score(own, 1.0, 1, np.zeros(1), np.array([[0.09]]), 1.0, np.zeros((0, 1)), np.zeros((0, 1)))
    search = SimpleNamespace(
        levels=DetectionThresholds(), candidates=60, scores=(found,), last=SimpleNamespace(unknowns=())
    )
    (limit,) = verdict.limits(search)
    sigma = 2.0 * 0.3
    draws = limit.value / sigma + np.random.default_rng(5).standard_normal(20_000)
    share = np.mean(np.abs(draws) > norm.isf(DetectionThresholds().candidate / 60 / 2))
    assert share == pytest.approx(0.95, abs=0.006)


def test_not_knowing_when_it_began_is_in_every_interval():
    unknown = SimpleNamespace(name="rub.viscous", nominal=0.0, unit="N m s/rad", lower=0.0, upper=np.inf)
    last = SimpleNamespace(
        unknowns=(unknown,),
        told=np.ones(1, dtype=bool),
        covariance=lambda: np.array([[4.0]]),
        point=SimpleNamespace(value=lambda u: 1.0),
    )
    own = Candidate("joint_friction", "joint1", "friction", "viscous", None, ("rub.viscous",), (1.0,))
    began = {"rub": SimpleNamespace(covariance=np.array([[5.0]]))}
    found = SimpleNamespace(last=last, bent={})
    assert verdict.values(found, own)[0].sigma == pytest.approx(2.0)
    assert verdict.values(found, own, began)[0].sigma == pytest.approx(3.0)


@pytest.mark.parametrize(("followed", "said"), [(0.85, "unexplained"), (0.95, "explained")])
def test_most_of_what_was_not_followed_has_to_go(followed, said):
    noise = {"imu.angular_rate": 20.0}
    found = SimpleNamespace(left=(), misfit=True, followed=followed, noise=noise, causes=())
    named = verdict.FoundCause("joint_friction", "joint1", "friction", "viscous", (), (), {})
    assert verdict.verdict(found, (named,))[0] == said


def test_a_generic_test_pays_for_its_variants():
    assert SpecificationTest("torque of joint1", "angle", 30.0, 2, grid=5).p_value == pytest.approx(
        5 * chi2.sf(30.0, 2)
    )


def laws(ratio: float, extended: float) -> tuple[Score, Score]:
    """A law and one of the same place that extends it by one parameter, with what each explains."""
    rng = np.random.default_rng(6)
    columns = rng.standard_normal((100, 2))
    plain = replace(score(ratio, 1), columns=columns[:, :1])
    larger = replace(score(extended, 2), columns=columns)
    own = replace(larger.candidate, shape="further", simpler=(plain.candidate.shape,))
    return plain, replace(larger, candidate=own)


def test_a_law_that_extends_another_is_rejected_by_chance_in_one_case_of_twenty():
    beyond = float(chi2.isf(THRESHOLDS.nested, 1))
    for more, rejected in ((beyond - 0.1, True), (beyond + 0.1, False)):
        plain, larger = laws(100.0, 100.0 + more)
        assert is_distinguishable(plain, larger, 10_000, DetectionThresholds()) is rejected


def test_the_simplest_law_that_explains_as_much_comes_first():
    plain, larger = laws(99.0, 100.0)
    assert simplest_law(larger, [larger, plain], 10_000, DetectionThresholds()) is plain
    plain, larger = laws(60.0, 100.0)
    assert simplest_law(larger, [larger, plain], 10_000, DetectionThresholds()) is larger


def test_a_beginning_is_not_known_better_than_within_a_sample(monkeypatch):
    """One that is certain to the sample is uniform within it: 0.29 of its length."""
    module = "smsid.diagnose._change_time_posterior"
    times = np.linspace(0.0, 10.0, 101)
    found = SimpleNamespace(run=SimpleNamespace(states=SimpleNamespace(time=times)), scales=np.ones(1))
    starts = SimpleNamespace(start=5.0, ratios=lambda t: -1e6 * np.abs(np.array(t) - 5.0))
    monkeypatch.setattr(f"{module}.Starts", lambda found, mine: starts)
    monkeypatch.setattr(
        f"{module}.step_from", lambda found, t: float(times[np.searchsorted(times, t - 1e-9)])
    )
    monkeypatch.setattr(f"{module}._over", lambda *_: change_time_posterior.Began(0.0, np.zeros((1, 1))))
    known = change_time_posterior.start_of(found, SimpleNamespace())
    assert known.sigma == pytest.approx(0.1 / np.sqrt(12.0))


TIME = np.arange(800)
FITTED = np.column_stack([np.ones(800), np.sin(TIME / 10.0), np.exp(-(((TIME - 300) / 60.0) ** 2))])


@dataclass(frozen=True)
class Coloured:
    """Of a problem, what a covariance asks for."""

    coloured: bool = True
    noise: ProcessNoise = field(default_factory=ProcessNoise)


def memory(rng: np.random.Generator, samples: float) -> np.ndarray:
    """An error of variance one that forgets within so many samples."""
    a = np.exp(-1.0 / samples)
    return lfilter([np.sqrt(1.0 - a * a)], [1.0, -a], rng.standard_normal(3000))[-len(TIME) :]


def fitted_beside_misfit(errors: np.ndarray) -> MapFit:
    """A constant, an oscillation and an event fitted to errors whose misfit is counted as it is."""
    data = SimpleNamespace(rows=1)
    run = SimpleNamespace(normalised=errors[:, None], used=np.ones((len(TIME), 1), dtype=bool))
    level = misfit_factors(data, run)[0]
    columns, seen = FITTED / level, errors / level
    found = np.linalg.lstsq(columns, seen, rcond=None)[0]
    run.innovations = (seen - columns @ found)[:, None]
    unknowns = tuple(SimpleNamespace(name=f"x.{k}", scale=1.0, nominal=0.0) for k in range(3))
    point = SimpleNamespace(value=lambda u: found[int(u.name[-1])])
    gram, none = columns.T @ columns, SimpleNamespace(rows=np.zeros((0, 3)), off=np.zeros(0))
    return MapFit(point, unknowns, Coloured(), run, columns[:, None], gram, np.zeros(3), 0.0, None, none)


def sigmas_off(found: MapFit) -> np.ndarray:
    return np.array([found.point.value(u) for u in found.unknowns]) / np.sqrt(np.diag(found.covariance()))


def test_intervals_beside_misfit_hold_where_its_spectrum_is_local():
    """The misfit swings as one parameter's signature does: by its level alone 88 % were inside."""
    rng, inside, white = np.random.default_rng(1), np.zeros(3), np.zeros(3)
    for _ in range(DRAWS):
        near = memory(rng, 30.0) * np.sin(TIME / 10.0) + memory(rng, 30.0) * np.cos(TIME / 10.0)
        found = fitted_beside_misfit(near)
        inside += np.abs(sigmas_off(found)) < 1.96
        white += np.abs(sigmas_off(replace(found, problem=Coloured(False)))) < 1.96
    assert (inside / DRAWS > 0.93).all(), inside / DRAWS
    assert white[1] / DRAWS < 0.9


def test_white_misfit_widens_hardly_anything():
    rng = np.random.default_rng(2)
    found = [fitted_beside_misfit(rng.standard_normal(len(TIME))) for _ in range(100)]
    more = [sigmas_off(replace(f, problem=Coloured(False))) / sigmas_off(f) for f in found]
    assert np.median(more) == pytest.approx(1.0) and np.mean(more) < 1.2


def test_errors_as_slow_as_the_record_are_no_proof():
    """A hundred samples of memory of 800: by its level alone a constant was there in one case of twenty."""
    rng, white, by_spectrum = np.random.default_rng(3), 0, 0
    constant = Candidate("body_error", "link", "inertia", "mass", None, ("x.0",), (1.0,))
    for _ in range(DRAWS):
        found = fitted_beside_misfit(memory(rng, 100.0))
        by_spectrum += chi2.sf(wald(found, constant), 1) < 1e-4
        white += chi2.sf(wald(replace(found, problem=Coloured(False)), constant), 1) < 1e-4
    assert white > 8 and by_spectrum <= 1


def share_taken(errors: np.ndarray, signature: np.ndarray) -> float:
    """The chance of what a signature takes of errors, both (N,)."""
    own = Candidate("body_error", "link", "inertia", "mass", None, ("x.0",), (1.0,))
    left = errors - signature * (signature @ errors) / (signature @ signature)

    def fitted(seen: np.ndarray) -> MapFit:
        none = SimpleNamespace(rows=np.zeros((0, 1)), off=np.zeros(0))
        unknowns, run = (SimpleNamespace(name="x.0"),), SimpleNamespace(innovations=seen[:, None])
        columns = np.zeros((len(seen), 1, 1))
        columns[0] = 1e-9
        return MapFit(None, unknowns, Coloured(), run, columns, np.eye(1), np.zeros(1), 0.0, None, none)

    return chance_of_share(fitted(errors), fitted(left), own)


@pytest.mark.parametrize("samples", [3.0, 30.0, 300.0])
def test_a_share_of_slow_misfit_that_looks_like_a_slow_signature_is_chance(samples):
    rng = np.random.default_rng(5)
    chances = [
        share_taken(memory(rng, samples), memory(rng, s)) for s in (30.0, 1000.0) for _ in range(DRAWS)
    ]
    assert np.mean(np.array(chances) < 0.01) < 0.01


def test_a_cause_that_takes_most_of_a_structured_misfit_away_is_proven():
    """What four slow sums say of themselves is a chance of 1e-5 at most where 40 standard deviations are."""
    rng, swing = np.random.default_rng(6), np.sin(TIME**2 / 3e3)
    assert share_taken(swing + 0.2 * memory(rng, 30.0), swing) < 1e-6
    assert share_taken(0.2 * swing + memory(rng, 30.0), swing) > 0.01


def test_a_constant_beside_fast_misfit_is_proven():
    """Though the level of the misfit, read before it was fitted, bounds its likelihood ratio."""
    rng = np.random.default_rng(4)
    constant = Candidate("body_error", "link", "inertia", "mass", None, ("x.0",), (1.0,))
    for size in (3.0, 30.0):
        found = fitted_beside_misfit(size + memory(rng, 2.0))
        assert chi2.sf(wald(found, constant), 1) < 1e-4
