"""Separating two causes: names, the noncentrality by least squares, and a small search."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.design import model_discrimination as separate
from smsid.design._limits import Limits
from smsid.design._trials import Motions, Thrusts
from smsid.design.model_discrimination import (
    candidates_of,
    design_separation,
    discriminate,
    resolve_candidates,
)
from smsid.diagnose.priors import nominal
from smsid.diagnose.score_test import signatures
from smsid.errors import ExperimentError


@pytest.fixture(scope="module")
def known(description):
    return nominal(description, None)


@pytest.fixture(scope="module")
def recording(model):
    kind = Motions(model, Limits(), 8.0)
    return kind.flown(kind.random(np.random.default_rng(0)))[1]


@pytest.fixture(scope="module")
def candidates(known, recording):
    return candidates_of(known, recording)


@pytest.mark.parametrize(
    "text",
    [
        "viscous at joint2,coulomb at joint2",
        "Viscous (joint_friction) at joint2, joint_friction (coulomb) at joint2",
        "joint_friction:joint2:viscous,joint_friction:joint2:coulomb",
    ],
)
def test_names_as_diagnose_prints_them(candidates, text: str):
    first, second = resolve_candidates(text, candidates)
    assert (first.kind, first.location, first.shape) == ("joint_friction", "joint2", "viscous")
    assert second.shape == "coulomb"


def test_names_with_a_comma(candidates):
    first, second = resolve_candidates("force, body at bus,bias at imu.acceleration", candidates)
    assert first.kind == "external_wrench" and second.kind == "sensor_bias"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("viscous at joint2", "names no two causes"),
        ("viscous at joint2,viscous at joint9", "No cause is named 'viscous at joint9'.*Did you mean"),
        ("joint_friction at joint2,viscous at joint1", r"'joint_friction at joint2' fits \d causes"),
        ("viscous at joint2,joint_friction:joint2:viscous", "given twice"),
    ],
)
def test_names_that_are_none_are_told(candidates, text: str, message: str):
    with pytest.raises(ExperimentError, match=message):
        resolve_candidates(text, candidates)


def test_limit_is_that_of_least_squares(known, recording, candidates):
    """Standard deviation of one cause with the other and all nuisances free: inverse of the whole matrix."""
    first, second = resolve_candidates("viscous at joint2,coulomb at joint2", candidates)
    found, everything = separate._fit(known, recording, separate.SLOW)
    columns = signatures(found, [first, second])
    m = len(found.unknowns)
    nuisance = np.vstack([found.whitened.reshape(-1, m), found.prior.rows])
    both = np.zeros((len(nuisance), 2))
    both[: len(columns[0])] = np.hstack([columns[0], columns[1]])
    whole = np.hstack([both, nuisance])
    size = np.linalg.norm(whole, axis=0)
    r = np.linalg.qr(whole / size, mode="r")
    covariance = np.linalg.inv(r.T @ r) / np.outer(size, size)
    judgement = discriminate(known, recording, first, second, separate.SLOW)
    sigma = np.sqrt(np.diag(covariance))[:2]
    ratio = np.array([judgement.limits[0][0], judgement.limits[1][0]]) / sigma
    assert ratio[0] == pytest.approx(ratio[1], rel=1e-4)
    # level 0.003 over all candidates, power 95 %
    from scipy.stats import norm

    needed = norm.isf(0.003 / len(everything) / 2) + norm.isf(0.05)
    assert ratio[0] == pytest.approx(needed, rel=1e-4)


def test_what_an_experiment_does_not_show_is_told(known, recording, candidates, model):
    kind = Thrusts(model, Limits(), 8.0)
    thrust = kind.flown(kind.random(np.random.default_rng(0)))[1]
    first, second = resolve_candidates("viscous at joint2,coulomb at joint2", candidates)
    with pytest.raises(ExperimentError, match=r"cannot be seen|is not told from|is not excited"):
        discriminate(known, thrust, first, second, separate.SLOW)


def test_a_search_gains(description, monkeypatch):
    monkeypatch.setattr(separate, "RATE", separate.SLOW)
    found = design_separation(
        description, ("viscous at joint2", "coulomb at joint2"), duration=8.0, effort=0.15, seed=1
    )
    assert [r.parameter for r in found.rows] == ["viscous", "coulomb"]
    gains = [r.before / r.limit for r in found.rows]
    assert np.prod(gains) >= 1.0
    assert 0.0 < found.correlation <= 1.0
    assert not any(Limits().share(u) > 1.0 + 1e-6 for u in found.limits)
    assert found.experiment.joint_motion is not None
