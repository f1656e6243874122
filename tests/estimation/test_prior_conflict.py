"""What is known beforehand against what recordings say: named where they contradict each other."""

import numpy as np

from smsid.estimation.identify_flights import identify_flights
from smsid.estimation.prior_conflict import conflict_of

from .satellite import Satellite, guess, recorded

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


def test_what_nothing_tells_is_no_conflict():
    assert conflict_of(np.array([50.0]), np.array([[1e-3]]), ["a"]) is None


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
