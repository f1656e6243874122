"""Refinement of recordings of another engine: inside its own intervals, at the noise it is given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from smsid.effects.appendage import BeamAppendage
from smsid.effects.slosh import Slosh
from smsid.errors import DescriptionError, NotIdentifiableError, RecordingError
from smsid.identify.estimate import load_estimate, save_estimate
from smsid.likelihood import Nuisance, Refinement, profile_interval, refine
from smsid.likelihood.pseudo_inertia import is_body

from . import twin

# of about 60 parameters the largest is beyond this with probability 4e-4
FAR = 4.5


def off(share: float = 0.05):
    """The description with slosh and panel wrong by ``share``."""
    d = twin.description()
    tank = next(e for e in d.effect if isinstance(e, Slosh))
    panel = next(e for e in d.effect if isinstance(e, BeamAppendage))
    tank = tank.model_copy(
        update={
            "mass": tank.mass * (1 + share),
            "stiffness": tuple(x * (1 - share) for x in tank.stiffness),
            "damping": tuple(x * (1 + 5 * share) for x in tank.damping),
        }
    )
    panel = panel.model_copy(update={"density": panel.density * (1 + share), "damping": panel.damping * 0.8})
    return d.with_effects(tank, panel)


TRUTH = {
    "total.mass": 2256.8,
    "tank.mass": 49.6,
    **{f"tank.stiffness.{a}": 0.41 for a in "xyz"},
    **{f"tank.damping.{a}": 0.02 for a in "xyz"},
    "panel.linear_density": 16.2,
}


@pytest.fixture(scope="module")
def first() -> Refinement:
    return refine(off(), [twin.noisy(twin.exp1((1, 1, 1), 60.0), 0)])


def test_exp1_is_inside_its_intervals(first: Refinement):
    for name, truth in TRUTH.items():
        p = first.estimate[name]
        assert abs(p.value - truth) < FAR * p.sigma, f"{name}: {p.value} +- {p.sigma}"
    assert first.estimate.method == "maximum_likelihood"
    # better than anyone needs: a bound that is far too wide would pass the above
    assert first.estimate["tank.mass"].relative_sigma < 2e-3
    assert first.estimate["total.mass"].relative_sigma < 1e-4


def test_biases_are_found(first: Refinement):
    noisy, clean = twin.noisy(twin.exp1((1, 1, 1), 60.0), 0), twin.exp1((1, 1, 1), 60.0)
    for channel in ("imu.acceleration", "imu.angular_rate", "panel.acceleration"):
        drawn = (noisy[channel] - clean[channel]).mean(axis=0).ravel()
        own = [p for p in first.estimate.group("nuisance") if f"{channel}.bias" in p.name]
        assert len(own) == len(drawn)
        for p, bias in zip(own, drawn, strict=True):
            assert abs(p.value - bias) < FAR * p.sigma, p.name


def test_noise_levels_come_from_the_data(first: Refinement):
    expected = {
        "pose.position": 1e-3,
        "pose.attitude": 1e-4,
        "pose.velocity": 1e-3,
        "imu.acceleration": 1e-4,
        "imu.angular_rate": 1e-5,
        "panel.acceleration": 1e-4,
    }
    for c in first.fit.pieces[0].channels:
        # 6001 samples: 0.9 % one sigma
        sigma = np.sqrt(np.diag(c.covariance))
        np.testing.assert_allclose(sigma, expected[c.name], rtol=FAR * 0.0092, err_msg=c.name)
    assert first.estimate.conditions["sum of squares / samples"] == pytest.approx(1.0, abs=0.02)


def test_what_exp1_cannot_see_is_said(first: Refinement):
    assert not any("bus.I" in p.name for p in first.estimate.parameters)
    assert any("inertias are not seen" in note for note in first.estimate.notes)
    along_x = refine(twin.description(), [twin.noisy(twin.exp1((1, 0, 0), 30.0), 0)])
    p = along_x.estimate["tank.stiffness.y"]
    assert p.status == "not_identifiable"
    assert "the data do not see it" in p.note


def test_description_carries_what_was_found(first: Refinement):
    tank = first.description.get_effect("tank")
    assert isinstance(tank, Slosh)
    assert tank.mass == pytest.approx(first.estimate["tank.mass"].value)
    panel = first.description.get_effect("panel")
    factor = first.estimate["panel.linear_density"].value / 16.2
    assert panel.mass == pytest.approx(97.2 * factor)  # type: ignore[attr-defined]


def test_covariance_is_that_of_the_parameters(first: Refinement):
    sigma = [p.sigma for p in first.estimate.parameters]
    np.testing.assert_allclose(np.sqrt(np.diag(first.covariance)), sigma, rtol=1e-10)
    assert first.correlation("total.mass", "total.mass") == pytest.approx(1.0)


def test_a_thrust_gain_leaves_the_mass_to_it(first: Refinement):
    """Mass and thrust enter as their ratio: with 1 % on the thrust, 1 % per axis is left on the mass."""
    loose = refine(
        twin.description(),
        [twin.noisy(twin.exp1((1, 1, 1), 60.0), 0)],
        nuisance=Nuisance(thrust_gain=0.01),
    )
    p = loose.estimate["total.mass"]
    assert p.relative_sigma == pytest.approx(0.01 / np.sqrt(3.0), rel=0.05)
    assert abs(p.value - 2256.8) < FAR * p.sigma


def test_profile_of_a_well_known_parameter_is_gaussian(first: Refinement):
    p = first.estimate["tank.mass"]
    found = profile_interval(first, "tank.mass")
    np.testing.assert_allclose([found.lower, found.upper], p.interval, atol=0.05 * p.sigma)
    assert not found.at_bound
    with pytest.raises(NotIdentifiableError, match="no profile"):
        profile_interval(first, "total.mass")


def test_profile_ends_at_the_bound_when_damping_is_not_seen():
    """Five seconds of thrust on an accelerometer: no damping at all is as good as a lot of it."""
    d = twin.description()
    d = d.with_sensors(*(s for s in d.sensor if s.kind == "imu"))
    found = refine(d, [twin.noisy(twin.exp1((1, 0, 0), 30.0), 0)])
    interval = profile_interval(found, "tank.damping.x")
    assert interval.at_bound
    assert interval.lower == 0.0
    assert interval.upper > 0.02


def test_profile_takes_the_place_of_a_gaussian_interval_that_does_not_hold(tmp_path: Path):
    """A minute on an accelerometer: the Gaussian interval of its damping reaches below zero."""
    d = twin.description()
    d = d.with_sensors(*(s for s in d.sensor if s.kind == "imu"))
    found = refine(d, [twin.noisy(twin.exp1((1, 0, 0), 60.0), 0)])
    p = found.estimate["tank.damping.x"]
    assert p.profile is not None
    assert p.interval == p.profile
    assert p.interval[0] >= 0.0
    assert p.interval[0] < 0.02 < p.interval[1]
    assert "not Gaussian" in p.note
    assert found.estimate["tank.mass"].profile is None
    save_estimate(found.estimate, tmp_path / "estimate.json")
    assert load_estimate(tmp_path / "estimate.json")["tank.damping.x"] == p


def test_bodies_handed_out_can_exist(first: Refinement):
    assert set(first.inertias) == {"bus", "link1", "link2", "link3"}
    assert all(is_body(theta) for theta in first.inertias.values())


def test_bad_input():
    clean = twin.exp1((1, 1, 1), 9.0)
    with pytest.raises(RecordingError, match="No recording"):
        refine(twin.description(), [])
    with pytest.raises(RecordingError, match="validation"):
        refine(twin.description(), [clean.with_role("validation")])
    heavy = twin.description().model_copy(update={"gravity": (0.0, 0.0, -9.81)})
    with pytest.raises(DescriptionError, match="without gravity"):
        refine(heavy, [clean])


@pytest.mark.slow
def test_both_experiments_jointly():
    """Every identifiable parameter of both, biases present, description off; nothing unphysical comes out."""
    found = refine(off(), [twin.noisy(r, 0) for r in (twin.exp1(), twin.exp2())])
    truth = refine_truth()
    named = [p for p in found.estimate.parameters if p.group != "nuisance"]
    assert {p.name for p in named} == set(truth)
    for p in named:
        assert abs(p.value - truth[p.name]) < FAR * p.sigma, f"{p.name}: {p.value} +- {p.sigma}"
    good = [p for p in named if p.status == "identifiable"]
    assert len(good) >= 35
    assert all(is_body(theta) for theta in found.inertias.values())


def refine_truth() -> dict[str, float]:
    from smsid.likelihood import fisher_information

    bound = fisher_information(twin.description(), [twin.exp1(), twin.exp2()])
    return {c.name: c.value for c in bound.combinations}
