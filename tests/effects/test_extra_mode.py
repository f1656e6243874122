"""One more mode beside an appendage, against the appendage that has it among its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from smsid.description import load_description
from smsid.effects import ExtraMode, ModalAppendage, Mode
from smsid.model import build_model

LOW = Mode(frequency=0.2, damping=0.01, translation=(0.0, 0.3, 2.0), rotation=(0.0, -6.0, 0.9))
MASS, PLACE, ALONG = 1.7, np.array([2.5, 0.4, 0.0]), np.array([0.6, 0.0, 0.8])
HIGH = Mode(
    frequency=0.9,
    damping=0.02,
    translation=tuple(np.sqrt(MASS) * ALONG),
    rotation=tuple(np.cross(PLACE, np.sqrt(MASS) * ALONG)),
)


def sail(*modes: Mode) -> ModalAppendage:
    return ModalAppendage(
        name="sail", position=(-1.5, 0.2, 0.1), rpy=(0.1, 0.2, 3.0), mass=30.0, center_of_mass=(2, 0, 0),
        inertia=(9.0, 0.0, 160.0, 0.0, 0.0, 165.0), mode=modes,
    )  # fmt: skip


def test_it_is_the_appendage_with_one_mode_more(urdf: Path) -> None:
    description = load_description(urdf / "paper_sms.toml")
    extra = ExtraMode(
        name="x", appendage="sail", mass=MASS, position=tuple(PLACE), direction=tuple(3.0 * ALONG),
        frequency=0.9, damping=0.02,
    )  # fmt: skip
    whole = build_model(description.with_effects(sail(LOW, HIGH)))
    apart = build_model(description.with_effects(sail(LOW), extra))
    # the own mode's mass may sit elsewhere along its direction: same linear motion, so deflections stay small
    rng = np.random.default_rng(0)
    for _ in range(5):
        v, tau = rng.normal(size=(2, whole.nv))
        v[:6] = 0.0
        found = apart.acceleration(0.0, apart.home, v, tau)
        np.testing.assert_allclose(found, whole.acceleration(0.0, whole.home, v, tau), rtol=1e-9, atol=1e-9)


def test_the_slope_by_its_mass_at_zero(urdf: Path) -> None:
    """Accelerations of the bus change linearly with a small mass that is pulled along by a soft spring."""
    description = load_description(urdf / "paper_sms.toml")
    plain = build_model(description)
    push = np.zeros(plain.nv)
    push[:3] = [5.0, 20.0, 40.0]
    rest, slopes = plain.acceleration(0.0, plain.home, np.zeros(plain.nv), push), []
    for mass in (1e-3, 1e-4):
        extra = ExtraMode(name="x", appendage="panel", mass=mass, position=(3.0, 1.0, 0.0), frequency=0.1)
        model = build_model(description.with_effects(extra))
        a = model.acceleration(0.0, model.home, np.zeros(model.nv), np.append(push, 0.0))
        slopes.append((a[: plain.nv] - rest) / mass)
    assert np.abs(slopes[1]).max() > 1e-6
    np.testing.assert_allclose(slopes[0], slopes[1], atol=1e-3 * np.abs(slopes[1]).max())


def test_it_moves_somewhere() -> None:
    with pytest.raises(ValidationError, match="`direction` must not be zero"):
        ExtraMode(name="x", appendage="p", position=(0, 0, 0), direction=(0, 0, 0), frequency=1.0)
