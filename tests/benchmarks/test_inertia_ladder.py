"""A draw of the ladder of which a Gaussian once said too much."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
NAME = "sines in three phases 0.2 Hz"


def test_where_the_likelihood_falls_slowly_an_interval_is_that_of_its_profile(monkeypatch):
    """Momentum of wheels in one plane leaves one combination to what turns by chance: the curvature at the
    maximum is four times what the likelihood falls by on the way to the truth.
    """
    monkeypatch.setattr(sys, "path", [str(BENCHMARKS), *sys.path])
    import inertia_ladder as ladder

    torque = ladder.profiles()[NAME]
    row = ladder.row_of("wheels", NAME, torque, ladder.flown("wheels", torque), np.eye(6), seed=33)
    assert not row["missing"] and len(row["not_identifiable"]) == 6
    assert max(np.abs(row["off"])) < 1.96
