"""What is asked in noise as stated while misfit is counted."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from smsid.diagnose import _misfit_proof as misfit_proof
from smsid.diagnose._misfit_proof import is_hopeful, with_what_it_lacks
from smsid.diagnose._noise_covariance import InflatedFit

from .search_stubs import Whole
from .test_model_comparison import score


def at(name):
    return SimpleNamespace(
        name=name, objective=0.0, run=SimpleNamespace(), point=None, unknowns=(), problem=None
    )


@pytest.mark.parametrize(
    ("left", "elsewhere", "freed"), [(1.1, 1.0, True), (3.0, 1.0, False), (1.1, 30.0, False)]
)
def test_further_parameters_that_misfit_hides_are_freed_where_all_is_followed_then(
    monkeypatch, left, elsewhere, freed
):
    """The torque that takes a rotor across its gap: beside 16 times the noise, it did not pay."""
    lost, noise = at("with the gap"), SimpleNamespace(scaled=lambda factor: "stated")
    lost.problem = Whole(noise, "raised")

    def evaluated(point, unknowns, problem):
        found = at("stated" if problem.data == "stated" else "raised again")
        found.run.normalised, found.run.used = np.array([[16.0, elsewhere]]), np.array([[True, True]])
        found.point, found.unknowns, found.problem = point, unknowns, problem
        return found

    def further(found, causes):
        larger = evaluated("turned", "more", found.problem)
        larger.run = "freed"
        return larger

    monkeypatch.setattr(misfit_proof, "evaluate", evaluated)
    monkeypatch.setattr(misfit_proof, "with_further", further)
    monkeypatch.setattr(misfit_proof, "own_component", lambda *_: 0)
    monkeypatch.setattr(misfit_proof, "normalised_rmse", lambda run: left)
    effect = SimpleNamespace(with_dynamics=lambda: ())
    backlash = SimpleNamespace(effect=effect, instance=lambda point: effect)
    cause = SimpleNamespace(score=SimpleNamespace(candidate=backlash))
    found = with_what_it_lacks(InflatedFit(at("nominal"), np.ones(1), misfit=True), cause, lost)
    assert (found is not lost) == freed
    if freed:
        assert (found.point, found.unknowns, found.problem.data) == ("turned", "more", noise)


@pytest.mark.parametrize(
    ("size", "misfit", "hopeful"), [(1.0, True, True), (0.25, True, False), (1.0, False, False)]
)
def test_what_takes_half_of_the_squared_errors_in_stated_noise_is_hopeful(size, misfit, hopeful):
    """The errors are ten times the noise in the second component, where the candidate is all there is."""
    rng = np.random.default_rng(3)
    errors = rng.standard_normal((40, 2))
    fit = SimpleNamespace(residual=errors.ravel(), run=SimpleNamespace(innovations=errors))
    fitted = InflatedFit(fit, np.array([1.0, 10.0]), misfit=misfit)
    own = replace(score(5.0, 1), columns=(errors * [0.0, size]).reshape(80, 1), estimate=np.ones(1))
    taken = 100.0 * (errors[:, 1] ** 2).sum() * (1.0 - (1.0 - size) ** 2)
    share = taken / (errors**2 @ [1.0, 100.0]).sum()
    assert (share > 0.5) == (size > 0.5)
    assert is_hopeful(fitted, own) is hopeful
