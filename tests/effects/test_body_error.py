"""A body that is denser than described: all of it, and nothing that other effects hang on it."""

from __future__ import annotations

from pathlib import Path

import pytest

from smsid.description import load_description
from smsid.effects import BodyError, Payload
from smsid.model import build_model

URDF = Path(__file__).resolve().parents[2] / "urdf"
PAPER = load_description(URDF / "paper_sms.toml")


def bus(*effects, last=()):
    """Inertial parameters (10,) of the bus with the paper's effects and others before or after them."""
    there = PAPER.model_copy(update={"effect": (*effects, *PAPER.effect, *last)})
    return build_model(there).pin.inertias[1].toDynamicParameters()


def alone():
    """The same of the bus with its wheels alone."""
    return build_model(PAPER.model_copy(update={"effect": ()})).pin.inertias[1].toDynamicParameters()


@pytest.mark.parametrize("density", [-0.2, 0.3])
def test_density_is_of_the_body_alone_wherever_its_effect_stands(density):
    denser = BodyError(name="denser", density=density)
    grasped = Payload(name="grasped", mass=3.0, com=(0.4, -0.2, 0.1))
    want = bus(grasped) + density * alone()
    assert bus(denser, grasped) == pytest.approx(want)
    assert bus(grasped, last=(denser,)) == pytest.approx(want)
    assert bus()[4:] != pytest.approx(alone()[4:]), "the paper's panels hang on its bus"
