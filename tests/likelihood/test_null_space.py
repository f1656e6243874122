"""Directions called unseen leave the prediction as it is; what they leave out does not."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.likelihood import Refinement, refine
from smsid.likelihood._null_space import UnseenDirection

from . import twin


@pytest.fixture(scope="module")
def short() -> Refinement:
    """Ten seconds of free floating: enough to see what moves."""
    return refine(twin.description(), [twin.noisy(twin.exp2(10.0), 0)])


def moved_by(found: Refinement, direction: UnseenDirection, size: float) -> float:
    """Sum of squares that a change along a direction makes, ``size`` of a body's size at most."""
    at = found.fit.point.parameters
    step = np.zeros(at.size)
    slopes = np.concatenate([at.sizes.ravel(), [s.slope for s in at.scalars]])
    for name, change in direction.changes.items():
        i = at.names.index(name)
        step[i] = change / slopes[i]
    step *= size / np.abs(step).max()
    piece, local = found.fit.pieces[0], found.fit.point.locals[0]
    pair = [piece.residuals(p, local, piece.predict(p, local)) for p in (at, at.moved(step))]
    changed = [b - a for a, b in zip(*pair, strict=True)]
    return piece.cost(changed)


def test_inertias_that_only_act_together(short: Refinement):
    several = [d for d in short.unseen if len(d.changes) > 1]
    names = [set(d.changes) for d in several]
    # links 1 and 2 share an axis direction: their moments about it show as one
    assert any({"link2.m"} <= n for n in names)
    for d in several:
        if all("." in n and n.split(".")[0] in short.inertias for n in d.changes):
            assert moved_by(short, d, 0.1) < 1.0, d.text
            if len(d.changes) <= 4:
                # without its smallest member the direction is seen
                *kept, _ = sorted(d.changes, key=lambda n: -abs(d.changes[n]))
                broken = UnseenDirection({n: d.changes[n] for n in kept}, d.units)
                assert moved_by(short, broken, 0.1) > 1e3, d.text


def test_notes_say_it_in_words(short: Refinement):
    note = next(n for n in short.estimate.notes if n.startswith("only in combination: link"))
    assert "kg" in note
    assert "leaves what was measured as it was" in note


def test_an_axis_without_thrust():
    found = refine(twin.description(), [twin.noisy(twin.exp1((1, 0, 0), 30.0), 0)])
    alone = {next(iter(d.changes)) for d in found.unseen if len(d.changes) == 1}
    assert {"tank.stiffness.y", "tank.stiffness.z", "bus.Ixx", "link2.mx"} <= alone
    assert "tank.stiffness.x" not in alone
    assert "tank.mass" not in alone
    masses = [d for d in found.unseen if set(d.changes) == {"link1.m", "bus.m"}]
    assert len(masses) == 1
    assert masses[0].changes["bus.m"] / masses[0].changes["link1.m"] == pytest.approx(-1.0, abs=1e-3)
