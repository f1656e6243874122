"""What intervals and verdicts rest on, by hand or simulated: likelihoods, walks, levels, sizes."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

from smsid.comparison._explanations import _chance
from smsid.estimation._contradictions import RecordingInformation, contradictions_of
from smsid.estimation._differences import Base
from smsid.estimation._prior_conflict import conflict_of
from smsid.estimation.kalman import KalmanFilter
from smsid.estimation.problem import UnknownInput
from smsid.identify.paper.hidden_states import HiddenStates
from smsid.identify.paper.momentum_regression import regress
from smsid.kernel.jit import available
from smsid.likelihood.combinations import Combination


@pytest.fixture(params=["plain", "compiled"])
def either_filter(request, monkeypatch):
    """Run the filter in numpy, then in compiled code, whichever is there already."""
    if request.param == "compiled" and not available():
        pytest.skip("numba is not installed")
    monkeypatch.setattr("smsid.estimation.filter_pass.compiled_pays", lambda: request.param == "compiled")


@pytest.mark.usefixtures("either_filter")
def test_the_likelihood_is_the_density_of_the_readings(known, problem):
    """Of one sample, whose covariance is known by hand: what is believed of the state, and the noise."""
    model = known.point.model()
    data = problem.data
    kalman = KalmanFilter(model, problem)
    believed = kalman.covariance.copy()
    run = kalman.advance(1)
    there = np.flatnonzero(run.used[0])
    h = run.sensitivity[0][there]
    covariance = h @ believed @ h.T + np.diag(data.sigma[there] ** 2)
    density = multivariate_normal.logpdf(run.errors[0, there], cov=covariance, allow_singular=True)
    assert run.log_likelihood == pytest.approx(density + 0.5 * len(there) * np.log(2.0 * np.pi), rel=1e-6)


@pytest.mark.usefixtures("either_filter")
def test_what_drives_unseen_wanders_as_it_is_said_to(known, problem):
    """Without a reading, the variance of an unknown torque is that at the start and its walk's since."""
    unknown = UnknownInput(3, 0.2, 0.05)
    data = replace(problem.data, values=np.full_like(problem.data.values, np.nan))
    kalman = KalmanFilter(known.point.model(), replace(problem, data=data, unknown_inputs=(unknown,)))
    kalman.advance(200)
    passed = data.times[200] - data.times[0]
    assert kalman.covariance[-1, -1] == pytest.approx(0.2**2 + 0.05**2 * passed, rel=1e-6)


def parts(z: float) -> list[RecordingInformation]:
    """Two recordings that tell as much of one parameter as is known before, ``z`` sigma apart in it."""
    # alone each moves by s / 2, which scatters by 1 / 4: the difference by 1 / 2
    apart = z * np.sqrt(0.5)
    return [RecordingInformation(n, np.eye(1), np.array([x])) for n, x in (("a", apart), ("b", -apart))]


@pytest.mark.parametrize(("z", "named"), [(3.5, False), (4.6, True)])
def test_recordings_contradict_each_other_from_one_case_in_ten_thousand_on(z, named):
    """What both have from the prior is no difference, and does not make one less likely."""
    rows = [Combination("p", "1", 1.0, np.eye(1)[0], 1.0)]
    assert bool(contradictions_of(parts(z), np.eye(1), rows)) is named


@pytest.mark.parametrize(("off", "named"), [(2.7, False), (3.05, True)])
def test_a_prior_is_contradicted_by_where_the_likelihood_is_largest(off, named):
    """A posterior mean is drawn to the prior: of data that tell 1.2 times as much, by nearly half."""
    found = conflict_of(np.array([off]), np.array([[1.2]]), ["p"])
    assert (found is not None) is named


def test_information_of_noise_levels_is_half_the_trace():
    """``tr(S^-1 S_i S^-1 S_j) / 2`` beside ``e_i' S^-1 e_j``: of a size of noise alone, half its rows."""
    rows, n, width = 3, 40, 1e-4
    whitening = np.tile(np.diag([1.0, 2.0, 0.5]), (n, 1, 1))
    used = np.ones((n, rows), dtype=bool)
    errors = np.zeros((n, rows))
    for given in (np.zeros(rows, dtype=bool), np.array([True, False, False])):
        own = {"used": used, "errors": errors, "innovations": errors, "given": given}
        here = SimpleNamespace(whitening=whitening, **own)
        louder = SimpleNamespace(used=used, errors=errors, whitening=whitening / np.sqrt(1.0 + width))
        whole = SimpleNamespace(at_likeliest_motion=False, profiled=False)
        column = Base.of(here).column(louder, width, whole)  # S grows in proportion: S^-1 dS = 1
        assert column @ column == pytest.approx(0.5 * (~given).sum() * n, rel=1e-3)


def test_errors_that_stay_make_an_estimate_as_uncertain_as_they_do():
    """Slow rows with errors correlated over a third of a second: against the scatter over draws."""
    rng = np.random.default_rng(8)
    n, step = 1200, 0.05
    t = step * np.arange(n)
    rows = np.column_stack([np.sin(0.4 * t), np.cos(0.25 * t)])
    keep = np.exp(-step / 0.3)
    values, sigmas = [], []
    motion = type("Motion", (), {"step": step, "again": None, "__len__": lambda self: n})()
    for _ in range(120):
        error = rng.standard_normal(n) * 0.01
        for k in range(1, n):
            error[k] += keep * error[k - 1]
        made = rows[:, None], (rows @ [1.0, 2.0] + error)[:, None]
        _, found = regress(motion, HiddenStates({}, {}), lambda *_, made=made: made, ("a", "b"), ("1", "1"))
        values.append(found.x)
        sigmas.append(np.sqrt(np.diag(found.covariance)))
    np.testing.assert_allclose(np.std(values, axis=0), np.mean(sigmas, axis=0), rtol=0.25)


def test_a_change_is_as_unlikely_as_what_it_explains_beside_the_others():
    data = SimpleNamespace(whitener=np.eye(3), white=np.array([1.5, 3.0, -0.4]), statistic=11.41)
    first, second = (SimpleNamespace(columns=np.eye(3)[:, [k]], names=(f"p{k}",)) for k in (0, 1))
    assert _chance(data, first, [first, second]) == pytest.approx(chi2.sf(1.5**2, 1))
    assert _chance(data, second, [first, second]) == pytest.approx(chi2.sf(3.0**2, 1))
