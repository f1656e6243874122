"""Candidates with a place or a phase: the linear score finds what the columns were mixed with."""

from types import SimpleNamespace

import numpy as np
import pytest

from smsid.diagnose._profiled_hypothesis import Imbalance, LeakHypothesis, ResolvedHypothesis
from smsid.effects import MassLoss, WheelImbalance
from smsid.estimation.map_estimate import MapFit

ROWS = 4000


def stub(columns, truth, rng, noise):
    """A fit with two fitted parameters whose residual is a mixture of columns, and noise."""
    whitened = rng.standard_normal((ROWS, 1, 2))
    residual = columns @ truth + whitened[:, 0] @ np.array([3.0, -2.0]) + noise * rng.standard_normal(ROWS)
    own = SimpleNamespace(whitened=whitened, unknowns=(None, None), prior=SimpleNamespace())
    own.prior.rows, own.prior.off = np.eye(2), np.zeros(2)
    own.residual = np.concatenate([residual, np.zeros(2)])
    own.factors = np.linalg.qr(np.vstack([whitened.reshape(ROWS, 2), own.prior.rows]))
    own.told = np.ones(2, dtype=bool)
    own._less = lambda *given: MapFit._less(own, *given)
    own.run = SimpleNamespace(samples=ROWS)
    return own


def scored(candidate, found, columns):
    (beside,) = MapFit.projected(found, [columns])
    return candidate.scored(found, beside)


@pytest.mark.parametrize("phase", [-2.0, 0.3, 2.9])
def test_phase_of_an_imbalance(phase):
    rng = np.random.default_rng(1)
    effect = WheelImbalance(name="w", wheel="wheel_x")
    candidate = Imbalance(
        "wheel_imbalance",
        "wheel_x",
        "actuator",
        "static imbalance",
        effect,
        ("w.static", "w.phase"),
        (1e-4, 1e-2),
    )
    columns = rng.standard_normal((ROWS, 2))
    found = scored(
        candidate, stub(columns, 0.4 * np.array([np.cos(phase), np.sin(phase)]), rng, 1.0), columns
    )
    assert found.freedom == 2
    assert abs(found.estimate[0] - 0.4) < 4.0 * np.sqrt(found.covariance[0, 0])
    assert found.covariance[0, 0] == pytest.approx(1.0 / ROWS, rel=0.1)
    assert found.candidate.effect.phase == pytest.approx(phase, abs=4.0 / (0.4 * np.sqrt(ROWS)))
    assert found.candidate.unknowns(())[0].nominal == 0.0


def leak():
    """A leak of a bus."""
    effect = MassLoss(name="leak", rate=0.0)
    free = ("leak.rate", "leak.position.x", "leak.position.y", "leak.position.z")
    return LeakHypothesis("mass_loss", "bus", "inertia", "mass loss", effect, free, (1e-3, 0.1, 0.1, 0.1))


def point(place):
    """The ten parameters of a unit point mass, by Steiner's theorem."""
    about = place @ place * np.eye(3) - np.outer(place, place)
    return np.r_[1.0, place, about[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]]


def test_a_leak_that_is_just_seen_is_sought_where_it_is():
    """At 5.4 sigmas; at the origin, where half of it shows, it was missed."""
    rng = np.random.default_rng(3)
    theta = point(np.array([0.5, -0.6, 0.4]))
    columns = rng.standard_normal((ROWS, 10))
    for _ in range(5):
        found = scored(
            leak(), stub(columns, 5.4 / np.linalg.norm(columns @ theta) * theta, rng, 1.0), columns
        )
        assert found.freedom == 4
        origin = np.sqrt(found.ratio)
        assert 3.0 < origin < 8.5


def test_what_is_no_leak_is_called_one_no_more_often_than_its_chance_says():
    rng = np.random.default_rng(4)
    columns = rng.standard_normal((ROWS, 10))
    chances = [scored(leak(), stub(columns, np.zeros(10), rng, 1.0), columns).p_value for _ in range(150)]
    assert 1 <= sum(p < 0.1 for p in chances) <= 25  # 15 expected at most


def test_place_of_a_leak():
    """Parameters of a point mass as Steiner's theorem has them, none of the place known before."""
    rng = np.random.default_rng(2)
    candidate = leak()
    columns, place, rate = rng.standard_normal((ROWS, 10)), np.array([0.5, -0.6, 0.4]), 2.0
    theta = point(place)
    found = scored(candidate, stub(columns, rate * theta, rng, 1.0), columns)
    assert found.freedom == 4
    sigma = np.sqrt(np.diag(found.covariance))
    assert abs(found.estimate[0] - rate) < 4.0 * sigma[0]
    off = np.array(found.candidate.effect.position) - place
    assert (np.abs(off) < 4.0 * sigma[1:] * 0.1 + 1e-3).all()
    nothing = scored(candidate, stub(columns, np.zeros(10), rng, 1.0), columns)
    assert nothing.ratio < 30.0
    gains = scored(candidate, stub(columns, -rate * theta, rng, 1.0), columns)
    assert gains.ratio < 0.2 * found.ratio, "mass is lost, not won"


@pytest.mark.parametrize("seen", [4, 10], ids=["turns alone", "nothing"])
def test_a_leak_of_what_nothing_shows_is_nothing(seen):
    """Attitude alone shows no mass that goes from where a body is held to be."""
    rng = np.random.default_rng(5)
    columns = rng.standard_normal((ROWS, 10))
    columns[:, :seen] = 0.0
    for _ in range(5):
        found = scored(leak(), stub(columns, np.zeros(10), rng, 1.0), columns)
        assert np.isfinite(found.covariance).all()
        if not np.any(found.candidate.effect.position):
            assert (found.ratio, found.freedom, found.p_value) == (0.0, 0, 1.0)
        else:
            assert seen == 4
            assert found.p_value > 1e-3


def test_the_priors_of_a_place_keep_their_means_under_another_name():
    """A leak that begins beside a described one: what was found of its place is no prior's mean."""
    place = {f"position.{axis}": 1.0 for axis in "xyz"}
    effect = MassLoss(name="leak", frame="bus", rate=0.0, position=(0.3, -0.2, 0.1), prior=place)
    free = ("leak.rate", *(f"leak.{p}" for p in place))
    found = ResolvedHypothesis(
        "mass_loss", "bus", "inertia", "mass loss", effect, free, (1e-3, 0.1, 0.1, 0.1),
        means=tuple((n, 0.0) for n in free[1:]),
    )  # fmt: skip
    apart = found.apart({"leak", "leak_later"})
    assert isinstance(apart, ResolvedHypothesis) and apart.effect.name == "leak_later2"
    assert apart.free == ("leak_later2.rate", *(f"leak_later2.{p}" for p in place))
    assert [u.nominal for u in apart.unknowns(())] == [0.0, 0.0, 0.0, 0.0]
    assert found.apart({"another"}) is found
