"""Which of an estimate's values a description takes."""

from __future__ import annotations

import numpy as np
import pytest

from smsid.description import load_description
from smsid.export import with_estimate
from smsid.identify.estimate import Estimate, classify

from .machines import URDF


def estimate(**values):
    """name -> (value, sigma), with underscores doubled for dots."""
    parameters = [classify(n.replace("__", "."), x, "1", s, "exp1") for n, (x, s) in values.items()]
    return Estimate("paper_sms", "test", tuple(parameters))


def taken(**values):
    found, notes = with_estimate(load_description(URDF / "paper_sms.toml"), estimate(**values))
    return {p.name: p.value for e in found.effect for p in e.parameters()}, notes


def test_identified_values_and_modes_are_taken():
    got, notes = taken(
        tank__mass=(48.0, 0.2), tank__stiffness__y=(0.43, 0.01), panel__mode2__frequency=(0.28, 1e-4),
        panel__mode2__damping=(0.006, 1e-4), panel__linear_density=(16.0, 0.1),
    )  # fmt: skip
    assert not notes
    assert got["tank.mass"] == 48.0 and got["tank.stiffness.y"] == 0.43 and got["tank.stiffness.x"] == 0.41
    assert got["panel.mode2.frequency"] == 0.28 and got["panel.mode2.damping"] == 0.006
    assert got["panel.mode1.frequency"] == pytest.approx(0.0457, rel=1e-3)
    assert got["panel.mass"] == pytest.approx(16.0 * 6.0)


def test_what_is_not_identifiable_stays_unless_it_differs():
    got, notes = taken(tank__damping__x=(0.04, 0.03), tank__damping__y=(0.2, 0.05))
    assert got["tank.damping.x"] == 0.02 and got["tank.damping.y"] == 0.2
    assert notes == ["tank.damping.x is not identifiable and stays as described"]


def test_what_cannot_be_told_stays():
    got, notes = taken(tank__mass=(np.nan, np.nan))
    assert got["tank.mass"] == 49.6 and len(notes) == 1


def test_a_value_beyond_its_bound_goes_to_the_bound():
    got, notes = taken(tank__damping__x=(-0.1, 0.001))
    assert got["tank.damping.x"] == 0.0 and "beyond its bound" in notes[0]
