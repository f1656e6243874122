"""Thrust that switches between samples of its command: derivatives, evidence, and what is found."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from smsid.estimation.identify import identify_spacecraft
from smsid.likelihood._switch_times import (
    intervals,
    moved_to,
    on_found_times,
    outside,
    switch_evidence,
    switch_times,
    with_switch_times,
)
from smsid.likelihood.jacobian import columns
from smsid.likelihood.nuisance_parameters import SWITCH, Nuisance
from smsid.likelihood.parameters import Parameters
from smsid.likelihood.point import Evaluation, SearchPoint
from smsid.likelihood.prior import Prior
from smsid.likelihood.recording_term import RecordingTerm, piece_of
from smsid.recording import Recording

from . import twin

BETWEEN = 6.66 + 0.01 * 5 / 6, 13.33 + 0.01 / 6
"""Where thrust switches in a flight of 40 s [s]: a sixth and a third of it, but that the engine's steps of
10 ms, from sample to sample, take a force as their stages do: the first, the two in the middle with two
thirds, the last. In a flight of 30 s it switches at samples.
"""


def sought(duration: float):
    """A piece with its times of switching, and where its local parameters are in truth, about."""
    clean = twin.exp1((1, 1, 1), duration)
    piece, local = piece_of(twin.model(), clean, Nuisance(biases=False), described_noise=True)
    piece = with_switch_times(piece)
    return piece, replace(local, switch=switch_times(piece)), Parameters.of(twin.model())


def outputs(piece: RecordingTerm, local, parameters):
    """Predictions at the samples by channel, attitude left out: it is held."""
    found = piece.residuals(parameters, local, piece.predict(parameters, local))
    return [-r for r, c in zip(found, piece.channels, strict=True) if c.quantity != "attitude"]


def test_derivatives_are_those_of_a_grid_that_ends_elsewhere():
    """No impulse there: thrust is predicted as it is, to its end a tenth of a millisecond to both sides."""
    piece, local, parameters = sought(40.0)
    times, step = switch_times(piece), 1e-4
    (slot,) = (s for s in piece.slots if s.kind == SWITCH)
    found = columns(piece, parameters, local, piece.predict(parameters, local))
    kept = [c for c in piece.channels if c.quantity != "attitude"]
    found = [x for x, c in zip(found, piece.channels, strict=True) if c.quantity != "attitude"]
    for k in range(2):
        sides = [times + s * step * np.eye(2)[k] for s in (1.0, -1.0)]
        up, down = (outputs(moved_to(piece, t), replace(local, switch=t), parameters) for t in sides)
        for c, own, more, less in zip(kept, found, up, down, strict=True):
            away = np.abs(c.times[:, None] - times).min(axis=1) > 0.1  # interpolated across no other jump
            difference = (more - less)[away] / (2 * step)
            got = (c.coarse_weights @ own[:, :, parameters.size + slot.start + k])[away]
            np.testing.assert_allclose(got, difference, atol=2e-3 * np.abs(difference).max(), err_msg=c.name)


def test_a_small_step_is_about_that_grid():
    piece, local, parameters = sought(40.0)
    later = switch_times(piece) + np.array([2e-4, -1e-4])
    rates = outputs(piece, replace(local, switch=later), parameters)
    exact = outputs(moved_to(piece, later), replace(local, switch=later), parameters)
    before = outputs(piece, local, parameters)
    kept = [c for c in piece.channels if c.quantity != "attitude"]
    for c, found, wanted, old in zip(kept, rates, exact, before, strict=True):
        away = np.abs(c.times[:, None] - later).min(axis=1) > 0.1
        size = np.abs(wanted - old)[away].max()
        assert np.abs(found - wanted)[away].max() <= 5e-3 * size, c.name


def test_a_switch_stays_between_its_samples():
    piece, local, _ = sought(40.0)
    far = on_found_times(piece, replace(local, switch=local.switch + np.array([1.0, -1.0])))
    assert far is not None
    np.testing.assert_allclose(switch_times(far), [6.67, 13.33], atol=2e-5)
    assert on_found_times(piece, replace(local, switch=local.switch + 1e-6)) is None


def commanded(every: int, later: float = 0.0):
    """The same flight, its command read every so many samples, the sensors so much later [s]."""
    clean = twin.exp1((1, 1, 1), 40.0)
    times, force = clean.time(), np.asarray(clean["command.force"])
    channels = {c: (times + later, np.asarray(clean[c])) for c in clean.channels if c != "command.force"}
    channels["command.force"] = times[::every], force[::every]
    return Recording.from_arrays(None, channels, labels=clean.labels, role="estimation", name="exp1")


def test_intervals_are_those_of_the_command():
    for every, first in ((10, 6.6), (7, 6.65)):
        piece, _ = piece_of(twin.model(), commanded(every), Nuisance(biases=False), described_noise=True)
        np.testing.assert_allclose(intervals(piece)[0], [first, first + 0.01 * every], atol=1e-9)
        np.testing.assert_allclose(intervals(with_switch_times(piece)), intervals(piece), atol=1e-9)
    late = piece_of(twin.model(), commanded(10, 6.65), Nuisance(biases=False), described_noise=True)[0]
    np.testing.assert_allclose(intervals(late)[0], [6.65, 6.7], atol=1e-9)  # nothing is read before
    assert (np.diff(with_switch_times(late).timeline.edges) > 0.0).all()


@pytest.mark.parametrize(("off", "out"), [(0.0, False), (0.004, False), (0.009, True), (-0.009, True)])
def test_a_time_far_outside_of_its_interval_is_none_of_a_switch(off, out):
    """Known to half a millisecond, 5 ms wide to each side."""
    piece, local, parameters = sought(40.0)
    local = replace(local, switch=local.switch + np.array([0.0, off]))
    variance = np.full(parameters.size + piece.size, 5e-4**2)
    normal = SimpleNamespace(covariance=lambda: np.diag(variance))
    point = SimpleNamespace(parameters=parameters, locals=(local,))
    assert outside(SimpleNamespace(normal=normal, point=point, pieces=(piece,))) is out  # type: ignore[arg-type]


def evidence(duration: float, seed: int, **told: str) -> float:
    noisy = twin.noisy(twin.exp1((1, 1, 1), duration), seed, biased=False)
    noisy = noisy.with_provenance(told) if told else noisy
    piece, local = piece_of(twin.model(), noisy, Nuisance(biases=False), described_noise=True)
    parameters = Parameters.of(twin.model())
    seen = Evaluation.at([piece], SearchPoint(parameters, (local,)))
    return switch_evidence([piece], seen, Prior(parameters, None))


def test_evidence_is_for_what_is_so():
    """At the true parameters, over draws of noise: between samples always, at samples hardly ever."""
    between = [evidence(40.0, seed) for seed in range(10)]
    at_samples = [evidence(30.0, seed) for seed in range(10)]
    assert min(between) > 10.0
    assert sum(x > 0.0 for x in at_samples) <= 1
    assert min(at_samples) > -20.0


def test_none_where_the_recording_says_so():
    assert evidence(40.0, 1, inputs="held") == -np.inf


@pytest.fixture(scope="module")
def found():
    return identify_spacecraft(twin.description(), [twin.noisy(twin.exp1((1, 1, 1), 40.0), 3)])


def test_found_with_everything_else(found):
    """Taken for switching at samples, masses were 13 to 24 sigma off here, and two clocks took the blame."""
    estimate = {p.name: p for p in found.estimate.parameters}
    for p in found.estimate.parameters:
        if p.group != "nuisance" and p.nominal is not None:  # the description is the truth
            assert abs(p.value - p.nominal) < 4.0 * p.sigma, p.name
    for k, time in enumerate(BETWEEN):
        p = estimate[f"exp1: command.force.switch_time[{k}]"]
        assert abs(p.value - time) < 4.0 * p.sigma
        assert p.sigma < 1e-3
    assert not any("clock" in name for name in estimate)
    assert any("switches between samples" in n for n in found.estimate.notes)


def test_at_samples_nothing_is_sought():
    run = identify_spacecraft(twin.description(), [twin.noisy(twin.exp1((1, 1, 1), 30.0), 3)])
    assert not any(SWITCH in p.name for p in run.estimate.parameters)
