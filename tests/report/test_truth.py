"""True values of combinations, and the bundled craft's own."""

from __future__ import annotations

import numpy as np

from smsid.cli.demo import identify_craft
from smsid.datasets import demonstration
from smsid.identify.estimate import classify
from smsid.identify.estimate_text import asked_for
from smsid.report.demo import TrueWorld, described_bodies


def test_a_combination_is_taken_apart_whatever_else_has_its_name():
    name = "link1.mx + 2 link2.m"
    world = TrueWorld(
        {"link1.mx": 1.0, "link2.m": 6.0}, {"link1.mx": 0.5, "link2.m": 5.0}, {"tank.mass": 3.0}
    )
    first, second = (classify(name, 0.0, "kg m", 1.0, "a", nominal=x) for x in (10.5, 20.5))
    assert world.value(first) == 13.0  # 2.5 more than described
    assert world.value(second) == 23.0  # of another thing of that name
    assert world.value(classify("tank.mass", 0.0, "kg", 1.0, "a")) == 3.0
    assert world.value(classify("link3.m", 0.0, "kg", 1.0, "a", nominal=1.0)) is None


def test_nothing_is_said_of_a_body_whose_appendages_differ():
    world = TrueWorld({"bus.m": 2.0}, {"bus.m": 1.0}, unsaid=("bus",))
    assert world.value(classify("bus.m", 0.0, "kg", 1.0, "a", nominal=1.0)) is None


def test_the_bundled_craft_is_identified_from_its_wrong_guess():
    """MuJoCo's numbers, read from a file that identification never sees."""
    which = demonstration()
    description, _, _, refinement, _ = identify_craft(which)
    bodies = described_bodies(description)
    world = TrueWorld(
        which.parameters, bodies, {k: v for k, v in which.parameters.items() if k not in bodies}
    )
    own = [p for p in asked_for(refinement.estimate) if p.status == "identifiable"]
    truth = world.values_of(own)
    assert len(own) == len(truth) > 20
    off = np.array([(p.value - truth[p.name]) / p.sigma for p in own])
    assert np.abs(off).max() < 3.5 and 0.4 < np.sqrt(np.mean(off**2)) < 1.4
    guess = np.array([(p.nominal - truth[p.name]) / p.sigma for p in own])
    assert np.sqrt(np.mean(guess**2)) > 10.0  # the guess was wrong
