"""Stand-ins for what a search handles: problems, candidates, scores, and a state of it."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from smsid.diagnose import _candidate_scores as candidate_scores
from smsid.diagnose import _forward_step as rounds
from smsid.diagnose._forward_step import SearchState
from smsid.diagnose._noise_covariance import InflatedFit
from smsid.diagnose.model_comparison import Cause
from smsid.diagnose.score_test import Score
from smsid.diagnose.thresholds import DetectionThresholds

FOUND, OTHER, VAIN = (("effect", place, "shape") for place in ("found", "other", "vain"))


@dataclass(frozen=True)
class Whole:
    """A problem as far as it is put together again."""

    data: SimpleNamespace
    noise: str
    coloured: bool = False
    substep: float = 0.1


def candidate(key, family="friction"):
    return SimpleNamespace(
        key=key,
        location=key[1],
        family=family,
        effect=None,
        beside=None,
        simpler=(),
        free=(f"{key[1]}.size",),
        also=(),
        parameters={f"{key[1]}.size"},
        holds=lambda other: False,
    )


def score_of(candidate):
    return Score(candidate, 30.0, 1, np.zeros(1), np.eye(1), 1.0, np.zeros((1, 1)), np.zeros((1, 1)))


class Stub(SimpleNamespace):
    """A score of a candidate in a fit."""

    def odds(self, samples):
        return self.ratio

    information_gain = odds


@pytest.fixture
def world(monkeypatch):
    """A state whose fit counts misfit until a cause is taken in, and what was asked for meanwhile.

    Signatures carry the name of the fit that they were taken at; the candidate ``vain`` is no cause.
    """
    asked = SimpleNamespace(scored=[], recompute_evidence=[], stepped=[], finer=True, accepted=[])

    def at(name, objective=0.0):
        changes = SimpleNamespace(by_candidate={})
        point = SimpleNamespace(description=SimpleNamespace(effect=()))
        run = SimpleNamespace(samples=100)
        told = {"problem": None, "run": run, "changes": changes, "point": point}
        return SimpleNamespace(name=name, objective=objective, **told)

    monkeypatch.setattr(rounds, "fit_from_nominal", lambda found, causes: found)  # all are at rest
    monkeypatch.setattr(rounds, "open_joints", lambda found: {})

    def signatures(fit, candidates):
        return {i: fit.name for i in range(len(candidates))}

    def scored(fit, candidates, columns, *, coarsely=False):
        asked.scored.append(
            (fit.name, {c.key: column for c, column in zip(candidates, columns, strict=True)})
        )
        order = {VAIN: 3.0, FOUND: 2.0, OTHER: 1.0}
        return [
            Stub(
                candidate=c,
                ratio=20.0 * order[c.key],
                freedom=1,
                p_value=asked.chances.get(c.key, 1e-12),
                excited=asked.excited,
                another=None,
                columns=asked.takes.get(c.key, order[c.key]),
                estimate=None,
            )
            for c in candidates
        ]

    def accept(current, best, rivals, levels, tried, has_room, **worth):
        key = best.candidate.key
        asked.accepted.append(key)
        asked.has_room = has_room
        if key == VAIN:
            return None, asked.instead or current
        return Cause(best, (), 30.0), at(f"with {key[1]}")

    def recompute_evidence(causes, last, nominal):
        asked.recompute_evidence.append(last.name)
        return [replace(c, ratio=1e6) for c in causes]

    def refitted(fitted, *, strong=False, told=None):
        return replace(fitted, misfit=fitted.misfit and not asked.finer)

    def finely(fit):
        asked.stepped.append(fit.name)
        return fit

    asked.same = lambda one, other: False
    asked.instead, asked.takes, asked.chances, asked.excited, asked.moved = None, {}, {}, 0.5, 1.0
    monkeypatch.setattr(InflatedFit, "explained", lambda fitted, columns, estimate: columns)
    for name, stub in {
        "accept": accept,
        "recompute_evidence": recompute_evidence,
        "refit_noise": refitted,
        "refine_steps": finely,
        "normalised_rmse": lambda *_: 1.0,
        "memory": lambda *_: (),
        "best_onsets": lambda *_: [],
        "refine_onset": lambda fit, score: (score, fit),
        "scan_onsets": lambda *_: {},
        "with_onset": lambda fit, score, alias, onsets: score,
        "drop_onset": lambda causes, fit, levels: (list(causes), fit),
        "with_further": lambda *_: None,
        "merge_step": lambda causes, fit, *_: (list(causes), fit),
        "is_same_error": lambda one, other: asked.same(one.candidate, other.candidate),
    }.items():
        monkeypatch.setattr(rounds, name, stub)
    for name, stub in {
        "signatures": signatures,
        "score_candidates": scored,
        "in_one_recording": lambda fit, scores, *_: scores,
        "squared_distance": lambda *_: asked.moved,
    }.items():
        monkeypatch.setattr(candidate_scores, name, stub)
    fitted = InflatedFit(at("nominal"), np.ones(1), misfit=True)
    asked.at = at
    return SearchState(fitted, [candidate(k) for k in (FOUND, OTHER, VAIN)], DetectionThresholds()), asked
