"""Effects that begin midway, on a recording of the package's own: when, and that one does not begin."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from smsid.diagnose import _change_point as onset
from smsid.diagnose._change_point import (
    always_together,
    best_onsets,
    cut_score,
    drop_onset,
    largest_innovation_time,
    moved_start,
    onset_penalty,
    refine_onset,
    scan_onsets,
    step_from,
    sync_onset,
    with_onset,
)  # fmt: skip
from smsid.diagnose.hypotheses import propose
from smsid.diagnose.model_comparison import Cause
from smsid.diagnose.score_test import score_candidates, signatures
from smsid.diagnose.thresholds import DetectionThresholds
from smsid.estimation.map_estimate import evaluate
from smsid.estimation.sensitivities import propagate

ALIAS = 9.2


def hidden(fitted, key, size, start):
    """The fit with its innovations moved as by a candidate that begins at a time."""
    point, problem, unknowns = fitted
    found = evaluate(point, unknowns, problem)
    kinds = ("torque_gain", "joint_friction", "external_wrench", "sensor_bias")
    candidates = [c for c in propose(point, problem, unknowns) if c.kind in kinds]
    one = next(c for c in candidates if c.key == key)
    one = one if start is None else one.apart({e.name for e in point.description.effect})
    begun = replace(one, effect=one.effect.model_copy(update={"start": start}))
    column = signatures(found, [begun])[0][:, 0]
    own = found.left(column[:, None])[:, 0]
    moved = column * size / np.sqrt(own @ own)
    rng = np.random.default_rng(7)
    innovations = rng.standard_normal(found.run.innovations.shape) * found.run.used
    innovations += moved.reshape(innovations.shape)
    found = replace(found, run=replace(found.run, innovations=innovations))
    columns = signatures(found, candidates)
    return found, score_candidates(found, [candidates[i] for i in columns], list(columns.values()))


@pytest.fixture(scope="module")
def fitted(known, problem):
    return known.point, problem, known.unknowns


KEY = ("torque_gain", "joint2", "torque constant")


@pytest.mark.parametrize("start", [None, 3.3])
def test_the_time_is_found_where_there_is_one(fitted, start):
    found, scores = hidden(fitted, KEY, 60.0, start)
    own = next(s for s in scores if s.candidate.key == KEY)
    begun = with_onset(found, own, ALIAS)
    if start is None:
        assert begun is own
    else:
        assert begun.candidate.effect.start == pytest.approx(start, abs=0.1)
        assert begun.ratio - own.ratio > onset_penalty(ALIAS)


@pytest.mark.parametrize("known_start", [None, 1.0, 5.0])
def test_what_begins_beside_its_own_effect_is_another_effect(fitted, known_start):
    """An effect has one start: friction that is described, or found, does not begin when more of it does."""
    point, problem, unknowns = fitted
    key = ("joint_friction", "joint2", "viscous")
    plain = next(c for c in propose(point, problem, unknowns) if c.key == key).effect
    described = plain.model_copy(update={"viscous": 0.01, "start": known_start})
    found, scores = hidden((point.with_effect(described), problem, unknowns), key, 60.0, 4.3)
    begun = with_onset(found, next(s for s in scores if s.candidate.key == key), ALIAS)
    own = begun.candidate
    another = f"{described.name}_{'later' if known_start is None else '2'}"
    assert own.effect.name == another and own.free == (f"{own.effect.name}.viscous",)
    assert own.effect.start == pytest.approx(4.3, abs=0.05) and own.effect.viscous == 0.0
    with_it = evaluate(found.point.with_effect(own.effect), (*unknowns, *own.unknowns(unknowns)), problem)
    same, _ = refine_onset(with_it, begun)
    assert same.candidate.effect.name == own.effect.name
    gone = replace(with_it, point=with_it.point.with_effect(own.effect.model_copy(update={"start": None})))
    always_there, kept = refine_onset(gone, begun)  # its effect was another cause's too, and begins no longer
    assert always_there.candidate.effect.start is None and kept is gone


def test_a_cause_begins_when_the_effect_does_that_it_is_part_of(fitted):
    """A Stribeck curve found after what seemed a Coulomb friction from a time on is there from then on."""
    point, problem, unknowns = fitted
    by_shape = {c.shape: c for c in propose(point, problem, unknowns) if c.location == "joint2"}
    first, second = by_shape["coulomb"], by_shape["stribeck"]
    known = first.effect.model_copy(update={"start": 3.0, "coulomb": 0.01})
    found, _ = hidden((point.with_effect(known), problem, unknowns), KEY, 1.0, None)
    score = score_candidates(found, [second], list(signatures(found, [second]).values()))[0]
    begun = sync_onset(found, score).candidate
    assert second.effect.start is None and begun.effect.start == 3.0
    assert begun.holds(replace(first, effect=known))


def test_of_a_strong_one_what_is_there_all_the_time_is_fitted_too(fitted):
    """A thousandth of a large ratio may make up a beginning: linear scores are not believed that far."""
    for size, strong in ((15.0, False), (60.0, True)):
        found, scores = hidden(fitted, KEY, size, 3.3)
        own = next(s for s in scores if s.candidate.key == KEY)
        begun = with_onset(found, own, ALIAS)
        assert begun.candidate.effect.start is not None
        assert begun.another is (own if strong else None)


@pytest.mark.parametrize("start", [2.34, 5.02])
def test_a_sensor_that_jumps_is_found_at_the_very_sample(fitted, start):
    """All that shows of it is one sample, which no grid of beginnings has."""
    key = ("sensor_bias", "encoder.joint_position[joint2]", "bias")
    found, scores = hidden(fitted, key, 60.0, start)
    assert key in {s.candidate.key for s in best_onsets(found, scores, 3)}
    own = next(s for s in scores if s.candidate.key == key)
    begun = with_onset(found, own, ALIAS).candidate.effect.start
    samples = found.run.states.time[found.run.used.any(axis=1)]
    assert np.searchsorted(samples, begun) == np.searchsorted(samples, start)
    assert largest_innovation_time(found.run) == pytest.approx(start, abs=0.021), (
        "the sample, or the one it is first seen in"
    )


def test_a_scan_of_all_beginnings_gives_what_each_gives_by_itself(fitted):
    """Of candidates with one parameter and with several, at samples and between them."""
    found, scores = hidden(fitted, KEY, 60.0, 3.3)
    some = [s for s in scores if s.candidate.kind in ("torque_gain", "sensor_bias", "external_wrench")]
    some += [s for s in scores if s.candidate.shape in ("coulomb", "by direction", "stribeck")]
    scan, when = scan_onsets(found, some), np.empty(2 * len(found.run.states.time) - 1)
    when[::2], when[1::2] = found.run.states.time, found.run.middle.time
    assert {len(x.changes) for x in scan.values()} > {1, 2}
    compared = 0
    for own in scan.values():
        for at in (1, 40, 101, 330, len(when) - 3):
            start = float(when[at])
            begun = replace(own.candidate, effect=own.candidate.effect.model_copy(update={"start": start}))
            exact = cut_score(found, begun, own.changes, start).ratio
            if exact > 0.0:  # else it would go beyond its bounds
                assert own.ratios[at] == pytest.approx(exact, rel=1e-6)
                compared += 1
    assert compared > 60


def test_what_only_its_onset_shows_is_among_those_that_begin(fitted):
    found, scores = hidden(fitted, KEY, 60.0, 3.3)
    assert KEY in {s.candidate.key for s in best_onsets(found, scores, 3)}


def test_an_onset_that_does_not_pay_is_dropped(fitted):
    found, scores = hidden(fitted, KEY, 60.0, None)
    own = next(s for s in scores if s.candidate.key == KEY)
    late = replace(own.candidate, effect=own.candidate.effect.model_copy(update={"start": 0.5}))
    point = found.point.with_effect(late.effect)
    with_it = evaluate(point, found.unknowns, found.problem)
    (score,), fit = always_together(with_it, [replace(own, candidate=late)], ALIAS)
    assert score.candidate.effect.start is None
    assert fit.point.description.get_effect(late.effect.name).start is None


def test_two_onsets_that_hold_each_other_up_are_dropped_together(fitted, monkeypatch):
    """Each alone pays, as long as the other is there; both together do not."""
    found, scores = hidden(fitted, KEY, 60.0, None)
    late, point = [], found.point
    for key in (KEY, ("joint_friction", "joint2", "viscous")):
        own = next(s for s in scores if s.candidate.key == key)
        effect = own.candidate.effect.model_copy(update={"start": 0.5})
        late.append(replace(own, candidate=replace(own.candidate, effect=effect)))
        point = point.with_effect(effect)
    with_them = evaluate(point, found.unknowns, found.problem)
    names = {s.candidate.effect.name for s in late}

    def none_late(point):
        return all(e.start is None for e in point.description.effect if e.name in names)

    def evaluated(point, unknowns, problem):
        here = evaluate(point, unknowns, problem)
        return here if none_late(point) else replace(here, objective=here.objective + 1e4)

    monkeypatch.setattr(onset, "evaluate", evaluated)
    (alone,), kept = always_together(with_them, late[:1], ALIAS)
    assert alone is late[0] and kept is with_them
    causes = [Cause(s, (), 100.0) for s in late]
    kept_causes, _ = drop_onset(causes, with_them, DetectionThresholds())
    assert all(c.score.candidate.effect.start is None for c in kept_causes)
    both, dropped = always_together(with_them, late, ALIAS)
    assert all(s.candidate.effect.start is None and s.candidate.grid == 1 for s in both)
    assert none_late(dropped.point)


def test_an_onset_that_pays_stays_beside_one_that_does_not(monkeypatch):
    """Together they would be dropped for less than two onsets cost."""

    def stand_in(start):
        own = SimpleNamespace(key=("effect", start), effect=SimpleNamespace(start=start), start=start)
        return Cause(SimpleNamespace(candidate=own), (), 100.0)

    def drop(found, scores, alias):
        (score,) = scores  # one is left then: there is nothing to drop together
        return (scores, found) if score.candidate.start == 5.0 else ([stand_in(None).score], "without")

    monkeypatch.setattr("smsid.diagnose._change_point.always_together", drop)
    causes, found = drop_onset([stand_in(5.0), stand_in(9.0)], "with", DetectionThresholds())
    assert [c.score.candidate.effect.start for c in causes] == [5.0, None] and found == "without"


def test_one_start_is_paid_for_once(fitted, monkeypatch):
    """Two causes of one effect have one start: together, they are no dearer than each of them."""
    found, scores = hidden(fitted, KEY, 60.0, None)
    shapes = [next(s for s in scores if s.candidate.key[1:] == ("joint2", x)) for x in ("viscous", "coulomb")]
    effect = shapes[0].candidate.effect.model_copy(update={"start": 0.5})
    late = [replace(s, candidate=replace(s.candidate, effect=effect)) for s in shapes]
    with_it = evaluate(found.point.with_effect(effect), found.unknowns, found.problem)

    def dearer(point, unknowns, problem):  # without the start, by more than one costs and less than two
        return replace(with_it, point=point, objective=with_it.objective + 0.75 * onset_penalty(ALIAS))

    monkeypatch.setattr(onset, "evaluate", dearer)
    monkeypatch.setattr(onset, "within_reach", lambda found: found.objective)
    monkeypatch.setattr(onset, "continue_fit", lambda found, **_: found)
    kept, same = always_together(with_it, late, ALIAS)
    assert kept == late and same is with_it


@pytest.mark.parametrize("begin", [3.3, 4.42, 4.55])  # the last two closer than the coarser grids
def test_a_fitted_effect_moves_to_where_it_begins(fitted, begin):
    point, problem, unknowns = fitted
    own = next(c for c in propose(point, problem, unknowns) if c.key == KEY)
    late = own.effect.model_copy(update={"start": 4.5, "error": 0.02})
    found = evaluate(point.with_effect(late), (*unknowns, *own.unknowns(unknowns)), problem)
    true = late.model_copy(update={"start": begin})
    moved = propagate(found.run, [found.changes.effect(late, true, 1.0)])[:, :, 0]
    noise = np.random.default_rng(7).standard_normal(moved.shape) * found.run.used
    for size, expected in ((0.0, 4.5), (1.0, begin)):
        there = replace(found, run=replace(found.run, innovations=noise + size * moved))
        start, gained = moved_start(there, late)
        assert (gained > 50.0) == bool(size)
        assert gained < 9.0 or start == pytest.approx(expected, abs=0.05)


def test_a_beginning_is_the_start_of_a_step(fitted):
    """It stays what it is where steps become shorter; a sample away it is another."""
    point, problem, unknowns = fitted
    found = evaluate(point, unknowns, problem)
    times = found.run.states.time
    step = (times[1] - times[0]) / found.changes.applied.means.shape[1]
    for time in (times[7], times[7] + 0.3 * step, times[7] + step):
        start = step_from(found, time)
        assert time - 1e-9 <= start < time + step
        assert (start - times[7]) / step == pytest.approx(round((start - times[7]) / step), abs=1e-9)
        assert step_from(found, start) == pytest.approx(start, abs=1e-12)
