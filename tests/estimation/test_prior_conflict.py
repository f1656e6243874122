"""What is known beforehand against what recordings say: named where they contradict each other."""

import numpy as np

from smsid.estimation import _prior_conflict as prior_conflict
from smsid.estimation._prior_conflict import conflict_of
from smsid.estimation.identify_flights import identify_flights
from tests.estimation.satellite import Satellite, guess, recorded

RIGID = Satellite(tank=(1e-9, 1e-9, 1e-9), panel=(1.0, 0.1, 1e-6, -1e-6))


def posterior(truth, information, rng):
    """Return the posterior's mean, in standard deviations of the prior, of data with an information."""
    root = np.linalg.cholesky(information)
    data = truth + np.linalg.solve(root.T, rng.standard_normal(len(truth)))
    return np.linalg.solve(information + np.eye(len(truth)), information @ data)


def test_truths_of_the_prior_are_no_conflict_and_others_are():
    rng = np.random.default_rng(3)
    rows = rng.standard_normal((6, 4)) * np.array([30.0, 3.0, 1.0, 0.3])
    information, names = rows.T @ rows, list("abcd")
    found = [
        conflict_of(posterior(rng.standard_normal(4), information, rng), information, names)
        for _ in range(300)
    ]
    assert not any(found)
    far = np.array([6.0, 0.0, 0.0, 0.0])
    for _ in range(20):
        conflict = conflict_of(posterior(far, information, rng), information, names)
        assert conflict is not None and conflict.parameters[0][0] == "a" and conflict.size > 2.0


def test_false_conflicts_are_as_rare_as_stated(monkeypatch):
    """At a level of 5 %: two tests, of which the smaller p is doubled, make it 3 to 5 %."""
    monkeypatch.setattr(prior_conflict, "SIGNIFICANCE", 0.05)
    rng = np.random.default_rng(8)
    rows = rng.standard_normal((40, 12)) * np.geomspace(100.0, 0.1, 12)
    information, names = rows.T @ rows, list("abcdefghijkl")
    heavier = 30.0 * rng.random(12)
    draws = (posterior(rng.standard_normal(12), information, rng) for _ in range(2000))
    found = sum(conflict_of(x, information, names, heavier) is not None for x in draws)
    assert 0.02 < found / 2000 < 0.062  # 0.05 and 2.5 standard deviations of the count


def test_a_scale_of_everything_is_found_though_no_parameter_is_far_off():
    """A tenth more of masses known to 5 to 10 %: no test of each by itself is sure of it."""
    rng = np.random.default_rng(9)
    rows = rng.standard_normal((60, 30)) * 50.0
    information, names = rows.T @ rows, [str(i) for i in range(30)]
    heavier = 1.0 / rng.uniform(0.05, 0.1, 30)
    for _ in range(20):
        truth = rng.standard_normal(30) + 0.1 * heavier
        conflict = conflict_of(posterior(truth, information, rng), information, names, heavier)
        assert conflict is not None and conflict.scale is not None and conflict.p_value < 1e-6
        factor, sigma = conflict.scale
        assert abs(factor - 1.1) < 4.0 * sigma and 0.008 < sigma < 0.02
        assert "times what was known" in conflict.sentence


def test_what_nothing_tells_is_no_conflict():
    assert conflict_of(np.array([50.0]), np.array([[1e-3]]), ["a"]) is None


def test_a_prior_that_tells_more_than_the_recordings_is_contradicted_by_them_all_the_same():
    """A tank stated 10 % too heavy within 0.1 kg, of which the data say a little less: 20 sigma, unseen."""
    conflict = conflict_of(np.array([-20.2]), np.array([[0.6]]), ["tank.mass"])
    assert conflict is not None and conflict.parameters == (("tank.mass", -20.2),)
    assert conflict_of(np.array([-1.0]), np.array([[0.6]]), ["tank.mass"]) is None


def test_an_inertia_that_is_stated_wrong_is_named_and_nothing_is_called_identifiable(tmp_path):
    """Stated at 100 kg m^2 within 0.2, while all that flies says 80."""

    def torque(t):
        return 0.05 * np.sin(2 * np.pi * np.array([0.04, 0.06, 0.09]) * t + [0, 1, 2])

    def drive(t):  # straight between the samples, as commands are taken; held over a step of the world
        k, share = divmod(10.0 * (t + 0.01), 1.0)
        return np.zeros(3), (1.0 - share) * torque(0.1 * k) + share * torque(0.1 * (k + 1.0)), np.zeros(3)

    flown = recorded(RIGID, RIGID.fly(20.0, drive), np.random.default_rng(3))
    at_samples = {"command.torque": np.array([torque(t) for t in flown.time()])}
    recording = flown.with_channels(at_samples)
    description = guess(tmp_path, RIGID, tank=False, panel=False)
    centre = {f"bus.m{a}": (300.0 * c, 0.1) for a, c in zip("xyz", RIGID.centre, strict=True)}
    found = identify_flights(description, [recording], cad={"bus.Ixx": (100.0, 0.2), **centre})
    assert found.quality.judgement == "not explained" and found.quality.widening > 3.0
    assert "bus.Ixx" in found.estimate.notes[0] and "known beforehand" in found.estimate.notes[0]
    assert not [p for p in found.estimate.parameters if p.status == "identifiable"]
    right = identify_flights(description, [recording], cad={"bus.Ixx": (80.5, 0.5), **centre})
    assert right.quality.conflict is None and right.quality.judgement == "explained"
