"""Knots of the joints' motion: enough for what outputs see of it, on a craft that its arm shakes."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from smsid.description import Description, load_description
from smsid.description.draft import CraftDraft, draft_arm
from smsid.estimation._batch_check import batch_contradictions
from smsid.experiments import fly, named_experiment
from smsid.likelihood import Refinement, fisher_information, refine
from smsid.likelihood._knots import _has_gaps, refined_motion, resolution, resolves_ringing
from smsid.likelihood.fit import fit
from smsid.likelihood.normal import Normal
from smsid.likelihood.point import SearchPoint
from smsid.likelihood.refine import OF_PARTS
from smsid.likelihood.spline import DerivativeSamples, fit_motion
from smsid.model import build_model
from smsid.recording import Recording
from smsid.sensing import add_noise

from . import twin

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from long_recordings import rigid, to_and_fro

SEEDS = (2, 3)


@pytest.fixture(scope="module")
def craft(tmp_path_factory) -> Description:
    """A bus of 200 kg with an arm of 150 kg and a panel whose third mode the arm's motion excites."""
    draft = CraftDraft("craft", (draft_arm(str(twin.URDF / "arm3.urdf")),), 4, 0, (6.0, 3.0), 200.0, 1.0)
    folder = tmp_path_factory.mktemp("craft")
    (folder / "craft_bus.urdf").write_text(draft.urdf())
    (folder / "craft.toml").write_text(draft.toml())
    return load_description(folder / "craft.toml")


@pytest.fixture(scope="module")
def clean(craft) -> dict[str, Recording]:
    """The experiments as perfect sensors would record them."""
    perfect = [s.model_copy(update={"errors": {}, "preset": None}) for s in craft.sensor]
    model = build_model(craft.with_sensors(*perfect))
    return {
        name: fly(model, named_experiment(name, model), np.random.default_rng(0)).recording
        for name in ("exp1", "exp2")
    }


def noisy(craft: Description, recording: Recording, seed: int) -> Recording:
    return add_noise(recording, craft.sensor, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def found(craft, clean) -> list[Refinement]:
    return [refine(craft, [noisy(craft, clean["exp2"], seed)]) for seed in SEEDS]


def test_modes_are_as_uncertain_as_the_joints_motion_leaves_them(found):
    """The third mode's damping was 10 standard deviations off at every seed, and its frequency 3."""
    names = [f"panel.mode{k}.{what}" for k in (1, 2, 3) for what in ("frequency", "damping")]
    modes = [r.estimate[n] for r in found for n in names]
    off = np.array([(p.value - p.nominal) / p.sigma for p in modes])
    assert np.all(np.abs(off) < 4.0)
    assert chi2.sf(np.sum(off**2), off.size) > 1e-3
    known = [p for r in found for p in r.estimate.parameters if p.nominal is not None and p.sigma]
    inside = np.mean([abs(p.value - p.nominal) < 1.96 * p.sigma for p in known])
    assert inside > 0.85


def test_the_bound_is_of_the_same_motion(craft, clean, found):
    bound = fisher_information(craft, clean["exp2"]).sigma
    for name in ("panel.mode3.damping", "panel.mode3.frequency", "arm/link3.mx", "panel.mode1.frequency"):
        assert found[0].estimate[name].sigma == pytest.approx(bound[name], rel=0.1)


def test_a_search_begins_with_knots_that_follow_what_rings(found):
    """It had been made twice: by the encoders' knots, then by these."""
    for r in found:
        assert all(resolves_ringing(p, r.fit.point.parameters.layout.model) for p in r.fit.pieces)
        assert [v.step is None for v in r.estimate.history].count(True) == 1


def test_two_flights_of_the_same_craft_do_not_contradict_each_other(craft, clean):
    recordings = [noisy(craft, clean[name], seed) for seed, name in enumerate(("exp1", "exp2"), start=1)]
    found = refine(craft, recordings)
    assert not batch_contradictions(found)
    # what could not be followed had looked like a clock of the panel that is late
    assert not any("clocks that do not agree" in n for n in found.estimate.notes)
    assert found.estimate.recordings == ("exp1", "exp2")


def test_a_divided_spline_is_the_same_motion():
    times = np.arange(0.0, 20.0, 0.01)
    samples = [
        DerivativeSamples(0, times, np.column_stack([np.sin(times), np.cos(2 * times)]), np.full(2, 1e-5))
    ]
    motion = fit_motion(samples, 0.0, 20.0, 100.0, 0.1)
    finer = motion.divided(3)
    assert finer.intervals == 3 * motion.intervals
    for mine, theirs in zip(finer.values(times), motion.values(times), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0.0, atol=1e-9 * np.abs(theirs).max())


def test_what_a_finer_motion_changes():
    """By hand: two parameters, of which the second is told half as well, and one sigma off."""
    before = Normal(np.diag([4.0, 4.0]), np.zeros((2, 2)), np.zeros(2))
    after = Normal(np.diag([4.0, 1.0]), np.zeros((2, 2)), np.array([0.0, 1.0]))
    change = resolution(before, after, np.eye(2))
    assert change.growth == pytest.approx(2.0) and change.shift == pytest.approx(1.0)
    assert not change.is_enough
    assert resolution(before, before, np.eye(2)).is_enough


def test_a_gap_between_readings_forbids_finer_knots():
    """Two seconds without a reading: a finer spline there took the search minutes, and meant nothing."""
    times = np.arange(0.0, 20.0, 0.01)
    for missing, gaps in ((0.0, False), (2.0, True)):
        own = times[(times < 8.0) | (times >= 8.0 + missing)]
        samples = (SimpleNamespace(derivative=0, times=own),)
        piece = SimpleNamespace(drive=SimpleNamespace(joints=SimpleNamespace(samples=samples, spacing=0.5)))
        assert _has_gaps(piece) is gaps


def test_a_search_with_knots_as_close_as_nodes_comes_to_rest():
    """Only the joints' motion could gain, by derivatives that are not exact there: it had been an error."""
    flown = refine(rigid(), [to_and_fro(build_model(rigid()), 6000, 9)])
    pieces, locals_ = refined_motion(flown.fit.pieces, flown.fit.point)
    assert pieces[0].drive.joints.spacing < 0.6 * flown.fit.pieces[0].drive.joints.spacing
    found = fit(pieces, SearchPoint(flown.fit.point.parameters, locals_), flown.prior)
    sigma = np.sqrt(np.diag(found.normal.covariance()))
    own = np.abs(found.normal.solved()) / sigma
    assert own[: found.point.parameters.size].max() < 0.03


def test_a_long_flight_has_knots_as_close_as_its_part_needed():
    """Whether they are enough is asked of the part alone, and a note says so."""
    whole = to_and_fro(build_model(rigid()), 6000, 9)
    part = refine(rigid(), [whole.window(0.0, 40.0)])
    pieces, locals_ = refined_motion(part.fit.pieces, part.fit.point)
    finer = replace(part, fit=fit(pieces, SearchPoint(part.fit.point.parameters, locals_), part.prior))
    found = refine(rigid(), [whole], finer, of_parts=True)
    assert found.fit.pieces[0].drive.joints.spacing < 1.1 * pieces[0].drive.joints.spacing
    assert OF_PARTS in found.estimate.notes and OF_PARTS not in part.estimate.notes
    assert found.fit.seen.predictions[0].timeline.edges[-1] == pytest.approx(59.99)
    known = [p for p in found.estimate.parameters if p.nominal is not None and p.status == "identifiable"]
    off = np.array([(p.value - p.nominal) / p.sigma for p in known])
    assert np.sqrt(np.mean(off**2)) < 1.6
